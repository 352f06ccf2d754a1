"""The data sets of `make real`: where they lie, how their columns are called, what is fitted, how runs are halved.

They were measured (one: simulated) by others and are no part of this repository: AUTOMARINE_DATA names the folder that
holds them, by default `data` in a folder `shared` beside the checkout; what is absent is skipped.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
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


BOLT_COLUMNS = """
[columns]
time_s = "Time (s)"
heading_deg = { from = "Yaw (rad)", unit = "rad" }
tau = { from = "T1", subtract = 1500, scale = 0.0025, sign = -1 }
"""
TANKER_COLUMNS = """
[columns]
heading_deg = "heading_deg"
yaw_rate_deg_s = "yaw_rate_degps"
tau = { from = "rudder_deg", scale = 0.02, sign = -1 }
"""
"""Its u_mps and v_mps are no speeds of the hull: they lie along and across the first course."""
CATAMARAN_ARM_M = 0.205  # half of what lies between its thrusters, whose thrusts are logged in newtons


@dataclass(frozen=True)
class RealSet:
    """Logs of one vehicle: those in `folder` that `glob` finds, with the column map `columns` (TOML; "" where names
    are canonical), `motions` by name; `halves` are the beginnings of the runs' names in either half, without them every
    other run goes to each; `numbers` are the base models tried; `measured` is False for what a simulator made. With
    `arm_m` the moment is that of two thrusts."""

    name: str
    folder: str
    motions: tuple[str, ...] = ("yaw",)
    glob: str = "run_*.csv"
    columns: str = ""
    halves: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    numbers: tuple[str, ...] = EVERY_MODEL
    measured: bool = True
    arm_m: float | None = None

    @property
    def path(self) -> Path:
        return DATA / self.folder

    def load(self, motion: str, scratch: Path) -> tuple[list[Run], tuple[ExcludedRun, ...]]:
        """Its runs of one motion, in the order of their names, and those set aside."""
        campaign = load_runs([str(self._folder(scratch) / self.glob)], self.column_map(scratch), dof=DOFS[motion])
        return list(campaign.runs), campaign.set_aside

    def _folder(self, scratch: Path) -> Path:
        """Where the logs lie, with the moment of two thrusts beside them if there is an arm."""
        if self.arm_m is None:
            return self.path
        for log in self.path.glob(self.glob):
            table = pd.read_csv(log)
            table.assign(tau_Nm=self.arm_m * (table["left_N"] - table["right_N"])).to_csv(scratch / log.name)
        return scratch

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
    RealSet("kvlcc2_zigzag", "yaw/kvlcc2_zigzag", glob="*.csv.gz", columns=TANKER_COLUMNS),
    RealSet("vtec_usv_payload", "yaw/vtec_usv_payload", glob="*.csv", arm_m=CATAMARAN_ARM_M),
    RealSet("bolt_auv_pool", "yaw/bolt_auv_pool", glob="[yY]aw_*.csv", columns=BOLT_COLUMNS),
    RealSet("minerva_hil_simulated", "yaw/minerva_hil_simulated", measured=False),
)  # fmt: skip


def present(only: str = "") -> Iterator[tuple[RealSet, str]]:
    """Set and motion of all that is at hand and has `only` in "set/motion"."""
    for each in SETS:
        for motion in each.motions:
            if each.path.is_dir() and only in f"{each.name}/{motion}":
                yield each, motion
