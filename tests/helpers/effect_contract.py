"""What every effect must do, one judge for all: a new file in `automarine_cli/effects` is judged without a line here.

`planted` makes runs of the paper's vehicle with effects in it; the contract itself is in `test_effects`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from made_runs import INERTIA, K_RR

from automarine_cli import effects
from automarine_cli.dofs import YAW
from automarine_cli.effects import Effect
from automarine_cli.effects.base import MIXED, ODD
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.logs.columns import SIGNALS
from automarine_cli.models.model import Model
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate
from automarine_cli.thrusters.map import parts_of

Plan = Sequence[tuple[float, float]]

PERIOD, WAIT, REST = 0.1, 60.0, 1.5  # s
LARGEST = 1.2

MIRRORED_SIGNS = {
    "compass-deviation": (1, -1, 1, -1, 1),  # sine terms are odd in the heading, cosine terms even
    "current-deviation": (1, -1, 1),
    "heading-moment": (1, -1),
    "thruster-imbalance": (-1, -1, 1),  # port and starboard change places
    "wall": (1, -1, 1, 1, -1),
    "periodic-disturbance": (-1, -1, 1, 1),  # the moment turns round, the period stays
}
"""What a mirrored campaign does to each parameter of a MIXED effect."""
SIZES: Mapping[str, tuple[float, ...]] = {
    "battery-sag": (0.5, 0.12),
    "battery-sag 1": (0.5, 0.25, 5.0),
    "battery-sag 2": (0.5, 0.8),
    "compass-deviation": (0.06, -0.04, 0.03, 0.02),
    "compass-deviation 2": (0.05, 0.04),
    "coulomb-drag 1": (0.03, 0.06, 0.15),
    "current-deviation": (0.06, 0.04),
    "cross-coupling": (0.4,),
    "cubic-drag": (0.35,),
    "dead-band 1": (0.35,),
    "dead-band 2": (0.4, 0.5),
    "drag-asymmetry": (0.12,),
    "heading-moment": (0.05, -0.03),
    "history-force": (0.4, 3.0),
    "history-force 1": (0.3,),
    "input-delay": (0.3,),
    "input-delay 1": (0.2, 0.45),
    "linear-drag": (0.2,),
    "periodic-disturbance": (0.06, -0.04, 3.1),
    "rudder": (2.0,),
    "rudder 1": (1.5, 0.05),
    "rudder 2": (0.15,),
    "rudder-inflow": (0.6,),
    "rudder-race": (1.5,),
    "rudder-rate": (0.6,),
    "rudder-rate 1": (0.8, 0.5),
    "rudder-stall": (0.6, 0.5),
    "saturation": (0.8,),
    "saturation 1": (1.5,),
    "tether-spring 1": (0.03, 1.5),
    "tether-spring 2": (0.01, 0.002),
    "thrust-exponent": (1.2,),
    "thrust-loss": (0.25,),
    "thruster-dead-band": (0.05,),
    "thruster-imbalance": (0.12, -0.08, 0.1),
    "thruster-lag": (0.3,),
    "thruster-limit": (0.5,),
    "thruster-lag 3": (0.5,),
    "thruster-lag 4": (0.3, 2.2),
    "wall": (0.25, -0.15),
    "wall 1": (0.15, -0.1),
    "water-swirl": (0.25, 8.0),
    "water-swirl 5": (0.3, 8.0, 2.5),
}
"""Sizes that show in the campaign below, where half more than the start is not one; references left out."""


def base_for(name: str, scale: float = 1.0, unit: str = "nu") -> Model:
    """The paper's vehicle as model 3; as model 1 for the effect that is its own drag, and steered for
    what acts on rudders."""
    name = name.partition(" ")[0]
    unit = STEERED if name in effects.names() and effects.get(name).acts_on else unit
    if name == "quadratic-drag":
        return Model.base("1", scale * INERTIA, (scale * 0.6,), unit, YAW)
    return Model.base("3", scale * INERTIA, (scale * K_RR,), unit, YAW)


def laws_of(effect: Effect) -> int:
    """How many laws it has; one that lets runs vary is judged by tests of its own."""
    return 1 if effect.per_run else len(effect.places)


def law_names() -> list[str]:
    """Every law of every effect: "water-swirl" is its first one, "water-swirl 1" the next."""
    turning = [name for name in effects.names() if effects.get(name).acts_in(YAW)]
    every = [(name, law) for name in turning for law in range(laws_of(effects.get(name)))]
    return [f"{name} {law}" if law else name for name, law in every]


def of_law(name: str) -> tuple[Effect, int]:
    """The effect of such a name, and its law."""
    first, _, law = name.partition(" ")
    return effects.get(first), int(law or 0)


def sizes_of(effect: Effect, law: int = 0) -> tuple[float, ...]:
    """Values of all parameters with which the effect is planted, for moments up to LARGEST, in one of its laws; a
    parameter that this law does not use is at its start, or at nothing."""
    fixed = {"moment": LARGEST, "clock": 0.0, "voltage": 12.0, "surge": 0.3}
    own = iter(SIZES.get(f"{effect.name} {law}", SIZES.get(effect.name, ())) if law else SIZES.get(effect.name, ()))
    at_law = tuple(float(law) if p.choices else p.start for p in effect.parameters)
    return tuple(
        fixed[p.reference] if p.reference
        else float(law) if p.choices
        else (p.start if p.laws else p.off) if held
        else next(own, 1.5 * p.start if p.start != p.off else 0.03)
        for p, held in zip(effect.parameters, effect.held(at_law))
    )  # fmt: skip


def with_planted(base: Model, *names: str) -> Model:
    """The model with these effects at their planted sizes."""
    for name in names:
        effect, law = of_law(name)
        base = base.with_effect(effect.name, sizes_of(effect, law))
    return base


def long_plans(sizes: Sequence[float] = (0.12, 0.25, 0.5, 0.8, 1.2)) -> list[Plan]:
    """Steps to both sides, long turns, coast-downs, reversals and manoeuvres, as (moment, seconds)."""
    both = (1.0, -1.0)
    steps: list[Plan] = [[(s * size, 6.0 + 3.0 / size**0.5)] for size in sizes for s in both]
    coast: list[Plan] = [[(s * 1.0, 6.0), (0.0, 9.0)] for s in both]
    back: list[Plan] = [[(s * 0.7, 8.0), (-s * 0.7, 10.0)] for s in both]
    moves: list[Plan] = [
        [(0.3, 5.0), (1.1, 4.0), (-0.6, 6.0), (0.0, 5.0)],
        [(-0.9, 4.0), (-0.2, 6.0), (0.9, 3.0), (-0.9, 4.0)],
    ]
    return steps + coast + back + moves


def short_plans() -> list[Plan]:
    """Fewer and shorter: seven shapes of run, each to both sides."""
    there: list[Plan] = [
        [(0.12, 10.0)],
        [(0.3, 9.0)],
        [(0.7, 8.0)],
        [(1.2, 7.0)],
        [(0.9, 4.0), (0.0, 6.0)],
        [(0.6, 5.0), (-0.6, 5.5)],
        [(0.2, 3.0), (1.0, 2.5), (-0.4, 3.0), (0.0, 2.0)],
    ]
    return [[(sign * moment, seconds) for moment, seconds in plan] for plan in there for sign in (1.0, -1.0)]


def made_signal(name: str, number: int, time: Floats) -> Floats:
    """A logged column that changes from run to run and within a run, in no step with the command nor with another."""
    signal, phase = SIGNALS[name], list(SIGNALS).index(name)
    of_run = np.sin(2.3 * number + phase)
    return signal.usual + signal.swing * (0.6 * of_run + 0.4 * np.sin((0.5 + 0.1 * phase) * time + number + phase))


def mirrored(run: Run) -> Run:
    """The run with its command and all that changes sides negated: port and starboard thruster have changed places."""
    signals = {name: SIGNALS[name].sign * column for name, column in run.extras.items() if name in SIGNALS}
    ahead, astern, other_ahead, other_astern = (-run.extras[part] for part in PARTS)
    parts = dict(zip(PARTS, (other_ahead, other_astern, ahead, astern)))
    return run.with_moment(-run.command, run.moment_unit, {**signals, **parts})


def unmeasured(plan: Plan, number: int, moment_unit: str = "nu", scale: float = 1.0) -> Run:
    """The run of a plan before anything was measured: clock, command, every signal, no heading yet."""
    whole = [(0.0, REST), *plan]
    ends = np.cumsum([seconds for _, seconds in whole])
    time = np.arange(0.0, ends[-1] - PERIOD / 4, PERIOD)
    command = scale * np.array([moment for moment, _ in whole])[np.searchsorted(ends, time, side="right")]
    # way on beside the turn: what both thrusters push alike, as the moment of one
    along = scale * 0.5 * np.sin(1.1 * number + 0.9 * time)
    parts = parts_of([0.5 * command + along, 0.5 * command - along], YAW)
    extras = {name: made_signal(name, number, time) for name in SIGNALS} | parts
    name = f"run_{number:02d}"
    clock = WAIT * number + time
    return Run(name, f"{name}.csv", clock, np.zeros(len(time)), command, moment_unit, extras, dof=YAW)


def measured(
    truth: Model,
    runs: Sequence[Run],
    *,
    seed: int = 0,
    noise_deg: float = 0.5,
    gain: float = 0.02,
    snag: Callable[[tuple[int, ...]], Floats] | None = None,
) -> list[Run]:
    """The runs as a vehicle of that truth makes them: any start heading, thrust scatter, commands that change
    anywhere between two samples, white noise of the heading; `snag` gives a moment for each window of the batch.
    """
    random = np.random.default_rng(seed)
    batch = make_batch(runs, 0.05, truth.signals)
    shape = (1, *batch.interval.shape)
    start = Start(
        position=random.uniform(-np.pi, np.pi, (1, len(runs))),
        log_gain=gain * random.standard_normal((1, len(runs))),
        switch_delay=batch.interval[None] * random.uniform(-0.5, 0.5, shape),
        disturbance=None if snag is None else snag((1, len(runs), batch.windows)),
    )
    found = simulate(truth, batch, start=start).position[0]
    found = found + np.deg2rad(noise_deg) * random.standard_normal(found.shape)
    return [replace(run, position=row[: len(run)]) for run, row in zip(runs, found)]


def planted(
    base: Model, *names: str, seed: int = 0, plans: Sequence[Plan] | None = None, noise_deg: float = 0.5
) -> list[Run]:
    """A campaign of the base vehicle with these effects in it, its runs in random order."""
    chosen = long_plans() if plans is None else plans
    order = np.random.default_rng(1000 + seed).permutation(len(chosen))
    runs = [unmeasured(chosen[i], number, base.moment_unit) for number, i in enumerate(order)]
    return measured(with_planted(base, *names), runs, seed=seed, noise_deg=noise_deg)


def mirrored_signs(effect: Effect) -> tuple[int, ...]:
    """What becomes of each parameter when heading and command are negated."""
    if effect.parity == MIXED:
        return MIRRORED_SIGNS[effect.name]
    return tuple(-1 if effect.parity == ODD and not p.held else 1 for p in effect.parameters)
