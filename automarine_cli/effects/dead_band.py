"""Thrusters that do nothing below a smallest command."""

import numpy as np

from automarine_cli.effects.base import Commands, Effect, Floats, Law, Parameter, Place, choice, deliver_by_law, inf

EDGE = 0.1
CUTS = tuple(0.02 * 1.3**i for i in range(14))
"""Widths at which a cut is tried, as shares of the largest moment."""


class DeadBand(Effect):
    """Nothing below a width; above it that much less, or, where the controller only cuts small commands, all of it; or
    all of it from there on until the command falls below a share of the width.

    The cut is smoothed over EDGE of the width, within which no test's moments could place it.
    """

    name = "dead-band"
    place = Place.ACTUATOR
    parameters = (
        Parameter("width", "half width of the dead-band", "{force}", 0.0, inf, 0.03),
        choice("law", "what is left above the width", "the rest; all; all, until it stalls"),
        Parameter("stall", "share of the width at which it stalls", "1", 0.0, 1.0, 0.5, scan=(0.3, 0.6), laws=(2,)),
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
            "{f}_delivered = {f} from |{f}| > width until |{f}| < stall width, else 0",
            "Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
            ("backlash", "coulomb-drag"),
        ),
    )

    def deliver(self, commands: Commands, values: tuple[Floats, ...]) -> Floats:
        return deliver_by_law((_rest, _all, _until_stall), commands, values, values[1])

    def scan(self, parameter: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
        """A cut has no slope to follow where no moment lies near it."""
        return CUTS if values[1] and parameter.name == "width" else parameter.scan


def _rest(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    return commands.force - np.clip(commands.force, -values[0], values[0])


def _all(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    return commands.force * _share(np.abs(commands.force), values[0])


def _share(size: Floats, width: Floats) -> Floats:
    """How much of a command of this size a cut at `width` passes."""
    return np.asarray(np.clip((size - width) / np.maximum(2.0 * EDGE * width, 1e-12) + 0.5, 0.0, 1.0))


def _until_stall(commands: Commands, values: tuple[Floats, ...]) -> Floats:
    """A thruster that has started goes on down to the lower edge, and stops as the command changes its side."""
    size, width = np.abs(commands.force), values[0]
    starts, goes_on = np.broadcast_arrays(_share(size, width), _share(size, values[2] * width))
    side = np.broadcast_to(np.sign(commands.force), starts.shape)
    passed, before = np.empty(starts.shape), np.broadcast_to(np.sign(commands.before), (*starts.shape[:2], 1))
    share, last = (np.broadcast_to(_share(np.abs(commands.before), width), before.shape)[..., 0], before[..., 0])
    for m in range(starts.shape[2]):
        share = np.where(side[..., m] == last, np.minimum(goes_on[..., m], share), 0.0)
        passed[..., m] = share = np.maximum(starts[..., m], share)
        last = side[..., m]
    return commands.force * passed
