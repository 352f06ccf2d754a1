"""Campaigns of the closed-loop benchmark: what is hidden, how large, who steers, and the logs that come of it.

Sizes are those that vehicles have where somebody looks for what is wrong: two to three times what pool vehicles usually
show, for the controller keeps commands small and turns short, and the disturbance hides as much again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from closed_loop_truth import INTERVAL, Chance, Log, Pilot, Vehicle, Voyage, sail

from automarine_cli.dofs import YAW
from automarine_cli.models.model import Model
from automarine_cli.runs.run import Run

FITTED, HELD_OUT = 10, 4
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Kind:
    """What a campaign hides: the library's names for it (`right`), the truth's laws with their sizes, and surroundings.

    `drags` are the base models to draw from, `disturbance` the range of its size [share of M], `unsteady` that of the
    thrust's unsteadiness, None for some in one campaign of four. `surge` logs the surge that turns the vehicle.
    """

    right: tuple[str, ...] = ()
    hidden: Mapping[str, float] = field(default_factory=dict)
    drags: tuple[str, ...] = ("3", "3", "2", "1")
    disturbance: tuple[float, float] = (0.05, 0.15)
    unsteady: tuple[float, float] | None = None
    surge: bool = False


KINDS: dict[str, Kind] = {
    "input-delay": Kind(("input-delay",), {"delay": 0.33}),
    "thruster-lag": Kind(("thruster-lag",), {"propeller-lag": 0.4}, ("3",)),
    "sensor-lag": Kind(("sensor-lag",), {"sensor-lag": 0.4}),
    "dead-band": Kind(("dead-band",), {"dead-band": 0.08}),
    "saturation": Kind(("saturation",), {"limit": 0.6}),
    "thrust-asymmetry": Kind(("thrust-asymmetry",), {"thrust-asymmetry": 0.12}),
    "battery-sag": Kind(("battery-sag",), {"discharge": 0.35}),
    "linear-drag": Kind(("linear-drag",), {"linear": 0.4}, ("3",)),
    "cubic-drag": Kind(("cubic-drag",), {"cubic": 1.5}, ("3",), unsteady=(0.0, 0.0)),
    "coulomb-drag": Kind(("coulomb-drag",), {"dry": 0.08}, ("3",)),
    "drag-asymmetry": Kind(("drag-asymmetry",), {"drag-asymmetry": 0.3}, ("3",)),
    "thrust-loss": Kind(("thrust-loss",), {"thrust-loss": 0.5}, ("3",)),
    "cross-coupling": Kind(("cross-coupling",), {"coupling": 0.4}, surge=True),
    "tether-spring": Kind(("tether-spring",), {"spring": 0.04}),
    "bias-moment": Kind(("bias-moment",), {"bias": 0.09}),
    "heading-moment": Kind(("heading-moment",), {"push": 0.1}),
    "compass-deviation": Kind(("compass-deviation",), {"hard-iron": 0.15, "soft-iron": 0.05}),
    "delay+dead-band": Kind(("input-delay", "dead-band"), {"delay": 0.33, "dead-band": 0.08}),
    "delay+coupling": Kind(("input-delay", "cross-coupling"), {"delay": 0.33, "coupling": 0.4}, surge=True),
    "clean": Kind(unsteady=(0.0, 0.0)),
    "clean-unsteady": Kind(unsteady=(0.2, 0.3)),
    "clean-disturbed": Kind(disturbance=(0.25, 0.3)),
}
"""Times in seconds; iron as shares of the Earth's field (about nine and three degrees); the rest as shares of the
largest moment, at the largest rate or a surge of 1 m/s where it grows with these, the spring's per radian."""

SIGNED = {"thrust-asymmetry", "drag-asymmetry", "coupling", "bias", "push", "hard-iron", "soft-iron"}

LOOK_ALIKES = {
    "input-delay": {"thruster-lag", "sensor-lag"},
    "thruster-lag": {"input-delay", "sensor-lag"},
    "sensor-lag": {"input-delay", "thruster-lag"},
    "dead-band": {"coulomb-drag", "thrust-exponent", "linear-drag"},
    "coulomb-drag": {"dead-band", "linear-drag", "thrust-exponent"},
    "linear-drag": {"coulomb-drag", "thrust-loss", "dead-band", "thrust-exponent"},
    "cubic-drag": {"saturation", "battery-sag", "thrust-exponent", "thrust-loss", "quadratic-drag"},
    "saturation": {"cubic-drag", "battery-sag", "thrust-exponent"},
    "battery-sag": {"voltage-exponent"},
    "thrust-loss": {"linear-drag", "quadratic-drag", "cubic-drag"},
    "thrust-asymmetry": {"drag-asymmetry", "linear-drag-asymmetry", "bias-moment"},
    "drag-asymmetry": {"thrust-asymmetry", "linear-drag-asymmetry", "bias-moment"},
    "bias-moment": {"thrust-asymmetry", "drag-asymmetry", "linear-drag-asymmetry", "gyro-drift"},
    "cross-coupling": {"linear-drag", "thrust-loss"},
    "tether-spring": {"water-swirl", "heading-moment"},
    "heading-moment": {"compass-deviation", "tether-spring"},
    "compass-deviation": {"heading-moment"},
}
"""What may stand in an effect's place if the verdict lists it as a rival."""


@dataclass(frozen=True)
class Campaign:
    """Logs to fit and held out, the base model that a user would bring, and what nobody logs."""

    fitted: tuple[Run, ...]
    held_out: tuple[Run, ...]
    base: Model
    chance: Chance


def make(name: str, seed: int, gyro: bool = False) -> Campaign:
    """The campaign of a kind; the same arguments always give the same."""
    kind, random = KINDS[name], np.random.default_rng([seed, *name.encode()])
    drag = str(random.choice(kind.drags))
    linear = {"1": 1.0, "2": float(random.uniform(0.2, 0.5)), "3": 0.0}[drag]
    signs = {law: float(random.choice([-1.0, 1.0])) if law in SIGNED else 1.0 for law in kind.hidden}
    hidden = {law: signs[law] * value for law, value in kind.hidden.items()}
    hidden["push-at"] = float(random.uniform(0.0, 2 * np.pi))
    time, fastest = float(random.uniform(0.3, 2.0)), float(random.uniform(30.0, 120.0) * DEGREE)
    vehicle = Vehicle(time, fastest, linear, hidden)
    inertia = float(np.exp(random.uniform(np.log(0.05), np.log(30.0))))  # kg m^2, small ROV to boat
    some = (0.1, 0.3) if random.random() < 0.25 else (0.0, 0.0)
    chance = Chance(
        disturbance=float(random.uniform(*kind.disturbance)),
        lasting=float(random.uniform(1.0, 4.0)),
        scatter=0.03,
        unsteady=float(random.uniform(*(some if kind.unsteady is None else kind.unsteady))),
        compass=float(random.uniform(0.5, 1.0) * DEGREE),
        gyro=0.3 * DEGREE,
        gyro_bias=0.5 * DEGREE,
    )
    pilot = draw_pilot(random, vehicle, gyro)
    lengths = tuple(int(n) for n in random.integers(600, 901, FITTED + HELD_OUT))
    decoy = random.random() < 0.25
    voyage = draw_voyage(random, lengths)
    log = sail(vehicle, pilot, voyage, chance, random)
    largest = inertia * vehicle.fastest / vehicle.time
    runs = [
        logged(i, length, voyage, log, largest, gyro, kind.surge or decoy, random) for i, length in enumerate(lengths)
    ]
    out = set(random.choice(len(runs), HELD_OUT, replace=False).tolist())
    quadratic, straight = largest / vehicle.fastest**2, largest / vehicle.fastest
    values = {
        "1": [0.85 * straight],
        "2": [0.85 * (1.0 - linear) * quadratic, 0.85 * linear * straight],
        "3": [0.85 * quadratic],
    }[drag]
    return Campaign(
        tuple(run for i, run in enumerate(runs) if i not in out),
        tuple(runs[i] for i in sorted(out)),
        Model.base(drag, 1.2 * inertia, values, "N m", YAW),
        chance,
    )


def draw_pilot(random: np.random.Generator, vehicle: Vehicle, gyro: bool) -> Pilot:
    """Full moment at an error of 20 to 60 degrees, if that leaves the loop no faster than two radians a second."""
    quickness = vehicle.fastest / vehicle.time  # rad/s^2 at the full moment
    natural = min(np.sqrt(quickness / (random.uniform(20.0, 60.0) * DEGREE)), 2.0)  # rad/s
    error, damping = natural**2 / quickness, random.uniform(0.5, 0.9)
    summed = 0.15 * natural * error if random.random() < 0.5 else 0.0
    return Pilot(float(error), float(2 * damping * natural / quickness), float(summed), 0.3, gyro)


def draw_voyage(random: np.random.Generator, lengths: tuple[int, ...]) -> Voyage:
    """A new heading, 30 to 170 degrees to either side, every 5 to 15 s; surge that comes and goes over ten seconds."""
    samples, runs = max(lengths), len(lengths)
    start = random.uniform(0.0, 2 * np.pi, runs)
    setpoint = np.empty((samples, runs))
    for i in range(runs):
        at = np.cumsum(random.uniform(5.0, 15.0, 20)) - 4.0
        turns = random.choice([-1.0, 1.0], 20) * random.uniform(30.0, 170.0, 20) * DEGREE
        which = np.searchsorted(at, INTERVAL * np.arange(samples), side="right")
        setpoint[:, i] = start[i] + np.concatenate([[0.0], np.cumsum(turns)])[which]
    surge = np.empty((samples, runs))
    now = aim = random.uniform(-0.2, 1.0, runs)
    for k in range(samples):
        surge[k] = now
        aim = np.where(random.random(runs) < INTERVAL / 15.0, random.uniform(-0.2, 1.0, runs), aim)
        now = now + INTERVAL / 5.0 * (aim - now)
    clock = np.cumsum(random.uniform(20.0, 60.0, runs) + INTERVAL * np.array(lengths))
    return Voyage(setpoint, surge, start, (clock - clock[0]).round(1))


def logged(
    i: int, length: int, voyage: Voyage, log: Log, largest: float, gyro: bool, surge: bool, random: np.random.Generator
) -> Run:
    """Run `i` as a logger keeps it: heading unwrapped, commands in N m, and what other sensors there are."""
    extras = {"yaw_rate": log.gyro[:length, i].copy()} if gyro else {}
    if surge:
        extras["surge"] = voyage.surge[:length, i] + 0.02 * random.standard_normal(length)
    name, time = f"run_{i:02d}", voyage.clock[i] + INTERVAL * np.arange(length)
    heading = np.unwrap((log.compass[:length, i] + np.pi) % (2 * np.pi) - np.pi)
    return Run(name, f"{name}.csv", time, heading, largest * log.command[:length, i], "N m", extras, dof=YAW)
