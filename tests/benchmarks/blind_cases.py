"""Cases of the blind benchmark: what is hidden, how large, in which layout, and the logs that come of it.

Sizes go by how well the campaign shows them: `visible` is the length of an effect's signature, in standard
deviations, after inertia, drag, start headings, thrust gains and switch instants have absorbed what they can. A small
effect has about SMALL, a large one at least LARGE and at least the size that pool vehicles usually have.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from blind_truth import LARGEST, SMALLEST, Chance, Floats, Plan, Vehicle, headings, surge

from automarine_cli.dofs import YAW
from automarine_cli.runs.run import Run

JUST = 5.0
"""An effect with so long a signature is found four times in five."""
SMALL, LARGE = 2 * JUST, 5 * JUST
COARSE = 0.05  # s, integrator step where only the length of a signature is wanted

LAWS: dict[str, tuple[str, float, float]] = {
    "linear": ("linear-drag", 0.08, 0.6), "quadratic": ("quadratic-drag", 0.3, 2.5),
    "cubic": ("cubic-drag", 0.15, 1.5), "bias": ("bias-moment", 0.03, 0.08), "spring": ("tether-spring", 0.01, 0.03),
    "dead-band": ("dead-band", 0.03, 0.09), "cut": ("dead-band", 0.16, 0.25), "saturation": ("saturation", 0.25, 0.6),
    "soft-saturation": ("saturation", 0.25, 0.5), "thrust-asymmetry": ("thrust-asymmetry", 0.05, 0.3),
    "drag-asymmetry": ("drag-asymmetry", 0.08, 0.5), "propeller-lag": ("thruster-lag", 0.15, 0.8),
    "delay": ("input-delay", 0.15, 0.8), "thrust-loss": ("thrust-loss", 0.1, 0.5),
    "sag-load": ("battery-sag", 0.1, 0.4), "sag-charge": ("battery-sag", 0.15, 0.4),
    "swirl": ("water-swirl", 0.02, 0.15), "coulomb": ("coulomb-drag", 0.03, 0.09),
    "hard-iron": ("compass-deviation", 0.05, 0.2), "soft-iron": ("compass-deviation", 0.04, 0.2),
    "sensor-lag": ("sensor-lag", 0.15, 0.8), "gyro-drift": ("gyro-drift", 0.004, 0.03),
    "waves": ("periodic-disturbance", 0.03, 0.2), "heading-moment": ("heading-moment", 0.03, 0.08),
    "surge": ("cross-coupling", 0.3, 1.5), "exponent": ("thrust-exponent", 0.1, 0.35),
    "thrust-lag": ("thruster-lag", 0.2, 0.8), "loaded-lag": ("thruster-lag", 0.15, 0.8),
    "slew": ("thruster-lag", 0.4, 1.5), "lag-down": ("thruster-lag", 0.12, 0.5),
    "swirl-passing": ("water-swirl", 0.03, 0.2), "swirl-jets": ("water-swirl", 0.02, 0.1),
    "swirl-settling": ("water-swirl", 0.02, 0.1), "smooth-saturation": ("saturation", 0.6, 1.2),
    "stribeck": ("coulomb-drag", 0.04, 0.1), "slack-spring": ("tether-spring", 0.02, 0.08),
    "hard-spring": ("tether-spring", 0.001, 0.01), "advance-loss": ("thrust-loss", 0.15, 0.6),
    "sag-slow": ("battery-sag", 0.15, 0.4), "delay-off": ("input-delay", 0.3, 1.0), "stall": ("dead-band", 0.3, 0.5),
    "current-pull": ("current-deviation", 0.05, 0.2), "hysteresis": ("backlash", 0.08, 0.2),
    "wall": ("wall", 0.1, 0.5), "history": ("history-force", 0.1, 0.6),
}  # fmt: skip
"""The truth's laws: the library's name, a usual size, and the largest that leaves a vehicle that turns."""

STRANGE: dict[str, tuple[float, float]] = {"temperature": (0.1, 0.3), "snags": (0.15, 0.6), "clock-drift": (0.3, 1.0)}
"""Laws that are not in the library, with a usual and a largest size."""

PAIRS = (
    ("dead-band", "propeller-lag"), ("bias", "swirl"), ("hard-iron", "linear"), ("sag-charge", "delay"),
    ("spring", "cubic"), ("thrust-asymmetry", "sensor-lag"), ("coulomb", "heading-moment"), ("exponent", "gyro-drift"),
)  # fmt: skip
SIGNED = {"bias", "thrust-asymmetry", "drag-asymmetry", "gyro-drift", "hard-iron", "soft-iron", "surge",
          "heading-moment", "exponent", "current-pull"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One campaign to be made: laws hidden (names of LAWS or STRANGE), "small", "large" or "usual", layout, seed."""

    hidden: tuple[str, ...]
    size: str
    layout: str
    seed: int
    runs: int = 24
    scatter: float | None = None
    noise: float | None = None  # degrees


@dataclass(frozen=True)
class Campaign:
    """Runs of a case, what was true, and how visible it is."""

    runs: tuple[Run, ...]
    vehicle: Vehicle
    visible: float


def make(case: Case) -> Campaign:
    """The logs of a case; the same case always gives the same."""
    random = np.random.default_rng([case.seed, *"/".join((*case.hidden, case.size, case.layout)).encode()])
    scale = float(random.choice([1.0, 10.0]))
    quadratic = float(random.uniform(0.6, 2.5))
    vehicle = Vehicle(float(random.uniform(0.5, 2.0)), quadratic, 0.0, scale, {})
    if "quadratic" in case.hidden:  # the base is then the paper's model 1
        vehicle = replace(vehicle, quadratic=0.0, linear=0.6 * quadratic)
    turn = float(random.choice([np.pi, 2 * np.pi]))
    rate = float(random.choice([10.0, 10.0, 10.0, 5.0, 20.0]))
    plan = draw_plan(random, vehicle, case.layout, case.runs, turn, rate)
    scatter = case.scatter if case.scatter is not None else float(random.choice([0.0, 0.02, 0.03, 0.05]))
    noise = np.radians(random.uniform(1.0, 2.0) if case.noise is None else case.noise)
    chance = Chance.draw(random, plan.length, scatter)
    sizes: dict[str, float] = {}
    visible = [np.inf]
    for law in case.hidden:
        sizes[law], length = _size(law, case.size, plan, vehicle, chance, scatter, noise)
        visible.append(length)
        if law in SIGNED:
            sizes[law] *= float(random.choice([-1.0, 1.0]))
        if law == "waves":
            sizes["wave-period"] = float(random.uniform(2.0, 6.0))
    vehicle = replace(vehicle, hidden=sizes)
    psi = headings(plan, vehicle, chance)
    runs = [_logged(i, plan, vehicle, chance, psi[i], noise, random) for i in range(len(plan.length))]
    order = random.permutation(len(runs))
    return Campaign(tuple(runs[i] for i in order), vehicle, min(visible))


def draw_plan(random: np.random.Generator, vehicle: Vehicle, layout: str, runs: int, turn: float, rate: float) -> Plan:
    """Moments from SMALLEST to LARGEST to both sides in random order; "full" has manoeuvres as well."""
    levels = np.tile(np.geomspace(SMALLEST, LARGEST, 12), -(-runs // 24))[: runs // 2]
    signed = np.concatenate([levels, -levels])
    kinds = np.array(["step"] * len(signed), dtype=object)
    if layout == "full":
        fifth = max(len(signed) // 5, 1)
        chosen = random.permutation(len(signed))
        kinds[chosen[:fifth]], kinds[chosen[fifth : 2 * fifth]] = "coast", "reverse"
        signed = np.concatenate([signed, np.full(8, 0.8)])
        kinds = np.concatenate([kinds, np.array(["sequence"] * 8, dtype=object)])
    instants, moments, length = [], [], []
    for moment, kind in zip(signed, kinds):
        steady = np.sqrt(abs(moment) / max(vehicle.quadratic, 1e-9))
        if vehicle.linear:
            steady = abs(moment) / vehicle.linear
        need = min(turn / steady + vehicle.inertia / max(2 * vehicle.quadratic * steady, vehicle.linear), 50.0)
        begin = random.uniform(2.0, 4.0)
        at, level = [begin], [moment]
        end = begin + need
        if kind == "coast":
            at, level, end = [begin, end], [moment, 0.0], end + 10.0
        elif kind == "reverse":
            at, level, end = [begin, end], [moment, -moment], end + 0.8 * need
        elif kind == "sequence":
            count = int(random.integers(6, 9))
            hold = random.uniform(1.5, 5.0, count)
            at = list(begin + np.cumsum(hold) - hold[0])
            level = list(random.choice([-1, 1], count) * random.uniform(0.0, LARGEST, count).round(2))
            end = at[-1] + hold[-1]
        instants.append(np.array(at))
        moments.append(np.array(level) * vehicle.scale)
        length.append(np.ceil(end))
    order = random.permutation(len(length))
    waits = np.array(length) + random.uniform(20.0, 90.0, len(length))
    clock = np.zeros(len(length))
    clock[order[1:]] = np.cumsum(waits[order])[:-1]
    start = random.uniform(0, 2 * np.pi, len(length))
    return Plan(tuple(instants), tuple(moments), np.array(length), clock.round(1), start, rate)


def _size(law: str, size: str, *campaign: Any) -> tuple[float, float]:
    """Size of a law for a case, and its visibility; `campaign` is what a Yardstick is made of."""
    usual, most = LAWS[law][1:] if law in LAWS else STRANGE[law]
    if law in ("cut", "clock-drift"):  # their visibility is no smooth matter of size
        return (usual if size != "large" else 0.5 * (usual + most)), np.inf
    if law in ("soft-saturation", "smooth-saturation", "stall"):
        return (usual if size != "large" else most), np.inf
    yardstick, value = Yardstick(*campaign), usual
    length = yardstick.visible(law, value)
    target = {"small": SMALL, "large": LARGE, "usual": 0.0}[size]
    for _ in range(2):
        wanted = value * target / max(length, 1e-6)
        wanted = max(wanted, usual) if size != "small" else wanted
        if abs(np.clip(wanted, 1e-3 * usual, most) / value - 1.0) > 0.05:
            value = float(np.clip(wanted, 1e-3 * usual, most))
            length = yardstick.visible(law, value)
    return value, length


class Yardstick:
    """What a campaign shows without the effect: headings, and their response to inertia, drag and gain."""

    def __init__(self, plan: Plan, vehicle: Vehicle, chance: Chance, scatter: float, noise: float) -> None:
        self.plan, self.vehicle, self.scatter, self.noise = plan, vehicle, scatter, noise
        self.chance = replace(chance, gain=np.ones_like(chance.gain))
        self.still = headings(plan, vehicle, self.chance, COARSE)
        dragged = replace(vehicle, quadratic=1.01 * vehicle.quadratic, linear=1.01 * vehicle.linear)
        stronger = replace(chance, gain=np.full(len(self.still), 1.01))
        self.inertia = self._response(replace(vehicle, inertia=1.01 * vehicle.inertia))
        self.drag = self._response(dragged)
        self.gain = (headings(plan, vehicle, stronger, COARSE) - self.still) / 0.01

    def _response(self, vehicle: Vehicle) -> Floats:
        return headings(self.plan, vehicle, self.chance, COARSE) - self.still

    def visible(self, law: str, value: float) -> float:
        """Length of a law's signature in standard deviations, freed of what everything else can absorb."""
        hidden = {law: value, "wave-period": 3.0}
        shown = self._response(replace(self.vehicle, hidden=hidden))
        rate = np.gradient(self.still, axis=1) / COARSE
        rows, uncertain = (max(round(1.0 / self.plan.rate / COARSE), 1), 1.0 / self.plan.rate / np.sqrt(12.0))
        hessian = np.zeros((3, 3))
        for i, last in enumerate(self.plan.length):
            part = (i, slice(0, int(last / COARSE), rows))
            y = np.stack([self.inertia[part], self.drag[part], shown[part]], axis=1)
            own = [10.0 + 0.0 * shown[part], max(self.scatter, 0.01) * self.gain[part], uncertain * rate[part]]
            free = np.stack(own, axis=1)
            inner = np.eye(3) * self.noise**2 + free.T @ free
            hessian += (y.T @ y - y.T @ free @ np.linalg.solve(inner, free.T @ y)) / self.noise**2
        length = np.sqrt(np.maximum(np.diag(hessian), 1e-12))
        h = hessian / np.outer(length, length)
        left = 1.0 - h[2, :2] @ np.linalg.lstsq(h[:2, :2], h[:2, 2], rcond=1e-10)[0]
        return float(length[2] * np.sqrt(max(left, 0.0)))


def _logged(
    i: int, plan: Plan, vehicle: Vehicle, chance: Chance, psi: Floats, noise: float, random: np.random.Generator
) -> Run:
    """One run as a logger keeps it: sampled, noisy, the command of the instant of the sample."""
    time = np.arange(int(plan.length[i] * plan.rate)) / plan.rate
    late = vehicle.size("clock-drift") * plan.clock[i] / plan.clock.max()
    fine = np.linspace(0.0, (len(psi) - 1) * 0.01, len(psi))
    heading = np.interp(time - late, fine, psi) + noise * random.standard_normal(len(time))
    heading = np.unwrap((heading + np.pi) % (2 * np.pi) - np.pi)
    which = np.searchsorted(plan.instants[i], time + 1e-9, side="right")
    moment = np.concatenate([[0.0], plan.moments[i]])[which]
    extras: Mapping[str, Floats] = {}
    if vehicle.size("surge"):
        extras = {"surge": surge(chance.surge[i], time) + 0.01 * random.standard_normal(len(time))}
    unit = "N m" if vehicle.scale != 1.0 else "nu"
    return Run(f"run_{i:02d}", f"run_{i:02d}.csv", plan.clock[i] + time, heading, moment, unit, extras, dof=YAW)
