"""From outputs to moments, loop by loop: the map, delays, dead-bands and lags that a model names."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from automarine_cli import effects
from automarine_cli.control.members import Vehicles
from automarine_cli.effects import Commands
from automarine_cli.effects.input_delay import InputDelay
from automarine_cli.effects.thruster_lag import ADVANCES, SHORTEST, Advance, ThrusterLag
from automarine_cli.models.vehicle import Bound, actuators
from automarine_cli.quantities import Floats

SLOWEST = 0.1
"""Share of the reference moment at which a lag that depends on the speed counts in margins."""


class Actuators:
    """The actuators of S vehicles in R flights, advanced in steps of `step` [s]; it remembers what they do."""

    def __init__(self, vehicles: Vehicles, flights: int, step: float) -> None:
        self.vehicles, self.step = vehicles, step
        self.terms = actuators(vehicles.model.forces(vehicles.theta))
        shape = (len(vehicles), flights)
        late = dead_time(vehicles) / step
        self._whole, self._share = late.astype(int), (late - late.astype(int))[:, None]
        self._ring = np.zeros((int(self._whole.max(initial=0)) + 2, *shape))
        self._rows, self._at = np.arange(len(vehicles)), 0
        self._now = [term for term in self.terms if not isinstance(term.effect, InputDelay | ThrusterLag)]
        self._before = [np.zeros(shape) for _ in self._now]
        self._lag = next((term for term in self.terms if isinstance(term.effect, ThrusterLag)), None)
        self._speed = np.zeros(shape)
        self._laws = self._by_law()
        self._gain = vehicles.gain[:, None]
        self._time = np.zeros((1, 1, 1))
        self._signals = {"voltage": vehicles.volts[:, None, None]}

    def begin(self, output: Floats) -> None:
        """Let an output (S, R) have been held for long."""
        moment = self._straight(output)
        self._ring[:] = moment
        for place, term in enumerate(self._now):
            self._before[place] = moment
            moment = self._at_once(term, moment, moment)
        self._speed = np.sign(moment) * np.sqrt(np.abs(moment))

    def deliver(self, output: Floats) -> Floats:
        """Mean moment (S, R) over the next step, for the output held over it."""
        ring, at, count = self._ring, self._at, len(self._ring)
        ring[at % count] = self._straight(output)
        near = ring[(at - self._whole) % count, self._rows]
        moment = near + self._share * (ring[(at - self._whole - 1) % count, self._rows] - near)
        self._at = at + 1
        for place, term in enumerate(self._now):
            asked = moment
            moment = self._at_once(term, asked, self._before[place])
            self._before[place] = asked
        if self._lag is not None:
            moment = self._slowly(moment)
        self._time = self._time + self.step
        return self._gain * moment

    def _straight(self, output: Floats) -> Floats:
        bend = self.vehicles.bend
        return self.vehicles.full * (output if bend is None else bend.of(output))

    def _at_once(self, term: Bound, moment: Floats, before: Floats) -> Floats:
        length = np.full((1, 1, 1), self.step)
        commands = Commands(moment[..., None], self._time, length, before[..., None], np.zeros((1, 1)), self._signals)
        return term.effect.deliver(commands, term.wide())[..., 0]

    def _by_law(self) -> list[tuple[Advance, NDArray[np.int64] | slice, tuple[Floats, ...]]]:
        """What advances the lag of which vehicles, with their values."""
        if self._lag is None:
            return []
        lag, law, largest, fall = self._lag.values
        own = (np.maximum(lag, SHORTEST), np.sqrt(np.maximum(largest, 1e-12)), fall)
        laws = np.unique(law)
        if len(laws) == 1:
            return [(ADVANCES[round(float(laws[0]))], slice(None), own)]
        places = [np.flatnonzero(law[:, 0] == one) for one in laws]
        return [(ADVANCES[round(float(k))], at, tuple(value[at] for value in own)) for k, at in zip(laws, places)]

    def _slowly(self, moment: Floats) -> Floats:
        wanted = np.sign(moment) * np.sqrt(np.abs(moment))
        impulse, speed, step = np.empty_like(wanted), np.empty_like(wanted), np.full((1, 1), self.step)
        for advance, here, own in self._laws:
            impulse[here], speed[here] = advance(wanted[here], self._speed[here], step, own)
        self._speed = speed
        return impulse / self.step


def dead_time(vehicles: Vehicles) -> Floats:
    """Delay of each vehicle's commands [s], (S,): the model's, the longer where rises and falls differ, and more."""
    late = vehicles.late
    for term in vehicles.model.forces(vehicles.theta):
        if isinstance(term.effect, InputDelay):
            rise, law, fall = (value[:, 0] for value in term.values)
            late = late + np.where(law == 1.0, np.maximum(rise, fall), rise)
    return late


def lag_of(vehicles: Vehicles) -> Floats:
    """Time constant [s] of the thrust of each vehicle for small changes, (S,)."""
    for term in vehicles.model.forces(vehicles.theta):
        if isinstance(term.effect, ThrusterLag):
            lag, law, largest, fall = (value[:, 0] for value in term.values)
            slower = np.sqrt(largest / np.maximum(SLOWEST * vehicles.full, 1e-12))
            return cast(Floats, np.select([law == 2.0, law == 4.0], [lag * slower, lag * np.maximum(fall, 1.0)], lag))
    return np.zeros(len(vehicles))


def output_slope(vehicles: Vehicles) -> Floats:
    """Change of moment per change of output about the output at which each vehicle is looked at, (S,)."""
    outputs = vehicles.at[:, None] * np.array([[1.0, -1.0]])
    whole = Actuators(vehicles, 2, 1.0)
    whole._lag, whole._share = None, 0.0 * whole._share
    whole.begin(outputs)
    moment = outputs * vehicles.full
    for term in whole._now:
        moment = whole._at_once(term, moment, moment)
    passed = (moment[:, 0] - moment[:, 1]) / (2.0 * vehicles.at)
    bent = 1.0 if vehicles.bend is None else vehicles.bend.slope(vehicles.at)
    return vehicles.gain * passed * bent


def needs_columns(names: list[str]) -> list[tuple[str, str]]:
    """Effects among these that act by a logged column that no controller simulation has, with the column."""
    found = []
    for name in names:
        columns = [column for column in effects.get(name).columns if column != "voltage"]
        found += [(name, columns[0])] if columns else []
    return found
