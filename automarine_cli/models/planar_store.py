"""`planar_model.json`: the model of surge, sway and yaw together, to and from plain data (automarine/planar-model/1).

    {"schema": "automarine/planar-model/1", "force_unit": "N", "moment_unit": "N m",
     "parameters": {"surge.m_u": ESTIMATE, "surge.X_uu": ESTIMATE, "sway.Y_r": ESTIMATE, "yaw.input-delay.t_d": 0.2,
                    "current.north": ESTIMATE, ...},
     "assumptions": [{"parameter": "sway.m_v", "equals": "surge.m_u", "because": "sentence"}],
     "covariance": {"parameters": [...], "matrix": [[...]]}, "valid_range": {...}}

Every parameter stands under its qualified name, and the names say what the model is made of: a term of drag or an
effect is there if its parameters are. What was not identified is a plain number, and its assumption is told.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from automarine_cli import effects
from automarine_cli.dofs import DOFS, YAW, Dof
from automarine_cli.dofs.motion import PLANAR
from automarine_cli.errors import ModelError
from automarine_cli.estimate import Given
from automarine_cli.models import planar
from automarine_cli.models.store import Covariance, Use, number_at, values_of
from automarine_cli.models.yaw_model import Term
from automarine_cli.pipeline.records import Codec, Source, read_plain, told
from automarine_cli.pipeline.result_files import ResultKind, ResultRecord
from automarine_cli.pipeline.words import LONGEST, printable

PARAMETERS = ("parameters",)
UNITS = {"force_unit": "N", "moment_unit": "N m"}
CURRENT = ("current.north", "current.east")


@dataclass(frozen=True, kw_only=True)
class PlanarFile(ResultRecord):
    """`planar_model.json`: parameters by qualified name."""

    unread: ClassVar[tuple[str, ...]] = (
        "fitted_to", "assumptions", "valid_range", "channels", "disturbance", "noises", "log_likelihood",
        "structure_because", "estimated", "estimated_because", "effects", "predicts", "parent", "notes", "warnings",
    )  # fmt: skip
    force_unit: str = "N"
    moment_unit: str = "N m"
    parameters: Mapping[str, Given]
    structure: str = ""
    covariance: Covariance | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    prediction: Use = field(default_factory=Use)


PLANAR_MODEL = ResultKind(f"{PLANAR.name}_model.json", f"{PLANAR.name}-model", PlanarFile, "fit-planar", YAW)


@dataclass(frozen=True)
class StoredPlanar:
    """The model of one file; `source` is its name, `free` are the parameters that its fit had free (none where the file
    does not say), `random` the sizes of what is random by name."""

    model: planar.PlanarModel
    source: str
    free: tuple[str, ...] = field(default=(), repr=False)
    random: Mapping[str, float] = field(default_factory=dict, repr=False)


def load_planar_model(path: Source) -> StoredPlanar:
    """The model of a `planar_model.json`. Raises ModelError with the file and the key's path."""
    return planar_from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def planar_json(model: planar.PlanarModel, estimates: Mapping[str, object] | None = None) -> dict[str, object]:
    """What every file of a planar model begins with; `estimates` by qualified name as plain data, else the number."""
    known = estimates or {}
    values = zip(model.parameter_names, model.theta.tolist())
    return {
        "schema": PLANAR_MODEL.schema,
        **UNITS,
        "parameters": {name: known.get(name, value) for name, value in values},
    }


def planar_from_json(data: Mapping[str, object], where: str = "planar model") -> StoredPlanar:
    """The model in the content of a `planar_model.json`; `where` names it for messages. Raises ModelError."""
    file, codec = PLANAR_MODEL.of(data, where), PLANAR_MODEL.codec(data, where)
    for key, unit in UNITS.items():
        if (found := getattr(file, key)) != unit:
            raise codec.refusal((key,), f"found {told(found)}, expected {told(unit)}: coupled motions are in newtons")
    values = {name: number_at(one, codec, (*PARAMETERS, name)) for name, one in file.parameters.items()}
    free = file.covariance.parameters if file.covariance else ()
    return StoredPlanar(_model(values, codec), where, free, file.random)


def units(model: planar.PlanarModel) -> dict[str, str]:
    found = [dof.unit_of("inertia", dof.units.forces[1]) for dof in PLANAR.dofs] + ["kg m", "kg m", "kg"]
    for dof, terms in zip(PLANAR.dofs, (model.surge, model.sway, model.yaw)):
        for term in terms:
            found += [dof.unit_in(one.unit, dof.units.forces[1]) for one in effects.get(term.name).parameters]
    found += [_derivative_unit(term.name) for term in model.cross]
    return dict(zip(model.parameter_names, [*found, *(["m/s"] * 2 if model.water else [])], strict=True))


def _derivative_unit(name: str) -> str:
    letter, _, along = name.partition("_")
    metres = (letter == "N") - sum(one != "r" for one in along)
    of_seconds = "s" if len(along) == 1 else "s²"
    of_metres = {1: " m", 0: "", -1: "/m", -2: "/m²"}[metres]
    return f"N m {of_seconds}" if metres == 1 else f"N {of_seconds}{of_metres}"


def _model(values: Mapping[str, float], codec: Codec) -> planar.PlanarModel:
    left = dict(values)
    inertia = _inertia(left, codec)
    water = [left.pop(name) for name in CURRENT if name in left]
    if len(water) == 1:
        lacking = next(name for name in CURRENT if name not in values)
        raise codec.refusal(
            PARAMETERS, f"key {told(lacking)} is missing; a current has {' and '.join(CURRENT)}, give both"
        )
    terms: dict[str, list[Term]] = {dof.name: [] for dof in PLANAR.dofs}
    cross: list[Term] = []
    while left:
        name = next(iter(left))
        motion, _, rest = name.partition(".")
        if motion not in terms or not rest:
            raise codec.refusal(PARAMETERS, _unknown(name))
        dof = DOFS[motion]
        if (term := _own(dof, rest, left, codec)) is not None:
            terms[motion].append(term)
        else:
            cross.append(Term(_cross(dof, rest, name, codec), (left.pop(name),)))
    for dof in PLANAR.dofs:
        drags = {term.name: term.values[0] for term in terms[dof.name] if term.values}
        if drags.get("linear-drag", 0.0) < 0 and "quadratic-drag" not in drags:
            name, value = dof.parameter("linear"), drags["linear-drag"]
            raise codec.refusal((*PARAMETERS, name), f"found {value:g}, expected a drag of zero or more")
    both = (water[0], water[1]) if water else None
    surge, sway, yaw = (tuple(terms[dof.name]) for dof in PLANAR.dofs)
    return planar.PlanarModel(inertia, surge, sway, yaw, tuple(cross), both)


def _inertia(left: dict[str, float], codec: Codec) -> planar.Inertia:
    sizes = [dof.parameter("inertia") for dof in PLANAR.dofs]
    for name in sizes:
        if name not in left:
            raise codec.missing(PARAMETERS, name)
        if (value := left[name]) <= 0:
            raise codec.refusal((*PARAMETERS, name), f"found {value:g}, expected an inertia above zero")
    couplings = [f"{PLANAR.name}.{name}" for name in planar.inertia_names()[len(sizes) :]]
    inertia = planar.Inertia(*(left.pop(name) for name in sizes), *(left.pop(name, 0.0) for name in couplings))
    inertia.refuse_unless_positive(f"{codec.name}: {PARAMETERS[0]}")
    return inertia


def _own(dof: Dof, rest: str, left: dict[str, float], codec: Codec) -> Term | None:
    """The term of the library that a parameter belongs to, its parameters taken out of what is left; None for none."""
    role = {symbol: role for role, symbol in dof.parameters.items()}.get(rest)
    name = planar.OF_ROLE.get(role or "", rest.partition(".")[0])
    if name not in effects.names():
        return None
    effect = effects.get(name)
    if not effect.acts_in(dof):
        raise codec.refusal((*PARAMETERS, f"{dof.name}.{rest}"), f"{name} does not act in {dof.name}; leave it out")
    keys = tuple(planar.parameters_of(dof, Term(name, ())))
    given = left.keys() & set(keys)
    if f"{dof.name}.{rest}" not in keys:
        raise codec.refusal(PARAMETERS, f"unknown key {told(f'{dof.name}.{rest}')}; did you mean {told(keys[0])}?")
    free = "{linear}"  # beside quadratic drag it may come out below zero
    values = values_of(effect, keys, left, codec, PARAMETERS, free)
    for key in keys:
        left.pop(key, None)
    found = {key.partition(".")[2].removeprefix(f"{name}.") for key in given}
    if not effect.role and (lacking := effect.lacking(found, values, dof)):
        raise codec.missing(PARAMETERS, f"{dof.name}.{name}.{lacking}")
    return Term(name, values)


def _cross(dof: Dof, rest: str, name: str, codec: Codec) -> str:
    letter = planar.FORCES[PLANAR.index(dof)]
    try:
        planar.derivative(rest)
    except ModelError:
        raise codec.refusal(PARAMETERS, _unknown(name)) from None
    if not rest.startswith(letter):
        raise codec.refusal((*PARAMETERS, name), f"{rest} is no derivative of {letter}, the force of {dof.name}")
    return rest


def _unknown(name: str) -> str:
    own = [name for dof in PLANAR.dofs for name in map(dof.parameter, dof.parameters)]
    known = [*own, *(f"{PLANAR.name}.{one}" for one in planar.inertia_names()[3:]), *CURRENT]
    close = difflib.get_close_matches(name[:LONGEST], known, n=1, cutoff=0.8)
    hint = f"did you mean {told(close[0])}?" if close else (
        f"known are {', '.join(known)}, effects such as yaw.input-delay.t_d, and derivatives by the velocities "
        f"{', '.join(planar.VELOCITIES)} of others, such as sway.Y_r"
    )  # fmt: skip
    return f"unknown key {told(name)}; {hint}"
