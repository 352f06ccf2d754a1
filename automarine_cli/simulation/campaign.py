"""`make_campaign`: a specification becomes runs with known truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from math import exp, floor, log2

import numpy as np

from automarine_cli import effects
from automarine_cli.errors import SettingError
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import ordered_map
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.logging_chain import Log, commanded, log_run, sample_times, switch_times
from automarine_cli.simulation.plans import Plan, make_plans
from automarine_cli.simulation.rollout import Start, simulate, step_for
from automarine_cli.simulation.specification import Specification
from automarine_cli.simulation.streams import normal, uniform

FINER = 8.0  # steps are this much shorter than a fit needs: the error stays below the last digit logged
AROUND = 1e-7  # s: the command changes in the middle of an interval of twice this length
CHUNK = 64  # runs that are simulated together
MOST_REDRAWS = 10_000


@dataclass(frozen=True)
class Drawn:
    """What was drawn for one run: start position and sensor's zero [rad or m], the factor on the command delivered,
    the constant moment or force added, the instants [s since the first sample] at which commands changed, and
    the bias of the rate logged [rad/s or m/s].
    """

    start: float
    zero: float
    log_gain: float
    added_moment: float
    switches: Floats
    rate_bias: float = 0.0

    @property
    def gain(self) -> float:
        """Moment or force delivered over the one commanded."""
        return exp(self.log_gain)


@dataclass(frozen=True)
class SimulatedRun:
    """One run: its plan, what was drawn for it, and its log."""

    plan: Plan
    drawn: Drawn
    log: Log


def make_campaign(
    specification: Specification, seed: int | None = None, *, jobs: int = 1, progress: Progress = silent
) -> tuple[SimulatedRun, ...]:
    """All runs in the order in which they were made; the same for any `jobs`. Raises SettingError."""
    seed = specification.seed if seed is None else seed
    plans = make_plans(specification, seed)
    steps = [_step(plan, specification) for plan in plans]
    chunks = _chunks(plans, steps, whole=bool(specification.effects))
    work = [(tuple(plans[i] for i in chunk), min(steps[i] for i in chunk)) for chunk in chunks]
    make = partial(_make, specification=specification, seed=seed)
    found = ordered_map(make, work, jobs, progress=progress, stage="simulating")
    made = dict(zip((i for chunk in chunks for i in chunk), (run for runs in found for run in runs)))
    return tuple(made[i] for i in range(len(plans)))


def _chunks(plans: Sequence[Plan], steps: Sequence[float], whole: bool) -> list[list[int]]:
    """Indices of the runs that are simulated together: runs of one step, so that no run's numbers depend on
    the others.

    The `whole` campaign where there are effects, since an effect may look at all of it.
    """
    if whole:
        return [list(range(len(plans)))] if plans else []
    order = sorted(range(len(plans)), key=lambda i: (steps[i], plans[i].samples, i))
    alike = [list(same) for _, same in groupby(order, key=lambda i: steps[i])]
    return [same[i : i + CHUNK] for same in alike for i in range(0, len(same), CHUNK)]


def _step(plan: Plan, specification: Specification) -> float:
    """Step [s] for one run, a power of two: few different ones, and none depends on the other runs."""
    largest = max((abs(moment) for moment in plan.moments), default=0.0)
    wanted = step_for(specification.model(), largest) / FINER
    return float(2.0 ** floor(log2(wanted)))


def _make(work: tuple[Sequence[Plan], float], specification: Specification, seed: int) -> list[SimulatedRun]:
    """Simulate and log some runs with one step."""
    plans, step = work
    logger = specification.logger
    drawn = [_draw(plan, specification, seed) for plan in plans]
    times = [sample_times(plan, logger, seed) for plan in plans]
    truth = _truth(plans, specification, drawn, times, step, seed)
    made = []
    for plan, draw, time, (position, rate) in zip(plans, drawn, times, truth):
        reading = position + draw.zero
        sensed = rate + draw.rate_bias
        log = log_run(plan, logger, seed, time, reading, sensed, draw.switches, specification.vehicle.dof)
        made.append(SimulatedRun(plan, draw, log))
    return made


def _draw(plan: Plan, specification: Specification, seed: int) -> Drawn:
    scatter, key = specification.scatter, plan.key
    if scatter.start == "random":
        start = 360.0 * float(uniform(1, seed, key, "start heading")[0])
    elif isinstance(scatter.start, tuple):
        start = scatter.start[plan.turn % len(scatter.start)]
    else:
        start = float(scatter.start)
    dof, bias = specification.vehicle.dof, specification.logger.rate_bias or 0.0
    return Drawn(
        start=float(dof.inner(start)),
        zero=float(dof.inner(scatter.zero) * normal(1, seed, key, "heading zero")[0]),
        log_gain=scatter.gain * float(normal(1, seed, key, "gain")[0]),
        added_moment=_added_moment(plan, specification, seed),
        switches=switch_times(plan, specification.logger, seed),
        rate_bias=float(dof.inner(bias) * normal(1, seed, key, "rate bias")[0]),
    )


def _added_moment(plan: Plan, specification: Specification, seed: int) -> float:
    scatter = specification.scatter
    if scatter.force == 0:
        return 0.0
    smallest = min((abs(moment) for moment in plan.moments if moment), default=np.inf)
    most = np.inf if scatter.force_most is None else scatter.force_most * smallest
    for draw in range(MOST_REDRAWS):
        moment = scatter.force * float(normal(1, seed, plan.key, "moment", str(draw))[0])
        if abs(moment) <= most:
            return moment
    force = specification.vehicle.dof.words.force
    raise SettingError(
        f"{specification.source}: scatter.{force} is {scatter.force:g}, far above {force}_most of the {force} "
        f"{smallest:g} of run {plan.name!r}; expected less scatter, or a larger {force}_most"
    )


def _truth(
    plans: Sequence[Plan],
    specification: Specification,
    drawn: Sequence[Drawn],
    times: Sequence[Floats],
    step: float,
    seed: int,
) -> list[tuple[Floats, Floats]]:
    """True reading [rad or m] and rate [rad/s or m/s] of each run at its samples."""
    model = specification.model()
    held = specification.campaign.held
    clocks = [_knots(time, draw.switches, held) for time, draw in zip(times, drawn)]
    runs = [
        Run(
            name=plan.name,
            source=plan.file,
            time=plan.start + clock,
            position=np.zeros_like(clock),
            moment=commanded(clock, draw.switches, plan.moments),
            moment_unit=model.moment_unit,
            dof=model.dof,
        )
        for plan, draw, clock in zip(plans, drawn, clocks)
    ]
    batch = make_batch(runs, step, hold=False)
    added = np.array([draw.added_moment for draw in drawn])
    start = Start(
        position=np.array([[draw.start for draw in drawn]]),
        log_gain=np.array([[draw.log_gain for draw in drawn]]),
        own=_own_phases(model, plans, seed),
        disturbance=np.broadcast_to(added[None, :, None], (1, len(plans), batch.windows)),
    )
    found = simulate(model, batch, start=start)
    truth = []
    for i, (plan, clock, time) in enumerate(zip(plans, clocks, times)):
        node = np.searchsorted(clock, np.maximum(time, clock[0]))  # held still before the clock begins
        if plan.group.fault == "never-moves":
            node = np.zeros_like(node)
        truth.append((found.position[0, i, node], found.velocity[0, i, node]))
    return truth


def _own_phases(model: YawModel, plans: Sequence[Plan], seed: int) -> dict[str, Floats]:
    """Sine and cosine (1, R, 2) of each run's own wave, for effects that vary from run to run: any phase is as
    likely."""
    own = {}
    for term in model.terms:
        if effects.get(term.name).varies(term.values):
            phase = np.array([2.0 * np.pi * uniform(1, seed, plan.key, term.name)[0] for plan in plans])
            own[term.name] = term.values[0] * np.stack([np.cos(phase), np.sin(phase)], axis=1)[None]
    return own


def _knots(time: Floats, switches: Floats, held: bool) -> Floats:
    """Instants at which a run is simulated [s]: its samples, and close to both sides of each change of command.

    They begin with the first sample; with the first change where that comes earlier or the vehicle is `held`.
    """
    first = time[0]
    if len(switches) and (held or switches[0] < first):
        first = switches[0]
    knots = np.unique(np.concatenate([[first], time, switches - AROUND, switches + AROUND]))
    return np.asarray(knots[knots >= first])
