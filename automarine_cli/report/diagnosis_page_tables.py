"""The tables of a diagnosis: regions, gap before and after, and what would have been seen."""

from collections.abc import Sequence

import numpy as np

from automarine_cli import effects
from automarine_cli.diagnosis.bins import SIZE, THRUST
from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.gap import Gap
from automarine_cli.diagnosis.study import JUDGED
from automarine_cli.diagnosis.where import Region
from automarine_cli.dofs import Dof
from automarine_cli.fits.run_effects import GAIN
from automarine_cli.report.tables import MISSING, Table, number

MOST_REGIONS = 8
MOST_NAMED_RUNS = 5


def regions_table(regions: Sequence[Region], unit: str, force: str = "thrust") -> Table:
    """Lay out the regions that stand out, the most significant first; gaps in `unit`, `force` as people call it."""
    return Table(
        "", ("variable", "from", "to", "unit", f"gap [{unit}]", "share of the gap", "seen in", "p", "runs"),
        tuple(_region(region, force) for region in regions[:MOST_REGIONS]),
        notes=(
            "p is corrected for all bins and variables. Shares of different variables overlap: they are views of one "
            "gap.",
        ),
    )  # fmt: skip


def _region(region: Region, force: str) -> tuple[str, ...]:
    some = ", ".join(region.runs[:MOST_NAMED_RUNS])
    more = len(region.runs) - MOST_NAMED_RUNS
    runs = f"{some} and {more} more" if more > 0 else some or MISSING
    kinds = {force: f"missing {force}", THRUST: "each run's own thrust", SIZE: "size of each run's gap"}
    return (
        region.variable, number(region.low, 3), number(region.high, 3), region.unit or MISSING, number(region.gap, 3),
        f"{region.share:.0%}", kinds.get(region.seen_in, region.seen_in), number(region.p_value, 2), runs,
    )  # fmt: skip


def gap_table(diagnosis: Diagnosis) -> Table:
    """Root mean square gap before and after, against the noise, on runs fitted and held out."""
    dof = diagnosis.study.base.dof
    unit, position = dof.units.shown, dof.words.position
    rows = [_gap_row(f"{len(diagnosis.study.runs)} runs fitted", diagnosis.gap, dof)]
    if diagnosis.held_out is not None and diagnosis.held_out_gap is not None:
        rows.append(_gap_row(f"{len(diagnosis.held_out.runs)} runs held out", diagnosis.held_out_gap, dof))
    scatter = [100.0 * trial.fit.factor(GAIN) for trial in (diagnosis.found.base, diagnosis.found.final)]
    return Table(
        "",
        ("runs", f"before [{unit}]", f"after [{unit}]", f"noise of the {position} [{unit}]",
         "gap above the noise closed"),
        tuple(rows),
        notes=(
            f"Root mean square errors of {position}s predicted {JUDGED:g} s ahead from the filtered state."
            if diagnosis.study.driven
            else f"Root mean square over whole runs simulated from their start, with each run's own start {position}, "
            "thrust and switch instants. "
            f"Thrust differs from run to run by {scatter[0]:.1f} % before and {scatter[1]:.1f} % after.",
        ),
    )  # fmt: skip


def _gap_row(name: str, gap: Gap, dof: Dof) -> tuple[str, ...]:
    cells = (f"{dof.shown(x):.2f}" for x in (gap.before, gap.after, gap.floor))
    above = gap.before**2 - gap.floor**2
    visible = above > 0.02 * gap.floor**2
    closed = f"{np.clip((gap.before**2 - gap.after**2) / above, 0.0, 1.0):.0%}" if visible else MISSING
    return (name, *cells, closed)


def detectable_table(diagnosis: Diagnosis) -> Table:
    """Smallest size of each effect that would have been named four times in five."""
    rows = []
    for name, size in sorted(diagnosis.detectable.items()):
        base = diagnosis.study.base
        told = effects.get(name).card(base.dof, base.moment_unit).parameters[_sized(name)]
        rows.append((name, told.name, number(size, 2), told.unit or MISSING))
    return Table(
        "", ("effect", "parameter", "smallest size seen", "unit"), tuple(rows),
        notes=("Sizes that these runs detect with 80 % power, measured from the value at which the effect is off.",),
    )  # fmt: skip


def _sized(name: str) -> int:
    """Place of the parameter that says how large an effect is: the first that is not a shape and is fitted."""
    return next((i for i, p in enumerate(effects.get(name).parameters) if not p.scan and not p.held), 0)
