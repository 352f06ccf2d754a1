"""`export`: a model written for a simulator or a paper; what the target cannot represent is listed, and refused."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from automarine_cli import effects
from automarine_cli import exports as targets
from automarine_cli.dofs import PLANAR, Dof, alone
from automarine_cli.effects.base import EVEN, ODD
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.exports import base
from automarine_cli.exports.base import MapSubject, ModelOrigin, MotionSubject, Options, Target, Unsupported
from automarine_cli.exports.vehicle import DAMPING, PLANES, Vehicle, planar_couplings
from automarine_cli.models.model import CONSTANT, DELAY, RESTORING, Model, Term
from automarine_cli.models.store import PLANAR_MODEL, file_and_models, models_of, motion_of
from automarine_cli.pipeline.records import Source, read_plain
from automarine_cli.pipeline.results_folder import manifest_of, refuse_existing, sha256, write_whole
from automarine_cli.quantities import STEERED
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
OF_THRUSTERS = "this file has no place for their map: write it by itself with --to thrusters"
GRAVITY_M_S2 = 9.80665
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
    it was written, or None. `origins` are the models' files, `carried` the effects in it, `left_out` those that are
    not, `not_identified` the motions that no model is of, `written` the text with its notes, `warnings` what its reader
    must be told. It has no frame.

    Keys: `schema`, `target`, `form`, `frame`, `moment_unit`, `source`, `sources`, `carried`, `not_identified`,
    `left_out`, `notes`, `text`.
    """

    target: str
    form: str
    frame: str
    origins: tuple[ModelOrigin, ...]
    moment_unit: str | None
    carried: tuple[str, ...]
    left_out: tuple[Unsupported, ...]
    written: base.Written
    not_identified: tuple[str, ...] = ()
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
        sources = [{"file": o.file, "sha256": o.sha256, "model": o.number or None} for o in self.origins]
        return {
            "schema": "automarine/export/1", "target": self.target, "form": self.form, "frame": self.frame,
            "moment_unit": self.moment_unit, "source": sources[0], "sources": sources, "carried": list(self.carried),
            "not_identified": list(self.not_identified), "left_out": [vars(effect) for effect in self.left_out],
            "notes": list(self.written.notes),
            "text": self.text,
        }  # fmt: skip


@sections.register
def _(result: Exported) -> Sections:
    if result.place is None:
        return Sections(())  # the text itself is printed
    summary = f"{result.target}, form {result.form}, frame {result.frame}: {listed(result.carried)}."
    lacking = [f"Not identified: {', '.join(result.not_identified)}."] if len(result.origins) > 1 else []
    return Sections((summary, *map(str, result.left_out), *lacking, *result.written.notes))


@dataclass(frozen=True)
class Targets:
    """The `targets` that there are, where `show_list` asks for them. `to_json()` lists them.

    Keys: `schema`, `targets`.
    """

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
    in_plane = target.several is not None and target.several.couples
    return [*target.motions, PLANAR.name] if in_plane else list(target.motions)


def export_targets() -> Targets:
    return Targets(tuple(targets.get(name) for name in targets.names()))


def export_model(
    model: Sequence[Source], to: str, *, form: str | None = None, number: str | None = None, frame: str | None = None,
    out: Path | None = None, overwrite: bool = False, **settings: Any,
) -> Exported:  # fmt: skip
    """Write the models of one vehicle in the files `model` for the target `to`, into the file `out` if that is given.

    `number` is which of a file's models (by default the preferred one), `frame` ENU or NED (by default the target's
    own); the other settings are those of `exports.base.Settings`. Raises ModelError, SettingError or OutputError, for
    an effect too that the target cannot represent, unless `allow_partial`."""
    target, chosen = targets.get(to), Options(**settings)
    _refuse_unused(target, chosen)
    files = [ModelSource(source, read_plain(source, "JSON", ModelError)) for source in model]
    takes, several = _taking(target, files)
    if chosen.arm is not None and not (several and any(file.of_thrusters for file in files)):
        raise SettingError("--arm is of the thrusters of a vehicle: give their thrusters.json beside its models")
    ending = "" if out is None else out.suffix.lower()
    usual = next((name for name, suffix in takes.forms.items() if suffix == ending), next(iter(takes.forms)))
    form = _one_of(takes.forms, form or usual, f"--form of {target.name}")
    frame = _one_of(takes.frames, (frame or takes.frames[0]).upper(), f"--frame of {target.name}")
    if out is not None:
        refuse_existing(out, overwrite=overwrite)
    subject: MapSubject | Vehicle
    unit, lacking = None, tuple[str, ...]()
    if target.motions:
        subject = _vehicle(takes, files, form, frame, chosen, number, several)
        carried = tuple(_carried(subject))
        unit = "N m" if subject.several else subject.axis.model.moment_unit
        lacking = tuple(subject.not_identified)
    else:
        subject, carried = _map_subject(files[0], form, frame, chosen), ("thruster map",)
    written = takes.write(subject)
    if out is not None:
        write_whole(out, written.text)
    return Exported(target.name, form, frame, subject.origins, unit, carried, subject.left_out, written, lacking, out)


@dataclass(frozen=True)
class ModelSource:
    """A file and its content."""

    source: Source
    data: Mapping[str, object]

    @property
    def origin(self) -> ModelOrigin:
        return ModelOrigin(printable(self.source.name), sha256(self.source))

    @property
    def in_plane(self) -> bool:
        return self.data.get("schema") == PLANAR_MODEL.schema

    @property
    def of_thrusters(self) -> bool:
        return self.data.get("schema") == MAP.schema

    @property
    def dofs(self) -> tuple[Dof, ...]:
        return PLANAR.dofs if self.in_plane else () if self.of_thrusters else (motion_of(self.data),)


def _taking(target: Target, files: Sequence[ModelSource]) -> tuple[Target, bool]:
    """The target as it takes these files, and whether as several motions. Raises SettingError where it does not, or
    where two of them are of one motion."""
    several = target.several
    takers = [name for name in targets.names() if (other := targets.get(name).several) and other.couples]
    for file in files:
        if file.in_plane and (several is None or not several.couples):
            wrong = f"{file.origin.file} is a model of surge, sway and yaw together; --to {target.name}"
            raise SettingError(f"{wrong} takes one motion: take --to {' or '.join(takers)}, or a model of one motion")
    if len(files) > 1 and several is None:
        raise SettingError(f"--to {target.name} takes one file, found {len(files)}: export each by itself")
    by_motion = dict[str, str]()
    for file in files:
        for name in [dof.name for dof in file.dofs] or ["thrusters"]:
            if name in by_motion:
                pair = f"{by_motion[name]} and {file.origin.file} are both of {name}"
                raise SettingError(f"{pair}; a vehicle has one model of each motion, give one of them")
            by_motion[name] = file.origin.file
    if several is None or (len(files) == 1 and not files[0].in_plane):
        return target, False
    return replace(target, forms=several.forms, carries=several.carries or target.carries), True


def _map_subject(file: ModelSource, form: str, frame: str, settings: Options) -> MapSubject:
    name = file.origin.file
    if not file.of_thrusters and "models" in file.data:
        wrong = f"{name} is a {motion_of(file.data).name} model"
        raise SettingError(f"{wrong}; --to thrusters takes the thrusters.json of a fit")
    full_scale = MAP.of(file.data, name).full_scale_N
    return MapSubject((file.origin,), frame, form, settings, (), ThrusterMap.from_json(file.data, name), full_scale)


def _one_of(choices: Iterable[str], value: str, option: str) -> str:
    if value not in choices:
        raise SettingError(f"{option}: found {value}, expected {' or '.join(choices)}")
    return value


def _carried(subject: Vehicle) -> Iterator[str]:
    """What the file holds: of one motion the names of its terms, of several their symbols."""
    yield "inertia"
    if subject.several:
        yield from (drag.name for drag in subject.drags)
        names = (f"{axis.dof.name}.{term.name}" for axis in subject.axes for term in axis.model.terms)
        yield from (name for name in names if name.partition(".")[2] not in DAMPING)
    else:
        yield from (term.name for term in subject.axis.model.terms)


def _of_motions(option: str, value: Any, motions: Sequence[str]) -> Mapping[str, Any]:
    """The value of each of the motions that an option is of. Raises SettingError for one value of several motions, and
    for a motion of no file."""
    if not isinstance(value, Mapping):
        if value is not None and len(motions) > 1:
            each = ",".join(f"{name}=..." for name in motions)
            raise SettingError(f"{option}: found {value}, which may be of {' or '.join(motions)}; give {option} {each}")
        return dict.fromkeys(motions, value)
    for name in value:
        _one_of(motions, name, option)
    return value


def _axes(file: ModelSource, frame: str, form: str, settings: Options, number: str | None) -> list[MotionSubject]:
    """The motions of a file as they stand in it, but for commands that its logger showed late."""
    name, origin = file.origin.file, file.origin
    if file.in_plane:
        model = models_of(file.data, name).undelayed
        axes = []
        for i, (dof, mass) in enumerate(zip(PLANAR.dofs, model.masses)):
            terms = tuple(replace(term, dof=0) for term in model.terms if term.dof == i and not term.is_cross)
            axis = Model(alone(dof), (mass,), terms, dof.units.forces[1])
            axes.append(MotionSubject((origin,), frame, form, settings, (), axis))
        return axes
    content, stored = file_and_models(file.data, name)
    which = _one_of(stored.models, number or stored.preferred, "--number")
    model = stored.models[which].delayed(-min(stored.command_delay, 0.0))
    manifest, logs = manifest_of(file.source.parent) if isinstance(file.source, Path) else None, None
    if manifest is not None and any(entry.sha256 == origin.sha256 for entry in manifest.outputs):
        logs = tuple((e.file, e.sha256 or "unreadable") for e in manifest.inputs if e.role in ("log", "hold_out"))
    return [MotionSubject((replace(origin, number=which),), frame, form, settings, (), model, content, logs)]


def _vehicle(
    target: Target, files: Sequence[ModelSource], form: str, frame: str, settings: Options, number: str | None,
    several: bool,
) -> Vehicle:  # fmt: skip
    """The models of the files with what the target carries, in its frame and unit. Raises SettingError, ModelError."""
    motions = [dof.name for file in files for dof in file.dofs]
    if not motions:
        takes = f"--to {target.name} takes a yaw model, as --to thrusters takes a map"
        raise SettingError(f"{files[0].origin.file} is a thruster map; {takes}")
    numbers = _of_motions("--number", number, motions)
    fitted = [file for file in files if file.dofs]
    axes = [a for f in fitted for a in _axes(f, frame, form, settings, numbers.get(f.dofs[-1].name))]
    axes.sort(key=lambda axis: axis.dof.number)
    foreign = [axis.dof.name for axis in axes if not several or axis.model.moment_unit != axis.dof.units.forces[1]]
    if settings.newton_metres_per_nu is not None and not foreign:
        raise SettingError(IN_NEWTONS.format(listed(file.origin.file for file in files), "newtons"))
    sizes = _of_motions("--newton-metres-per-nu", settings.newton_metres_per_nu, foreign)
    turning = [axis.dof.name for axis in axes if axis.dof.angular or not several]
    rigid = _of_motions("--rigid-inertia", settings.rigid_inertia, turning)
    refused = list[Unsupported]()
    for i, axis in enumerate(axes):
        dof, name = axis.dof, axis.dof.name
        inertia = rigid.get(name) or (None if dof.angular else settings.rigid_mass)
        each = replace(settings, newton_metres_per_nu=sizes.get(name), rigid_inertia=inertia)
        model = in_unit(target, axis.model, each, axis.origin, several)
        steered = not several or axis.model.moment_unit == STEERED
        carries = target.carries if steered else target.carries - {"rudder-inflow"}
        terms, lacking = split(replace(target, carries=carries), model)
        lenient = {DELAY} - {effect.name for effect in axis.file.effects} if axis.file else set[str]()
        lenient |= {RESTORING, CONSTANT} if several and dof.biased else set()
        called = [_of_vehicle(e, model, frame, settings.rigid_mass) if several else e for e in lacking]
        refused += [new for old, new in zip(lacking, called) if old.name not in lenient]
        axes[i] = replace(axis, settings=each, left_out=tuple(called), model=replace(model, terms=terms))
    if refused and not settings.allow_partial:
        missing = "; ".join(f"{effect.name} ({effect.why})" for effect in refused)
        hint = "" if target.name == "python" or several else ", or take --to python, which has nearly every effect"
        where = listed(file.origin.file for file in fitted)
        remedy = f"give --allow-partial to write the file without{hint}"
        raise SettingError(f"{where}: {target.name} cannot represent {missing}; {remedy}")
    for i, axis in enumerate(axes):
        axes[i] = axis = replace(axis, model=in_enu(axis.model) if frame == "ENU" else axis.model)
        refuse_inertia(target, axis.settings.rigid_inertia, axis.model, axis.origin, several)
        if target.si and axis.file is not None:
            _refuse_driving(axis.model, target, axis.origin)
    left_out = [effect for axis in axes for effect in axis.left_out]
    coupled: dict[str, Any] = {}
    for file in files:
        if file.in_plane:
            stored = models_of(file.data, file.origin.file)
            coupled |= planar_couplings(stored.model, frame) | {"water": stored.model.water}
            if stored.command_delay > 0.0:
                left_out.append(Unsupported(DELAY, f"no entry of the matrices holds its {stored.command_delay:.3g} s"))
        elif file.of_thrusters:
            coupled["thrusters"] = thrusters = _map_subject(file, form, frame, settings)
            if not target.several or not target.several.thrusters:
                left_out.append(Unsupported("thrusters", f"{OF_THRUSTERS}; {thrusters.about_places()}"))
    origins = tuple(dict.fromkeys([*(axis.origin for axis in axes), *(f.origin for f in files if f.of_thrusters)]))
    return Vehicle(origins, frame, form, settings, tuple(left_out), tuple(axes), several, **coupled)


def _of_vehicle(effect: Unsupported, model: Model, frame: str, mass: float | None) -> Unsupported:
    """An effect that is left out, called by its motion; of a constant force or moment its size too, in the frame."""
    name, size = f"{model.dof.name}.{effect.name}", ""
    if effect.name in (CONSTANT, RESTORING):
        alone_here = replace(model, terms=tuple(term for term in model.terms if term.name == effect.name))
        value = (in_enu(alone_here) if frame == "ENU" else alone_here).terms[0].values[0]
        size = f": {base.number(value)} {base.plain(model.moment_unit)}"
        if effect.name == RESTORING and mass is not None:
            size += f", GM {value / (GRAVITY_M_S2 * mass):.4g} m"
    return Unsupported(name, effect.why + size)


def in_unit(target: Target, model: Model, settings: Options, origin: ModelOrigin, several: bool) -> Model:
    """The model in the target's unit of moment. Raises SettingError where its size is not told, or told twice."""
    dof, factor = model.dof, settings.newton_metres_per_nu
    unit, force = dof.units.forces[1], dof.words.force
    full = "newton metres" if dof.angular else "newtons"
    if model.moment_unit == unit and factor is not None:
        raise SettingError(IN_NEWTONS.format(origin.file, full))
    if model.moment_unit != unit and (target.si or several) and factor is None:
        theirs = "angles of the rudder (rad)" if model.moment_unit == STEERED else "normalised (nu)"
        needs = "a vehicle of several motions" if several else target.name
        raise SettingError(
            f"{origin.file}: its {force}s are {theirs} and {needs} needs {full}; give "
            f"--newton-metres-per-nu{f' {dof.name}=VALUE' if several else ''} with the {force} [{unit}] that one "
            f"{model.moment_unit} stands for, as a bollard test "
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
    if term.name in target.carries and (term.name not in target.in_plane or dof.number in PLANES):
        lacks = (term.name, effect.law(term.values)) in target.lacks
        return "the target has no counterpart for its law" if lacks else ""
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
        key = term.name if term.name in base.DRAGS else i
        twin = merged.get(key)
        merged[key] = replace(twin, values=(twin.values[0] + term.values[0],)) if twin else term
    return tuple(merged.values())


def _matters(term: Term) -> bool:
    effect = effects.get(term.name)
    return any(value != off for value, off, shape in zip(term.values, effect.off, effect.shapes) if not shape)


def refuse_inertia(target: Target, rigid: float | None, model: Model, origin: ModelOrigin, several: bool) -> None:
    """Raise SettingError for a rigid inertia that is no part of the total, or for none where it is the mass."""
    option = "--rigid-mass" if several and not model.dof.angular else "--rigid-inertia"
    if rigid is None and target.si and not model.dof.angular:
        raise SettingError(
            f"{origin.file}: the identified {model.dof.words.inertia}, {model.inertia:.4g}, holds the water that moves "
            f"along; as a link's mass it would weigh on the vehicle: give the vehicle's own with {option}"
        )
    if rigid is not None and not 0.0 < rigid <= model.inertia:
        raise SettingError(
            f"{option}: found {rigid:g}, expected more than 0 and no more than {model.inertia:.6g}, the total of rigid "
            f"and added inertia in {origin.file}; check unit and axis"
        )


def _refuse_driving(model: Model, target: Target, origin: ModelOrigin) -> None:
    """Raise SettingError for a linear drag that is none: model 2 may have one of the wrong sign."""
    linear, _ = model.drag()
    if linear < 0:
        name, unit = model.dof.symbols.linear, model.dof.unit_of("linear", model.moment_unit)
        raise SettingError(
            f"{origin.file}, model {origin.number}: {name} = {linear:.4g} {unit} would drive the vehicle at small "
            f"{model.dof.words.speed}s, and {target.name} would not come to rest; take a model without it with "
            "--number 1 or 3"
        )


def _refuse_unused(target: Target, settings: Options) -> None:
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
