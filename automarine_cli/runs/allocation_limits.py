"""Commanded moments that the thrusters cannot give: told from logs that hold both the total and single thrusters.

Where no thruster is at a limit, control allocation is one law, tau = sum c_i |n_i|^p sgn(n_i), with c_i of each way;
it is fitted there, and says what the thrusters gave where one stands at its limit. Source: Fossen (2021), Handbook of
Marine Craft Hydrodynamics and Motion Control, second edition (control allocation; thrust against propeller speed).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs import DOFS, Dof
from automarine_cli.pipeline.records import FILLER, to_mapping
from automarine_cli.pipeline.words import listed
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ASKED, Run

Mask = NDArray[np.bool_]

SINGLE = re.compile(r"(n|rpm|thruster)_\w+|thruster\d+")
"""Names of columns that hold the command or speed of one thruster."""
EXPONENTS = (2.0, 1.5, 1.0)  # Of thrust against speed, of normalised commands against thrust, and between
LAW = 0.01  # Share of the commands' root mean square that a law leaves of them; more is no law
SHORT = 0.01  # Share of the largest command from which on what was given is not what was asked
FEWEST = 3  # Samples at one largest value that make it a limit, and samples that fall short


@dataclass(frozen=True)
class Commanded:
    """Total command (N,) [`unit`] of a degree of freedom beside the thrusters' commands (N, T) called `names`, without
    gaps."""

    dof: Dof
    unit: str
    names: tuple[str, ...]
    total: Floats
    single: Floats


@dataclass(frozen=True)
class AllocationLimit:
    """What the thrusters did not give: `share` of the samples; of the worst of them what was `asked` and `given`
    [`unit`], and the `thrusters` at their limits, by name with the command there."""

    dof: Dof = field(metadata=FILLER)
    unit: str
    share: float
    asked: float
    given: float
    thrusters: Mapping[str, float]

    @property
    def sentence(self) -> str:
        percent = f"{100 * self.share:.2g}" if self.share < 0.1 else f"{100 * self.share:.0f}"
        held = listed(f"{name} at its limit of {limit:.4g}" for name, limit in self.thrusters.items())
        return (
            f"the thrusters cannot give the {self.dof.words.full_force} commanded in {percent} % of the samples: at "
            f"worst {self.asked:.4g} {self.unit} was asked and {self.given:.4g} {self.unit} given, with {held}; fits "
            "use what was given"
        )

    @property
    def warning(self) -> str:
        return f"T{self.sentence[1:]}."

    def to_json(self) -> dict[str, object]:
        """Its form in check.json."""
        return {"command": self.dof.command} | to_mapping(self)


@dataclass(frozen=True)
class Law:
    """An allocation as logs show it: coefficients (2 T,) of every thruster ahead and astern, the exponent, and the
    commands (T,) at which thrusters are at a limit, infinite where they never were."""

    names: tuple[str, ...]
    coefficients: Floats
    exponent: float
    low: Floats
    high: Floats
    tolerance: float

    def given(self, single: Floats) -> Floats:
        """What thrusters give under commands (N, T), (N,)."""
        return _terms(single, self.exponent) @ self.coefficients

    def shares(self, single: Floats) -> Floats:
        """How much each thruster gives, (N, T), a size."""
        parts = _terms(single, self.exponent) * self.coefficients
        return np.abs(parts[:, : len(self.names)] + parts[:, len(self.names) :])

    def short(self, total: Floats, single: Floats) -> Mask:
        """Which samples (N,) ask for what thrusters at a limit do not give."""
        at_limit = (_at(single, self.low, self.high)).any(axis=1)
        return np.asarray(at_limit & (np.abs(total - self.given(single)) > self.tolerance))


def commanded(run: Run) -> list[Commanded]:
    """The total commands of a run that single thrusters stand beside."""
    names = tuple(sorted(name for name in run.extras if SINGLE.fullmatch(name)))
    if not names:
        return []
    single = np.stack([run.extras[name] for name in names], axis=1)
    totals = {dof: run.extras[dof.command] for dof in DOFS.values() if dof.command in run.extras}
    total = run.extras.get(ASKED, run.moment)
    totals |= {run.dof: total} if total is not None else {}
    units = {dof: run.moment_unit if dof is run.dof else dof.units.forces[1] for dof in totals}
    finite = {dof: total for dof, total in totals.items() if np.isfinite(total).all()}
    return [Commanded(dof, units[dof], names, total, single) for dof, total in finite.items()]


def laws_of(runs: Sequence[Sequence[Commanded]]) -> Iterator[tuple[Law, dict[int, Commanded]]]:
    """The allocation of each degree of freedom of which runs show one, with what these ask, by their numbers."""
    for dof in DOFS.values():
        asked = {i: part for i, parts in enumerate(runs) for part in parts if part.dof is dof}
        if law := _law([*asked.values()]):
            yield law, asked


def _law(several: Sequence[Commanded]) -> Law | None:
    """The allocation of one degree of freedom over several runs; None where the logs show none, or no limit."""
    if len({part.names for part in several}) != 1:
        return None
    total, single, names = *_together(several), several[0].names
    sound = np.isfinite(single).all(axis=1)
    total, single = total[sound], single[sound]
    if not total.any():
        return None
    low, high = _limits(single, np.minimum), _limits(single, np.maximum)
    free = ~_at(single, low, high).any(axis=1)
    if free.all() or not total[free].any():
        return None
    distinct = len(np.unique(single[free], axis=0))
    found = []
    for exponent in EXPONENTS:
        terms = _terms(single[free], exponent)
        # thrusters that always pull together are taken to give alike: the least norm of terms of one size
        size = np.sqrt(np.mean(terms**2, axis=0))
        scale = np.where(size > 0, size, 1.0)
        scaled, _, rank, _ = np.linalg.lstsq(terms / scale, total[free], rcond=1e-6)
        coefficients = scaled / scale
        left = float(np.sqrt(np.mean((total[free] - terms @ coefficients) ** 2)))
        if distinct > 2 * rank and left <= LAW * float(np.sqrt(np.mean(total[free] ** 2))):
            tolerance = max(SHORT * float(np.abs(total).max()), 10.0 * left)
            found.append((left, Law(names, coefficients, exponent, low, high, tolerance)))
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _together(several: Sequence[Commanded]) -> tuple[Floats, Floats]:
    return np.concatenate([part.total for part in several]), np.concatenate([part.single for part in several])


def limit_of(law: Law, several: Sequence[Commanded]) -> AllocationLimit | None:
    """What runs ask of the thrusters beyond their limits, None where that is nothing."""
    total, single = _together(several)
    short = law.short(total, single)
    if np.count_nonzero(short) < FEWEST:
        return None
    given = law.given(single)
    worst = int(np.argmax(np.where(short, np.abs(total - given), 0.0)))
    held = _at(single[[worst]], law.low, law.high)[0] & (law.shares(single[[worst]])[0] > 0.1 * law.tolerance)
    thrusters = {name: float(n) for name, n, at_limit in zip(law.names, single[worst], held) if at_limit}
    dof, unit = several[0].dof, several[0].unit
    return AllocationLimit(dof, unit, float(short.mean()), float(total[worst]), float(given[worst]), thrusters)


def within_limits(runs: Sequence[Run]) -> tuple[list[Run], tuple[AllocationLimit, ...]]:
    """The runs of one campaign driven by what their thrusters gave, where that is not what was commanded, which the
    notes of each tell; and what all of them together asked beyond the limits."""
    limited, limits = list(runs), []
    for law, asked in laws_of([commanded(run) for run in runs]):
        limit = limit_of(law, [*asked.values()])
        if limit is None:
            continue
        limits.append(limit)
        for i, part in asked.items():
            short, run = law.short(part.total, part.single), limited[i]
            of_run = limit_of(law, [part])
            notes = () if of_run is None else (of_run.sentence,)
            run = replace(run, notes=(*run.notes, *notes), reading=(*run.reading, *notes))
            total = np.where(short, law.given(part.single), part.total)
            if part.dof is not run.dof:
                run = replace(run, extras={**run.extras, part.dof.command: total})
            elif ASKED not in run.extras:
                run = replace(run, moment=total)
            limited[i] = run
    return limited, tuple(limits)


def _terms(single: Floats, exponent: float) -> Floats:
    """Regressors (N, 2 T): |n|^p sgn(n) of each thruster where it drives ahead, then where it drives astern."""
    power = np.sign(single) * np.abs(single) ** exponent
    return np.concatenate([np.maximum(power, 0.0), np.minimum(power, 0.0)], axis=1)


def _limits(single: Floats, end: np.ufunc) -> Floats:
    limit = end(end.reduce(single, axis=0), 0.0)
    plateau = (np.abs(single - limit) <= 1e-9 * np.abs(limit)).sum(axis=0) >= FEWEST
    endless = np.inf if end is np.maximum else -np.inf
    return np.asarray(np.where(plateau & (limit != 0), limit, endless))


def _at(single: Floats, low: Floats, high: Floats) -> Mask:
    """Which thrusters are at a limit, (N, T)."""
    with np.errstate(invalid="ignore"):
        return np.asarray((single <= low * (1 - 1e-9)) | (single >= high * (1 - 1e-9)))
