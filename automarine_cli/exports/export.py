"""`export`: a model written for a simulator or a paper; what the target cannot represent is listed, and refused."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

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
from automarine_cli.pipeline.manifest import sha256
from automarine_cli.pipeline.one_file import refuse_existing, write_whole
from automarine_cli.pipeline.plain_data import Source, read_plain
from automarine_cli.pipeline.reuse import logs_behind
from automarine_cli.pipeline.words import listed, printable
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.results.kinds import PLANAR_MODEL
from automarine_cli.results.kinds import THRUSTER_MAP as MAP
from automarine_cli.thrusters.map import ThrusterMap


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
    out: Path | None = None

    @property
    def text(self) -> str:
        """The file's content."""
        return self.written.text

    @property
    def missing(self) -> tuple[str, ...]:
        """A sentence for each effect that the file leaves out."""
        return tuple(f"Left out: {effect.name}: {effect.why}." for effect in self.left_out)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must not miss: effects left out, and the notes that warn."""
        return (*self.missing, *(note for note in self.written.notes if note.startswith(("Warning", "Left out"))))

    def to_json(self) -> dict[str, Any]:
        """Schema automarine/export/1."""
        return {
            "schema": "automarine/export/1",
            "target": self.target,
            "form": self.form,
            "frame": self.frame,
            "moment_unit": self.moment_unit,
            "source": {"file": self.origin.file, "sha256": self.origin.sha256, "model": self.origin.number or None},
            "carried": list(self.carried),
            "left_out": [vars(effect) for effect in self.left_out],
            "notes": list(self.written.notes),
            "text": self.text,
        }


@sections.register
def _(result: Exported) -> Sections:
    if result.out is None:
        return Sections(())  # the text itself is printed
    held = f"{result.target}, form {result.form}, frame {result.frame}: {listed(result.carried)}."
    return Sections((held, *result.missing, *result.written.notes))


@dataclass(frozen=True)
class Targets:
    """All targets, for the list."""

    targets: tuple[Target, ...]

    def to_json(self) -> dict[str, Any]:
        """Schema automarine/export-targets/1."""
        return {
            "schema": "automarine/export-targets/1",
            "targets": [
                {
                    "name": target.name,
                    "says": target.says,
                    "takes": target.takes,
                    "motions": _motions(target),
                    "forms": dict(target.forms),
                    "frames": list(target.frames),
                    "effects": sorted(target.carries),
                    "newton_metres": target.si,
                    "source": target.source,
                }
                for target in self.targets
            ],
        }


@sections.register
def _(result: Targets) -> Sections:
    rows = tuple(
        (target.name, target.says, ", ".join(_motions(target)) or "thrusters", ", ".join(target.forms),
         ", ".join(target.frames))
        for target in result.targets
    )  # fmt: skip
    note = "The first form and the first frame are taken where none is asked for; --json lists the effects of each."
    return Sections([Table("Targets", ("target", "writes", "models of", "forms", "frames"), rows, notes=(note,))])


def _motions(target: Target) -> list[str]:
    """Motions whose models a target takes; none where it takes thruster maps."""
    together = [PLANAR.name] * (target.planar is not None)
    return [*target.motions, *together] if target.takes == YAW_MODEL else []


def export_targets() -> Targets:
    """List every target there is."""
    return Targets(tuple(targets.get(name) for name in targets.names()))


def export_model(
    model: Source,
    to: str,
    *,
    form: str | None = None,
    number: str | None = None,
    frame: str | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    **settings: Any,
) -> Exported:
    """Write the model in a file `model` for the target `to`, into the file `out` if that is given.

    `number` is which of the file's models (by default the preferred one), `frame` ENU or NED (by default the target's
    own); the other settings are those of `exports.base.Settings`. Raises ModelError, SettingError or OutputError, for
    an effect too that the target cannot represent, unless `allow_partial`.
    """
    target, chosen = targets.get(to), Settings(**settings)
    refuse_unused(target, chosen)
    data = read_plain(model, "JSON", ModelError)
    origin = Origin(printable(model.name), sha256(model))
    planar = data.get("schema") == PLANAR_MODEL.schema
    forms, frames = _taken_of_plane(target, origin, chosen) if planar else (target.forms, target.frames)
    usual = next(iter(forms)) if planar else _form_by_ending(target, out)
    form = _one_of(forms, form or usual, f"--form of {target.name}")
    frame = _one_of(frames, (frame or frames[0]).upper(), f"--frame of {target.name}")
    if out is not None:
        refuse_existing(out, overwrite=overwrite)
    if planar:
        result = _of_plane(target, data, origin, form, frame, chosen)
    elif target.takes == THRUSTER_MAP:
        result = _of_map(target, data, origin, form, frame, chosen)
    else:
        logs = logs_behind(model, origin.sha256)
        result = _of_yaw(target, data, origin, number, form, frame, chosen, logs)
    if out is not None:
        write_whole(out, result.text)
    return replace(result, out=out)


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


def _of_plane(
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
    full_scale = MAP.of(data, origin.file).full_scale_N
    subject = MapSubject(origin, ThrusterMap.from_json(data, origin.file), frame, form, settings, full_scale)
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
    return next((form for form, suffix in target.forms.items() if suffix == ending), next(iter(target.forms)))


def _one_of(choices: Iterable[str], value: str, option: str) -> str:
    if value not in choices:
        raise SettingError(f"{option}: found {value}, expected {' or '.join(choices)}")
    return value
