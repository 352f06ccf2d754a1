"""Cards of effects: the library as a list, or the whole card of one."""

from dataclasses import dataclass

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.effects import Effect
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table, number

ACTS_ON = {
    "actuator": "actuator: the {force} delivered for the {force} commanded",
    "moment": "{force}: one more {force} on the vehicle",
    "water": "water: the water that the drag acts through",
    "sensor": "sensor: the {position} that is read for the true one",
}
FITTED_AGAINST = {
    "moment": "the largest {force} of the logs",
    "clock": "the logs' first instant",
    "voltage": "the logs' mean voltage",
    "surge": "the logs' mean speed ahead or astern",
}


@dataclass(frozen=True)
class EffectCards:
    """Cards of effects in a motion; `in_full` where one was asked for by name, `every` where no motion was."""

    cards: tuple[Effect, ...]
    in_full: bool
    dof: Dof
    every: bool

    def dof_of(self, effect: Effect) -> Dof:
        """The motion in whose letters a card is: the one asked for, or the first in which the effect acts."""
        return self.dof if effect.acts_in(self.dof) or not self.every else DOFS[effect.motions[0]]

    def to_json(self) -> dict[str, object]:
        """Return the cards (schema automarine/effects/1); infinity, which JSON has no word for, is null."""
        return {
            "schema": "automarine/effects/1",
            **({} if self.dof.wraps else {"motion": self.dof.name}),
            "effects": [_card_json(effect, self.dof_of(effect)) for effect in self.cards],
        }


@sections.register
def _(result: EffectCards) -> Sections:
    if result.in_full:
        return _card(result.cards[0], result.dof_of(result.cards[0]), result.every)
    rows = [
        {"name": effect.name, "place": dof.fill(ACTS_ON[effect.place.value]).partition(":")[0],
         "equation": effect.card(dof).equation, "parameters": ", ".join(effect.names_in(dof))}
        for effect, dof in ((effect, result.dof_of(effect)) for effect in result.cards)
    ]  # fmt: skip
    return Sections([Table.of("Library of effects", rows)], answer=f"The library has {len(rows)} effects.")


def _card(effect: Effect, dof: Dof, every: bool) -> Sections:
    card, motions = effect.card(dof), effect.motions
    lines = {
        "equation": card.equation,
        "acts on": dof.fill(ACTS_ON[effect.place.value]),
        "only in": " and ".join(motions) if every and len(motions) < len(DOFS) else "",
        "states": ", ".join(effect.states) or "none of its own",
        "columns needed": ", ".join(effect.columns) or f"none beyond time, {dof.words.position} and command",
        "revealed by": card.reveals,
        "mistaken for": ", ".join(effect.mistaken_for),
        "told apart by": card.separated_by,
        "source": effect.source,
    }
    texts = [f"{label:<14}  {text}" for label, text in lines.items() if text or label != "only in"]
    sentences = "\n".join(("", *texts))
    choices = next((p.choices for p in effect.parameters if p.choices), ())
    for word, law, equation in zip(choices[1:], effect.laws, card.laws):
        sentences += f"\n\nlaw: {word}\n  {equation}\n  mistaken for {', '.join(law.mistaken_for)}; {law.source}"
    rows = [
        {
            "symbol": p.name, "meaning": p.meaning, "unit": p.unit, "bounds": f"{number(p.lower)} to {number(p.upper)}",
            "start": number(p.start), "off": "any" if shape else number(p.off),
            "reference or choices": " or ".join(p.choices) or dof.fill(FITTED_AGAINST.get(p.reference, "")),
        }
        for p, shape in zip(card.parameters, effect.shapes)
    ]  # fmt: skip
    note = f"Starts are for a largest {dof.words.force} of one. A reference is taken from the logs, not "
    note += "fitted. Of choices, numbered from 0, a diagnosis tries each."
    return Sections([sentences, Table.of("Parameters", rows, [note])], answer=f"{effect.name}: {card.says}")


def _card_json(effect: Effect, dof: Dof) -> dict[str, object]:
    card = effect.card(dof)
    return {
        "name": effect.name, "place": effect.place.value, "motions": list(effect.motions), "equation": card.equation,
        "parameters": [
            {
                "name": p.name, "meaning": p.meaning, "unit": p.unit, "lower": p.lower, "upper": p.upper,
                "start": p.start, "off": None if shape else p.off, "any_when_off": shape,
                "reference": p.reference or None, "choices": list(p.choices),
            }
            for p, shape in zip(card.parameters, effect.shapes)
        ],
        "laws": [
            {"equation": equation, "source": law.source, "mistaken_for": list(law.mistaken_for)}
            for law, equation in zip(effect.laws, card.laws)
        ],
        "states": list(effect.states), "columns_needed": list(effect.columns), "says": card.says,
        "reveals": card.reveals, "mistaken_for": list(effect.mistaken_for), "separated_by": card.separated_by,
        "parity": effect.parity, "source": effect.source,
    }  # fmt: skip
