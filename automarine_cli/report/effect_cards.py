"""Cards of effects: the library as a list, or the whole card of one."""

import math
from dataclasses import dataclass

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.effects import Effect, Parameter
from automarine_cli.effects.base import EVEN, MIXED, ODD
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table, number

SCHEMA = "automarine/effects/1"

ACTS_ON = {
    "actuator": "actuator: the {force} delivered for the {force} commanded",
    "moment": "{force}: one more {force} on the vehicle",
    "water": "water: the water that the drag acts through",
    "sensor": "sensor: the {position} that is read for the true one",
}
MIRRORED = {
    EVEN: "even: a mirrored campaign has the same parameters",
    ODD: "odd: a mirrored campaign has all parameters negated",
    MIXED: "mixed: a mirrored campaign has some parameters negated",
}
FITTED_AGAINST = {
    "moment": "the largest {force} of the logs",
    "clock": "the logs' first instant",
    "voltage": "the logs' mean voltage",
}


@dataclass(frozen=True)
class EffectCards:
    """Cards of effects in a motion; `whole` where one was asked for by name, `every` where no motion was."""

    cards: tuple[Effect, ...]
    whole: bool
    dof: Dof
    every: bool

    def to_json(self) -> dict[str, object]:
        """Return the cards (schema automarine/effects/1); infinity, which JSON has no word for, is null."""
        return {
            "schema": SCHEMA,
            **({} if self.dof.wraps else {"motion": self.dof.name}),
            "effects": [_card_json(effect, self.dof) for effect in self.cards],
        }


@sections.register
def _(result: EffectCards) -> Sections:
    if result.whole:
        return Sections(_card(result.cards[0], result.dof, result.every))
    return Sections([_list(result.cards, result.dof)])


def _list(cards: tuple[Effect, ...], dof: Dof) -> Table:
    rows = tuple(
        (effect.name, dof.fill(ACTS_ON[effect.place.value]).partition(":")[0], effect.card(dof).equation,
         ", ".join(effect.names_in(dof)))
        for effect in cards
    )  # fmt: skip
    note = "automarine effects NAME prints the whole card of one."
    return Table("Library of effects", ("name", "place", "equation", "parameters"), rows, notes=(note,))


def _card(effect: Effect, dof: Dof, every: bool) -> tuple[Table | str, ...]:
    card, motions = effect.card(dof), effect.motions
    lines = [
        ("equation", card.equation),
        ("acts on", dof.fill(ACTS_ON[effect.place.value])),
        *([("only in", " and ".join(motions))] if every and len(motions) < len(DOFS) else []),
        ("states", ", ".join(effect.states) or "none of its own"),
        ("columns needed", ", ".join(effect.columns) or f"none beyond time, {dof.words.position} and command"),
        ("verdict", card.says),
        ("revealed by", card.reveals),
        ("mistaken for", ", ".join(effect.mistaken_for)),
        ("told apart by", card.separated_by),
        ("parity", MIRRORED[effect.parity]),
        ("source", effect.source),
    ]
    width = max(len(label) for label, _ in lines)
    sentences = "\n".join((effect.name, "", *(f"{label.ljust(width)}  {text}" for label, text in lines)))
    choices = next((p.choices for p in effect.parameters if p.choices), ())
    for word, law, equation in zip(choices[1:], effect.laws, card.laws):
        sentences += f"\n\nlaw: {word}\n  {equation}\n  mistaken for {', '.join(law.mistaken_for)}; {law.source}"
    rows = tuple(_parameter_row(*three, dof) for three in zip(card.parameters, effect.parameters, effect.shapes))
    header = ("symbol", "meaning", "unit", "bounds", "start", "off", "reference or choices")
    note = f"Starts are for a largest {dof.words.force} of one. A parameter with a reference is taken from the logs, "
    note += "not fitted; one with choices is 0 for the first and so on, and a diagnosis tries each."
    return (sentences, Table("Parameters", header, rows, notes=(note,)))


def _parameter_row(card: Parameter, parameter: Parameter, shape: bool, dof: Dof) -> tuple[str, ...]:
    return (
        card.name,
        card.meaning,
        card.unit,
        f"{_bound(parameter.lower)} to {_bound(parameter.upper)}",
        number(parameter.start),
        "any" if shape else _bound(parameter.off),
        " or ".join(parameter.choices) or dof.fill(FITTED_AGAINST.get(parameter.reference, "")),
    )


def _bound(value: float) -> str:
    return number(value) if math.isfinite(value) else "∞" if value > 0 else "-∞"


def _card_json(effect: Effect, dof: Dof) -> dict[str, object]:
    card = effect.card(dof)
    return {
        "name": effect.name,
        "place": effect.place.value,
        "motions": list(effect.motions),
        "equation": card.equation,
        "parameters": [
            {
                "name": filled.name,
                "meaning": filled.meaning,
                "unit": filled.unit,
                "lower": _finite(p.lower),
                "upper": _finite(p.upper),
                "start": p.start,
                "off": None if shape else _finite(p.off),
                "any_when_off": shape,
                "reference": p.reference or None,
                "choices": list(p.choices),
            }
            for filled, p, shape in zip(card.parameters, effect.parameters, effect.shapes)
        ],
        "laws": [
            {"equation": equation, "source": law.source, "mistaken_for": list(law.mistaken_for)}
            for law, equation in zip(effect.laws, card.laws)
        ],
        "states": list(effect.states),
        "columns_needed": list(effect.columns),
        "says": card.says,
        "reveals": card.reveals,
        "mistaken_for": list(effect.mistaken_for),
        "separated_by": card.separated_by,
        "parity": effect.parity,
        "source": effect.source,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
