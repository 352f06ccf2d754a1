"""`verify`: are the files of a folder of results, and the inputs, still what its manifest recorded?"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import click

from automarine_cli.commands import options
from automarine_cli.commands.command import argument, command
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.results_folder import MANIFEST, Entry, Manifest, is_manifest, read_manifest, sha256
from automarine_cli.text import printable

if TYPE_CHECKING:
    from automarine_cli.report.verification import FolderVerified, Verification

NOT_RESULTS = (".DS_Store", "Thumbs.db", "desktop.ini")  # what file managers leave in any folder


@command("verify", report="verification", saves=False)
@argument(
    "folders", nargs=-1, required=True, metavar="DIR...", reads="files",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)  # fmt: skip
@options.together(options.inputs, options.as_json, options.verbosity)
def verify(folders: Sequence[Path], inputs: Sequence[Path]) -> "Verification":
    """Compare the files in DIR and their inputs with the hashes in each manifest.json, and list what changed.

    The list names results that changed, are missing or were added, and inputs that changed. Without --inputs, inputs
    are searched for by name here and next to DIR; a missing one is not an error. With --inputs all of them must be in
    these folders. The exit status is 0 if nothing changed, otherwise 1.

    \b
    Example:
      automarine fit-yaw sample_runs/steps -o out/yaw
      automarine verify out/yaw
    """
    from automarine_cli.report.verification import Verification

    return Verification(tuple(result for folder in folders for result in _inside(folder, inputs)))


def _finish(ctx: click.Context, result: Any) -> None:
    for change in (change for folder in result.folders for change in folder.changes()):
        click.echo(change, err=True)
    if not result.whole:
        ctx.exit(1)


verify.finish = _finish


def _inside(folder: Path, inputs: Sequence[Path]) -> list["FolderVerified"]:
    try:
        manifests = [*filter(is_manifest, sorted(folder.rglob(MANIFEST)))]
    except OSError as problem:
        raise SettingError(
            f"{folder}: cannot be read ({problem.strerror}); make it readable, or give another folder"
        ) from None
    if (folder / MANIFEST).is_file() and folder / MANIFEST not in manifests:
        read_manifest(folder / MANIFEST)  # says what is wrong with it
    if not manifests:
        raise SettingError(f"{folder}: no {MANIFEST} of automarine here or in a folder below; give a folder of results")
    places = [path.parent for path in manifests]
    return [_verified(place, read_manifest(place / MANIFEST), places, inputs) for place in places]


def _verified(folder: Path, manifest: Manifest, places: Sequence[Path], inputs: Sequence[Path]) -> "FolderVerified":
    from automarine_cli.report.verification import Change, FolderVerified

    recorded = {entry.file: entry.sha256 for entry in manifest.outputs}
    changes = []
    for name, content in recorded.items():
        if not (folder / name).is_file():
            changes.append(Change(name, "missing", "missing"))
        elif sha256(folder / name) != content:
            changes.append(Change(name, "changed", "changed since it was written"))
    nested = [place for place in places if place != folder and folder in place.parents]
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        recorded_file = name in recorded or name == MANIFEST or path.name in NOT_RESULTS
        if not recorded_file and not path.is_dir() and not any(place in path.parents for place in nested):
            changes.append(Change(name, "extra", "extra: not among the files that were written"))
    # where nobody says: in the working directory, and in the folder that holds the results
    parent = folder.resolve().parent
    likely = [Path()] if Path.cwd() == parent or Path.cwd() in parent.parents else [Path(), parent]
    sought = list(_find_inputs(manifest.inputs, inputs or likely))
    where = f"under {', '.join(str(place) for place in inputs)}" if inputs else "here or beside the results"
    bad = []
    for name, there, changed in sought:
        if changed is not None:
            bad.append(Change(name, "changed", f"changed; {changed} has other content"))
        elif there is None:
            bad.append(Change(name, "missing" if inputs else "not-found", f"not found {where}"))
    good = len(sought) - len(bad)
    return FolderVerified(str(folder), manifest.command, len(recorded), tuple(changes), len(sought), good, tuple(bad))


def _find_inputs(entries: Sequence[Entry], folders: Sequence[Path]) -> Iterator[tuple[str, Path | None, Path | None]]:
    """Yield of each recorded input its name, the file under the folders (hidden ones left out) that holds what was read
    then, and where there is none one of that whole name."""
    by_name: dict[str, list[Path]] = {}
    for place, inside, files in (at for path in folders for at in os.walk(path if path.is_dir() else path.parent)):
        inside[:] = sorted(name for name in inside if not name.startswith("."))
        for name in sorted(files):
            by_name.setdefault(printable(name), []).append(Path(place, name))
    for entry in entries:
        paths = by_name.get(PurePosixPath(entry.file).name, [])
        alike = [path for path in paths if printable(path.resolve().as_posix()).endswith(f"/{entry.file}")]
        same = next((path for path in [*alike, *paths] if entry.sha256 in (None, sha256(path))), None)
        yield entry.file, same, alike[0] if alike and same is None else None
