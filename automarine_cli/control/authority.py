"""What the whole output gives: the moment or force, and how it grows with the output."""

import numpy as np

from automarine_cli.control.knowledge import Knowledge
from automarine_cli.control.members import Bend
from automarine_cli.control.targets.base import Target
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.thrusters.map import ThrusterMap

ROUNDING = 1.02
"""How far beyond the whole output moments of a log may seem to go."""
POINTS = 401


def authority(
    target: Target, known: Knowledge, full: float | None, drive: tuple[ThrusterMap, float] | None
) -> tuple[float, Bend | None]:
    """Moment or force at the whole output in the model's unit, and the map from output to it where one is given.

    Raises ModelError where the model's unit is none that the target can use, or the map contradicts the model, and
    SettingError for a map of one direction.
    """
    unit, source, dof = known.stored.moment_unit, known.stored.source, known.model.dof
    bend, most = (None, None) if drive is None else turning(*drive)
    if full is None and most is not None and unit != "nu":
        full = most
    if full is None and unit == "nu":
        if known.largest is not None and known.largest > ROUNDING:
            raise ModelError(
                f"{source}: its {dof.words.force}s reach {known.largest:g} nu, which is no output of {target.name}, "
                f"from -1 to 1; give --full with the {dof.words.force} [nu] of the whole output"
            )
        full = 1.0
    if full is None:
        also = " or --thrusters MAP.json and --arm METRES" if dof.levered else ""
        raise ModelError(
            f"{source}: its {dof.words.force}s are in {unit}, and {target.name} commands outputs from -1 to 1; give "
            f"--full with the {dof.words.force} [{unit}] of the whole output{also}"
        )
    if known.largest is not None and full < known.largest / 1.25:
        what = "the thruster map gives" if most is not None and full == most else "--full is"
        raise ModelError(
            f"{source}: it was fitted to {dof.words.force}s up to {known.largest:.4g} {unit}, and {what} {full:.4g} "
            f"{unit} at the whole output; give the map and the arm of the thrusters of these logs"
        )
    if most is not None and unit != "nu" and abs(full / most - 1.0) > 0.1:
        raise ModelError(
            f"{source}: --full is {full:.4g} {unit}, and the thruster map gives {most:.4g} {unit} at the whole output; "
            "leave out one of them"
        )
    return full, bend


def turning(known: ThrusterMap, arm: float) -> tuple[Bend, float]:
    """How the moment of two thrusters `arm` [m] off the centre line, one ahead and one astern, grows with the output,
    and the largest one [N m]. Raises SettingError for a map that cannot say.

    The whole output is a control signal of 1, or the largest that the map tells of where that is more: pulses, percent.
    """
    ahead, astern = known.both_ways
    most = max(known.largest or 1.0, 1.0)
    output = np.linspace(0.0, 1.0, POINTS)
    thrust = ahead.thrust(most * output) + astern.thrust(most * output)
    if not thrust[-1] > 0:
        raise SettingError(
            "the thruster map gives no thrust at the whole output; give a map whose control signal goes from -1 to 1, "
            "or that says how far it was measured (fit it again)"
        )
    return Bend(output, np.asarray(thrust / thrust[-1])), float(arm * thrust[-1])
