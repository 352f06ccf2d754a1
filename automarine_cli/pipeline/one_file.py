"""One file of results that stands alone, without a folder and a manifest: written whole or not at all."""

from pathlib import Path

from automarine_cli.errors import OutputError
from automarine_cli.pipeline import staging


def refuse_existing(target: Path, *, overwrite: bool) -> None:
    """Raise OutputError for a file that is there already unless `overwrite`, and for a folder."""
    if target.is_dir():
        raise OutputError(f"{target} is a folder; give the name of a file after -o")
    if target.exists() and not overwrite:
        raise OutputError(f"{target} is there already; give --overwrite to replace it, or another name with -o")


def write_whole(target: Path, text: str) -> None:
    """Write the file beside its place, then put it there at once. Raises OutputError."""
    with staging.one_sentence(target.parent):
        target.parent.mkdir(parents=True, exist_ok=True)
        new = target.with_name(f".{target.name}.automarine-new")
        new.unlink(missing_ok=True)
        staging.write(new, text.encode("utf-8"), through=True)
        new.replace(target)
