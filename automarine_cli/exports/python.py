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

from automarine_cli import effects
from automarine_cli.effects import base
from automarine_cli.effects.base import Effect
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.exports.base import Planar, Target, Written, YawSubject, comment, filled, head, number, plain
from automarine_cli.exports.planar import PlanarSubject
from automarine_cli.models.model import VELOCITIES, Term

MAX_STEP_S = 0.02  # s: the longest step of the integrator
METHODS = {"deliver", "moment", "water_rate", "derivatives", "read", "remember", "states"}
"""What of an effect acts; all else describes it."""
_LIBRARY = map(effects.get, effects.built_in())
PYTHON_EFFECTS = [effect.name for effect in _LIBRARY if not (effect.columns or effect.reads_force)]
"""Effects that need no logged column."""


def write(subject: YawSubject) -> Written:
    terms, dof, symbols = subject.model.terms, subject.dof, subject.dof.symbols
    inertia = symbols.inertia.upper()  # I_R, M_U, M_W
    logged = [name for term in terms for name in effects.get(term.name).needs]
    moments = (term.name for term in terms if effects.get(term.name).place.value == "moment")
    motion = f"{symbols.inertia} {symbols.velocity}' = {subject.force}"
    equation = " ".join([motion, *map(subject.equation_of, moments)])
    text = {
        **dof.vocabulary,
        "head": comment(head(subject, equation, ()), "#"),
        "inertia": inertia,
        "constants": f"{inertia} = {number(subject.model.inertia)}  # {subject.unit}: rigid and added together\n"
        + "".join(constants(subject, term) for term in terms),
        "runtime": runtime([effects.get(term.name) for term in terms]),
        "terms": "".join(f"    ({maker(effects.get(t.name))}, {arguments(subject, t)}),\n" for t in terms),
        "title": dof.words.position.capitalize(),
        "given": dof.words.force if symbols.force == subject.force else symbols.force,
        "unit": subject.model.moment_unit,
        "more": ", **columns" if logged else "",
        "columns": f" So does columns[{logged[0]!r}][i]." if logged else "",
        "signals": "{name: np.asarray(column)[None, sample] for name, column in columns.items()}" if logged else "{}",
        "step": number(MAX_STEP_S),
    }
    return Written(filled("python", text))


def runtime(chosen: Iterable[Effect]) -> str:
    """The source of what effects need to act, in the library's own order: no definition that nothing calls."""
    classes = [type(effect) for effect in chosen]
    effect_modules = sorted({kind.__module__ for kind in classes} - {Learned.__module__})
    modules: list[ModuleType] = [base, *(sys.modules[name] for name in (Learned.__module__, *effect_modules))]
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


def constants(subject: YawSubject, term: Term) -> str:
    effect = effects.get(term.name)
    cards = effect.card(subject.dof, subject.model.moment_unit).parameters
    return "".join(
        f"{name} = {number(value)}  # {plain(card.unit)}: {plain(card.meaning)}\n"
        for name, card, value in zip(names(subject, term), cards, term.values)
        if name
    )


def names(subject: YawSubject, term: Term) -> list[str]:
    """The constant of each parameter: K_RR of the drags, THRUST_LOSS_B of others; empty for one that stands as a number
    among the values: a choice of law, and what counts under no such law, or makes a learned curve."""
    effect, result = effects.get(term.name), []
    for parameter, name in zip(effect.parameters, effect.names_in(subject.dof)):
        is_number = isinstance(effect, Learned) or parameter.choices or not effect.counts(parameter, term.values)
        unique = name if parameter.name != name else f"{term.name}_{name}"  # a symbol of the motion needs no more
        result.append("" if is_number else unique.replace("-", "_").upper())
    return result


def arguments(subject: YawSubject, term: Term) -> str:
    """The values of a term as a tuple; an effect that may differ from run to run gets none of a run's own."""
    values = [name or number(value) for name, value in zip(names(subject, term), term.values)]
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


def write_planar(subject: PlanarSubject) -> Written:
    rows = [", ".join(number(value) for value in line) for line in subject.inertia]
    sums: list[list[str]] = [[], [], []]
    constants = []
    for name, places, value in subject.drags():
        along = VELOCITIES[places[-1]]
        size = f" * abs({VELOCITIES[places[1]]})" if len(places) == 3 else ""
        meaning = "coupling" if {*places} != {places[0]} else "linear drag" if len(places) == 2 else "quadratic drag"
        sums[places[0]].append(f"{name.upper()}{size} * {along}")
        constants.append(f"{name.upper()} = {number(value)}  # {meaning}")
    for i, value in enumerate(subject.constant.tolist()):
        if value:
            sums[i].append(f"- {'XYN'[i]}_0")
            constants.append(f"{'XYN'[i]}_0 = {number(value)}  # always acts")
    # some terms bring their sign along
    drags = "\n".join(f"            {' + '.join(terms).replace('+ - ', '- ') or '0.0'}," for terms in sums)
    north, east = subject.water or (0.0, 0.0)
    text = {
        "head": comment(subject.head(), "#"),
        "inertia": ", ".join(f"[{row}]" for row in rows),
        "current": f"({number(north)}, {number(east)})",
        "constants": "\n".join(constants) + "\n" * bool(constants),
        "drags": drags,
        "step": number(MAX_STEP_S),
        "axes": AXIS_SENSES[subject.frame],
        "water": WATER[subject.frame],
        "moved": MOVED[subject.frame],
    }
    return Written(filled("python_planar", text), subject.about_water())


TARGET = Target(
    name="python",
    says="one file of Python and numpy with simulate()",
    forms={"simulate": ".py"},
    carries=frozenset({*PYTHON_EFFECTS, PREFIX}),
    si=False,
    uses=frozenset({"newton_metres_per_nu"}),
    write=write,
    planar=Planar({"simulate": ".py"}, ("NED", "ENU"), write_planar),
)
