"""`run --from`: the same result again, from the recipe that its manifest recorded."""

import tempfile
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap, LogFile
from automarine_cli.pipeline.codec import Codec
from automarine_cli.pipeline.inputs import Sought, find_inputs
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.plain_data import Document
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.words import listed
from automarine_cli.workflows.command import Command, commands

SCHEMA = "automarine/rerun/1"


@dataclass(frozen=True)
class Rerun:
    """A result that was made again: its recipe, the new manifest, and what became of each file."""

    recorded: Manifest
    made: Manifest

    @property
    def files(self) -> dict[str, str]:
        """`same`, `different`, `missing` now or `new`, for each file of either result."""
        then = {entry.file: entry.sha256 for entry in self.recorded.outputs}
        now = {entry.file: entry.sha256 for entry in self.made.outputs}
        return {name: _fate(then.get(name), now.get(name)) for name in sorted({*then, *now})}

    @property
    def same(self) -> bool:
        """Whether every file has the bytes recorded, and none is missing or new."""
        return set(self.files.values()) <= {"same"}

    @property
    def versions(self) -> dict[str, tuple[str, str]]:
        """Versions then and now, of what has another version now."""
        then, now = self.recorded.versions, self.made.versions
        return {
            name: (then.get(name, "none"), now.get(name, "none"))
            for name in {**then, **now}
            if then.get(name) != now.get(name)
        }

    def to_json(self) -> dict[str, Any]:
        """The result: schema automarine/rerun/1."""
        return {
            "schema": SCHEMA,
            "command": self.recorded.command,
            "same": self.same,
            "files": self.files,
            "versions": {name: {"then": then, "now": now} for name, (then, now) in self.versions.items()},
        }

    def sentences(self) -> list[str]:
        """What was made again, whether it is the same, and which versions differ."""
        odd = [f"{name} ({fate})" for name, fate in self.files.items() if fate != "same"]
        inputs = len(self.recorded.inputs)
        said = f"{self.recorded.command} made again from {inputs} input{'s' * (inputs != 1)}: "
        total = len(self.files)
        said += f"{len(odd)} of {total} files are not as recorded: {listed(odd)}" if odd else (
            f"all {total} files have the bytes recorded"
        )  # fmt: skip
        versions = [f"{name} {then} then, {now} now" for name, (then, now) in self.versions.items()]
        if versions:
            return [f"{said}.", f"Versions differ: {'; '.join(versions)}."]
        return [f"{said}. All versions are those recorded."]


def rerun(
    recorded: Path,
    *,
    inputs: Sequence[Path] = (),
    out: Path | None = None,
    overwrite: bool = False,
    jobs: int = 1,
    progress: Progress = silent,
) -> Rerun:
    """Run the command that the manifest `recorded` (or the folder that holds it) tells of, on the same inputs.

    They are looked for by name and content under `inputs`, by default the working directory. Writes the results if
    `out` is given; else they are made, compared and dropped. Raises SettingError for inputs that are missing or
    changed and for a manifest that cannot be followed, and whatever the command itself refuses.
    """
    place = recorded / MANIFEST if recorded.is_dir() else recorded
    if not place.exists():
        raise SettingError(f"{recorded}: no {MANIFEST} here; give a folder of results, or its {MANIFEST}")
    manifest = read_manifest(place)
    known = {name: command for name, command in commands().items() if command.repeats}
    if manifest.command not in known:
        raise SettingError(f"{place.name}: command is {manifest.command!r}; known are {', '.join(known)}")
    found = find_inputs(manifest.inputs, list(inputs) or [Path()])
    _refuse_lost(found, inputs)
    command = known[manifest.command]
    settings = _settings(command, manifest, found, place.name)
    with tempfile.TemporaryDirectory(prefix="automarine-") as spare:
        target = Path(spare) / "again" if out is None else out
        command(**settings, out=target, overwrite=overwrite, jobs=jobs, progress=progress)
        return Rerun(manifest, read_manifest(target / MANIFEST))


def _refuse_lost(found: Sequence[Sought], inputs: Sequence[Path]) -> None:
    lost = [f"{one.entry.file} ({'changed' if one.changed else 'not found'})" for one in found if one.path is None]
    if lost:
        where = f"under {', '.join(str(place) for place in inputs)}" if inputs else "in the working directory"
        raise SettingError(
            f"{len(lost)} of {len(found)} recorded inputs are not {where} as they were: {listed(lost)}; "
            "give the folders that hold them with --inputs"
        )


def _settings(command: Command[Any, Any], manifest: Manifest, found: Sequence[Sought], where: str) -> dict[str, Any]:
    """The options as they were given. Raises SettingError for what this version does not know."""
    roles: dict[str, list[Path]] = {}
    for one in found:
        roles.setdefault(one.entry.role, []).extend([one.path] if one.path else [])
    options = command.chosen({"model": next(iter(roles.get("model", ())), None)}).options
    hints, settings = typing.get_type_hints(options), {}
    known = {one.name: one for one in fields(options)}
    for key, value in manifest.options.items():
        if key not in known or known[key].metadata.get("unrecorded"):
            raise SettingError(
                f"{where}: options: unknown key {key!r} of {manifest.command}; give a manifest as it wrote it"
            )
        if "read" not in known[key].metadata:
            settings[key] = Codec(where).value(hints[key], value, ("options", key))
    for key, option in known.items():
        read = option.metadata.get("read")
        if read is None:
            continue
        if read.kind == "file":
            value = manifest.options.get(key, "" if option.metadata["unrecorded"] else None)
            settings[key] = _file(key, value, hints[key], roles, f"{where}: options.{key}")
        elif read.kind == "logs":
            entries = (sought for sought in found if sought.entry.role == read.role)
            settings[key] = [LogFile(one.path, one.entry.file, False) for one in entries if one.path]
        else:
            settings[key] = [path.parent if read.kind == "folders" else path for path in roles.get(read.role, ())]
    return settings if manifest.seed is None or "seed" not in known else {**settings, "seed": manifest.seed}


def _file(key: str, value: object, hint: object, roles: Mapping[str, list[Path]], where: str) -> object:
    """The file that was given as this option, or the table that was given in its place."""
    if value is None:
        return None
    table = next((one for one in typing.get_args(hint) if is_dataclass(one) and one is not Document), None)
    if table is not None and isinstance(value, Mapping):
        given = Codec(where).value(table, value)
        place = next(iter(roles.get("dbc", ())), None)
        return replace(given, dbc=str(place)) if place and isinstance(given, ColumnMap) else given
    if not roles.get(key):
        raise SettingError(f"{where}: no input was recorded as the {key}; it was no file, call Python again")
    return roles[key][0]


def _fate(then: str | None, now: str | None) -> str:
    if now is None:
        return "missing"
    if then is None:
        return "new"
    return "same" if then == now else "different"
