"""The folders that a campaign's report is made from: what each step left, read and checked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.errors import OutputError
from automarine_cli.fits.estimate import Estimate
from automarine_cli.pipeline.manifest import MANIFEST, Manifest, read_manifest
from automarine_cli.pipeline.plain_data import read_plain


@dataclass(frozen=True)
class Kind:
    """What a step leaves: its result file, how that file's schema begins, what it is in words, of which motion
    (a campaign's main one where it is of none)."""

    file: str
    schema: str
    words: str
    dof: Dof


def folder_of(dof: Dof, step: str) -> str:
    """The folder of "validation" or "diagnosis" of a motion; those of yaw, which every campaign has, need no name."""
    return step if dof is YAW else f"{dof.name}_{step}"


def _of(dof: Dof) -> Iterator[tuple[str, Kind]]:
    """Folders of one motion."""
    name, also = dof.name, "" if dof is YAW else f" in {dof.name}"
    yield name, Kind(f"{name}_model.json", f"automarine/{name}-model/", f"a {name} model", dof)
    for step in ("validation", "diagnosis"):
        yield folder_of(dof, step), Kind(f"{step}.json", f"automarine/{step}/", f"a {step}{also}", dof)


FORCES = tuple(dof for dof in DOFS.values() if dof is not YAW)
"""Motions that only some campaigns have."""

RESULTS = {
    "check": Kind("check.json", "automarine/check/", "a look at the logs", YAW),
    "thrusters": Kind("thrusters.json", "automarine/thruster-map/", "a thruster map", YAW),
    **dict(_of(YAW)),
}
"""What each folder of every campaign holds."""

OF_FORCE = {
    **dict(entry for dof in FORCES for entry in _of(dof)),
    "planar": Kind("planar_model.json", "automarine/planar-model/", "a planar model", YAW),
    "planar_validation": Kind("validation.json", "automarine/validation/", "a planar validation", YAW),
    "planar_diagnosis": Kind("diagnosis.json", "automarine/diagnosis/", "a planar diagnosis", YAW),
}
"""The same of the steps that only campaigns with these motions, or with all three together, have."""


@dataclass(frozen=True)
class StepResult:
    """One step's folder: its result file, under the keys of its motion, and its manifest (None if there is none)."""

    name: str
    folder: Path
    data: Mapping[str, Any]
    manifest: Manifest | None

    @property
    def dof(self) -> Dof:
        """The motion that it is of."""
        return (RESULTS | OF_FORCE)[self.name].dof

    @property
    def file(self) -> str:
        """The result file, as messages name it."""
        return f"{self.name}/{(RESULTS | OF_FORCE)[self.name].file}"

    def at(self, *keys: str | int) -> Any:
        """A value in the result file. Raises OutputError with its place if it is not there."""
        value: Any = self.data
        for key in keys:
            try:
                value = value[key]
            except (KeyError, IndexError, TypeError):
                place = ".".join(str(one) for one in keys)
                raise OutputError(
                    f"{self.file}: {place} is missing; expected a file as automarine writes it. Run that step again"
                ) from None
        return value

    def number(self, *keys: str | int) -> float:
        """A number in the result file. Raises OutputError if it is none."""
        value = self.at(*keys)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise OutputError(f"{self.file}: {'.'.join(map(str, keys))} is no number. Run that step again")
        return float(value)

    def estimate(self, *keys: str | int) -> Estimate:
        """An estimate in the result file. Raises OutputError if it is none."""
        low, high = (self.number(*keys, "ci95", i) for i in (0, 1))
        return Estimate(
            self.number(*keys, "value"), self.number(*keys, "stderr"), (low, high), str(self.at(*keys, "unit"))
        )

    def text(self, name: str) -> str:
        """A text file of the folder; empty if it is not there."""
        path = self.folder / name
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def read_steps(folder: Path) -> dict[str, StepResult]:
    """The steps that are there, by folder name in their order. Raises OutputError if there is none, or for a file
    that automarine did not write so."""
    found = {}
    for name, kind in (RESULTS | OF_FORCE).items():
        path = folder / name / kind.file
        if not path.is_file():
            continue
        data = read_plain(path, "JSON", OutputError)
        if not str(data.get("schema", "")).startswith(kind.schema):
            raise OutputError(
                f"{name}/{kind.file}: schema is {data.get('schema')!r}; expected {kind.schema}1. Run that step again"
            )
        manifest = path.with_name(MANIFEST)
        found[name] = StepResult(name, folder / name, data, read_manifest(manifest) if manifest.is_file() else None)
    if not found:
        raise OutputError(
            f"{folder}: none of the folders {', '.join(RESULTS)} with results is here; give a folder that "
            "automarine run made, or write the results of single commands into folders of these names"
        )
    return found
