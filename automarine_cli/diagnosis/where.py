"""Where simulation and measurement disagree: which stretches of which variable stand out against chance.

Two gaps are looked at: the heading measured less simulated, and the disturbance moment, held over two seconds at a
time, that would make the simulation follow the log. In bins of a variable their means are compared with chance by
turning the sign of whole runs (a run is the unit: samples within it hang together), the largest mean of a variable
against the largest that chance gives. Variables that belong to a whole run are compared with the run's own thrust
gain and the size of its gap, by permuting the runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from automarine_cli.diagnosis.bins import THRUST, Variable, of_runs, of_samples, over_variables
from automarine_cli.diagnosis.given import disturbance, missed
from automarine_cli.diagnosis.study import Study
from automarine_cli.diagnosis.trials import Trial
from automarine_cli.diagnosis.variables import Column, columns, direction
from automarine_cli.dofs import Dof
from automarine_cli.fits import linear_mixed
from automarine_cli.fits.innovations import InnovationsFit
from automarine_cli.fits.mixed_model import derivatives
from automarine_cli.fits.run_effects import DISTURBANCE, GAIN
from automarine_cli.fits.variances import choose_variances
from automarine_cli.quantities import Floats

PERMUTATIONS = 2000
ODD_RUN = 2.0
"""A run takes part in a region where its own mean there is this many times what heading noise gives."""


@dataclass(frozen=True)
class Region:
    """A stretch of one variable in which the gap stands out; `gap` is the mean that repeats from run to run, as shown.

    `seen_in` says which gap shows it: that of the position, of the moment or force, of "thrust" (a run's own gain) or
    its "size". `share` is the part
    of the gap above the noise that lies in the region.
    """

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
        return {
            "variable": self.variable, "from": self.low, "to": self.high, "unit": self.unit,
            f"gap_{unit}": self.gap, "p_value": self.p_value, "runs": list(self.runs), "share": self.share,
            "seen_in": self.seen_in,
        }  # fmt: skip


@dataclass(frozen=True)
class Where:
    """Everything that the figure and the result need; residual headings (R, N) [rad], zero in the padding.

    `columns` hold each variable's values, `sign` (R, N) the side to which the last moment pushed, `gain` (R,) each
    run's own thrust [%]; `moment` (R, N) is the disturbance moment at each sample [the moment's unit].
    """

    variables: tuple[Variable, ...]
    columns: tuple[Column, ...]
    regions: tuple[Region, ...]
    names: tuple[str, ...]
    residual: Floats
    moment: Floats
    sign: Floats
    gain: Floats
    mean_moment: Floats
    time: Floats
    seen: NDArray[np.bool_]
    floor: float
    moment_unit: str
    dof: Dof


@dataclass(frozen=True)
class Gap:
    """What is left of R runs at N samples, as in `Where`; `raw` (R, N) is what is left if every run has the same
    thrust. `shown` turns it into the unit in which people see it."""

    names: tuple[str, ...]
    residual: Floats
    raw: Floats
    sign: Floats
    seen: NDArray[np.bool_]
    gain: Floats
    floor: float
    gain_unit: str = "%"
    shown: Callable[[float], float] = float


@dataclass(frozen=True)
class Looked:
    """Variables with their columns, and the regions in which a gap stands out, the surest first."""

    variables: tuple[Variable, ...]
    columns: tuple[Column, ...]
    regions: tuple[Region, ...]


def look(of: Sequence[Column], kinds: Mapping[str, tuple[str, Floats]], gap: Gap, seed: int) -> Looked:
    """Look at a gap against the columns `of` its runs; `kinds` are what is averaged over samples (R, N), with its unit,
    by name. `seed` draws the signs of the runs."""
    drawn = np.random.default_rng(seed).random((PERMUTATIONS, len(gap.names)))
    found: list[tuple[Column, Variable, Floats]] = []
    for column in of:
        if column.of_the_run:
            mirrored = np.sign(gap.sign.sum(axis=1))
            looked = of_runs(column, gap.gain, mirrored, _size(gap.residual, gap.seen), drawn, gap.gain_unit)
        else:
            looked = of_samples(column, kinds, gap.sign, np.where(drawn < 0.5, -1.0, 1.0))
        if looked is not None:
            found.append((column, *looked))
    judged = over_variables(found)
    regions = [region for column, variable in judged for region in _regions(column, variable, gap)]
    regions.sort(key=lambda region: (region.p_value, -region.share))
    return Looked(tuple(variable for _, variable in judged), tuple(column for column, _ in judged), tuple(regions))


def find_where(study: Study, base: Trial, seed: int) -> Where:
    """Look at the gap of `base` on the runs of `study` against every variable; `seed` draws the signs."""
    residual, moment = gaps(study, base)
    batch, dof = study.batch, study.base.dof
    raw = without_gains(study, base)
    fitted = np.where(batch.seen, batch.position - residual, 0.0)
    sign = np.where(batch.seen, direction(study), 0.0)
    gain = 100.0 * base.fit.own(GAIN)[:, 0]
    kinds = {
        dof.words.position: (dof.units.shown, dof.shown(residual)),
        THRUST: (dof.units.shown, dof.shown(raw)),
        dof.words.force: (study.base.moment_unit, moment),
    }
    gap = Gap(batch.names, residual, raw, sign, batch.seen, gain, study.floor, shown=dof.shown)
    looked = look(columns(study, fitted), kinds, gap, seed)
    pushed = [run.command[run.command != 0] for run in study.runs]
    return Where(
        variables=looked.variables,
        columns=looked.columns,
        regions=looked.regions,
        names=batch.names,
        residual=residual,
        moment=moment,
        sign=sign,
        gain=gain,
        mean_moment=np.array([float(p.mean()) if len(p) else 0.0 for p in pushed]),
        time=study.time,
        seen=batch.seen,
        floor=study.floor,
        moment_unit=study.base.moment_unit,
        dof=dof,
    )


def gaps(study: Study, trial: Trial) -> tuple[Floats, Floats]:
    """Residual headings [rad] of a trial on the runs it was fitted to, and the disturbance moment, both (R, N).

    The disturbances are the windows of `whole_runs`, their size estimated with everything else at the trial's fit.
    """
    if isinstance(trial.fit, InnovationsFit):
        return missed(study, trial.model, trial.fit), disturbance(study, trial.model, trial.fit)
    problem, batch = study.problem(trial.model), study.batch
    residual = study.residual(trial.fit.fitted)
    b = trial.fit.run_effects
    lasts = batch.window.max(axis=1, initial=0, where=batch.length > 0)
    windows = (np.arange(batch.windows) <= lasts[:, None]).astype(float)
    problem = replace(problem, effects=problem.effects.with_scale(disturbance=windows))
    fitted, by_phi, by_run = derivatives(problem, trial.fit.phi, b)
    gram = problem.gram(by_phi, by_run, fitted, b)
    variances = choose_variances(gram, problem.effects, trial.fit.variances)
    b = linear_mixed.posterior_mean(gram, problem.effects, variances, np.zeros(len(trial.fit.phi)))
    window = np.take_along_axis(batch.window, np.minimum(batch.node, batch.window.shape[1] - 1), axis=1)
    inertia = trial.model.index(trial.model.dof.parameter("inertia"))
    held = np.take_along_axis(trial.fit.effects.of(b, DISTURBANCE), np.minimum(window, batch.windows - 1), axis=1)
    return residual, np.where(batch.seen, trial.fit.theta[inertia] * held, 0.0)


def without_gains(study: Study, trial: Trial) -> Floats:
    """Measured less simulated headings (R, N) [rad] if every run had the same thrust: what a gain could hide."""
    if isinstance(trial.fit, InnovationsFit):
        return missed(study, trial.model, trial.fit)
    problem = study.problem(trial.model)
    b = trial.fit.run_effects.copy()
    trial.fit.effects.of(b, GAIN)[...] = 0.0
    return study.residual(problem.readings(trial.fit.phi, b))


def _size(residual: Floats, seen: NDArray[np.bool_]) -> Floats:
    """Logarithm of each run's root mean square gap, (R,)."""
    return np.asarray(0.5 * np.log(np.maximum((residual**2).sum(axis=1) / seen.sum(axis=1), 1e-18)))


def _regions(column: Column, variable: Variable, gap: Gap) -> list[Region]:
    """Neighbouring bins that stand out together, to the same side, are one region."""
    side = np.where(variable.stands_out, np.sign(variable.telling.t), 0.0)
    changes = np.flatnonzero(np.diff(np.concatenate([[0.0], side, [0.0]])))
    values = column.values[:, None] if column.of_the_run else column.values
    found = []
    for begin, end in pairwise(changes):
        if side[begin] == 0:
            continue
        low, high = float(variable.edges[begin]), float(variable.edges[end])
        with np.errstate(invalid="ignore"):
            inside = gap.seen & (values >= low) & (values < high)
        row = max(variable.rows, key=lambda r: float(np.abs(r.t[begin:end]).max()))
        found.append(_region(column, variable, gap, (low, high), row.kind, inside))
    return found


def _region(
    column: Column, variable: Variable, gap: Gap, ends: tuple[float, float], kind: str, inside: NDArray[np.bool_]
) -> Region:
    """One region: its gap, the runs that show it, and its share of the whole gap above the noise."""
    residual = gap.raw if kind == THRUST else gap.residual
    count = max(int(inside.sum()), 1)
    square = residual**2 - gap.floor**2
    excess = float((square * inside).sum())
    if column.of_the_run:
        size = float(np.sqrt(max(excess / count, 0.0)))
    else:
        sums = ((residual * inside).sum(), (residual * gap.sign * inside).sum())
        size = max(abs(float(one)) for one in sums) / count
    samples = np.maximum(inside.sum(axis=1), 1)
    mean = np.abs((residual * inside).sum(axis=1)) / samples
    rough = (square * inside).sum(axis=1) / samples > 0.5 * gap.floor**2
    taking = inside.any(axis=1) & ((mean > ODD_RUN * gap.floor / np.sqrt(samples)) | rough)
    share = excess / max(float((square * gap.seen).sum()), 1e-300)
    return Region(
        variable.name, *ends, variable.unit, float(gap.shown(size)), variable.p_value,
        tuple(name for name, part in zip(gap.names, taking) if part),
        float(np.clip(share, 0.0, 1.0)), kind,
    )  # fmt: skip
