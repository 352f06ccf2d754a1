"""`samples`: the sample logs, copied to where the examples of every help find them."""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import click

import automarine_cli
from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command
from automarine_cli.errors import OutputError

if TYPE_CHECKING:
    from automarine_cli.report.log_tables import Samples

SOURCE = Path(automarine_cli.__file__).parent / "sample_runs"


@command("samples", report="log_tables", saves=False, then="automarine check {folder}/steps")
@argument("folder", default="sample_runs", type=click.Path(path_type=Path), metavar="[DIR]")
@options.together(options.as_json, options.verbosity)
def samples(folder: Path) -> "Samples":
    """Copy the sample logs into a new folder, for the examples of each help.

    The logs are simulated, and their truth is with them. Without DIR the folder is sample_runs, where all examples
    look for it.

    \b
    Example:
      automarine samples
    """
    from automarine_cli.report.log_tables import Samples

    if folder.exists():
        raise OutputError(f"{folder} exists; give another folder, or delete it first")
    part = folder.with_name(f".{folder.name}.part")
    try:
        shutil.copytree(SOURCE, part, copy_function=shutil.copyfile)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return Samples(folder, tuple(sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())))
