"""What to run next: the extra run in which two fitted explanations differ most, and by how many sigma.

Both models are simulated on each kind of run that a pool allows. Of the difference of their headings only what
stands out of the noise and of what the run's own nuisances (start heading, thrust gain, instants of the changes) and
the uncertainty of inertia and drag would do anyway counts: sigma² = d' R^-1 d with R the covariance of such a run.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.smooth import learned_term
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import Found, Trial
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.fits.linear_mixed import SMALLEST_FACTOR
from automarine_cli.fits.mixed_model import MixedFit, derivatives
from automarine_cli.fits.outcome import SMALLEST
from automarine_cli.fits.run_effects import DISTURBANCE, SWITCHES
from automarine_cli.models.yaw_model import steady_rate
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.thrusters.propulsion import parts_of

Command = Callable[[Floats], Floats]

REST, TURN, TAIL, RAMP = 2.0, 8.0, 15.0, 40.0  # seconds of standing, driving, coasting, sweeping
LONGEST = 90.0
LOW_VOLTAGE = 0.85
TELLS, CLEAR = 4.0, 10.0
"""Standard errors from which a run is said to tell two explanations apart, and to do so clearly."""
NOT_TELLING = "none of the usual runs would: log the thrusters' speed or use a second {position} sensor"


@dataclass(frozen=True)
class Advice:
    """One extra run on paper: what it is, and the sentence."""

    kind: str
    sentence: str


def split_by(study: Study, found: Found) -> dict[tuple[str, str], str]:
    """For each rival in `found`: the run that would tell it from the effect named, by (effect, rival). What curves over
    columns would do in runs that nobody has made is not known: of these it is what the rival's card says."""
    curved = learned_term(found.final.model) is not None
    return {
        (rival.replaces, rival.name): effects.get(rival.name).card(study.base.dof).separated_by
        if curved or learned_term(rival.trial.model) is not None
        else suggest(study, found.final, rival.trial, rival.replaces, rival.name).sentence
        for rival in found.rivals
    }


def suggest(study: Study, final: Trial, rival: Trial, name: str, rival_name: str) -> Advice:
    """The kind of extra run on which `final` and `rival` differ most beyond what both could absorb."""
    sigmas = separations(study, final, rival)
    kind = max(sigmas, key=lambda key: sigmas[key])
    sigma = sigmas[kind]
    if sigma < TELLS:
        sentence = (
            f"{study.base.dof.fill(NOT_TELLING)} "
            f"(the best of them, {kind}, separates {name} from {rival_name} by {sigma:.1f} standard errors)"
        )
    else:
        clearly = "clearly" if sigma > CLEAR else f"by {sigma:.0f} standard errors"
        sentence = f"{kind} would separate {name} from {rival_name} {clearly}"
    return Advice(kind, sentence)


def separations(study: Study, final: Trial, rival: Trial) -> dict[str, float]:
    """Sigma between the two models on each kind of extra run."""
    kinds = extra_runs(study)
    extra = replace(study, runs=tuple(kinds.values()), driven=False)  # lays out its own batch
    problem, other = extra.problem(final.model), extra.problem(rival.model)
    if study.driven:
        problem = replace(problem, effects=problem.effects.with_scale(disturbance=1.0))
    b = np.zeros_like(problem.effects.scale)
    phi, theirs = (one.search(np.append(t.fit.of_model, 0.0)) for one, t in ((problem, final), (other, rival)))
    first, by_phi, by_run = derivatives(problem, phi, b)
    second = other.readings(theirs, np.zeros_like(other.effects.scale))
    own = len(study.base.theta)
    values = np.maximum(np.abs(final.fit.theta[:own]), SMALLEST)
    # errors are those of the coordinates of the search, which are not always the same
    ours, here = (np.where(marks[:own], values, 1.0) for marks in (final.fit.positive, problem.positive))
    spread, turn = np.linalg.eigh(final.fit.covariance[:own, :own] * np.outer(ours, ours))
    by_base = (by_phi[:, :, :own] / here) @ (turn * np.sqrt(np.maximum(spread, 0.0)))
    noises = np.array([max(study.sensor_floor, 1e-4), *list(final.fit.noise_of.values())[1:]])
    factors = [_size(final, name) for name in problem.effects.factor_names]
    variances = np.log([*noises, *np.maximum(factors, SMALLEST_FACTOR)])
    precision = problem.precision(noises)
    by_own = by_run * problem.effects.deviation(variances)[:, None, :]
    sigmas = {}
    for i, kind in enumerate(kinds):
        here = problem.seen[i]
        difference = ((second[i] - first[i]) * precision)[here]
        if np.all(np.isfinite(difference)):
            may = np.concatenate([by_base[i][here], by_own[i][here]], axis=1) * precision[here, None]
            pull = may.T @ difference
            kernel = np.eye(may.shape[1]) + may.T @ may
            square = float(difference @ difference - pull @ np.linalg.solve(kernel, pull))
            sigmas[kind] = float(np.sqrt(max(square, 0.0)))
    return sigmas


def _size(final: Trial, name: str) -> float:
    """How large a kind of run effect is, by a fit."""
    if isinstance(final.fit, MixedFit):
        return final.fit.factor(name)
    if name == DISTURBANCE:
        return final.fit.value(f"{final.model.dof.name}.disturbance")
    return 1.0 if name == SWITCHES else final.fit.factor(name)


def extra_runs(study: Study) -> dict[str, Run]:
    """One run of each kind, sampled like the campaign's, with its largest or middle moment."""
    sizes = np.abs(
        np.concatenate([run.command[run.command != 0] for run in study.runs if np.any(run.command)] or [[1.0]])
    )
    large, middle, small = float(sizes.max()), float(np.median(sizes)), float(sizes.min())
    period = float(np.median([run.sample_period for run in study.runs]))
    unit, dof = study.base.moment_unit, study.base.dof
    start, clock = _next_start(study), max(float(run.time[-1]) for run in study.runs) + 60.0
    inertia, rate = study.base.inertia, max(float(steady_rate(large, *study.base.drag())), 1e-3)
    turn = float(np.clip(6.0 * inertia * rate / large, TURN, LONGEST / 3))
    long = float(np.clip(dof.limits.long / rate, turn, LONGEST))
    single = set(PARTS) <= set(study.signals)
    low = max(min(small, 0.5 * middle), 0.02 * large)

    def run(
        name: str, length: float, command: Command, at: float = clock, position: float | None = None,
        port: float = 0.5,
    ) -> Run:  # fmt: skip
        t = np.arange(0.0, length, period)
        psi = np.full(len(t), study.runs[0].position[0] if position is None else position)
        extras = {
            key: np.full(len(t), float(np.mean([np.mean(r.extras[key]) for r in study.runs]))) for key in study.signals
        }
        if dof.velocity in (study.channels or ()):
            extras[dof.velocity] = np.zeros(len(t))
        tau = np.asarray(command(t), dtype=float)
        if single:
            extras |= parts_of([port * tau, (1.0 - port) * tau], dof)
        summed = not study.position_counts
        return Run(name, "extra", t + at, psi, tau, unit, extras, dof=dof, summed_up=summed)

    def step(tau: float, end: float, after: float = 0.0) -> Command:
        return lambda t: np.where(t < REST, 0.0, np.where(t < REST + end, tau, after))

    tag, from_elsewhere = f"{large:.3g} {unit}", {}
    if dof.wraps:  # what depends on the position shows only from another one
        place = f"{dof.shown(start % dof.turn):.0f} {dof.words.units}"
        kind = f"one step of {tag} from a start {dof.words.position} of {place}"
        from_elsewhere[kind] = run("elsewhere", REST + turn, step(large, turn), position=start)
    kinds = {
        f"one coast-down from {tag}": run("coast", REST + turn + TAIL, step(large, turn)),
        f"one reversal at {tag}": run("reversal", REST + 2 * turn, step(large, turn, -large)),
        f"one slow ramp from {-middle:.3g} to {middle:.3g} {unit} over {RAMP:.0f} s": run(
            "ramp", RAMP, lambda t: middle * (2.0 * t / RAMP - 1.0)
        ),
        **from_elsewhere,
        f"one long {dof.words.move} of {long:.0f} s at {tag}": run("long", REST + long, step(large, long)),
        f"one step of only {low:.3g} {unit}": run("small", REST + 3 * turn, step(low, 3 * turn)),
        f"a repeat of {tag} when the campaign has lasted twice as long": run(
            "late", REST + turn, step(large, turn), at=clock + _span(study)
        ),
        "a rest record of 60 s with the thrusters idle": run("rest", 60.0, lambda t: 0.0 * t),
    }
    if single:
        half = step(0.5 * large, turn, -0.5 * large)
        for name, share in (("port", 1.0), ("starboard", 0.0)):
            kind = f"the {name} thruster alone, forward and backward, at {0.5 * large:.3g} {unit}"
            kinds[kind] = run("alone", REST + 2 * turn, half, port=share)
    if "voltage" in study.signals:
        low_run = run("voltage", REST + turn, step(large, turn))
        volts = LOW_VOLTAGE * low_run.extras["voltage"]
        kinds[f"a repeat of {tag} at {volts[0]:.3g} V"] = replace(low_run, extras={**low_run.extras, "voltage": volts})
    return kinds


def _span(study: Study) -> float:
    """How long the campaign lasted [s]."""
    return max(float(r.time[-1]) for r in study.runs) - min(float(r.time[0]) for r in study.runs)


def _next_start(study: Study) -> float:
    """The start heading [rad] farthest from those that the campaign had."""
    used = np.array([run.position[0] for run in study.runs])
    tried = np.arange(24) * np.pi / 12.0
    away = np.abs(np.angle(np.exp(1j * (tried[:, None] - used)))).min(axis=1)
    return float(tried[int(np.argmax(away))])


def general_advice(study: Study) -> tuple[str, ...]:
    """What to run next when nothing is missing: the kinds of runs that the campaign lacks."""
    coasts = reversals = 0
    for run in study.runs:
        pushed = np.sign(run.command)
        moving = np.flatnonzero(pushed)
        if len(moving) == 0:
            continue
        coasts += bool(np.any(pushed[moving[0] :] == 0) and len(run) - moving[-1] > 3.0 / run.sample_period)
        reversals += bool(np.any(pushed[moving] != pushed[moving[0]]))
    rests = sum(not np.any(run.command) for run in study.runs)
    starts = np.array([run.position[0] for run in study.runs])
    even = float(np.abs(np.exp(1j * starts).mean()))
    sides = {float(np.sign(run.command[run.command != 0].mean())) for run in study.runs if np.any(run.command)}
    dof = study.base.dof
    words, advice = dof.words, []
    if coasts < 2:
        advice.append("Add two coast-downs: they separate a dead-band from Coulomb drag and show thrust loss.")
    if reversals < 2:
        advice.append(f"Add two reversals at full {words.force}: lags, delay and swirl show most there.")
    if even > 0.7 and dof.wraps:
        advice.append(
            f"Start runs from other {words.position}s: a {words.sensor} and a current show only against "
            f"{words.position}."
        )
    if len(sides - {0.0}) < 2:
        advice.append(f"{words.move.capitalize()} {words.both_ways}: asymmetry and bias need the other sign.")
    if rests == 0:
        advice.append(
            f"Add one rest record of a minute: bias, current and {words.rate_sensor} drift show without any model."
        )
    if not set(study.signals) - set(PARTS):
        advice.append("Log the supply voltage: without it a sag can hardly be separated from drag.")
    return tuple(advice) or ("The campaign has every kind of run; more runs of the same kinds narrow the intervals.",)
