"""Plain Python: one file with numpy that simulates the model.

The file holds the effects' own methods, copied from the library with all that they call, and a loop of classical
Runge-Kutta steps around them. In the templates {x} and {v} stand for the letters of position and rate, {given} for the
command as logged.
"""

import ast
import inspect
import sys
from collections.abc import Iterable
from types import ModuleType

import numpy as np

from automarine_cli import effects
from automarine_cli.dofs import HEAVE
from automarine_cli.effects.base import Effect
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.effects.thruster_imbalance import each
from automarine_cli.effects.thruster_lag import OF_EACH
from automarine_cli.exports import base
from automarine_cli.exports.thrusters import largest_signal, table
from automarine_cli.exports.vehicle import MATRIX_EFFECTS, PLANES, RUDDER_LAWS, SPEED_LETTERS, STEERING, Vehicle
from automarine_cli.models.model import CONSTANT, RESTORING, Term
from automarine_cli.quantities import Floats

MAX_EXPORT_STEP_S = 0.02  # s: the longest step of the integrator
METHODS = {"deliver", "moment", "water_rate", "derivatives", "read", "remember", "states"}
"""What of an effect acts; all else describes it."""
_LIBRARY = map(effects.get, effects.built_in())
PYTHON_EFFECTS = [effect.name for effect in _LIBRARY if not (effect.columns or effect.reads_force)]
"""Effects that need no logged column."""
RUDDER = " `rudder` is its angle as logged{0} [rad]."


def write(subject: Vehicle) -> base.Written:
    return _vehicle(subject) if subject.several else _motion(subject.axis)


def _motion(subject: base.MotionSubject) -> base.Written:
    terms, dof, symbols = subject.model.terms, subject.dof, subject.dof.symbols
    inertia = symbols.inertia.upper()  # I_R, M_U, M_W
    logged = [name for term in terms for name in effects.get(term.name).needs]
    moments = (term.name for term in terms if effects.get(term.name).place.value == "moment")
    motion = f"{symbols.inertia} {symbols.velocity}' = {subject.force}"
    equation = " ".join([motion, *map(subject.equation_of, moments)])
    text = {
        **dof.vocabulary, "head": base.comment(base.head(subject, equation, ()), "#"), "inertia": inertia,
        "constants": f"{inertia} = {base.number(subject.model.inertia)}  # {subject.unit}: rigid and added together\n"
        + "".join(constants(subject, term) for term in terms),
        "runtime": runtime([effects.get(term.name) for term in terms]),
        "terms": "".join(f"    ({maker(effects.get(t.name))}, {arguments(subject, t)}),\n" for t in terms),
        "title": dof.words.position.capitalize(), "unit": subject.model.moment_unit,
        "given": dof.words.force if symbols.force == subject.force else symbols.force,
        "more": ", **columns" if logged else "", "step": base.number(MAX_EXPORT_STEP_S),
        "columns": f" So does columns[{logged[0]!r}][i]." if logged else "",
        "signals": "{name: np.asarray(column)[None, sample] for name, column in columns.items()}" if logged else "{}",
    }  # fmt: skip
    return base.Written(base.filled("python", text))


def runtime(chosen: Iterable[Effect]) -> str:
    """The source of what effects need to act, in the library's own order: no definition that nothing calls."""
    classes = [type(effect) for effect in chosen]
    effect_modules = sorted({each.__module__, *(kind.__module__ for kind in classes)} - {Learned.__module__})
    modules: list[ModuleType] = [effects.base, *(sys.modules[name] for name in (Learned.__module__, *effect_modules))]
    defined = {name: part for module in modules for name, part in definitions(module).items()}
    needed, new = set[str](), {"State", "Commands", "Effect", *(kind.__name__ for kind in classes)}
    while new:
        needed |= new
        new = {name for caller in new for name in defined[caller][1] if name in defined} - needed
    return "\n\n\n".join(source for name, (source, _) in defined.items() if name in needed)


def definitions(module: ModuleType) -> dict[str, tuple[str, set[str]]]:
    """The source of all that a module defines, by name, with the names that stand in it; of an effect what acts."""
    lines, defined = inspect.getsource(module).splitlines(), dict[str, tuple[str, set[str]]]()
    for node in ast.parse("\n".join(lines)).body:
        decorators = getattr(node, "decorator_list", [])
        parts: list[ast.stmt] = [node]
        if isinstance(node, ast.ClassDef) and not decorators:  # an effect
            parts = [part for part in node.body if METHODS & set(_bound(part))]
        source = "\n\n".join("\n".join(lines[part.lineno - 1 : part.end_lineno]) for part in parts)
        if parts != [node]:
            source = f"{lines[node.lineno - 1]}\n{source or '    pass'}"
        source = "\n".join([*(lines[decorator.lineno - 1] for decorator in decorators), source])
        called = {name.id for part in (*parts, *getattr(node, "bases", ())) for name in ast.walk(part)
                 if isinstance(name, ast.Name)}  # fmt: skip
        defined |= dict.fromkeys(_bound(node), (source, called))
    return defined


def _bound(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]


def maker(effect: Effect) -> str:
    """What makes an effect in the file; a learned curve is told what it runs over."""
    if not isinstance(effect, Learned):
        return f"{type(effect).__name__}()"
    x = effect.variable
    source = x.code or (f"state.position % {x.turn!r}" if x.turn else f"state.signals[{x.name!r}]")
    variable = f"SimpleNamespace(read=lambda state: {source}, sized={x.sized}, turn={x.turn!r})"
    return f'type("Curve", (Learned,), {{"name": "", "variable": {variable}}})()'


def constants(subject: base.MotionSubject, term: Term) -> str:
    cards = effects.get(term.name).card(subject.dof, subject.model.moment_unit).parameters
    return "".join(
        f"{name} = {base.number(value)}  # {base.plain(card.unit)}: {base.plain(card.meaning)}\n"
        for name, card, value in zip(names(subject, term), cards, term.values)
        if name
    )


def names(subject: base.MotionSubject, term: Term) -> list[str]:
    """The constant of each parameter: K_RR of the drags, THRUST_LOSS_B of others; empty for one that stands as a number
    among the values: a choice of law, and what counts under no such law, or makes a learned curve."""
    effect, result = effects.get(term.name), []
    for parameter, name in zip(effect.parameters, effect.names_in(subject.dof)):
        is_number = isinstance(effect, Learned) or parameter.choices or not effect.counts(parameter, term.values)
        unique = name if parameter.name != name else f"{term.name}_{name}"  # a symbol of the motion needs no more
        result.append("" if is_number else unique.replace("-", "_").upper())
    return result


def arguments(subject: base.MotionSubject, term: Term) -> str:
    """The values of a term as a tuple; an effect that may differ from run to run gets none of a run's own."""
    values = [name or base.number(value) for name, value in zip(names(subject, term), term.values)]
    return f"({', '.join([*values, *['0.0'] * effects.get(term.name).per_run])},)"


AXIS_SENSES = {
    "NED": "u ahead, v to starboard, r clockwise; psi clockwise from north.",
    "ENU": "u ahead, v to port, r anticlockwise; psi anticlockwise from east.",
}
WATER = {
    "NED": "c * current[0] + s * current[1], c * current[1] - s * current[0]",
    "ENU": "c * current[1] + s * current[0], c * current[0] - s * current[1]",
}
MOVED = {
    "NED": "c * ground[0] - s * ground[1], s * ground[0] + c * ground[1]",
    "ENU": "s * ground[0] + c * ground[1], c * ground[0] - s * ground[1]",
}
"""Rates of north and east by the velocities in the vehicle's axes."""


def _vehicle(subject: Vehicle) -> base.Written:
    """One file of the plane, which has simulate() alone, and one of all else."""
    in_plane, enu = subject.places == PLANES and len(subject.origins) == 1, subject.frame == "ENU"
    north, east = subject.water or (0.0, 0.0)
    water = (north, east) if in_plane else (east, north, 0.0) if enu else (north, east, 0.0)
    places = PLANES if in_plane else list(range(6))
    forces: list[list[str]] = [[] for _ in range(6)]
    constants = []
    for drag in subject.drags:
        size = f" * {drag.factor}" if drag.factor else ""
        forces[drag.places[0]].append(f"{drag.name.upper()}{size} * {SPEED_LETTERS[drag.places[-1]]}")
        constants.append(f"{drag.name.upper()} = {base.number(drag.value)}  # {drag.meaning}")
    for i, value in enumerate(subject.diagonal(CONSTANT).tolist()):
        if value:
            # some terms bring their sign along
            name, weighs = f"{base.FORCE_LETTERS[i]}_0", i == HEAVE.number
            forces[i] += [] if weighs else [f"- {name}"]
            constants.append(f"{name} = {base.number(value)}  # {'weight less buoyancy' if weighs else 'always acts'}")
    for axis in subject.axes:
        i, leans = axis.dof.number, {"roll": "cos(theta) * sin(phi)", "pitch": "sin(theta)"}
        if value := axis.value(RESTORING):
            name = f"{axis.force}_{axis.dof.symbols.position}".upper()
            forces[i].append(f"{name} * {leans[axis.dof.name]}")
            constants.append(f"{name} = {base.number(value)}  # m g GM")
    for i, name, value, factor, meaning in subject.steering("rudder", "force[0]" if in_plane else "forces[0]"):
        forces[i].append(f"- {name} * {factor}")
        constants.append(f"{name} = {base.number(value)}  # {meaning}")
    lines = [f"[{base.row(line, ', ')}]" for line in subject.inertia[places][:, places]]
    rudder = any("rudder" in term for terms in forces for term in terms)
    thrusters = ""
    if subject.thrusters is not None:
        n, thrust = table(subject.thrusters.map, largest_signal(subject.thrusters))
        columns: dict[str, Floats] = {"n": n, "thrust": thrust, "places": np.array(subject.thrusters.places)}
        thrusters = base.filled("python_thrusters", {name: base.row(x, ", ") for name, x in columns.items()})
    steered = {
        "column": ", rudder", "unpacked": "        force, rudder = force[:3], force[3]\n", "arguments": ", rudder=0.0",
        "more": RUDDER.format(" with the other sign" if enu else ""),
    }  # fmt: skip
    text = {
        "thrusters": thrusters, "inertia": (", " if in_plane else ",\n    ").join(lines),
        "current": f"({base.row(water, ', ')})",
        "constants": "".join(f"{line}\n" for line in constants),
        "drags": "\n".join(f"            {' + '.join(forces[i]).replace('+ - ', '- ') or '0.0'}," for i in places),
        "step": base.number(MAX_EXPORT_STEP_S), "axes": AXIS_SENSES[subject.frame], "water": WATER[subject.frame],
        "moved": MOVED[subject.frame], "places": subject.places,
        **(steered if rudder else dict.fromkeys(steered, "")),
        "weight": f"{base.FORCE_LETTERS[HEAVE.number]}_0" if subject.diagonal(CONSTANT)[HEAVE.number] else "0.0",
        "head": base.comment(subject.head(), "#"),
    }  # fmt: skip
    return base.Written(base.filled("python_planar" if in_plane else "python_vehicle", text), subject.about_water())


TARGET = base.Target(
    name="python",
    says="one file of Python and numpy with simulate()",
    forms={"simulate": ".py"}, carries=frozenset({*PYTHON_EFFECTS, *RUDDER_LAWS, PREFIX}), si=False,
    lacks=frozenset({("thruster-lag", OF_EACH)}),
    uses=frozenset({"newton_metres_per_nu", "arm", "n_max"}), write=write,
    several=base.Several({"simulate": ".py"}, MATRIX_EFFECTS | STEERING, couples=True, thrusters=True),
)  # fmt: skip
