"""What effects are given: the state of a degree of freedom at an instant, and the commands of all runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from automarine_cli.quantities import Floats


@dataclass(slots=True)
class State:
    """State of one degree of freedom of all runs under all parameter sets at one instant: arrays that broadcast to
    (P, R).

    `position` [rad or m, unwrapped, true], `origin` the same at the run's start, `velocity` over ground [per s],
    `relative` the velocity through the water, on which drag depends, `delivered` moment or force after the actuators,
    `time` in the run [s], `signals` other logged columns held over the step, `flow` the velocities through the water
    of all degrees of freedom that move together, by their place, `stored` the states of the effect that is asked for
    its moment. The simulator fills it in anew for every instant. In the plane `position` is north, east or the heading.
    """

    position: Floats
    origin: Floats
    velocity: Floats
    relative: Floats
    delivered: Floats
    time: Floats
    signals: Mapping[str, Floats]
    flow: Sequence[Floats] = ()
    stored: Sequence[Floats] = ()

    @property
    def travelled(self) -> Floats:
        """Way since the run's start [rad or m]."""
        return self.position - self.origin


@dataclass(frozen=True)
class Commands:
    """The commands of all runs on the simulation grid, for actuator effects.

    `force` (P, R, M), moment or force, is held over each of the M steps, `start` and `length` (P, R, M) [s] say when;
    `before` (R, 1) is what was held before the first sample, `clock` (R, 1) the campaign's clock [s] at the run's
    first sample; `signals` are other logged columns, (R, M).
    """

    force: Floats
    start: Floats
    length: Floats
    before: Floats
    clock: Floats
    signals: Mapping[str, Floats]
