"""`run --from`: the same result again, from the recipe that its manifest recorded."""

import inspect
import tempfile
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from automarine_cli.errors import SettingError
from automarine_cli.logs import ColumnMap, LogFile
from automarine_cli.models.planar_store import is_planar
from automarine_cli.pipeline.inputs import Sought, find_inputs
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.outputs import UNRECORDED
from automarine_cli.pipeline.progress import Progress, silent
from automarine_cli.pipeline.recipe import converted
from automarine_cli.pipeline.words import listed
from automarine_cli.planning.limits import Limits
from automarine_cli.workflows.campaigns import run_campaigns
from automarine_cli.workflows.check import check
from automarine_cli.workflows.compare import compare
from automarine_cli.workflows.diagnose import diagnose
from automarine_cli.workflows.diagnose_planar import diagnose_planar
from automarine_cli.workflows.diagnose_thrusters import diagnose_thrusters, is_thruster_map
from automarine_cli.workflows.fit_planar import fit_planar
from automarine_cli.workflows.fit_thrusters import fit_thrusters
from automarine_cli.workflows.fit_yaw import FITS
from automarine_cli.workflows.plan import plan
from automarine_cli.workflows.run import run_campaign
from automarine_cli.workflows.simulate import simulate
from automarine_cli.workflows.slice import slice_log
from automarine_cli.workflows.validate import validate
from automarine_cli.workflows.validate_planar import validate_planar

SCHEMA = "automarine/rerun/1"
COMMANDS: Mapping[str, Callable[..., object]] = {
    "check": check,
    "fit-thrusters": fit_thrusters,
    **{f"fit-{name}": fit for name, fit in FITS.items()},
    "fit-planar": fit_planar,
    "validate": validate,
    "diagnose": diagnose,
    "simulate": simulate,
    "plan": plan,
    "slice": slice_log,
    "compare": compare,
    "run": run_campaign,
    "campaigns": run_campaigns,
}
GIVEN_AS_TABLE = {"columns": ColumnMap, "limits": Limits}  # options that may be a table in place of a file
# Options that are files; logs, hold_out and specification are more.
FILES = ("model", "thrusters", "columns", "diagnosis", "limits")


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
    if manifest.command not in COMMANDS:
        raise SettingError(f"{place.name}: command is {manifest.command!r}; known are {', '.join(COMMANDS)}")
    found = find_inputs(manifest.inputs, list(inputs) or [Path()])
    _refuse_lost(found, inputs)
    work, settings = _recipe(manifest, found, place.name)
    with tempfile.TemporaryDirectory(prefix="automarine-") as spare:
        target = Path(spare) / "again" if out is None else out
        work(**settings, out=target, overwrite=overwrite, jobs=jobs, progress=progress)
        return Rerun(manifest, read_manifest(target / MANIFEST))


def _refuse_lost(found: Sequence[Sought], inputs: Sequence[Path]) -> None:
    lost = [
        f"{one.entry.file} ({'changed' if one.changed else 'not found'})" for one in found if one.path is None
    ]
    if lost:
        where = f"under {', '.join(str(place) for place in inputs)}" if inputs else "in the working directory"
        raise SettingError(
            f"{len(lost)} of {len(found)} recorded inputs are not {where} as they were: {listed(lost)}; "
            "give the folders that hold them with --inputs"
        )


def _recipe(
    manifest: Manifest, found: Sequence[Sought], where: str
) -> tuple[Callable[..., object], dict[str, Any]]:
    """The workflow and its settings. Raises SettingError for what this version does not know."""
    roles: dict[str, list[Sought]] = {}
    for one in found:
        roles.setdefault(one.entry.role, []).append(one)
    work = COMMANDS[manifest.command]
    if work is diagnose and "model" in roles and is_thruster_map(roles["model"][0].path or Path()):
        work = diagnose_thrusters
    if work is diagnose and "model" in roles and is_planar(roles["model"][0].path or Path()):
        work = diagnose_planar
    if work is validate and "model" in roles and is_planar(roles["model"][0].path or Path()):
        work = validate_planar
    known, hints = inspect.signature(work).parameters, typing.get_type_hints(work)
    settings: dict[str, Any] = {}
    for key, value in manifest.options.items():
        if key not in known or key in UNRECORDED:
            raise SettingError(
                f"{where}: options: unknown key {key!r} of {manifest.command}; give a manifest as it wrote it"
            )
        if key in FILES:
            settings[key] = _file(key, value, roles, f"{where}: options.{key}")
        elif key != "hold_out":
            settings[key] = converted(hints[key], value, f"{where}: options.{key}")
    for key, role in (("logs", "log"), ("hold_out", "hold_out"), ("thruster_tests", "thruster_tests")):
        if key in known:
            settings[key] = [
                LogFile(one.path, one.entry.file, False) for one in roles.get(role, ()) if one.path
            ]
    for key in ("specification", "campaign"):
        if key in known:
            settings[key] = _file(key, "", roles, f"{where}: inputs")
    if "campaigns" in known:
        settings["campaigns"] = [one.path for one in roles.get("campaign", ()) if one.path]
    if "results" in known:
        settings["results"] = [one.path.parent for one in roles.get("result", ()) if one.path]
    if "seed" in known and manifest.seed is not None:
        settings["seed"] = manifest.seed
    return work, settings


def _file(
    key: str, value: object, roles: Mapping[str, list[Sought]], where: str
) -> Path | ColumnMap | Limits | None:
    """The file that was given as this option, or the table that was given in its place."""
    if value is None:
        return None
    if key in GIVEN_AS_TABLE and isinstance(value, Mapping):
        given = converted(GIVEN_AS_TABLE[key], value, where)
        place = next((one.path for one in roles.get("dbc", ()) if one.path), None)
        return replace(given, dbc=str(place)) if place and isinstance(given, ColumnMap) else given
    if not roles.get(key):
        raise SettingError(f"{where}: no input was recorded as the {key}; it was no file, call Python again")
    return roles[key][0].path


def _fate(then: str | None, now: str | None) -> str:
    if now is None:
        return "missing"
    if then is None:
        return "new"
    return "same" if then == now else "different"
