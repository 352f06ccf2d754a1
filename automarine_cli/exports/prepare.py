"""A stored model made fit for a target: its unit of moment, and only the effects that the target has terms for."""

from dataclasses import replace

from automarine_cli import effects
from automarine_cli import exports as targets
from automarine_cli.dofs import Dof
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import SettingError
from automarine_cli.exports.base import DRAG, LeftOut, Origin, Settings, Target
from automarine_cli.exports.conversions import in_newton_metres
from automarine_cli.models.yaw_model import Term, YawModel
from automarine_cli.pipeline.words import listed

WHY_NAMED = {"thruster-lag": "it acts in the thrusters; --to thrusters has --lag for it"}
WHY_CONSTANT = "it is the vehicle's weight less its buoyancy: set mass and volume of your model by it"
WHY = {
    "sensor": "it acts on the reading, not on the vehicle",
    "actuator": "it acts in the thrusters, before the {force}",
    "moment": "the target's equation has no such term",
    "water": "the target's water has no state of its own",
}


def in_unit(target: Target, model: YawModel, settings: Settings, origin: Origin) -> YawModel:
    """The model in the target's unit of moment. Raises SettingError where its size is not told, or told twice."""
    dof, factor = model.dof, settings.newton_metres_per_nu
    unit, force = dof.units.forces[1], dof.words.force
    full = "newton metres" if dof.levered else "newtons"
    if model.moment_unit == unit and factor is not None:
        raise SettingError(
            f"{origin.file} is in {full} already; --newton-metres-per-nu is for the unit nu, so leave it out"
        )
    if model.moment_unit == "nu" and target.si and factor is None:
        raise SettingError(
            f"{origin.file}: its {force}s are normalised (nu) and {target.name} needs {full}; give "
            f"--newton-metres-per-nu with the {force} [{unit}] that one nu stands for, as a bollard test "
            f"{'and the thrusters' + chr(39) + ' arm tell' if dof.levered else 'tells'} it"
        )
    return model if factor is None else in_newton_metres(model, factor)


def refuse_motion(target: Target, dof: Dof, origin: Origin) -> None:
    """Raise SettingError for a model of a motion that the target does not take."""
    if dof.name not in target.motions:
        raise SettingError(
            f"{origin.file} is a model of {dof.name}; --to {target.name} takes models of {listed(target.motions)}"
        )


def split(target: Target, model: YawModel, settings: Settings) -> tuple[tuple[Term, ...], tuple[LeftOut, ...]]:
    """Terms that the target carries, and the others; an effect that is switched off is nobody's loss."""
    dof = model.dof
    live = sorted(filter(_matters, _merged(model.terms)), key=lambda term: effects.get(term.name).stage)
    kept = tuple(term for term in live if not _why_not(target, term, dof, settings))
    lost = (term for term in live if term not in kept)
    return kept, tuple(LeftOut(term.name, _why_not(target, term, dof, settings)) for term in lost)


def _why_not(target: Target, term: Term, dof: Dof, settings: Settings) -> str:
    """Why the target cannot carry a term; empty where it can."""
    effect = effects.get(term.name)
    carried = target.carries_with(settings) if target.carries_with else target.carries
    if effect.varies(term.values) and not target.varying:
        return "it differs from run to run"
    if term.name.startswith(PREFIX) and PREFIX in carried:
        return ""
    if term.name in carried:
        law = effect.law(term.values)
        if (term.name, law) in target.lacks:
            return target.lacks[term.name, law]
        known = not law or target.laws is None or (term.name, law) in target.laws or effect.varies(term.values)
        return "" if known else f"its law {_law_name(term)!r} remembers earlier commands"
    named = WHY_NAMED | dict(target.why)
    if dof.has_constant and term.name == "bias-moment":
        return WHY_CONSTANT
    if term.name in named:
        return named[term.name]
    return f"it needs the logged {listed(effect.columns)}" if effect.columns else dof.fill(WHY[effect.place.value])


def _law_name(term: Term) -> str:
    """What the term's law is called."""
    effect = effects.get(term.name)
    return next(p.choices[effect.law(term.values)] for p in effect.parameters if p.choices)


def _merged(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Drag that a model has twice, once of its own and once found by a diagnosis, as one term."""
    found: dict[str, Term] = {}
    for term in terms:
        twin = found.get(term.name) if term.name in DRAG else None
        key = f"{term.name} {len(found)}" if term.name in found and twin is None else term.name
        found[key] = term if twin is None else replace(twin, values=(twin.values[0] + term.values[0],))
    return tuple(found.values())


def _matters(term: Term) -> bool:
    effect = effects.get(term.name)
    return any(value != off for value, off, shape in zip(term.values, effect.off, effect.shapes) if not shape)


def cannot(target: Target, left_out: tuple[LeftOut, ...], origin: Origin) -> str:
    """The sentence for effects that the target has no term for."""
    told = "; ".join(f"{one.name} ({one.why})" for one in left_out)
    python = targets.get("python")
    has = target is not python and all(one.name in python.carries for one in left_out)
    hint = ", or take --to python, which has them" if has else ""
    return (
        f"{origin.file}: {target.name} cannot represent {told}; give {target.instead or ''}--allow-partial to write "
        f"the file without{hint}"
    )


def refuse_inertia(target: Target, rigid: float | None, model: YawModel, origin: Origin) -> None:
    """Raise SettingError for a rigid inertia that is no part of the total, or for none where it is the mass."""
    dof, word = model.dof, model.dof.words.inertia
    if rigid is None and target.si and not dof.levered:
        raise SettingError(
            f"{origin.file}: the identified {word}, {model.inertia:.4g}, holds the water that moves along; as a "
            "link's mass it would weigh on the vehicle: give the vehicle's own with --rigid-inertia"
        )
    if rigid is not None and not 0.0 < rigid <= model.inertia:
        raise SettingError(
            f"--rigid-inertia: found {rigid:g}, expected more than 0 and no more than {model.inertia:.6g} "
            f"{dof.unit_of('inertia', model.moment_unit)}, the total of rigid and added {word} in {origin.file}; check "
            "unit and axis"
        )


def refuse_driving(model: YawModel, target: Target, origin: Origin) -> None:
    """Raise SettingError for a linear drag that is none: model 2 may have one of the wrong sign."""
    linear, _ = model.drag()
    if linear < 0:
        name, unit = model.dof.symbols.linear, model.dof.unit_of("linear", model.moment_unit)
        raise SettingError(
            f"{origin.file}, model {origin.number}: {name} = {linear:.4g} {unit} would drive the vehicle at small "
            f"{model.dof.words.speed}s, and {target.name} would not come to rest; take a model without it with "
            "--number 1 or 3"
        )


def refuse_unused(target: Target, settings: Settings) -> None:
    """Raise SettingError for a setting that the target does not use."""
    for name in settings.given:
        if name not in target.uses and name != "allow_partial":
            users = [one for one in targets.names() if name in targets.get(one).uses]
            option = f"--{name.replace('_', '-')}"
            raise SettingError(f"{option} means nothing to {target.name}; it is for {listed(users)}, so leave it out")
