"""Thrusters that do nothing below a smallest command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Law, Parameter, Place, choice, deliver_by_law, inf

CUTS = tuple(0.02 * 1.1**i for i in range(34))
"""Widths at which a cut is tried, as shares of the largest moment; the wider half of them for one that stalls."""


class DeadBand(Effect):
    """Nothing below a width; above it that much less, or, where the controller only cuts small commands, all of it; or
    all of it from there on until the command falls below a smaller one."""

    name = "dead-band"
    place = Place.ACTUATOR
    parameters = (
        Parameter("width", "half width of the dead-band", "{force}", 0.0, inf, 0.03),
        choice("law", "what is left above the width", "the rest; all; all, until it stalls"),
        Parameter("stall", "{force} at which it stalls", "{force}", 0.0, inf, 0.05, scan=(0.05, 0.1, 0.2), laws=(2,)),
    )
    equation = "{f}_delivered = sgn({f}) max(|{f}| - width, 0)"
    says = "The thrusters give nothing below a smallest {force}."
    reveals = "slow ramps through zero, and the smallest {forces}"
    mistaken_for = ("coulomb-drag", "linear-drag", "thrust-exponent")
    separated_by = "a coast-down: a dead-band leaves it alone, Coulomb drag stops it in finite time"
    source = "Blue Robotics T200 performance data (2019): no thrust within 7 to 10 % of the command range"
    laws = (
        Law(
            "{f}_delivered = {f} where |{f}| > width, else 0",
            "Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
            ("coulomb-drag", "thrust-exponent"),
        ),
        Law(
            "{f}_delivered = {f} from |{f}| > width until |{f}| < stall, else 0",
            "Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
            ("backlash", "coulomb-drag"),
        ),
    )

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return deliver_by_law((_rest, _all, _until_stall), commands, values, values[1])

    def placed(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        return (values[1] > 0.0, False, values[1] == 2.0)

    def scan(self, parameter: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
        """A cut has no slope to follow where no moment lies near it."""
        cuts = CUTS[len(CUTS) // 2 :] if values[1] == 2.0 else CUTS
        return cuts if values[1] and parameter.name == "width" else parameter.scan


def _rest(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    return commands.force - np.clip(commands.force, -values[0], values[0])


def _all(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    return np.where(np.abs(commands.force) > values[0], commands.force, 0.0)


def _until_stall(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """A thruster that has started goes on down to the lower edge, and stops as the command changes its side."""
    size, width = np.abs(commands.force), values[0]
    starts, goes_on = np.broadcast_arrays(size > width, size > values[2])
    side, passed = np.broadcast_to(np.sign(commands.force), starts.shape), np.empty(starts.shape, dtype=bool)
    runs, last = np.broadcast_arrays(np.abs(commands.before) > width, np.sign(commands.before), starts[..., :1])[:2]
    runs, last = runs[..., 0], last[..., 0]
    for m in range(starts.shape[2]):
        passed[..., m] = runs = starts[..., m] | (runs & goes_on[..., m] & (side[..., m] == last))
        last = side[..., m]
    return np.where(passed, commands.force, 0.0)
