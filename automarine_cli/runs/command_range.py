"""Do the thruster commands of the logs fit the map that makes moments or forces of them? Told by range and neutral."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.errors import RunError
from automarine_cli.quantities import Floats

BEYOND, FAR_BEYOND = 1.05, 3.0
"""Times the range of the map from which a thrust is extrapolated, and from which the commands are not of this map."""
INSIDE, FAR_INSIDE, HALF = 0.1, 0.02, 0.5
"""The same towards zero, shares of the range; below half of it the largest command must not be exactly 1 or 100."""
SHARES = {1.0: "normalised (-1 to 1)", 100.0: "like percent"}
"""What commands are whose largest value comes near one of these."""
LITTLE = 0.1  # Share of the largest force below which a force says no direction
PULSES = (800.0, 1500.0, 2200.0)  # us: shortest, neutral, longest


@dataclass(frozen=True)
class CommandRange:
    """Thruster commands of one run or several: lowest, highest and usual value, and the range and unit of the map's."""

    low: float
    high: float
    usual: float
    names: tuple[str, ...]
    of_map: tuple[float, float]
    unit: str

    @classmethod
    def of(
        cls, commands: Sequence[Floats], names: Sequence[str], of_map: tuple[float, float], unit: str
    ) -> "CommandRange":
        """The range of commands (N,) of several thrusters."""
        every = np.concatenate(commands)
        low, high = float(np.min(every)), float(np.max(every))
        return cls(low, high, float(np.median(every)), tuple(names), of_map, unit)


@dataclass(frozen=True)
class Misfit:
    """Why commands do not fit a map, and what would mend it; `impossible` where they cannot be of this map at all."""

    sentence: str
    impossible: bool


def misfit_of(ranges: Iterable[CommandRange]) -> Misfit | None:
    """What is wrong with the commands of a campaign, by the ranges of its runs; None where they fit."""
    every = list(ranges)
    if not every:
        return None
    low, high = min(one.low for one in every), max(one.high for one in every)
    (least, largest), unit, names = every[0].of_map, every[0].unit, every[0].names
    size, most = max(abs(low), abs(high)), max(abs(least), abs(largest))
    if size == 0 or most == 0:
        return None
    ratio, usual = size / most, float(np.median([one.usual for one in every]))
    said = (
        f"the thruster commands {' and '.join(names)} go from {low:.4g} to {high:.4g}, those of the thruster map from "
        f"{least:.4g} to {largest:.4g}{f' {unit}' if unit else ''}: "
    )
    share = next((word for whole, word in SHARES.items() if 0.2 * whole < size <= 1.01 * whole), "")
    scale = f"{most if size <= 1.01 else most / 100:.4g}" if size <= 101 else "FACTOR"

    def misfit(why: str, key: str, value: str, impossible: bool) -> Misfit:
        rule = f'{names[0]} = {{ from = "NAME", {key} = {value} }}'
        mend = f"write {rule} under [columns] to mend that, or give the map of this signal"
        return Misfit(f"{said}{why}; {mend}", impossible)

    if PULSES[0] <= low and high <= PULSES[2] and most < PULSES[0]:
        return misfit("pulses of which the neutral was not subtracted", "subtract", "1500", True)
    if low >= 0 > least and low < usual < high and abs(usual - (low + high) / 2) <= 0.05 * (high - low):
        why = f"they are never negative and mostly {usual:.4g}, half the range, a neutral that was not subtracted"
        return misfit(why, "subtract", f"{usual:.4g}", False)
    if ratio > FAR_BEYOND:
        looks = f"they look {share}, not" if share else "they are not"
        return misfit(f"{looks} the signal of this map", "scale", scale, True)
    if ratio > BEYOND:
        return misfit("beyond its ends the thrust is a guess", "scale", "FACTOR", False)
    whole = any(abs(size - one) <= 0.01 * one for one in SHARES)
    if ratio <= INSIDE or (ratio <= HALF and whole):
        looks = f"they look {share}" if share else "they look like another unit"
        return misfit(f"{looks}, or the vehicle was hardly driven", "scale", scale, ratio <= FAR_INSIDE)
    return None


def usual_neutral(low: float, high: float, seen: float) -> float:
    """The neutral of a signal that goes from `low` to `high` and gives nothing at `seen`: 1500 where it is pulses."""
    pulses = PULSES[0] <= low and high <= PULSES[2] and abs(seen - PULSES[1]) <= 100.0
    return PULSES[1] if pulses else seen


def undirected(n: Floats, force: Floats) -> str:
    """What is wrong with the control signal of a thruster test, arrays (N,); "" where it can be right."""
    low, high = float(n.min()), float(n.max())
    if PULSES[0] <= low and PULSES[1] <= high <= PULSES[2] and low > 0.4 * high:
        return (
            f"the control signal goes from {low:.4g} to {high:.4g}, as pulses about 1500 do; if it is that, write n = "
            '{ from = "NAME", subtract = 1500 } under [columns]'
        )
    if low >= 0 and force.min() < -LITTLE * force.max() < 0:
        return (
            'the control signal is never negative while the force goes both ways; write n = { from = "NAME", sign_from '
            '= "COLUMN" } with a column that says the direction, or subtract its neutral, under [columns]'
        )
    return ""


def warnings_of(ranges: Iterable[CommandRange]) -> tuple[str, ...]:
    """What a person is warned of. Raises RunError where the commands cannot be of this map at all."""
    found = misfit_of(ranges)
    if found is None:
        return ()
    if found.impossible:
        raise RunError(found.sentence)
    return (f"{found.sentence[0].upper()}{found.sentence[1:]}.",)
