"""`export`: a model written for a simulator or a paper; what the target cannot represent is listed, and refused."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from automarine_cli import exports as targets
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.exports.base import (
    THRUSTER_MAP,
    YAW_MODEL,
    LeftOut,
    MapSubject,
    Origin,
    Settings,
    Target,
    Written,
    YawSubject,
)
from automarine_cli.exports.conversions import in_enu
from automarine_cli.exports.planar import planar_subject
from automarine_cli.exports.prepare import (
    cannot,
    in_unit,
    refuse_driving,
    refuse_inertia,
    refuse_motion,
    refuse_unused,
    split,
)
from automarine_cli.models.planar_store import planar_from_json
from automarine_cli.models.store import file_and_models, motion_of
from automarine_cli.pipeline.manifest import manifest_of, sha256
from automarine_cli.pipeline.records import Source, read_plain
from automarine_cli.pipeline.results_folder import refuse_existing, write_whole
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import PLANAR_MODEL
from automarine_cli.results.kinds import THRUSTER_MAP as MAP
from automarine_cli.thrusters.map import ThrusterMap
from automarine_cli.workflows.command import Command, Runner, reads
from automarine_cli.workflows.view import View

SCHEMA = "automarine/export/1"


@dataclass(frozen=True)
class Exported:
    """The file's text, with what it holds, what it leaves out, and what its reader must be told."""

    target: str
    form: str
    frame: str
    origin: Origin
    moment_unit: str | None
    carried: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    written: Written

    @property
    def text(self) -> str:
        """The file's content."""
        return self.written.text

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must not miss: effects left out, and the notes that warn."""
        left = tuple(f"Left out: {one.name}: {one.why}." for one in self.left_out)
        return left + tuple(note for note in self.written.notes if note.startswith(("Warning", "Left out")))

    def to_json(self) -> dict[str, object]:
        """Schema automarine/export/1."""
        return {
            "schema": SCHEMA,
            "target": self.target,
            "form": self.form,
            "frame": self.frame,
            "moment_unit": self.moment_unit,
            "source": {"file": self.origin.file, "sha256": self.origin.sha256, "model": self.origin.number or None},
            "carried": list(self.carried),
            "left_out": [vars(one) for one in self.left_out],
            "notes": list(self.written.notes),
            "text": self.text,
        }

    def tables(self) -> tuple[Table | str, ...]:
        """What is in the file, what is not, and the notes."""
        held = f"{self.target}, form {self.form}, frame {self.frame}: {listed(self.carried)}."
        return (held, *(f"Left out: {one.name}: {one.why}." for one in self.left_out), *self.written.notes)


@dataclass(frozen=True)
class Targets:
    """All targets, for the list."""

    targets: tuple[Target, ...]

    def to_json(self) -> dict[str, object]:
        """Schema automarine/export-targets/1."""
        return {
            "schema": "automarine/export-targets/1",
            "targets": [
                {
                    "name": one.name,
                    "says": one.says,
                    "takes": one.takes,
                    "motions": _motions(one),
                    "forms": dict(one.forms),
                    "frames": list(one.frames),
                    "effects": sorted(one.carries),
                    "newton_metres": one.si,
                    "source": one.source,
                }
                for one in self.targets
            ],
        }

    def tables(self) -> tuple[Table, ...]:
        """One row a target."""
        rows = tuple(
            (one.name, one.says, _taken(one), ", ".join(one.forms), ", ".join(one.frames)) for one in self.targets
        )
        note = "The first form and the first frame are taken where none is asked for; --json lists the effects of each."
        return (Table("Targets", ("target", "writes", "models of", "forms", "frames"), rows, notes=(note,)),)


def _logs_behind(file: Source, sha256: str) -> tuple[tuple[str, str], ...] | None:
    """Return names and hashes of the logs that a result file was made of, by the manifest beside it; None without."""
    manifest = manifest_of(file.parent) if isinstance(file, Path) else None
    if manifest is None or not any(entry.sha256 == sha256 for entry in manifest.outputs):
        return None
    return tuple((e.file, e.sha256 or "unreadable") for e in manifest.inputs if e.role in ("log", "hold_out"))


def _taken(target: Target) -> str:
    return ", ".join(_motions(target)) or "thrusters"


def _motions(target: Target) -> list[str]:
    """Motions whose models a target takes; none where it takes thruster maps."""
    together = [PLANAR.name] * (target.planar is not None)
    return [*target.motions, *together] if target.takes == YAW_MODEL else []


def export_targets() -> Targets:
    """Every target there is."""
    return Targets(tuple(targets.get(name) for name in targets.names()))


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """The model and the target; `number` is which of the file's yaw models (by default the preferred one), `frame` ENU
    or NED (by default the target's own)."""

    model: Source = field(metadata=reads("file"))
    to: str
    form: str | None = None
    number: str | None = None
    frame: str | None = None


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Settings, _Asked):
    """The same, with the settings that targets use."""

    @property
    def settings(self) -> Settings:
        """Those of targets alone."""
        return Settings(**{one.name: getattr(self, one.name) for one in fields(Settings)})


def _export(asked: ExportOptions, runner: Runner) -> Exported:
    """Write the model in a file `model` for the target `to`, into the file `out` if that is given.

    The settings are those of `exports.base.Settings`. Raises ModelError, SettingError or OutputError, for an effect too
    that the target cannot represent, unless `allow_partial`.
    """
    target, settings, out = targets.get(asked.to), asked.settings, runner.out
    refuse_unused(target, settings)
    data = read_plain(asked.model, "JSON", ModelError)
    origin = Origin(printable(asked.model.name), sha256(asked.model))
    planar = data.get("schema") == PLANAR_MODEL.schema
    forms, frames = _taken_of_plane(target, origin, settings) if planar else (target.forms, target.frames)
    usual = next(iter(forms)) if planar else _form_by_ending(target, out)
    form = _one_of(forms, asked.form or usual, f"--form of {target.name}")
    frame = _one_of(frames, (asked.frame or frames[0]).upper(), f"--frame of {target.name}")
    if out is not None:
        refuse_existing(out, overwrite=runner.overwrite)
    if planar:
        result = _planar(target, data, origin, form, frame, settings)
    elif target.takes == THRUSTER_MAP:
        result = _of_map(target, data, origin, form, frame, settings)
    else:
        logs = _logs_behind(asked.model, origin.sha256)
        result = _of_yaw(target, data, origin, asked.number, form, frame, settings, logs)
    if out is not None:
        write_whole(out, result.text)
    return result


def _taken_of_plane(target: Target, origin: Origin, settings: Settings) -> tuple[Mapping[str, str], Sequence[str]]:
    """Forms and frames of a target for models of surge, sway and yaw together."""
    if target.planar is None:
        takers = [name for name in targets.names() if targets.get(name).planar is not None]
        raise SettingError(
            f"{origin.file} is a model of surge, sway and yaw together; --to {target.name} takes one motion: take --to "
            f"{' or '.join(takers)}, or a model of one motion"
        )
    if settings.newton_metres_per_nu is not None:
        raise SettingError(
            f"{origin.file} is in newtons already; --newton-metres-per-nu is for the unit nu, so leave it out"
        )
    return target.planar.forms, target.planar.frames


def _planar(
    target: Target, data: Mapping[str, object], origin: Origin, form: str, frame: str, settings: Settings
) -> Exported:
    """A model of surge, sway and yaw together."""
    assert target.planar is not None
    subject = planar_subject(planar_from_json(data, origin.file).model, origin, frame, form, settings, target.name)
    carried = ("inertia", *(name for name, _, _ in subject.drags()))
    written = target.planar.write(subject)
    return Exported(target.name, form, frame, origin, "N m", carried, subject.left_out, written)


def _of_map(
    target: Target, data: Mapping[str, object], origin: Origin, form: str, frame: str, settings: Settings
) -> Exported:
    if data.get("schema") != MAP.schema and "models" in data:
        motion = motion_of(data).name
        raise SettingError(f"{origin.file} is a {motion} model; --to {target.name} takes the thrusters.json of a fit")
    found = ThrusterMap.from_json(data, origin.file)
    full_scale = MAP.of(data, origin.file).full_scale_N
    subject = MapSubject(origin, found, frame, form, settings, full_scale)
    return Exported(target.name, form, frame, origin, None, ("thruster map",), (), target.write(subject))


def _of_yaw(
    target: Target,
    data: Mapping[str, object],
    origin: Origin,
    number: str | None,
    form: str,
    frame: str,
    settings: Settings,
    logs: tuple[tuple[str, str], ...] | None,
) -> Exported:
    if data.get("schema") == MAP.schema:
        raise SettingError(f"{origin.file} is a thruster map; --to {target.name} takes a yaw model, as --to thrusters "
                           "takes a map")  # fmt: skip
    refuse_motion(target, motion_of(data), origin)
    file, stored = file_and_models(data, origin.file)
    which = _one_of(stored.models, number or stored.preferred, "--number")
    origin = replace(origin, number=which)
    model = in_unit(target, stored.models[which], settings, origin)
    kept, left_out = split(target, model, settings)
    if left_out and not settings.allow_partial:
        raise SettingError(cannot(target, left_out, origin))
    part = replace(model, terms=kept)
    part = in_enu(part) if frame == "ENU" else part
    refuse_inertia(target, settings.rigid_inertia, part, origin)
    if target.si:
        refuse_driving(part, target, origin)
    subject = YawSubject(origin, part, frame, form, settings, left_out, file, logs)
    carried = ("inertia", *(term.name for term in kept))
    return Exported(target.name, form, frame, origin, part.moment_unit, carried, left_out, target.write(subject))


def _form_by_ending(target: Target, out: Path | None) -> str:
    """The first form whose files end as `out` does, else the first of all."""
    ending = "" if out is None else out.suffix.lower()
    return next((form for form, its in target.forms.items() if its == ending), next(iter(target.forms)))


def _one_of(known: Iterable[str], asked: str, what: str) -> str:
    if asked not in known:
        raise SettingError(f"{what}: found {asked}, expected {' or '.join(known)}")
    return asked


export = Command(
    "export", ExportOptions, _export, {Exported: View(Exported.tables, lambda result: iter(result.warnings))},
)  # fmt: skip
