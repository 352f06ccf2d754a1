"""Is a result on the disk still what its command would make? If not, why not: inputs, settings or version."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.manifest import (
    MANIFEST,
    Input,
    Manifest,
    input_entries,
    is_manifest,
    read_manifest,
    sha256_if_readable,
    versions_here,
)
from automarine_cli.pipeline.outputs import json_text, recorded_options
from automarine_cli.pipeline.plain_data import Source
from automarine_cli.pipeline.words import listed


def why_made_again(
    folder: Path, *, command: str, options: Mapping[str, object], seed: int | None, inputs: Sequence[Input]
) -> str | None:
    """Why `command` must run although there is `folder`; None if what it holds is what would be made again.

    Told are, in this order: no result, another version, settings, inputs, files that somebody changed. Options
    that the manifest does not record (such as the number of jobs) change no result and are not looked at.
    """
    manifest = manifest_of(folder)
    if manifest is None or manifest.command != command:
        return "no result yet"
    return (
        _version(manifest)
        or _settings(manifest, options, seed)
        or _inputs(manifest, inputs)
        or _outputs(manifest, folder)
    )


def manifest_of(folder: Path) -> Manifest | None:
    """The manifest of a folder of results; None where there is none, or none that this version reads."""
    try:
        place = folder / MANIFEST
        return read_manifest(place) if is_manifest(place) else None
    except (OSError, SettingError):
        return None


def logs_behind(file: Source, sha256: str) -> tuple[tuple[str, str], ...] | None:
    """Names and hashes of the logs that a result file was made of, told by the manifest beside it; None without one."""
    manifest = manifest_of(file.parent) if isinstance(file, Path) else None
    if manifest is None or not any(one.sha256 == sha256 for one in manifest.outputs):
        return None
    return tuple((one.file, one.sha256 or "unreadable") for one in manifest.inputs if one.role in ("log", "hold_out"))


def _version(manifest: Manifest) -> str | None:
    then, now = manifest.versions, versions_here()
    odd = [name for name in {**then, **now} if then.get(name) != now.get(name)]
    told = (f"{name} {then.get(name, 'none')} then, {now.get(name, 'none')} now" for name in odd)
    return f"version: {listed(told)}" if odd else None


def _settings(manifest: Manifest, options: Mapping[str, object], seed: int | None) -> str | None:
    now = json.loads(json_text(recorded_options(options)))
    then = dict(manifest.options)
    odd = [key for key in {**then, **now} if then.get(key) != now.get(key)]
    odd += ["seed"] if manifest.seed != seed else []
    return f"settings changed: {listed(odd)}" if odd else None


def _inputs(manifest: Manifest, inputs: Sequence[Input]) -> str | None:
    then = {(entry.role, entry.file): entry.sha256 for entry in manifest.inputs}
    now = {(str(one["role"]), str(one["file"])): one["sha256"] for one in input_entries(inputs)}
    odd = [name for (role, name), sha in now.items() if then.get((role, name), sha) != sha]
    odd += [f"{name} (new)" for role, name in now if (role, name) not in then]
    odd += [f"{name} (gone)" for role, name in then if (role, name) not in now]
    return f"inputs changed: {listed(odd)}" if odd else None


def _outputs(manifest: Manifest, folder: Path) -> str | None:
    odd = [e.file for e in manifest.outputs if sha256_if_readable(folder / e.file) != e.sha256]
    return f"results changed since they were written: {listed(odd)}" if odd else None


def remove_results(folder: Path, command: str) -> bool:
    """Take away what `command` wrote into `folder`, and the folder if nothing else is in it; whether it was there."""
    manifest = manifest_of(folder)
    if manifest is None or manifest.command != command:
        return False
    for entry in manifest.outputs:
        (folder / entry.file).unlink(missing_ok=True)
    (folder / MANIFEST).unlink()
    if not any(folder.iterdir()):
        folder.rmdir()
    return True
