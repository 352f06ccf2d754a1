"""All runs under all models of a file: free and restarted runs, their scores (sums a run, so that runs pool and
resample exactly) with intervals over runs, which model does best, what filters predict.

Predictions are from filtered states on driven and disturbed runs, beside somebody who expects no change. The models'
own parameters are held; the sizes of what is random (disturbance, unsteady thrust, scatter of the gain, noise) are
fitted on these very runs, for no file knows the weather of their day.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from automarine_cli.comparison.simulated_runs import (
    FreeRun,
    Restarts,
    find_restarts,
    free_runs,
    planar_free_runs,
    planar_overshoots,
    remade,
    restarted_errors,
)
from automarine_cli.dofs import PLANAR, YAW, Dof
from automarine_cli.effects.thruster_imbalance import lacking_signal
from automarine_cli.errors import FitError, ModelError, RunError, SettingError
from automarine_cli.filters.course import make_course
from automarine_cli.filters.kalman import Predicted, predict
from automarine_cli.fits.characteristics import overshoots, overshoots_json
from automarine_cli.fits.driven import (
    Judgement,
    base_starts,
    by_model_alone,
    driven_problem,
    is_driven,
    judged_of,
    mostly_held,
    worth_of,
)
from automarine_cli.fits.innovations import channels_json, fit_innovations, measured_noises
from automarine_cli.fits.preference import forecast_losses, is_ahead, outweighs
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels, Use
from automarine_cli.pipeline.parallel import Progress, counted, silent
from automarine_cli.pipeline.records import ResultKind, ResultRecord, Shown, keyed
from automarine_cli.quantities import Floats
from automarine_cli.runs.channels import NOTHING_TO_CHOOSE, ChannelChoice, unbiased_velocity
from automarine_cli.runs.checks import without_undriven
from automarine_cli.runs.half_turn import start_at_rest
from automarine_cli.runs.load import GAP_IN_PERIODS, LoadedRuns, load_runs, require_usable
from automarine_cli.runs.run import ExcludedRun, Run, command_warnings, position_noise, runs_json
from automarine_cli.text import format_value
from automarine_cli.thrusters.map import driven_by, moment_maker

SMOOTHING_S = 1.0  # over which a position is smoothed for its rate; 5 samples at least
MIN_RUNS_OF_INTERVAL = 3
RESAMPLES = 2000  # how often each run is in each
EXPECTED_DRAWS = 3  # how often runs are simulated anew with more thrust and with less
SINGLE_RUN = np.ones((1, 1), dtype=np.int64)  # the only resample of one run
NO_ERRORS = np.zeros(0)
RMS, MAX, FIT = "rms", "max", "fit"


class ScoreKind(NamedTuple):
    """A size of errors of one kind; its key in files and its heading in tables are templates."""

    errors: str
    size: str
    key: str
    heading: str


SCORES = {
    "rmse": ScoreKind("position", RMS, "rmse_{shown_unit}", "rmse {shown_unit}"),
    "max_abs": ScoreKind("position", MAX, "max_abs_{shown_unit}", "max {shown_unit}"),
    "fit_percent": ScoreKind("position", FIT, "fit_percent", "fit %"),
    "restarted_rmse": ScoreKind("restarted", RMS, "restarted_rmse_{shown_unit}", "restarted rmse {shown_unit}"),
    "rate_rmse": ScoreKind("rate", RMS, "{speed}_rmse_{shown_unit}_s", "{speed} rmse {shown_unit}/s"),
}
"""Of one degree of freedom: free runs from the start of each run to its end, fit 100 (1 - |error| / |measured - its
mean|), restarted with the state set anew from the smoothed measured position."""
PLANAR_SCORES = {
    score.key: score
    for score in (
        ScoreKind("heading", RMS, "heading_rmse_deg", "heading deg"),
        ScoreKind("heading", MAX, "heading_max_abs_deg", "max deg"),
        ScoreKind("position", RMS, "position_rmse_m", "position m"),
        ScoreKind("position", MAX, "position_max_abs_m", "max m"),
        ScoreKind("surge", RMS, "surge_rmse_m_s", "surge m/s"),
        ScoreKind("sway", RMS, "sway_rmse_m_s", "sway m/s"),
        ScoreKind("yaw_rate", RMS, "yaw_rate_rmse_deg_s", "yaw rate deg/s"),
    )
}


@dataclass(frozen=True)
class Overall:
    """One score over all runs, with its 95 % interval over runs where there are three or more."""

    value: float | None
    ci95: tuple[float, float] | None = None


Errors: TypeAlias = Mapping[str, Floats]
"""Errors (n,) of one run under one model by kind, in the unit that people see, none at all where the simulation
diverges; `measured` is the position about its mean."""


def errors_of(free: FreeRun, restarted: Floats) -> Errors:
    """Errors of a free run, and those restarted (N,) [rad or m], which are none where a restart diverges."""
    if free.diverged:
        return {}
    dof = free.run.dof
    again = dof.shown(restarted[1:]) if np.all(np.isfinite(restarted)) else np.zeros(0)
    measured = dof.shown(free.run.position)
    position, rate = dof.shown(free.error), rate_error(free)
    return {"position": position, "restarted": again, "rate": rate, "measured": measured - measured.mean()}


def planar_errors(free: FreeRun) -> Errors:
    """Errors of a free run in the plane, of what its log holds."""
    if free.diverged:
        return {}
    names = (YAW.position, *(dof.velocity for dof in PLANAR.dofs))
    errors = {"position": free.distance} | {name: free.error_of(name) for name in names}
    scale = {name: YAW.logged(1.0) for name in YAW.channels}
    return {
        name: scale.get(name, 1.0) * error[np.isfinite(error)] for name, error in errors.items() if error is not None
    }


def rate_error(free: FreeRun) -> Floats:
    """Return measured less simulated rate, in the unit that people see, as many values as there are. With a rate in the
    log, less its bias, at the samples that have one; otherwise both positions are treated alike, put on an even grid
    and differentiated by Savitzky and Golay's parabola, never across a gap."""
    run, dof = free.run, free.run.dof
    logged = unbiased_velocity(run)
    if logged is not None:
        return np.asarray(dof.shown((logged - free.rate)[~np.isnan(logged)]))
    period = run.sample_period
    width = max(5, 2 * round(SMOOTHING_S / period / 2) + 1)
    arm = np.arange(width // 2, -width // 2, -1)  # the parabola's slope, as `np.convolve` takes weights
    weights = arm / (arm @ arm) / period
    edges = np.flatnonzero(np.diff(run.time) > GAP_IN_PERIODS * period) + 1
    slopes = [np.zeros(0)]
    for time, error in zip(np.split(run.time, edges), np.split(free.error, edges)):
        even = np.arange(time[0], time[-1] + 1e-6 * period, period)
        if len(even) >= width:
            slopes.append(np.convolve(np.interp(even, time, error), weights, mode="valid"))
    return np.asarray(dof.shown(np.concatenate(slopes)))


def pooled(runs: Sequence[Errors], score: ScoreKind, drawn: NDArray[np.int64] = SINGLE_RUN) -> Overall:
    """Return one score over runs, all samples pooled or the largest error of all, with its interval over the resamples
    `drawn`; nothing under a model that diverged in any run."""
    errors = [run.get(score.errors, NO_ERRORS) for run in runs]
    below = _squares(runs, "measured") if score.size == FIT else np.array([float(len(error)) for error in errors])
    if below.sum() <= 0 or not all(runs):
        return Overall(None)
    if score.size == MAX:
        return Overall(max(float(np.abs(error).max()) for error in errors if len(error)))
    root, roots = _roots(_squares(runs, score.errors), below, drawn)
    if score.size == FIT:
        root, roots = 100.0 * (1.0 - root), 100.0 * (1.0 - roots)
    return Overall(root, _interval(roots, int(np.sum(below > 0))))


def lead(better: Sequence[Errors], worse: Sequence[Errors], drawn: NDArray[np.int64]) -> Overall:
    """Return by how much the pooled free-run rmse of one model is below another's, over the same resamples."""
    counts = np.array([float(len(run["position"])) for run in worse])
    (first, firsts), (second, seconds) = (_roots(_squares(s, "position"), counts, drawn) for s in (worse, better))
    return Overall(first - second, _interval(firsts - seconds, len(better)))


def _squares(runs: Sequence[Errors], kind: str) -> Floats:
    return np.array([error @ error for error in (run.get(kind, NO_ERRORS) for run in runs)])


def _roots(above: Floats, below: Floats, drawn: NDArray[np.int64]) -> tuple[float, Floats]:
    """Return the root of a ratio of sums over runs, and of each resample of these."""
    sums = drawn @ below
    return float(np.sqrt(above.sum() / below.sum())), np.sqrt((drawn @ above)[sums > 0] / sums[sums > 0])


def _interval(draws: Floats, runs: int) -> tuple[float, float] | None:
    if runs < MIN_RUNS_OF_INTERVAL:
        return None
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(low), float(high)


@dataclass(frozen=True)
class Scored:
    """One model: its free runs and their errors in the order of the runs, and its scores over all of them by name."""

    free: tuple[FreeRun, ...]
    errors: tuple[Errors, ...]
    overall: Mapping[str, Overall]

    @property
    def diverged(self) -> tuple[str, ...]:
        return tuple(free.run.name for free in self.free if free.diverged)

    @cached_property
    def values(self) -> list[dict[str, float | None]]:
        """The scores of each run."""
        table = SCORES | PLANAR_SCORES
        return [{name: pooled([errors], table[name]).value for name in self.overall} for errors in self.errors]


@dataclass(frozen=True, kw_only=True)
class ScoreEntry:
    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}", "heading_rmse_deg"))
    ci95: tuple[float, float] | None = field(default=None, metadata=keyed("rmse_{shown_unit}_ci95"))
    restarted: float | None = field(default=None, metadata=keyed("restarted_rmse_{shown_unit}"))
    runs: Mapping[str, "ScoreEntry"] = field(default_factory=dict)


@dataclass(frozen=True)
class ForecastEntry:
    horizon_s: float
    runs: Mapping[str, float] = field(default_factory=dict)
    rmse: float | None = field(default=None, metadata=keyed("rmse_{shown_unit}"))
    constant_rate: float | None = field(default=None, metadata=keyed("constant_rate_{shown_unit}"))
    constant: float | None = field(default=None, metadata=keyed("constant_{position}_{shown_unit}"))


@dataclass(frozen=True, kw_only=True)
class ValidationFile(ResultRecord):
    """`validation.json`: the models of a file against measured runs; of a planar model there is one, and no fit."""

    models: Mapping[str, ScoreEntry]
    best: str
    preferred_by_fit: str = ""
    noise_floor: float | None = field(default=None, metadata=keyed("noise_floor_{shown_unit}"))
    expected: float | None = field(default=None, metadata=keyed("restarted_expected_{shown_unit}"))
    use: Use = field(default_factory=Use)
    contradiction: str = ""
    logs: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    prediction: Mapping[str, tuple[ForecastEntry, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.best not in self.models:
            raise SettingError(f"best: found {format_value(self.best)}, expected one of {', '.join(self.models)}")

    @property
    def judged(self) -> str:
        """The number of the model that counts: who has no more logs cannot know which does best on them."""
        return self.preferred_by_fit if self.preferred_by_fit in self.models else self.best


VALIDATION = ResultKind("validation.json", "validation", ValidationFile, "validate")


@dataclass(frozen=True, repr=False)
class Validation(Shown):
    """What was measured against what each of the `stored` models says; in the plane there is one, and no restarts.

    `models` has the scores of each by number, `scores` what is scored, `key(name)` the column of a score, `dof` the
    motion. `best` is the number of the model with the smallest free-run error of position over all runs, None where
    every model diverged; `because` is the sentence that says so. `runs` are the logs, `restarts` where they were
    simulated anew, `set_aside` those left out, each with its reason. `floors` are the noise of the runs' positions, in
    the unit that people see, `floor` that of all; `channels` the sensors used. Where the runs are driven there are
    `predictions` of each model from filtered states, which count for nothing of those `outweighed` by the likelihood of
    the preferred one, and `use` says of what use it is. `expected` is the restarted error that the preferred model
    would have if it were right; `followed_better` the model whose free runs are nearer than its own by more than
    chance, empty for none, and `contradiction` says so. `overshoots` are the angles [rad] of
    zigzags by a rudder, of logs and of the preferred model. `says` is a summary. `to_json()` is validation.json.

    Frame, a row per run and model: `run`, `model`, `rmse_deg`, `max_abs_deg`, `fit_percent`, `restarted_rmse_deg`,
    `rate_rmse_deg_s`, `noise_floor_deg`, `restarted_horizon_s`, `restarted_at`, `start`.

    Keys: `schema`, `models`, `best`, `logs`, `runs`, `noise_floor_deg`, `restarted_expected_deg`, `best_because`,
    `preferred_by_fit`, `effects`, `moment_unit`, `command_delay_s`.
    """

    stored: StoredModels
    models: Mapping[str, Scored]
    best: str | None
    because: str = ""
    restarts: tuple[Restarts, ...] = ()
    floors: tuple[float, ...] = ()
    set_aside: tuple[ExcludedRun, ...] = ()
    channels: ChannelChoice = NOTHING_TO_CHOOSE
    predictions: Mapping[str, tuple[Predicted, ...]] = field(default_factory=dict)
    outweighed: frozenset[str] = frozenset()
    expected: float | None = None
    followed_better: str = ""
    overshoots: tuple[tuple[float, float], ...] = ()

    @property
    def contradiction(self) -> str:
        """Say which model these runs bear out in place of the one that the fit preferred; empty for none."""
        preferred, unit = self.stored.preferred, self.dof.units.shown
        if (ahead := self._ahead) is not None:
            rival = next((number for number in ahead if number not in self.outweighed), "")
            pair = [judged_of(worth_of(self.predictions[number])) for number in (rival, preferred) if number]
            sizes = [(float(self.dof.shown(score.error)), f"{score.horizon:g} s ahead") for score in pair if score]
        else:
            rival = self.followed_better
            values = [self.models[number].overall["rmse"].value for number in (rival, preferred) if number]
            sizes = [(value, "over whole runs") for value in values if value is not None]
        if not rival or len(sizes) < 2 or sizes[0][0] > (1.0 - MIN_CONTRADICTION) * sizes[1][0]:
            return ""
        (error, where), (error_of_preferred, _) = sizes
        return (
            f"These runs contradict the fit, which preferred model {preferred}: model {rival} is off by {error:.3g} "
            f"{unit} {where}, model {preferred} by {error_of_preferred:.3g}. A fit to the logs of both decides."
        )

    @cached_property
    def _ahead(self) -> list[str] | None:
        """Models that predict better than the preferred one by more than chance, best first; None where none can."""
        if (losses := forecast_losses(self.predictions, len(self.runs)) if self.predictions else None) is None:
            return None
        ranked = sorted(losses, key=lambda number: float(losses[number].sum()))
        return [number for number in ranked if is_ahead(losses[number], losses[self.stored.preferred])]

    @property
    def use(self) -> Judgement | None:
        """What the model that the fit preferred predicts: who has no more logs cannot know which does best on them."""
        if self.stored.in_plane or not self.predictions:
            return None
        worth = {self.dof.position: worth_of(self.predictions[self.stored.preferred])}
        return Judgement(worth, len(self.runs), biased=bool(self.outweighed.intersection(self._ahead or ())))

    @property
    def says(self) -> str:
        """Say whether the preferred model is of use on driven runs; empty for others."""
        if self.use is None:
            return ""
        which = ", which the fit preferred," if len(self.models) > 1 else ""
        return self.use.sentence(self.dof, f"Model {self.stored.preferred}{which}", "on these runs")

    @property
    def runs(self) -> tuple[Run, ...]:
        return tuple(free.run for free in next(iter(self.models.values())).free)

    @property
    def dof(self) -> Dof:
        """That of the words; yaw in the plane."""
        return self.stored.dof

    @property
    def scores(self) -> Mapping[str, ScoreKind]:
        return PLANAR_SCORES if self.stored.in_plane else SCORES

    @property
    def floor(self) -> float:
        """The noise of all runs together, pooled as an rmse is."""
        return float(np.sqrt(np.average(np.square(self.floors), weights=[len(run) for run in self.runs])))

    def key(self, name: str) -> str:
        return self.dof.fill(self.scores[name].key)

    def to_json(self) -> dict[str, object]:
        stored, dof, runs, unit = self.stored, self.dof, self.runs, self.dof.units.shown
        logs: dict[str, dict[str, object]] = {
            run.name: {"file": run.source, "samples": len(run), "duration_s": float(run.time[-1] - run.time[0])}
            for run in runs
        }
        data: dict[str, object] = {
            "schema": VALIDATION.schema,
            **({"motion": stored.model.motion.name} if stored.in_plane or not dof.wraps else {}),
            "models": {number: self._model_json(scored) for number, scored in self.models.items()},
            "best": self.best,
            "logs": logs,
            "runs": runs_json(len(runs), self.set_aside, runs),
            **({"overshoot_deg": overshoots_json(self.overshoots)} if self.overshoots else {}),
        }
        if stored.in_plane:
            return data
        for run, floor, restarts in zip(runs, self.floors, self.restarts):
            logs[run.name] |= {
                f"noise_floor_{unit}": floor, "restarts": len(restarts.states), "restarted_at": restarts.rule,
                "restarted_horizon_s": restarts.horizon,
            }  # fmt: skip
        if self.contradiction:
            data["contradiction"] = self.contradiction
        if self.use is not None:
            prediction = {number: self._ahead_json(predicted) for number, predicted in self.predictions.items()}
            data |= {"prediction": prediction, "use": {"of_use": self.use.of_use, "says": self.says}}
        return data | {
            f"noise_floor_{unit}": self.floor, f"restarted_expected_{unit}": self.expected,
            "best_because": self.because, "preferred_by_fit": stored.preferred,
            "effects": list(stored.effects), f"{dof.words.force}_unit": stored.model.moment_unit,
            "command_delay_s": stored.command_delay, **channels_json(self.channels, measured_noises(runs, dof)),
        }  # fmt: skip

    def _ahead_json(self, predicted: tuple[Predicted, ...]) -> list[dict[str, object]]:
        """By horizon, in the unit in which people see positions."""
        entries = [score.to_json(self.dof) for score in worth_of(predicted)]
        for entry, ahead in zip(entries, predicted):
            sizes = self.dof.shown(np.sqrt(ahead.by_run(len(self.runs))))
            entry["runs"] = {run.name: float(size) for run, size in zip(self.runs, sizes) if np.isfinite(size)}
        return entries

    def _model_json(self, scored: Scored) -> dict[str, object]:
        overall = {self.key(name): score for name, score in scored.overall.items()}
        return {
            **{key: score.value for key, score in overall.items()},
            **{f"{key}_ci95": list(score.ci95) for key, score in overall.items() if score.ci95 is not None},
            "diverged": list(scored.diverged),
            "runs": {
                free.run.name: {self.key(name): value for name, value in values.items()}
                | {"diverged": free.diverged}
                | ({"start": free.start.how} if free.start.how else {})
                for free, values in zip(scored.free, scored.values)
            },
        }


def compare(stored: StoredModels, runs: Sequence[Run], seed: int = 0, progress: Progress = silent) -> Validation:
    """Simulate and score `runs` under every model. Raises RunError as `make_batch`."""
    drawn = np.random.default_rng(seed).multinomial(len(runs), np.full(len(runs), 1.0 / len(runs)), size=RESAMPLES)
    models: dict[str, Scored] = {}
    if stored.in_plane:
        free = tuple(planar_free_runs(stored.model, runs))
        errors = tuple(map(planar_errors, free))
        overall = {name: pooled(errors, score, drawn) for name, score in PLANAR_SCORES.items()}
        models[stored.preferred] = Scored(free, errors, overall)
        return Validation(stored, models, stored.preferred, overshoots=_overshoots(stored, runs))
    restarts = tuple(map(find_restarts, runs))
    for number, model in stored.models.items():
        simulated = free_runs(model, runs)
        free = tuple(counted(progress, f"simulating model {number}", simulated, len(runs)))
        errors = tuple(map(errors_of, free, restarted_errors(model, free, restarts)))
        models[number] = Scored(free, errors, {name: pooled(errors, score, drawn) for name, score in SCORES.items()})
    values = {number: scored.overall["rmse"].value for number, scored in models.items()}
    ranked = sorted((value, len(stored.models[n].theta), n) for n, value in values.items() if value is not None)
    best, because = _because([number for *_, number in ranked], models, drawn, stored)
    floors = tuple(float(run.dof.shown(position_noise(run.time, run.position))) for run in runs)
    expected = expected_error(stored.model, models[stored.preferred].free, stored.scatter, seed)
    is_rival = best not in (None, stored.preferred) and values[stored.preferred] is not None
    better = best if best and is_rival and _leads(models[best], models[stored.preferred], drawn)[1] else ""
    validation = Validation(stored, models, best, because, restarts, floors, expected=expected, followed_better=better)
    return replace(validation, overshoots=_overshoots(stored, runs))


def _overshoots(stored: StoredModels, runs: Sequence[Run]) -> tuple[tuple[float, float], ...]:
    """Give overshoot angles of zigzags, of logs and of the preferred model; none where that diverges."""
    angles_of = planar_overshoots if stored.in_plane else overshoots
    steered = stored.in_plane or stored.model.steered
    pairs = [pair for run in runs for pair in angles_of(stored.model, run)] if steered else []
    return tuple(pairs) if np.isfinite(pairs).all() else ()


def expected_error(model: Model, free: Sequence[FreeRun], scatter: float | None, seed: int) -> float | None:
    """Return the restarted error that the model would have if it were right, in the unit that people see. The runs are
    simulated anew with the noise of theirs, with more thrust and with as much less by the `scatter`, and scored as the
    measured ones. None where the scatter is not known, or the model runs away."""
    if scatter is None or any(of_run.diverged for of_run in free):
        return None
    rng, errors = np.random.default_rng(seed), list[Floats]()
    for gain in EXPECTED_DRAWS * (1.0 + scatter, 1.0 - scatter):
        again = remade(model, free, gain, rng)
        errors += [error[1:] for error in restarted_errors(model, again, [find_restarts(of.run) for of in again])]
    size = float(model.dof.shown(np.sqrt(np.mean(np.square(np.concatenate(errors))))))
    return size if np.isfinite(size) else None


MIN_CONTRADICTION = 0.1  # share of the error by which a rival has to be better to contradict the fit's preference
MIN_LEAD = 0.01  # share of the error below which a lead is of no use


def _leads(best: Scored, rival: Scored, drawn: NDArray[np.int64]) -> tuple[Overall, bool]:
    """Give by how much the best model's free runs are nearer than a rival's, and whether that matters and is no
    chance."""
    gap, error = lead(best.errors, rival.errors, drawn), best.overall["rmse"].value or 0.0
    return gap, (gap.value or 0.0) > MIN_LEAD * error and (gap.ci95 is None or gap.ci95[0] > 0)


def _because(
    ranked: Sequence[str], models: Mapping[str, Scored], drawn: NDArray[np.int64], stored: StoredModels
) -> tuple[str | None, str]:
    """Say which model follows the runs best, and whether its lead over the next could be chance or matters."""
    if not ranked:
        return None, "No model follows these runs: every simulation diverges."
    best, *behind = ranked
    if not behind:
        return best, f"Model {best} is the only one{' that follows all runs' if len(models) > 1 else ''}."
    second = behind[0]
    gap, is_lead = _leads(models[best], models[second], drawn)
    # two digits, all before the point where there are more
    value, *ends = (f"{x:.0f}" if abs(x) >= 10 else f"{x:.2g}" for x in (gap.value or 0.0, *(gap.ci95 or ())))
    apart = f"{value}{' [{}, {}]'.format(*ends) if ends else ''} {stored.dof.units.shown}"
    if is_lead:
        says = f"Model {best} has the smallest free-run {stored.dof.position} error"
        return best, f"{says}, {apart} below model {second}."
    sizes = {number: len(stored.models[number].theta) for number in sorted((best, second))}
    simpler = ""
    if len(set(sizes.values())) > 1:
        simpler = f"; model {min(sizes, key=sizes.__getitem__)} is simpler"
    return best, f"Models {' and '.join(sizes)} are equally good, {apart} apart{simpler}."


class Followed(NamedTuple):
    """Predictions of one model, log densities (R,) of the runs that were followed, and what is unexplained of them."""

    predicted: tuple[Predicted, ...]
    density: Floats
    unexplained: float


def with_predictions(compared: Validation, channels: tuple[str, ...] | None) -> Validation:
    """Predict with every model of a file from the filtered states of the runs, by channels of these names, None for
    positions; noise and thrust alone say no more what a right model misses by. Nothing changes where neither these runs
    are driven nor those that were fitted, or no filter follows them."""
    stored, runs = compared.stored, compared.runs
    at_rest = start_at_rest(runs)
    try:
        if not stored.random and (mostly_held(runs) or not is_driven(runs, at_rest, channels)):
            return compared  # held commands tell in a simulation what they do
        followed = {number: _followed(model, runs, at_rest, channels) for number, model in stored.models.items()}
    except FitError:  # what the free runs say has to do
        return compared
    _, density, unexplained = followed[stored.preferred]
    outweighed = frozenset(n for n, rival in followed.items() if outweighs(density, rival.density, unexplained))
    predictions = {number: each.predicted for number, each in followed.items()}
    return replace(compared, predictions=predictions, outweighed=outweighed, expected=None)


def _followed(
    model: Model, runs: Sequence[Run], at_rest: NDArray[np.bool_], channels: tuple[str, ...] | None
) -> Followed:
    """Follow runs by one model, with the sizes that they themselves give to what is random."""
    course = make_course(runs, at_rest, model.signals, channels=channels)
    problem = driven_problem(model, course)
    problem = replace(problem, parameters=problem.parameters.fixed_at(model.theta))
    fit = fit_innovations(problem, np.unique(base_starts(problem), axis=0), brief=True)
    (predicted,) = predict(model, course, model.theta, problem.noises(fit.theta[None]), alone=by_model_alone(runs))
    lasting = tuple(ahead for ahead in predicted if len(ahead.error))
    return Followed(lasting, fit.density, problem.unexplained(fit.phi))


def load_usable(
    logs: Logs, stored: StoredModels, columns: ColumnMap, thrusters: Any, arm: float | None, *, strict: bool, jobs: int,
    progress: Progress,
) -> LoadedRuns:  # fmt: skip
    """Load the runs of the models' motion that each of them can be driven by and that their commands may have moved,
    commanded through the map `thrusters` where there is one; the others are set aside. Raises LogError or RunError as
    `load_runs`, and ModelError for commands in another unit than the models'."""
    drive = moment_maker(thrusters, arm, columns, stored.dof)
    campaign = load_runs(logs, columns, dof=stored.dof, strict=strict, jobs=jobs, progress=progress)
    signals = dict.fromkeys(name for model in stored.models.values() for name in model.signals)

    def complete(run: Run) -> Run:
        driven = run if drive is None else drive(run)
        _ = driven.command  # refused where there is none
        for name in signals:
            if (signal := driven.signal(name)) is None:
                raise RunError(f"an effect of the model needs the {lacking_signal(name, '; map it with --columns')}")
            if missing := int(np.count_nonzero(~np.isfinite(signal))):
                raise RunError(
                    f"an effect of the model needs {name!r} in every row; {missing} rows lack it. Complete the column, "
                    "or validate a model without that effect"
                )
        return driven

    commanded, aside = driven_by(campaign.runs, complete)
    usable, undriven = without_undriven(commanded)
    for run in usable:
        if run.moment_unit != stored.model.moment_unit and np.any(run.command):  # a decay is the same in any unit
            raise ModelError(
                f"{stored.source} was fitted to {stored.dof.words.force}s in {stored.model.moment_unit}, {run.source} "
                f"gives them in {run.moment_unit}; there is no factor between the two. Give logs in "
                f"{stored.model.moment_unit}, or fit a model to logs in {run.moment_unit}"
            )
    set_aside = (*campaign.set_aside, *aside, *undriven)
    require_usable(usable, set_aside, len(campaign.inputs), strict)
    command_warnings(usable)  # refused where they cannot be of this map
    return replace(campaign, runs=tuple(usable), set_aside=set_aside)
