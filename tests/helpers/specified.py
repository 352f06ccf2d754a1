"""Specifications from files, and their campaigns as clean runs, without a log in between."""

from pathlib import Path

import numpy as np

from automarine_cli.dofs import Dof
from automarine_cli.logs import LogFile, LogTable
from automarine_cli.logs.columns import RUN
from automarine_cli.logs.table import Labels
from automarine_cli.pipeline.records import read_mapping
from automarine_cli.runs.load import runs_of_table
from automarine_cli.runs.run import Run
from automarine_cli.simulation.campaign import SimulatedRun, make_campaign
from automarine_cli.simulation.specification import Specification, specification_from
from automarine_cli.text import printable


def read_specification(path: Path) -> Specification:
    """The specification in a TOML (or JSON) file. Raises SettingError with file and key."""
    return specification_from(read_mapping(path), printable(path.name))


def make_runs(specification: Specification, seed: int | None = None) -> list[Run]:
    """The campaign as runs, cleaned as if read from its logs; a run that cleaning sets aside is left out.

    `seed` replaces the specification's. No file is written. Raises SettingError.
    """
    runs: list[Run] = []
    for made in make_campaign(specification, seed):
        table = as_table(made, specification.force_unit, specification.scatter.dof)
        found, _ = runs_of_table(LogFile(Path(made.plan.file), made.plan.file, named=False), table)
        runs += found
    return runs


def as_table(made: SimulatedRun, moment_unit: str, dof: Dof) -> LogTable:
    """The log as the reader would give it."""
    units = {dof.position: dof.units.log, dof.command: moment_unit, dof.velocity: f"{dof.units.log}/s"}
    logged = {name: made.columns.get(dof.column(name, unit)) for name, unit in units.items()}
    columns = {"time": made.columns["time_s"]} | {
        name: column if name == dof.command else dof.inner(column)
        for name, column in logged.items() if column is not None
    }  # fmt: skip
    count = len(made.columns["time_s"])
    runs = Labels((made.plan.name,), np.zeros(count, dtype=np.int64))
    return LogTable(made.plan.file, columns, np.arange(1, count + 1), {RUN: runs}, {dof.command: moment_unit}, dof=dof)
