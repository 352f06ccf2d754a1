"""Where and by how much simulation and measurement disagree: which stretches of a variable stand out against chance.

Two gaps are looked at: the heading measured less simulated, and the disturbance moment, held over two seconds at a
time, that would make the simulation follow the log. In bins of a variable their means are compared with chance by
turning the sign of whole runs (a run is the unit: samples within it hang together), the largest mean of a variable
against the largest that chance gives. Of driven runs the gap is the error of predictions against what was known as
they began, for a controller answers what comes later. Variables that belong to a whole run are compared with the run's
own thrust gain and the size of its gap, by permuting the runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import special

from automarine_cli.comparison.validation import compare
from automarine_cli.diagnosis.search import STANDS
from automarine_cli.diagnosis.study import DiagnosisProblem, filtered, judged, missed
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.dofs import DOFS
from automarine_cli.effects.learned import hyphened
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.filters.course import Course
from automarine_cli.filters.kalman import Predicted
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.linear_mixed import DISTURBANCE, GAIN, choose_variances
from automarine_cli.fits.mixed_model import MixedFit, derivatives
from automarine_cli.models.model import Model
from automarine_cli.models.store import StoredModels
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import LOGGED_COMMAND, Run

MIN_IN_A_BIN = 2  # runs that a bin needs: one run alone says nothing about chance
OF_THE_RUN = 0.1  # a column that varies within runs by less than this share of its spread is one of the run
COLUMN_UNITS = {"voltage": "V", "sway": "m/s"}  # of columns that are no velocity of a motion
VELOCITY_UNITS = {dof.velocity: dof.units for dof in DOFS.values()}


@dataclass(frozen=True)
class Factor:
    """One variable: values (R, N) with NaN where it means nothing, or (R,) for a property of the whole run."""

    name: str
    unit: str
    values: Floats

    @property
    def of_the_run(self) -> bool:
        return self.values.ndim == 1


def columns(study: DiagnosisProblem, fitted: Floats, rate: Floats | None = None) -> list[Factor]:
    """Every variable of the runs of `study`; `fitted` (R, N) are headings [rad] and `rate` [rad/s] their rate, by
    default the slope of headings smooth enough to differentiate."""
    batch, dof = study.batch, study.base.dof
    observed, time, words, force = batch.seen, study.time, dof.words, study.base.moment_unit
    position = dof.units.shown
    if rate is None:
        rate = np.zeros_like(fitted)
        for row, psi, t, mask in zip(rate, fitted, time, observed):
            row[mask] = np.gradient(psi[mask], t[mask])
    moment, first = at_samples(study, [run.command for run in study.runs]), np.full(len(study.runs), np.nan)
    for i, run in enumerate(study.runs):
        pushed = run.command[run.command != 0]
        if len(pushed) and np.ptp(np.abs(pushed)) < 1e-6 * np.abs(pushed).max():  # of one size
            first[i] = pushed[0]
    place = dof.shown(fitted)  # not as measured: readings below a place have errors below nothing
    start = dof.shown(np.array([np.median(run.position[:5]) for run in study.runs]))
    if dof.wraps:
        place, start = place % 360.0, start % 360.0
    order = np.argsort(np.argsort(batch.start, kind="stable"), kind="stable").astype(np.float64) + 1.0
    variables = [
        Factor("time-since-command-change", "s", since_change(moment, time)),
        Factor("time-in-run", "s", time),
        Factor(hyphened(words.travelled), position, dof.shown(fitted - fitted[:, :1])),
        Factor(words.position, position, place),
        Factor(hyphened(words.rate), f"{position}/s", dof.shown(rate)),
        Factor(words.force, force, moment),
        Factor(words.force, force, first),
        Factor(f"{words.force}-size", force, np.abs(first)),
        Factor(f"start-{words.position}", position, start),
        Factor("run-order", "", order),
        Factor("campaign-clock", "s", batch.start),
    ]
    for name in sorted(set.intersection(*(set(run.extras) for run in study.runs)) - {LOGGED_COMMAND, *PARTS}):
        units = VELOCITY_UNITS.get(name)
        scale, unit = (1.0, COLUMN_UNITS.get(name, "")) if units is None else (units.per_base, f"{units.log}/s")
        column = of_run_or_sample(name, unit, scale * at_samples(study, [run.extras[name] for run in study.runs]))
        variables.append(replace(column, name=hyphened(words.rate) if name == dof.velocity else name))
    varying: dict[tuple[str, bool], Factor] = {}
    for column in variables:
        values = column.values if column.of_the_run else np.where(observed, column.values, np.nan)
        if np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values):
            varying.setdefault((column.name, column.of_the_run), replace(column, values=values))
    return list(varying.values())


def at_samples(study: DiagnosisProblem, logged: Sequence[Floats]) -> Floats:
    """A column of each run at all samples, (R, N), NaN in the padding."""
    values = np.full(study.batch.seen.shape, np.nan)
    for row, column in zip(values, logged):
        row[: len(column)] = column
    return values


def last_side(moment: Floats) -> Floats:
    """Sign of the last of moments (R, N) that was not zero; that of the first one before it."""
    signs = np.sign(moment)
    at = np.maximum.accumulate(np.where(signs != 0, np.arange(moment.shape[1]), -1), axis=1)
    first = np.argmax(signs != 0, axis=1)
    return np.take_along_axis(signs, np.where(at < 0, first[:, None], at), axis=1)


def edges(values: Floats, most: int) -> Floats:
    """Edges (B + 1,) of at most `most` bins of about equal numbers of `values`; one bin a value where there are few."""
    values = values[np.isfinite(values)]
    different = np.unique(np.round(values, 9))
    if len(different) <= most:
        inner = 0.5 * (different[1:] + different[:-1])
        margin = 0.5 * float(np.min(np.diff(different))) if len(different) > 1 else 0.5
        return np.concatenate([[different[0] - margin], inner, [different[-1] + margin]])
    cut = np.unique(np.quantile(values, np.linspace(0.0, 1.0, most + 1)))
    cut = cut[np.concatenate([[True], np.diff(cut) > 1e-9 * np.ptp(cut)])]
    if cut[0] < 0 < cut[-1] and len(cut) > 2:
        cut[1 + int(np.argmin(np.abs(cut[1:-1])))] = 0.0  # no bin mixes the two sides
        cut = np.unique(cut)
    cut[-1] += 1e-9 * max(abs(cut[-1]), 1.0)
    return cut


def since_change(moment: Floats, time: Floats) -> Floats:
    """Time since the command last changed, NaN before it ever did."""
    changed = np.diff(moment, axis=1, prepend=0.0) != 0
    at = np.maximum.accumulate(np.where(changed, np.arange(moment.shape[1]), -1), axis=1)
    since = time - np.take_along_axis(time, np.maximum(at, 0), axis=1)
    return np.where(at >= 0, since, np.nan)


def of_run_or_sample(name: str, unit: str, values: Floats) -> Factor:
    """A logged column as a property of the run, (R,), where it hardly changes within runs (R, N)."""
    if np.isfinite(values).any(axis=1).all():
        mean = np.asarray(np.nanmean(values, axis=1))
        within = float(np.sqrt(np.nanmean((values - mean[:, None]) ** 2)))
        if within < OF_THE_RUN * float(np.nanstd(values)) or within < 1e-12:
            values = mean
    return Factor(name, unit, values)


STANDS_OUT = 0.05
SURE = 0.01
"""Share of campaigns with nothing missing in which any variable may have bins that stand out: beside one that has,
something is missing."""
MAX_BINS = 12
THRUST, SIZE = "thrust", "size"  # the gaps of whole runs: in their own gain of the thrust, and in how large theirs is


@dataclass(frozen=True)
class Row:
    """One way to average the gap in bins: `mean` (B,) with its standard error over runs, `t` (B,) and p (B,).

    `directed` means that gaps count along the moment: what mirrors with the command adds up. `p` is family-wise over
    the variable's bins and rows; degrees for headings, the moment's unit, or per cent for the thrust gain."""

    kind: str
    directed: bool
    unit: str
    mean: Floats
    error: Floats
    t: Floats
    p: Floats


@dataclass(frozen=True)
class Variable:
    """The gap in the bins of one variable, and the largest |t| that each draw of `chance` gives; `p_value` is corrected
    for the number of variables."""

    column: Factor
    edges: Floats
    middle: Floats
    rows: tuple[Row, ...]
    chance: Floats
    p_value: float
    stands_out: NDArray[np.bool_]

    @property
    def telling(self) -> Row:
        return max(self.rows, key=lambda row: float(np.nanmax(np.abs(row.t), initial=0.0)))


def of_samples(column: Factor, kinds: Mapping[str, tuple[str, Floats]], sign: Floats, flips: Floats) -> Variable | None:
    """Bin samples; compare sums over runs with those of runs whose signs are turned at random."""
    cut = edges(column.values, MAX_BINS)
    count = len(cut) - 1
    if count < 2:
        return None
    which = np.where(np.isfinite(column.values), np.digitize(np.nan_to_num(column.values), cut[1:-1]), -1)
    member = which[None] == np.arange(count)[:, None, None]  # (B, R, N)
    samples = member.sum(axis=2).T.astype(float)  # (R, B)
    enough = (samples > 0).sum(axis=0) >= MIN_IN_A_BIN
    rows, chance = [], np.zeros(len(flips))
    for kind, (unit, gap) in kinds.items():
        for directed in (False, True):
            values = gap * sign if directed else gap
            sums = np.einsum("brn,rn->rb", member, values)
            spread = np.sqrt(np.maximum((sums**2).sum(axis=0), 1e-300))
            t = np.where(enough, sums.sum(axis=0) / spread, 0.0)
            chance = np.maximum(chance, np.abs((flips @ sums)[:, enough] / spread[enough]).max(axis=1, initial=0))
            total = np.maximum(samples.sum(axis=0), 1.0)
            mean = np.where(enough, sums.sum(axis=0) / total, np.nan)
            around = sums - samples * np.nan_to_num(mean)
            error = np.where(enough, np.sqrt((around**2).sum(axis=0)) / total, np.nan)
            rows.append(Row(kind, directed, unit, mean, error, t, np.ones(count)))
    return _tested(column, cut, column.values, which, rows, chance)


def of_runs(
    column: Factor, gain: Floats, mirrored: Floats, size: Floats, drawn: Floats, unit: str = "%"
) -> Variable | None:
    """Bin runs; compare the bins' mean gain [unit], and size of the gap, with those of runs drawn in another order."""
    have = np.isfinite(column.values)
    values, count = column.values[have], int(have.sum())
    cut = edges(values, int(np.clip(count // 4, 4, MAX_BINS)))
    bins = len(cut) - 1
    if bins < 2 or count < 2 * MIN_IN_A_BIN:
        return None
    which = np.digitize(values, cut[1:-1])
    member = (which[:, None] == np.arange(bins)).astype(float)
    number = member.sum(axis=0)
    enough = (number >= MIN_IN_A_BIN) & (number < count)
    orders = np.argsort(drawn[:, have], axis=1)
    rows, chance = [], np.zeros(len(drawn))
    looks = ((THRUST, False, unit, gain), (THRUST, True, unit, gain * mirrored), (SIZE, False, "log", size))
    for kind, directed, unit, look in looks:
        centred = look[have] - look[have].mean()
        error = max(float(centred.std(ddof=1)), 1e-12) / np.sqrt(np.maximum(number, 1.0))
        mean = np.where(number > 0, centred @ member / np.maximum(number, 1.0), np.nan)
        t = np.where(enough, np.nan_to_num(mean) / error, 0.0)
        by_chance = centred[orders] @ member / np.maximum(number, 1.0) / error
        chance = np.maximum(chance, np.abs(by_chance[:, enough]).max(axis=1, initial=0))
        rows.append(Row(kind, directed, unit, mean, error, t, np.ones(bins)))
    return _tested(column, cut, values, which, rows, chance)


def _tested(
    column: Factor, cut: Floats, values: Floats, which: NDArray[np.int64], rows: list[Row], chance: Floats
) -> Variable:
    """The variable with p-values from the largest |t| that chance gives over all its bins and rows."""
    bins = [values[which == b] for b in range(len(cut) - 1)]
    middle = np.array([np.mean(inside) if len(inside) else np.nan for inside in bins])
    tested = tuple(replace(r, p=(1.0 + _as_large(chance, np.abs(r.t))) / (1.0 + len(chance))) for r in rows)
    p_value, nothing = min(float(row.p.min()) for row in tested), np.zeros(len(middle), dtype=bool)
    return Variable(column, cut, middle, tested, chance, p_value, nothing)


def _as_large(chance: Floats, values: Floats) -> Floats:
    """How many draws give as much as each value or more. Few runs have few different draws, so many are the same but
    for rounding, which must not decide."""
    return np.asarray(len(chance) - np.searchsorted(np.sort(chance), values * (1 - 1e-9), side="left"), dtype=float)


def over_variables(tested: Sequence[Variable]) -> tuple[Variable, ...]:
    """Step-down least p over the variables (Westfall and Young 1993): like Holm's, but variables that say the same,
    such as run order and clock, count once because all are judged in the same draws."""
    draws = len(tested[0].chance) if tested else 0
    null = np.array([_as_large(variable.chance, variable.chance) / draws for variable in tested])
    order = sorted(range(len(tested)), key=lambda i: tested[i].p_value)
    corrected, least = dict[int, Variable](), 0.0
    for rank, i in enumerate(order):
        smallest = np.sort(null[order[rank:]].min(axis=0))
        bins = np.min([row.p for row in tested[i].rows], axis=0)
        adjusted = (1.0 + np.searchsorted(smallest, bins, side="right")) / (1.0 + draws)
        least = max(least, float(adjusted.min()))
        stands_out = (np.maximum(adjusted, least) < STANDS_OUT) & (least < SURE)
        corrected[i] = replace(tested[i], p_value=least, stands_out=stands_out)
    return tuple(corrected[i] for i in range(len(tested)))


PERMUTATIONS = 2000
ODD_RUN = 2.0  # A run takes part in a region where its own mean there is this many times what heading noise gives


@dataclass(frozen=True)
class Region:
    """A stretch of one variable in which the gap stands out; `gap` is the mean that repeats from run to run, as shown.

    `seen_in` says which gap shows it: that of the position, of the moment or force, of "thrust" (a run's own gain) or
    its "size". `share` is the part of the gap above the noise that lies in the region."""

    variable: str
    low: float
    high: float
    unit: str
    gap: float
    p_value: float
    runs: tuple[str, ...]
    share: float
    seen_in: str

    def to_json(self, unit: str) -> dict[str, object]:
        """The contract's form; `unit` ends the key of the gap."""
        keys = {"low": "from", "high": "to", "gap": f"gap_{unit}"}
        return {keys.get(name, name): value for name, value in {**vars(self), "runs": list(self.runs)}.items()}


@dataclass(frozen=True, kw_only=True)
class ResidualGrid:
    """What is left of R runs at N samples: residual positions (R, N) [rad or m], zero in the padding, and `raw` ones,
    if every run has the same thrust; `sign` (R, N) is the side to which the last moment pushed, `gain` (R,) each run's
    own thrust. `convert` turns residuals into the unit in which people see them."""

    names: tuple[str, ...]
    residual: Floats
    raw: Floats
    sign: Floats
    observed: NDArray[np.bool_]
    gain: Floats
    floor: float
    gain_unit: str = "%"
    convert: Callable[[float], float] = float


@dataclass(frozen=True, kw_only=True)
class ResidualRegions:
    """Variables, and the regions in which a gap stands out, the surest first."""

    variables: tuple[Variable, ...] = ()
    regions: tuple[Region, ...] = ()


def find_regions(
    of: Sequence[Factor], kinds: Mapping[str, tuple[str, Floats]], gap: ResidualGrid, seed: int
) -> ResidualRegions:
    """Look at a gap against the columns `of` its runs; `kinds` are what is averaged over samples (R, N), with its unit,
    by name. `seed` draws the signs of the runs."""
    drawn = np.random.default_rng(seed).random((PERMUTATIONS, len(gap.names)))
    tested: list[Variable | None] = []
    for column in of:
        if column.of_the_run:
            mirrored = np.sign(gap.sign.sum(axis=1))
            size = 0.5 * np.log(np.maximum((gap.residual**2).sum(axis=1) / gap.observed.sum(axis=1), 1e-18))
            tested.append(of_runs(column, gap.gain, mirrored, size, drawn, gap.gain_unit))
        else:
            tested.append(of_samples(column, kinds, gap.sign, np.where(drawn < 0.5, -1.0, 1.0)))
    variables = over_variables([variable for variable in tested if variable is not None])
    regions = [region for variable in variables for region in _regions(variable, gap)]
    regions.sort(key=lambda region: (region.p_value, -region.share))
    return ResidualRegions(variables=variables, regions=tuple(regions))


def find_where(study: DiagnosisProblem, base: CandidateFit, seed: int) -> ResidualRegions:
    """Look at the gap of `base` on the runs of `study` against every variable; `seed` draws the signs."""
    batch, dof, fit = study.batch, study.base.dof, base.fit
    side = last_side(np.nan_to_num(at_samples(study, [run.command for run in study.runs])))
    if fit.driven:  # what is known as a prediction begins is independent of its error by chance
        residual = missed(study, base.model, fit)
        fitted, rate, moment = filtered(study, base.model, fit)
        raw, variables = residual, columns(study, fitted, rate)
    else:
        residual, moment = study.residual(fit.fitted), pushes(study, base.model, fit)
        same_thrust = fit.run_effects.copy()
        fit.effects.of(same_thrust, GAIN)[...] = 0.0
        raw = study.residual(study.problem(base.model).readings(fit.phi, same_thrust))
        variables = columns(study, np.where(batch.seen, batch.position - residual, 0.0))
    kinds = {
        dof.words.position: (dof.units.shown, dof.shown(residual)),
        THRUST: (dof.units.shown, dof.shown(raw)),
        dof.words.force: (study.base.moment_unit, moment),
    }
    gap = ResidualGrid(
        names=batch.names, residual=residual, raw=raw, sign=np.where(batch.seen, side, 0.0), observed=batch.seen,
        gain=100.0 * base.fit.effects_of(GAIN)[:, 0], floor=study.floor, convert=dof.shown,
    )  # fmt: skip
    return find_regions(variables, kinds, gap, seed)


def pushes(study: DiagnosisProblem, model: Model, fit: MixedFit) -> Floats:
    """The disturbance moment (R, N) that would make whole runs follow a fit.

    The disturbances are the windows of `whole_runs`, their size estimated with everything else as fitted."""
    problem, batch = study.problem(model, disturbed=True), study.batch
    b = fit.effects.carried(fit.run_effects, problem.effects)
    fitted, by_phi, by_run = derivatives(problem, fit.phi, b)
    gram = problem.gram(by_phi, by_run, fitted, b)
    variances = choose_variances(gram, problem.effects, fit.variances)
    b = linear_mixed.posterior_mean(gram, problem.effects, variances, np.zeros(len(fit.phi)))
    window = np.take_along_axis(batch.window, np.minimum(batch.step, batch.window.shape[1] - 1), axis=1)
    pushing = np.take_along_axis(problem.effects.of(b, DISTURBANCE), np.minimum(window, batch.windows - 1), axis=1)
    return np.where(batch.seen, fit.theta[model.index(model.dof.parameter("inertia"))] * pushing, 0.0)


def _regions(variable: Variable, gap: ResidualGrid) -> list[Region]:
    """Neighbouring bins that stand out together, to the same side, are one region."""
    side = np.where(variable.stands_out, np.sign(variable.telling.t), 0.0)
    changes = np.flatnonzero(np.diff(side, prepend=0.0, append=0.0))
    return [_region(variable, gap, begin, end) for begin, end in pairwise(changes.tolist()) if side[begin] != 0]


def _region(variable: Variable, gap: ResidualGrid, begin: int, end: int) -> Region:
    """The region of bins from `begin` to `end`: its gap, the runs that show it, and its share of the whole gap above
    the noise."""
    column, low, high = variable.column, float(variable.edges[begin]), float(variable.edges[end])
    values = column.values[:, None] if column.of_the_run else column.values
    inside = gap.observed & (values >= low) & (values < high)
    kind = max(variable.rows, key=lambda row: float(np.abs(row.t[begin:end]).max())).kind
    residual = gap.raw if kind == THRUST else gap.residual
    count = max(int(inside.sum()), 1)
    square = residual**2 - gap.floor**2
    excess = float((square * inside).sum())
    if column.of_the_run:
        size = float(np.sqrt(max(excess / count, 0.0)))
    else:
        sums = ((residual * inside).sum(), (residual * gap.sign * inside).sum())
        size = max(abs(float(total)) for total in sums) / count
    samples = np.maximum(inside.sum(axis=1), 1)
    mean = np.abs((residual * inside).sum(axis=1)) / samples
    rough = (square * inside).sum(axis=1) / samples > 0.5 * gap.floor**2
    taking = inside.any(axis=1) & ((mean > ODD_RUN * gap.floor / np.sqrt(samples)) | rough)
    share = excess / max(float((square * gap.observed).sum()), 1e-300)
    return Region(
        column.name, low, high, column.unit, float(gap.convert(size)), variable.p_value,
        tuple(dict.fromkeys(name for name, part in zip(gap.names, taking) if part)),
        float(np.clip(share, 0.0, 1.0)), kind,
    )  # fmt: skip


def stretch(region: Region) -> str:
    unit = f" {region.unit}" if region.unit else ""
    return f"where {region.variable} is {region.low:.3g} to {region.high:.3g}{unit}"


@dataclass(frozen=True)
class Gap:
    """Root mean square of measured less modelled, before and after, and the noise estimated without a model.

    Of motions over all samples of a set of runs, with `residuals` (R, N) [rad] before and after, zero in the padding;
    or of predictions over one `horizon` [s], (A,) each, whose `targets` are places of runs (A,) and times in them (A,)
    [s]. Each run's own start heading, start rate, thrust gain and switch instants are taken at their posterior means:
    what is left is what the model lacks, and noise. Of free runs from the commands alone, in the unit that people see,
    with `ci95` over runs: infinite of a model that diverges."""

    before: float
    after: float
    floor: float
    residuals: tuple[Floats, ...] = ()
    horizon: float | None = None
    ci95: tuple[tuple[float, float] | None, ...] = ()
    targets: tuple[NDArray[np.int64], Floats] | None = None

    @property
    def exceeds_noise(self) -> bool:
        return self.after > STANDS * self.floor

    @property
    def closed(self) -> float:
        """Share of the mean square above the noise that is gone."""
        return (self.before**2 - self.after**2) / max(self.before**2 - self.floor**2, 1e-24)

    def little(self, least: float, error: str = "the held-out error") -> str:
        """Say how little of an `error` stands no longer above the noise; empty from the share `least`."""
        if not self.before > STANDS * self.floor or self.closed >= least:
            return ""
        closed = 100.0 * max(self.closed, 0.0)
        return f"closes {closed:.0f} % of {error} above the noise: a name takes {100 * least:.0f} %."

    @property
    def in_noises(self) -> str:
        floor = max(self.floor, 1e-12)
        return f"{self.after / floor:.1f} times the noise, and was {self.before / floor:.1f} times"

    def to_json(self, unit: str, convert: Callable[[float], float] = float) -> dict[str, object]:
        sizes = {"before": self.before, "after": self.after, "noise_floor": self.floor}
        return {
            **{f"{name}_{unit}": float(convert(x)) if np.isfinite(x) else None for name, x in sizes.items()},
            **{f"{name}_ci95": ends and list(ends) for name, ends in zip(sizes, self.ci95)},
            **({} if self.horizon is None else {"horizon_s": self.horizon}),
        }


def gap(study: DiagnosisProblem, base: CandidateFit, final: CandidateFit, fitted: bool = False) -> Gap:
    """The gap of the base and of the final model on the runs of `study`; `fitted` if both were fitted to these."""
    if base.fit.driven and final.fit.driven:
        predicted = (study.predictions(base.model, base.fit), study.predictions(final.model, final.fit))
        return gap_ahead(study.course, *predicted, study.floor)
    off = tuple(residuals(study, trial, fitted) for trial in (base, final))
    before, after = (float(np.sqrt((residual**2).sum() / max(int(study.batch.seen.sum()), 1))) for residual in off)
    return Gap(before, after, study.floor, off)


def residuals(study: DiagnosisProblem, trial: CandidateFit, fitted: bool = False) -> Floats:
    """Measured less simulated positions (R, N) with each run's own effects at their posterior means."""
    assert not trial.fit.driven  # driven runs are predicted, not simulated whole
    return study.residual(trial.fit.fitted if fitted else study.responses_of(trial.model, trial.fit)[0])


def gap_ahead(course: Course, before: Sequence[Predicted], after: Sequence[Predicted], floor: float) -> Gap:
    """The gap of predictions by two models of the runs of `course`; not a number where all are too short."""
    old, new = judged(before), judged(after)
    targets = old.run, course.time[old.run, old.target]
    return Gap(old.rmse(), new.rmse(), floor, (old.error, new.error), old.horizon, targets=targets)


def gap_from_commands(
    study: DiagnosisProblem, runs: Sequence[Run], base: CandidateFit, final: CandidateFit, seed: int
) -> Gap | None:
    """Give the gap of `runs` held out as `validate` finds it: nothing is fitted to them but the start of one under way.

    Both models are those of `gap`: the base refitted to the runs of `study`, and the final one as it was fitted to
    them. Each has its fit's command delay, as the file of the extended model. None of driven runs."""
    if study.driven or not runs:
        return None
    models = {str(i): t.model.delayed(study.command_delay(t.fit)) for i, t in enumerate((base, final))}
    stored = StoredModels(models, "1", 0.0, "")
    validation = compare(stored, runs, seed)
    scores = [scored.overall["rmse"] for scored in validation.models.values()]
    before, after = (np.inf if score.value is None else score.value for score in scores)
    return Gap(before, after, validation.floor, ci95=tuple(score.ci95 for score in scores))


MIN_GAINS = 10  # runs from which the order of their gains says anything


def gains_drift(study: DiagnosisProblem, trial: CandidateFit) -> bool:
    """Whether runs made one after the other have more alike gains than chance allows (p < 0.001).

    Von Neumann's ratio of the mean squared successive difference to the variance of the gains in the order of the
    clock; independent gains give 2 n/(n - 1), with a variance of about 4/n (von Neumann, 1941, Ann. Math. Stat. 12)."""
    gains = trial.fit.effects_of(GAIN)[np.argsort(study.batch.start), 0]
    count, spread = len(gains), float(((gains - gains.mean()) ** 2).sum())
    if count < MIN_GAINS or spread < 1e-12:
        return False
    alike = 1.0 - 0.5 * float((np.diff(gains) ** 2).sum()) / spread
    return bool(alike * np.sqrt((count**2 - 1) / (count - 2)) > -special.ndtri(1e-3))


def is_autocorrelated(study: DiagnosisProblem, trial: CandidateFit) -> bool:
    """Whether neighbouring residuals agree more than chance allows (lag-one correlation over all runs, p < 0.001)."""
    residual = residuals(study, trial, fitted=True)
    observed = study.batch.seen[:, 1:]
    product = (residual[:, 1:] * residual[:, :-1])[observed].sum()
    correlation = product / max((residual**2).sum(), 1e-300)
    return bool(correlation * np.sqrt(observed.sum()) > -special.ndtri(1e-3))
