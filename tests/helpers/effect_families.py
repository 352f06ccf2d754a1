"""The effects of the library in families, as the gallery of the guide and its pictures show them."""

from automarine_cli import effects
from automarine_cli.effects import Effect, Place
from automarine_cli.effects.base import SINGLE


def family(effect: Effect) -> str:
    if effect.place is Place.ACTUATOR:
        return "Single thrusters" if effect.stage == SINGLE and effect.logged else "Thrusters and battery"
    if effect.place is Place.SENSOR:
        return "Sensors"
    return "Water, tether and surroundings" if effect.power is None else "Drag"


def families() -> dict[str, list[Effect]]:
    """The library's own effects that may be hidden, by family, both in the order of their names."""
    found: dict[str, list[Effect]] = {}
    for name in effects.built_in():
        if effects.get(name).role == "restoring":  # of roll and pitch, whose models have it always
            continue
        found.setdefault(family(effects.get(name)), []).append(effects.get(name))
    return dict(sorted(found.items()))


def picture_of(title: str) -> str:
    """The file name of a family's picture, without its ending."""
    return f"effects_{title.replace(',', '').split()[0].lower()}"
