"""How two thrusters make a moment: the inverse of their map, and the largest moment that they can give."""

from dataclasses import dataclass
from math import floor, log10

from scipy import optimize

from automarine_cli.errors import SettingError
from automarine_cli.thrusters.forms import Curve
from automarine_cli.thrusters.map import ThrusterMap

ROUND_DOWN = 1e-6


@dataclass(frozen=True)
class Drive:
    """Two equal thrusters `arm` [m] off the centre line, control signals up to `most`.

    With `equal_thrust` one pulls ahead as much as the other astern, so that the vehicle is not pushed ahead; else both
    get the same size of signal. `unit` is one unit of the model's moment in N m.
    """

    ahead: Curve
    astern: Curve
    arm: float
    most: float
    equal_thrust: bool
    unit: float

    @property
    def largest(self) -> float:
        """Largest moment, in the model's unit."""
        ahead, astern = self._thrust(self.ahead, self.most), self._thrust(self.astern, self.most)
        pull = 2.0 * min(ahead, astern) if self.equal_thrust else ahead + astern
        return self.arm * pull / self.unit * (1.0 - ROUND_DOWN)

    @property
    def largest_told(self) -> float:
        """The same, rounded down to three digits."""
        largest = self.largest
        unit = 10.0 ** (floor(log10(largest)) - 2)
        return float(f"{floor(largest / unit) * unit:.3g}")

    def forces(self, moment: float) -> tuple[float, float]:
        """Thrust [N] of the thruster that pulls ahead and of the one that pulls astern (a size)."""
        wanted = abs(moment) * self.unit / self.arm
        if self.equal_thrust:
            return wanted / 2.0, wanted / 2.0
        n = self._common(wanted)
        return self._thrust(self.ahead, n), self._thrust(self.astern, n)

    def commands(self, moment: float) -> tuple[float, float]:
        """Control signals (n_port, n_stbd) that give the moment; positive turns to starboard."""
        if moment == 0.0:
            return 0.0, 0.0
        if self.equal_thrust:
            each, _ = self.forces(moment)
            ahead, astern = _signal(self.ahead, each), _signal(self.astern, each)
        else:
            ahead = astern = self._common(abs(moment) * self.unit / self.arm)
        return (ahead, -astern) if moment > 0 else (-astern, ahead)

    def _common(self, wanted: float) -> float:
        """The signal at which both thrusters together give the thrust `wanted` [N]."""

        def short(n: float) -> float:
            return self._thrust(self.ahead, n) + self._thrust(self.astern, n) - wanted

        return float(optimize.brentq(short, 0.0, self.most, xtol=1e-12 * self.most))

    @staticmethod
    def _thrust(curve: Curve, n: float) -> float:
        return float(curve.thrust(n))  # type: ignore[arg-type]


def drive_of(known: ThrusterMap, arm: float, most: float | None, equal_thrust: bool, unit: float) -> Drive:
    """The drive of a map. Raises SettingError for a map of one direction, and where the largest signal is not known."""
    if known.forward is None or known.backward is None:
        lacking = "forward" if known.forward is None else "backward"
        raise SettingError(
            f"the thruster map has no {lacking} direction, but one thruster pulls each way in a turn; fit the map "
            "from a "
            "test that pulls both ways"
        )
    ends = [curve.n_sat for curve in (known.forward, known.backward) if curve.n_sat is not None]
    largest = most if most is not None else min(ends, default=None)
    if largest is None:
        raise SettingError(
            "the thruster map does not say how far the control signal goes; give thrusters.largest_command in "
            "the limits"
        )
    return Drive(known.forward, known.backward, arm, largest, equal_thrust, unit)


def _signal(curve: Curve, force: float) -> float:
    """The control signal that gives a thrust, inverse of `Curve.thrust`."""
    return float(curve.n_0 + (force / curve.a) ** (1.0 / curve.p))
