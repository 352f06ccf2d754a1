"""The data sets of `make real`: where they lie, how their columns are called, what is fitted, how runs are halved.

They were measured (one: simulated) by others and are no part of this repository: AUTOMARINE_DATA names the folder that
holds them, by default `data` in a folder `shared` beside the checkout; what is absent is skipped.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from automarine_cli.dofs import DOFS
from automarine_cli.logs import ColumnMap, read_column_map
from automarine_cli.runs.load import load_runs
from automarine_cli.runs.run import Run, SetAside

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "data"
DATA = Path(os.environ.get("AUTOMARINE_DATA", BESIDE))
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
    are canonical), `motions` by name.

    `halves` are the beginnings of the runs' names in either half; without them every other run goes to each.
    `numbers` are the base models tried; `measured` is False for what somebody's simulator made.
    """

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

    def load(self, motion: str, scratch: Path) -> tuple[list[Run], tuple[SetAside, ...]]:
        """Its runs of one motion, in the order of their names, and those set aside; the column map is written into
        `scratch`."""
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


@dataclass(frozen=True)
class Contact:
    """One command on a log that is looked at only, or to be refused: what it answers holds `said`, with `status`."""

    name: str
    arguments: tuple[str, ...]
    status: int
    said: str

    @property
    def log(self) -> Path:
        return DATA / self.arguments[-1]


SETS = (
    RealSet(
        "kingfisher_lake",
        "yaw/kingfisher_lake",
        columns=LAKE_COLUMNS,
        halves=(("run_01", "run_05", "run_15", "run_21", "run_25"), ("run_03", "run_11", "run_19", "run_23", "run_29")),
    ),
    RealSet("heavy_rov_sea", "yaw/heavy_rov_sea", motions=("yaw", "surge", "sway", "heave")),
    RealSet("cybership_enterprise", "yaw/cybership_enterprise", motions=("yaw", "surge", "sway")),
    RealSet("minerva_hil_simulated", "yaw/minerva_hil_simulated", measured=False),
)

CONTACTS = (
    Contact(
        "not_connected",
        ("fit-yaw", "yaw/not_connected/run_20150518_1819.csv"),
        1,
        "something that this log does not hold",
    ),
    Contact("ardusub telemetry", ("check", "ardusub/small.tlog"), 0, "worked back from SERVO_OUTPUT_RAW"),
    Contact("ardusub log", ("check", "ardusub/small.BIN"), 0, "worked back from RCOU by the mixing"),
)


def present(only: str = "") -> Iterator[tuple[RealSet, str]]:
    """Set and motion of all that is at hand and has `only` in "set/motion"."""
    for one in SETS:
        for motion in one.motions:
            if one.path.is_dir() and only in f"{one.name}/{motion}":
                yield one, motion
