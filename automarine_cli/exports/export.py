"""`export`: a model written for a simulator or a paper; what the target cannot represent is listed, and refused."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from automarine_cli import effects
from automarine_cli import exports as targets
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.effects.base import EVEN, ODD
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.exports import base
from automarine_cli.exports.base import DRAGS, MapSubject, Origin, Settings, Target, Unsupported, Written, YawSubject
from automarine_cli.exports.planar import PlanarSubject, planar_subject
from automarine_cli.models.model import DELAY, RESTORING, Model, Term
from automarine_cli.models.store import PLANAR_MODEL, file_and_models, models_of, motion_of
from automarine_cli.pipeline.records import Source, read_plain
from automarine_cli.pipeline.results_folder import manifest_of, refuse_existing, sha256, write_whole
from automarine_cli.report.sections import Sections, sections
from automarine_cli.report.tables import Table
from automarine_cli.text import listed, printable
from automarine_cli.thrusters.map import THRUSTER_MAP as MAP
from automarine_cli.thrusters.map import ThrusterMap

PLACE_WHY = {
    "sensor": "it acts on the reading, not on the vehicle",
    "actuator": "it acts in the thrusters, before the {force}",
    "moment": "the target's equation has no such term",
    "water": "the target's water has no state of its own",
}
IN_NEWTONS = "{} is in {} already; --newton-metres-per-nu is for the unit nu, so leave it out"
Values = tuple[float, ...]
MIRROR_OF_MIXED: dict[str, Callable[[Values], Values]] = {
    # reading: pi/2 - (psi + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi)
    "compass-deviation": lambda v: (-v[1], -v[0], -v[2], *v[3:]),
    "heading-moment": lambda v: (-v[1], -v[0]),
    "wall": lambda v: (-v[0], v[1], v[2], -v[3], v[4]),
    "current-deviation": lambda v: (v[0], -v[1], v[2]),
    "periodic-disturbance": lambda v: (-v[0], -v[1], *v[2:]),
    "thruster-imbalance": lambda v: v,  # a thruster is the same in any frame
}
"""Effects of which a mirror negates some parameters."""


@dataclass(frozen=True)
class Exported:
    """The `text` of the file for a `target`, in a `form` and `frame`, with moments in `moment_unit`. `place` is where
    it was written, or None. `origin` is the model's file, `carried` the effects in it, `left_out` those that are not,
    `written` the text with its notes, `warnings` what its reader must be told. It has no frame.

    Keys: `schema`, `target`, `form`, `frame`, `moment_unit`, `source`, `carried`, `left_out`, `notes`, `text`.
    """

    target: str
    form: str
    frame: str
    origin: Origin
    moment_unit: str | None
    carried: tuple[str, ...]
    left_out: tuple[Unsupported, ...]
    written: Written
    place: Path | None = None

    @property
    def text(self) -> str:
        return self.written.text

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must not miss: effects left out, and the notes that warn."""
        notes = (note for note in self.written.notes if note.startswith(("Warning", "Left out")))
        return (*map(str, self.left_out), *notes)

    def to_json(self) -> dict[str, Any]:
        source = {"file": self.origin.file, "sha256": self.origin.sha256, "model": self.origin.number or None}
        return {
            "schema": "automarine/export/1", "target": self.target, "form": self.form, "frame": self.frame,
            "moment_unit": self.moment_unit, "source": source, "carried": list(self.carried),
            "left_out": [vars(effect) for effect in self.left_out], "notes": list(self.written.notes),
            "text": self.text,
        }  # fmt: skip


@sections.register
def _(result: Exported) -> Sections:
    if result.place is None:
        return Sections(())  # the text itself is printed
    summary = f"{result.target}, form {result.form}, frame {result.frame}: {listed(result.carried)}."
    return Sections((summary, *map(str, result.left_out), *result.written.notes))


@dataclass(frozen=True)
class Targets:
    """The `targets` that there are, where `show_list` asks for them."""

    targets: tuple[Target, ...]

    def to_json(self) -> dict[str, Any]:
        rows = [
            {"name": target.name, "says": target.says, "motions": _motions(target), "forms": dict(target.forms),
             "frames": list(target.frames), "effects": sorted(target.carries), "newton_metres": target.si}
            for target in self.targets
        ]  # fmt: skip
        return {"schema": "automarine/export-targets/1", "targets": rows}


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
    return [*target.motions, *[PLANAR.name] * (target.planar is not None)]


def export_targets() -> Targets:
    return Targets(tuple(targets.get(name) for name in targets.names()))


def export_model(
    model: Source, to: str, *, form: str | None = None, number: str | None = None, frame: str | None = None,
    out: Path | None = None, overwrite: bool = False, **settings: Any,
) -> Exported:  # fmt: skip
    """Write the model in a file `model` for the target `to`, into the file `out` if that is given.

    `number` is which of the file's models (by default the preferred one), `frame` ENU or NED (by default the target's
    own); the other settings are those of `exports.base.Settings`. Raises ModelError, SettingError or OutputError, for
    an effect too that the target cannot represent, unless `allow_partial`."""
    target, chosen = targets.get(to), Settings(**settings)
    _refuse_unused(target, chosen)
    data = read_plain(model, "JSON", ModelError)
    origin, kind = Origin(printable(model.name), sha256(model)), data.get("schema")
    if kind == PLANAR_MODEL.schema and target.planar is None:
        takers = " or ".join(name for name in targets.names() if targets.get(name).planar is not None)
        wrong = f"{origin.file} is a model of surge, sway and yaw together; --to {target.name} takes one motion"
        raise SettingError(f"{wrong}: take --to {takers}, or a model of one motion")
    takes = target.planar if kind == PLANAR_MODEL.schema and target.planar else target
    ending = "" if out is None or takes is not target else out.suffix.lower()
    usual = next((name for name, suffix in takes.forms.items() if suffix == ending), next(iter(takes.forms)))
    form = _one_of(takes.forms, form or usual, f"--form of {target.name}")
    frame = _one_of(takes.frames, (frame or takes.frames[0]).upper(), f"--frame of {target.name}")
    if out is not None:
        refuse_existing(out, overwrite=overwrite)
    unit: str | None = None
    subject: PlanarSubject | MapSubject | YawSubject
    if takes is not target:
        if chosen.newton_metres_per_nu is not None:
            raise SettingError(IN_NEWTONS.format(origin.file, "newtons"))
        planar = models_of(data, origin.file)
        subject = planar_subject(planar, origin, frame, form, chosen, target.name)
        unit, carried = "N m", ("inertia", *(name for name, _, _ in subject.drags()))
    elif not target.motions:
        if kind != MAP.schema and "models" in data:
            wrong = f"{origin.file} is a {motion_of(data).name} model"
            raise SettingError(f"{wrong}; --to {target.name} takes the thrusters.json of a fit")
        full_scale = MAP.of(data, origin.file).full_scale_N
        subject = MapSubject(origin, frame, form, chosen, (), ThrusterMap.from_json(data, origin.file), full_scale)
        carried = ("thruster map",)
    else:
        logs = _logs_behind(model, origin.sha256)
        subject = _yaw_subject(target, data, origin, number, form, frame, chosen, logs)
        unit = subject.model.moment_unit
        carried = ("inertia", *(term.name for term in subject.model.terms))
    written = takes.write(subject)
    if out is not None:
        write_whole(out, written.text)
    return Exported(target.name, form, frame, subject.origin, unit, carried, subject.left_out, written, out)


def _one_of(choices: Iterable[str], value: str, option: str) -> str:
    if value not in choices:
        raise SettingError(f"{option}: found {value}, expected {' or '.join(choices)}")
    return value


def _yaw_subject(
    target: Target, data: Mapping[str, object], origin: Origin, number: str | None, form: str, frame: str,
    settings: Settings, logs: tuple[tuple[str, str], ...] | None,
) -> YawSubject:  # fmt: skip
    """A model of one motion with what the target carries, in its frame and unit. Raises SettingError, ModelError."""
    if data.get("schema") == MAP.schema:
        takes = f"--to {target.name} takes a yaw model, as --to thrusters takes a map"
        raise SettingError(f"{origin.file} is a thruster map; {takes}")
    file, stored = file_and_models(data, origin.file)
    which = _one_of(stored.models, number or stored.preferred, "--number")
    origin = replace(origin, number=which)
    logger = min(stored.command_delay, 0.0)  # commands that a logger shows late are none to a simulator
    model = in_unit(target, stored.models[which].delayed(-logger), settings, origin)
    terms, left_out = split(target, model)
    refused = [effect for effect in left_out if effect.name != DELAY or DELAY in stored.effects]
    if refused and not settings.allow_partial:
        missing = "; ".join(f"{effect.name} ({effect.why})" for effect in refused)
        hint = ", or take --to python, which has nearly every effect" * (target.name != "python")
        remedy = f"give --allow-partial to write the file without{hint}"
        raise SettingError(f"{origin.file}: {target.name} cannot represent {missing}; {remedy}")
    model = replace(model, terms=terms)
    model = in_enu(model) if frame == "ENU" else model
    refuse_inertia(target, settings.rigid_inertia, model, origin)
    if target.si:
        _refuse_driving(model, target, origin)
    return YawSubject(origin, frame, form, settings, left_out, model, file, logs)


def in_unit(target: Target, model: Model, settings: Settings, origin: Origin) -> Model:
    """The model in the target's unit of moment. Raises SettingError where its size is not told, or told twice."""
    dof, factor = model.dof, settings.newton_metres_per_nu
    unit, force = dof.units.forces[1], dof.words.force
    full = "newton metres" if dof.angular else "newtons"
    if model.moment_unit == unit and factor is not None:
        raise SettingError(IN_NEWTONS.format(origin.file, full))
    if model.moment_unit == "nu" and target.si and factor is None:
        raise SettingError(
            f"{origin.file}: its {force}s are normalised (nu) and {target.name} needs {full}; give "
            f"--newton-metres-per-nu with the {force} [{unit}] that one nu stands for, as a bollard test "
            f"{'and the thrusters' + chr(39) + ' arm tell' if dof.levered else 'tells'} it"
        )
    return model if factor is None else in_newton_metres(model, factor)


def split(target: Target, model: Model) -> tuple[tuple[Term, ...], tuple[Unsupported, ...]]:
    """Terms that the target carries, and the others; an effect that is switched off is nobody's loss."""
    live = sorted(filter(_matters, _merged(model.terms)), key=lambda term: effects.get(term.name).stage)
    reasons = [(term, _why_not(target, term, model.dof)) for term in live]
    left_out = tuple(Unsupported(term.name, why) for term, why in reasons if why)
    return tuple(term for term, why in reasons if not why), left_out


def _why_not(target: Target, term: Term, dof: Dof) -> str:
    effect = effects.get(term.name)
    if effect.varies(term.values) and not target.varying:
        return "it differs from run to run"
    if term.name.startswith(PREFIX) and PREFIX in target.carries:
        return ""
    if term.name in target.carries:
        return "the target has no counterpart for its law" * ((term.name, effect.law(term.values)) in target.lacks)
    if dof.has_constant and term.name == "bias-moment":
        return "it is the vehicle's weight less its buoyancy: set mass and volume of your model by it"
    if term.name == RESTORING:
        return "it is weight and buoyancy: set the centres of mass and of volume of your model by it"
    if effect.columns:
        return f"it needs the logged {listed(effect.columns)}"
    return dof.fill(PLACE_WHY[effect.place.value])


def _merged(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Drag that a model has twice, once of its own and once found by a diagnosis, as one term."""
    merged: dict[str | int, Term] = {}
    for i, term in enumerate(terms):
        key = term.name if term.name in DRAGS else i
        twin = merged.get(key)
        merged[key] = replace(twin, values=(twin.values[0] + term.values[0],)) if twin else term
    return tuple(merged.values())


def _matters(term: Term) -> bool:
    effect = effects.get(term.name)
    return any(value != off for value, off, shape in zip(term.values, effect.off, effect.shapes) if not shape)


def refuse_inertia(target: Target, rigid: float | None, model: Model, origin: Origin) -> None:
    """Raise SettingError for a rigid inertia that is no part of the total, or for none where it is the mass."""
    if rigid is None and target.si and not model.dof.angular:
        raise SettingError(
            f"{origin.file}: the identified {model.dof.words.inertia}, {model.inertia:.4g}, holds the water that moves "
            "along; as a link's mass it would weigh on the vehicle: give the vehicle's own with --rigid-inertia"
        )
    if rigid is not None:
        base.refuse_part("--rigid-inertia", rigid, model.inertia, origin)


def _refuse_driving(model: Model, target: Target, origin: Origin) -> None:
    """Raise SettingError for a linear drag that is none: model 2 may have one of the wrong sign."""
    linear, _ = model.drag()
    if linear < 0:
        name, unit = model.dof.symbols.linear, model.dof.unit_of("linear", model.moment_unit)
        raise SettingError(
            f"{origin.file}, model {origin.number}: {name} = {linear:.4g} {unit} would drive the vehicle at small "
            f"{model.dof.words.speed}s, and {target.name} would not come to rest; take a model without it with "
            "--number 1 or 3"
        )


def _refuse_unused(target: Target, settings: Settings) -> None:
    for name, value in vars(settings).items():
        if value not in (None, False) and name not in target.uses and name != "allow_partial":
            users = [other for other in targets.names() if name in targets.get(other).uses]
            option = f"--{name.replace('_', '-')}"
            raise SettingError(f"{option} means nothing to {target.name}; it is for {listed(users)}, so leave it out")


def in_enu(model: Model) -> Model:
    """The model, given in NED, for yaw angle, rate and moment (or another motion's) in ENU; its own inverse.

    ENU: yaw anticlockwise from east for clockwise from north (NED). With psi_enu = pi/2 - psi, r_enu = -r and
    tau_enu = -tau, drag that is odd in the rate keeps its coefficients; a constant moment and every difference between
    the two directions change their sign; what depends on the heading changes sine for cosine, since sin psi =
    cos psi_enu and sin 2 psi = sin 2 psi_enu, cos 2 psi = -cos 2 psi_enu. Heave, positive down in NED and up in ENU,
    mirrors alike; surge is ahead in both. Raises ModelError for an effect whose mirror image is not written down here.
    """
    if not base.mirrored(model.dof):
        return model
    return replace(model, terms=tuple(_mirrored(term) for term in model.terms))


def _mirrored(term: Term) -> Term:
    parity = effects.get(term.name).parity
    if parity == EVEN:
        return term
    if parity == ODD:
        return replace(term, values=tuple(-value for value in term.values))
    if term.name not in MIRROR_OF_MIXED:
        raise ModelError(f"effect {term.name} has no form in ENU yet; export in NED with --frame NED")
    return replace(term, values=MIRROR_OF_MIXED[term.name](term.values))


def in_newton_metres(model: Model, factor: float) -> Model:
    """The same motion under moments in N m (forces in N): inertia, drag times the factor, others by their units."""

    def scaled(term: Term) -> Term:
        pairs = zip(effects.get(term.name).parameters, term.values)
        return replace(term, values=tuple(parameter.scaled(value, factor) for parameter, value in pairs))

    terms, unit = tuple(map(scaled, model.terms)), model.dof.units.forces[1]
    return replace(model, masses=(factor * model.inertia,), terms=terms, moment_unit=unit)


def _logs_behind(file: Source, sha256: str) -> tuple[tuple[str, str], ...] | None:
    """Return names and hashes of the logs that a result file was made of, by the manifest beside it; None without."""
    manifest = manifest_of(file.parent) if isinstance(file, Path) else None
    if manifest is None or not any(entry.sha256 == sha256 for entry in manifest.outputs):
        return None
    return tuple((e.file, e.sha256 or "unreadable") for e in manifest.inputs if e.role in ("log", "hold_out"))
