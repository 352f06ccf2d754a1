"""`effects`: the library of effects, as a list or as the whole card of one."""

import math
from dataclasses import dataclass

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.effects import Effect, Parameter
from automarine_cli.effects.base import EVEN, MIXED, ODD, ParameterCard
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.words import listed
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
        """The cards (schema automarine/effects/1); infinity, which JSON has no word for, is null."""
        return {
            "schema": SCHEMA,
            **({} if self.dof.wraps else {"motion": self.dof.name}),
            "effects": [_card_json(effect, self.dof) for effect in self.cards],
        }

    def tables(self) -> tuple[Table | str, ...]:
        """The list of all, or sentences and the parameters of one."""
        return _card(self.cards[0], self.dof, self.every) if self.whole else (_list(self.cards, self.dof),)


def effects(name: str | None = None, motion: str | None = None) -> EffectCards:
    """All effects that may act in a motion, or the one of that name; without a motion the whole library, told of yaw.

    Raises ModelError for a name that is not in the library, SettingError for a motion that is none of ours or one in
    which the effect does not act.
    """
    if motion is not None and motion not in DOFS:
        raise SettingError(f"motion {motion!r} is not known; known are {', '.join(DOFS)}")
    dof = YAW if motion is None else DOFS[motion]
    cards = tuple(library.get(one) for one in (library.names() if name is None else (name,)))
    own = tuple(one for one in cards if motion is None or one.acts_in(dof))
    if not own:
        where = cards[0].motions
        raise SettingError(f"{name} does not act in {motion}; it acts in {listed(where)}: give --motion {where[0]}")
    return EffectCards(own, name is not None, dof, motion is None)


def _list(cards: tuple[Effect, ...], dof: Dof) -> Table:
    rows = tuple((one.name, _place(one, dof), one.card(dof).equation, ", ".join(one.names_in(dof))) for one in cards)
    note = "automarine effects NAME prints the whole card of one."
    return Table("Library of effects", ("name", "place", "equation", "parameters"), rows, notes=(note,))


def _place(one: Effect, dof: Dof) -> str:
    """Where it acts, in a word: the first of ACTS_ON."""
    return dof.fill(ACTS_ON[one.place.value]).partition(":")[0]


def _card(one: Effect, dof: Dof, every: bool) -> tuple[Table | str, ...]:
    card, motions = one.card(dof), one.motions
    lines = [
        ("equation", card.equation),
        ("acts on", dof.fill(ACTS_ON[one.place.value])),
        *([("only in", " and ".join(motions))] if every and len(motions) < len(DOFS) else []),
        ("states", ", ".join(one.states) or "none of its own"),
        ("columns needed", ", ".join(one.columns) or f"none beyond time, {dof.words.position} and command"),
        ("verdict", card.says),
        ("revealed by", card.reveals),
        ("mistaken for", ", ".join(one.mistaken_for)),
        ("told apart by", card.separated_by),
        ("parity", MIRRORED[one.parity]),
        ("source", one.source),
    ]
    width = max(len(label) for label, _ in lines)
    sentences = "\n".join((one.name, "", *(f"{label.ljust(width)}  {text}" for label, text in lines)))
    choices = next((p.choices for p in one.parameters if p.choices), ())
    for word, law, equation in zip(choices[1:], one.laws, card.laws):
        sentences += f"\n\nlaw: {word}\n  {equation}\n  mistaken for {', '.join(law.mistaken_for)}; {law.source}"
    rows = tuple(_parameter_row(*three, dof) for three in zip(card.parameters, one.parameters, one.shapes))
    header = ("symbol", "meaning", "unit", "bounds", "start", "off", "reference or choices")
    note = f"Starts are for a largest {dof.words.force} of one. A parameter with a reference is taken from the logs, "
    note += "not fitted; one with choices is 0 for the first and so on, and a diagnosis tries each."
    return (sentences, Table("Parameters", header, rows, notes=(note,)))


def _parameter_row(card: ParameterCard, parameter: Parameter, shape: bool, dof: Dof) -> tuple[str, ...]:
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


def _card_json(one: Effect, dof: Dof) -> dict[str, object]:
    card = one.card(dof)
    return {
        "name": one.name,
        "place": one.place.value,
        "motions": list(one.motions),
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
            for filled, p, shape in zip(card.parameters, one.parameters, one.shapes)
        ],
        "laws": [
            {"equation": equation, "source": law.source, "mistaken_for": list(law.mistaken_for)}
            for law, equation in zip(one.laws, card.laws)
        ],
        "states": list(one.states),
        "columns_needed": list(one.columns),
        "says": card.says,
        "reveals": card.reveals,
        "mistaken_for": list(one.mistaken_for),
        "separated_by": card.separated_by,
        "parity": one.parity,
        "source": one.source,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
