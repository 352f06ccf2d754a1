"""`effects`: the library of effects, as a list or as the whole card of one."""

import math
from dataclasses import dataclass

from automarine_cli import effects as library
from automarine_cli.dofs import DOFS
from automarine_cli.effects import Effect, Parameter
from automarine_cli.effects.base import EVEN, MIXED, ODD
from automarine_cli.report.tables import Table, number

SCHEMA = "automarine/effects/1"
MOMENT = "moment unit"  # what stands for the logs' own unit of moment in print

ACTS_ON = {
    "actuator": "actuator: the moment delivered for the moment commanded",
    "moment": "moment: one more moment on the vehicle",
    "water": "water: the water that the drag acts through",
    "sensor": "sensor: the heading that is read for the true one",
}
MIRRORED = {
    EVEN: "even: a mirrored campaign has the same parameters",
    ODD: "odd: a mirrored campaign has all parameters negated",
    MIXED: "mixed: a mirrored campaign has some parameters negated",
}
FITTED_AGAINST = {
    "moment": "the largest moment of the logs",
    "clock": "the logs' first instant",
    "voltage": "the logs' mean voltage",
}


@dataclass(frozen=True)
class EffectCards:
    """Cards of effects; `whole` where one was asked for by name."""

    cards: tuple[Effect, ...]
    whole: bool

    def to_json(self) -> dict[str, object]:
        """The cards (schema automarine/effects/1); infinity, which JSON has no word for, is null."""
        return {"schema": SCHEMA, "effects": [_card_json(effect) for effect in self.cards]}

    def tables(self) -> tuple[Table | str, ...]:
        """The list of all, or sentences and the parameters of one."""
        return _card(self.cards[0]) if self.whole else (_list(self.cards),)


def effects(name: str | None = None) -> EffectCards:
    """All effects, or the one of that name. Raises ModelError for a name that is not in the library."""
    cards = tuple(library.get(one) for one in (library.names() if name is None else (name,)))
    return EffectCards(cards, whole=name is not None)


def _list(cards: tuple[Effect, ...]) -> Table:
    rows = tuple(
        (one.name, one.place.value, one.equation, ", ".join(p.name for p in one.parameters)) for one in cards
    )
    note = "automarine effects NAME prints the whole card of one."
    return Table("Library of effects", ("name", "place", "equation", "parameters"), rows, notes=(note,))


def _card(one: Effect) -> tuple[Table | str, ...]:
    lines = [
        ("equation", one.equation),
        ("acts on", ACTS_ON[one.place.value]),
        *([] if len(one.axes) == len(DOFS) else [("only in", " and ".join(one.axes))]),
        ("states", ", ".join(one.states) or "none of its own"),
        ("columns needed", ", ".join(one.needs) or "none beyond time, heading and command"),
        ("verdict", one.says),
        ("revealed by", one.reveals),
        ("mistaken for", ", ".join(one.mistaken_for)),
        ("told apart by", one.separated_by),
        ("parity", MIRRORED[one.parity]),
        ("source", one.source),
    ]
    width = max(len(label) for label, _ in lines)
    sentences = (one.name, "", *(f"{label.ljust(width)}  {text}" for label, text in lines))
    rows = tuple(_parameter_row(parameter, shape) for parameter, shape in zip(one.parameters, one.shapes))
    header = ("symbol", "meaning", "unit", "bounds", "start", "off", "reference or choices")
    note = "Starts are for a largest moment of one. A parameter with a reference is taken from the logs, not fitted; "
    note += "one with choices is 0 for the first and so on, and a diagnosis tries each."
    return ("\n".join(sentences), Table("Parameters", header, rows, notes=(note,)))


def _parameter_row(parameter: Parameter, shape: bool) -> tuple[str, ...]:
    return (
        parameter.name,
        parameter.meaning,
        parameter.unit_for(MOMENT),
        f"{_bound(parameter.lower)} to {_bound(parameter.upper)}",
        number(parameter.start),
        "any" if shape else _bound(parameter.off),
        " or ".join(parameter.choices) or FITTED_AGAINST.get(parameter.reference, ""),
    )


def _bound(value: float) -> str:
    return number(value) if math.isfinite(value) else "∞" if value > 0 else "-∞"


def _card_json(one: Effect) -> dict[str, object]:
    return {
        "name": one.name,
        "place": one.place.value,
        "motions": list(one.axes),
        "equation": one.equation,
        "parameters": [
            {
                "name": p.name,
                "meaning": p.meaning,
                "unit": p.unit_for(MOMENT),
                "lower": _finite(p.lower),
                "upper": _finite(p.upper),
                "start": p.start,
                "off": None if shape else _finite(p.off),
                "any_when_off": shape,
                "reference": p.reference or None,
                "choices": list(p.choices),
            }
            for p, shape in zip(one.parameters, one.shapes)
        ],
        "states": list(one.states),
        "columns_needed": list(one.needs),
        "says": one.says,
        "reveals": one.reveals,
        "mistaken_for": list(one.mistaken_for),
        "separated_by": one.separated_by,
        "parity": one.parity,
        "source": one.source,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
