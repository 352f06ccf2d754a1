"""The data sets of `make real`: where they lie, how their columns are called, what is fitted, how runs are halved.

They were measured (one: simulated) by others and are no part of this repository: AUTOMARINE_DATA names the folder that
holds them, by default `data` in a folder `shared` beside the checkout; what is absent is skipped.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from repository import DATA

from automarine_cli.dofs import DOFS
from automarine_cli.logs import ColumnMap, read_column_map
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import ExcludedRun, Run

EVERY_MODEL = ("1", "2", "3")

LAKE_COLUMNS = """
[columns]
heading_deg = { from = "heading_deg", unit = "deg", sign = -1 }
tau_Nm = { from = "tau_N_nominal_Nm", unit = "N m", sign = -1 }
surge_m_s = "speed_mps"
"""


@dataclass(frozen=True)
class RealSet:
    """Logs of one vehicle: those in `folder` that `glob` finds, with the column map `columns` (TOML; "" where names
    are canonical), `motions` by name; `halves` are the beginnings of the runs' names in either half, without them every
    other run goes to each; `numbers` are the base models tried; `measured` is False for what a simulator made."""

    name: str
    folder: str
    motions: tuple[str, ...] = ("yaw",)
    glob: str = "run_*.csv"
    columns: str = ""
    halves: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    numbers: tuple[str, ...] = EVERY_MODEL
    measured: bool = True

    @property
    def path(self) -> Path:
        return DATA / self.folder

    def load(self, motion: str, scratch: Path) -> tuple[list[Run], tuple[ExcludedRun, ...]]:
        """Its runs of one motion, in the order of their names, and those set aside."""
        campaign = load_runs([str(self.path / self.glob)], self.column_map(scratch), dof=DOFS[motion])
        return list(campaign.runs), campaign.set_aside

    def column_map(self, scratch: Path) -> ColumnMap | None:
        """Its column map, written into the folder `scratch`; None where names are canonical."""
        if not self.columns:
            return None
        path = scratch / f"{self.name}.toml"
        path.write_text(self.columns)
        return read_column_map(path)

    def halved(self, runs: list[Run]) -> tuple[list[Run], list[Run]]:
        if self.halves is None:
            return runs[::2], runs[1::2]
        first, second = ([run for run in runs if run.name.startswith(half)] for half in self.halves)
        return first, second


SETS = (
    RealSet(
        "kingfisher_lake", "yaw/kingfisher_lake", columns=LAKE_COLUMNS,
        halves=(("run_01", "run_05", "run_15", "run_21", "run_25"), ("run_03", "run_11", "run_19", "run_23", "run_29")),
    ),
    RealSet("heavy_rov_sea", "yaw/heavy_rov_sea", ("yaw", "surge", "sway", "heave")),
    RealSet("cybership_enterprise", "yaw/cybership_enterprise", ("yaw", "surge", "sway")),
    RealSet("minerva_hil_simulated", "yaw/minerva_hil_simulated", measured=False),
)  # fmt: skip


def present(only: str = "") -> Iterator[tuple[RealSet, str]]:
    """Set and motion of all that is at hand and has `only` in "set/motion"."""
    for each in SETS:
        for motion in each.motions:
            if each.path.is_dir() and only in f"{each.name}/{motion}":
                yield each, motion
