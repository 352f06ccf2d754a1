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
    """Why commands do not fit a map, a sentence; `impossible` where they cannot be of this map at all."""

    sentence: str
    impossible: bool


def misfit_of(ranges: Iterable[CommandRange]) -> Misfit | None:
    """What is wrong with the commands of a campaign, by the ranges of its runs; None where they fit."""
    every = list(ranges)
    if not every:
        return None
    low, high = min(one.low for one in every), max(one.high for one in every)
    ends, unit = every[0].of_map, every[0].unit
    size, most = max(abs(low), abs(high)), max(map(abs, ends))
    if size == 0 or most == 0:
        return None
    ratio, usual = size / most, float(np.median([one.usual for one in every]))
    names = every[0].names
    said = (
        f"the thruster commands {' and '.join(names)} go from {low:.4g} to {high:.4g}, those of the thruster map from "
        f"{ends[0]:.4g} to {ends[1]:.4g}{f' {unit}' if unit else ''}"
    )
    rule = f'{names[0]} = {{ from = "NAME", '
    share = next((word for most_of, word in SHARES.items() if 0.2 * most_of < size <= 1.01 * most_of), "")
    if PULSES[0] <= low and high <= PULSES[2] and most < PULSES[0]:
        return Misfit(f"{said}: pulses of which the neutral was not subtracted; write {rule}subtract = 1500 }} under "
                      "[columns]", True)  # fmt: skip
    if low >= 0 > ends[0] and low < usual < high and abs(usual - (low + high) / 2) <= 0.05 * (high - low):
        return Misfit(f"{said}: they never go below 0 and are mostly {usual:.4g}, half the range, which looks like a "
                      f"neutral that was not subtracted; if so, write {rule}subtract = {usual:.4g} }} under [columns]",
                      False)  # fmt: skip
    if ratio > BEYOND:
        looks = f"they look {share}, not" if share else "they are not"
        why = f"{looks} the signal of this map" if ratio > FAR_BEYOND else "beyond it the thrust is a guess"
        return Misfit(f"{said}: {why}; {_remedy(rule, most, size)}", ratio > FAR_BEYOND)
    if ratio <= INSIDE or (ratio <= HALF and _whole(size)):
        looks = f"they look {share}" if share else "they look like another unit"
        return Misfit(f"{said}: {looks}, or the vehicle was hardly driven; {_remedy(rule, most, size)}",
                      ratio <= FAR_INSIDE)  # fmt: skip
    return None


def _whole(size: float) -> bool:
    """Whether the largest command is exactly that of a share: 1, or 100 percent."""
    return any(abs(size - most) <= 0.01 * most for most in SHARES)


def _remedy(rule: str, most: float, size: float) -> str:
    scale = most if size <= 1.01 else most / 100 if size <= 101 else 0
    example = f"{scale:.4g}" if scale else "FACTOR"
    return (
        f"bring them to the map's unit with {rule}scale = {example} }} under [columns], or give the map of this signal"
    )


def warnings_of(ranges: Iterable[CommandRange]) -> tuple[str, ...]:
    """What a person is warned of. Raises RunError where the commands cannot be of this map at all."""
    found = misfit_of(ranges)
    if found is None:
        return ()
    if found.impossible:
        raise RunError(found.sentence)
    return (f"{found.sentence[0].upper()}{found.sentence[1:]}.",)
