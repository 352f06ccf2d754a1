"""Plain Python: one file with numpy, readable in one go, that simulates the model.

The equation is ours, effects included, by classical Runge-Kutta on sub-steps. Source: `automarine effects NAME` has
the equation of each effect; `python_terms` has it as the file writes it. In the templates {x} and {v} stand for the
letters of position and rate, {F} for that of force or moment, {force} for its word, {given} for the logged one.
"""

from automarine_cli import effects
from automarine_cli.effects.base import Parameter
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.exports import planar_python
from automarine_cli.exports.base import Planar, Target, Written, YawSubject, commented, head, number, plain
from automarine_cli.exports.python_terms import LAWS, LINES, STATES, Lines, curve_constants, curve_lines
from automarine_cli.models.yaw_model import Term

STEP = 0.02  # s: the longest step of the integrator
SHARE = 0.25  # of a propeller's time constant, where that is shorter
WIDE = 90  # characters of a line that is still read at a glance

FILE = '''{head}import numpy as np

{constants}

def simulate(time, {given}, {x}0=0.0, {v}0=0.0{more}):
    """{title} as it is read [{base_unit}] and {speed} [{base_unit}/s] at `time` [s] under `{given}` [{unit}], all (N,).

    {given}[i] holds from time[i] to time[i + 1]; before time[0] there is none.{columns}
    """
'''
BODY = """    time, {given} = np.asarray(time, float), np.asarray({given}, float)

    def slope(t, state, {F}):
{slope}
    state = np.array([{state}])
    found = [state]
    for i in range(len(time) - 1):
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / {step})))
        h = (time[i + 1] - time[i]) / steps
        for t in time[i] + h * np.arange(steps):
            {F} = {command}
            a = slope(t, state, {F})
            b = slope(t + h / 2, state + h / 2 * a, {F})
            c = slope(t + h / 2, state + h / 2 * b, {F})
            state = state + h / 6 * (a + 2 * b + 2 * c + slope(t + h, state + h * c, {F}))
        found.append(state)
    {x}, {v} = np.array(found).T[:2]
{reading}    return {x}, {v}
"""


def write(subject: YawSubject) -> Written:
    """The text of the file."""
    terms, values, own = subject.model.terms, subject.values, letters(subject)
    written = [lines_of(subject, term) for term in terms]
    more = ["n"] * ("thruster-lag" in values) + ["water"] * ("water-swirl" in values)
    logged = [name for term in terms for name in effects.get(term.name).needs]
    laws = [(term.name, effects.get(term.name).law(term.values)) for term in terms]
    more += [name for law in laws for name in STATES.get(law, ())]
    lag, *_, fall = values.get("thruster-lag", (STEP / SHARE, 1.0))
    lag *= min(1.0, fall)
    top = own | {
        "head": commented(head(subject, equation(subject), ()), "#"),
        "constants": inertia(subject) + "".join(constants(subject, term) for term in terms),
        "title": own["position"].capitalize(),
        "unit": subject.model.moment_unit,
        "more": ", **columns" if logged else "",
        "columns": f" So does columns[{logged[0]!r}][i]." if logged else "",
    }
    body = own | {
        "slope": indented(slope_of(subject, written, more), 8),
        "state": ", ".join([f"{own['x']}0", f"{own['v']}0", *["0.0"] * len(more)]),
        "step": number(min(STEP, SHARE * lag)),
        "command": command(subject),
        "reading": indented([line for one in written for line in one.reading], 4),
    }
    return Written(FILE.format_map(top) + BODY.format_map(body))


def letters(subject: YawSubject) -> dict[str, str]:
    """What stands in the templates; force or moment as logged has its own letter, or where that is taken its word."""
    own, force = subject.dof.symbols.force, subject.force
    return {**subject.dof.vocabulary, "F": force, "given": subject.dof.words.force if own == force else own}


def slope_of(subject: YawSubject, written: list[Lines], more: list[str]) -> list[str]:
    """The right-hand side: the states `more` stand beside position and rate."""
    words, x, v = subject.dof.words, subject.dof.symbols.position, subject.dof.symbols.velocity
    slopes = [v, f"{words.force} / {constant_of_inertia(subject)}", *(f"{one}_dot" for one in more)]
    water = f" - water  # the {words.speed} through water that moves as well"
    return [
        f"{', '.join([x, v, *more])} = state",
        f"s = {v}{water if 'water' in more else '  # the water stands'}",
        *(line for one in written for line in one.command),
        *total(subject, [one.moment for one in written if one.moment]),
        *(line for one in written for line in one.state),
        f"return np.array([{', '.join(slopes)}])",
    ]


def total(subject: YawSubject, moments: list[str]) -> list[str]:
    """The sum of moments, in one line or one line a term."""
    force, word = subject.force, subject.dof.words.force
    line = " ".join([f"{word} = {force}", *moments])
    return [line] if len(line) < WIDE else [f"{word} = (", f"    {force}", *(f"    {one}" for one in moments), ")"]


def equation(subject: YawSubject) -> str:
    """The sum of moments in words of the effects."""
    moments = [term.name for term in subject.model.terms if effects.get(term.name).place.value == "moment"]
    own = subject.dof.symbols
    first = f"{own.inertia} {own.velocity}' = {subject.force}"
    return " ".join([first, *map(subject.equation_of, moments)])


def lines_of(subject: YawSubject, term: Term) -> Lines:
    """The lines of one term with the names of its constants in them."""
    effect = effects.get(term.name)
    if isinstance(effect, Learned):
        return curve_lines(term.values, effect.variable).filled(letters(subject))
    lines = LAWS.get((term.name, effect.law(term.values)), LINES[term.name])
    # a name that is a symbol of the motion stands in the lines by what it is
    names = {p.name.strip("{}"): constant(subject, term, p) for p in effects.get(term.name).parameters}
    return lines.filled({**letters(subject), **names})


def command(subject: YawSubject) -> str:
    """The moment held over a sub-step from t to t + h."""
    given = letters(subject)["given"]
    if "input-delay" not in subject.values:
        return f"{given}[i]"
    (term,) = (term for term in subject.model.terms if term.name == "input-delay")
    late = constant(subject, term, effects.get(term.name).parameters[0])
    return f"np.append({given}, 0.0)[np.searchsorted(time, t + h / 2 - {late}, 'right') - 1]"


def inertia(subject: YawSubject) -> str:
    """The line of the inertia."""
    value = number(subject.model.inertia)
    return f"{constant_of_inertia(subject)} = {value}  # {subject.unit}: rigid and added together\n"


def constant_of_inertia(subject: YawSubject) -> str:
    """The inertia's name: I_R, M_U, M_W."""
    return subject.dof.symbols.inertia.upper()


def constants(subject: YawSubject, term: Term) -> str:
    """One line for each parameter that counts: name, value, unit and meaning. Choices of law are in the equation."""
    effect = effects.get(term.name)
    if isinstance(effect, Learned):
        return curve_constants(term.values, effect.variable)
    lines = zip(effect.parameters, effect.card(subject.dof, subject.model.moment_unit).parameters, term.values)
    return "".join(
        f"{constant(subject, term, p)} = {number(value)}  # {plain(told.unit)}: {plain(told.meaning)}\n"
        for p, told, value in lines
        if not p.choices and effect.counts(p, term.values)
    )


def constant(subject: YawSubject, term: Term, parameter: Parameter) -> str:
    """The constant's name: K_RR of the drags, THRUST_LOSS_B of others."""
    name = parameter.name_in(subject.dof)
    own = parameter.name != name  # a symbol of the motion
    return (name if own else f"{term.name}_{name}").replace("-", "_").upper()


def indented(lines: list[str], by: int) -> str:
    """Lines of code at their depth."""
    return "".join(f"{' ' * by}{line}\n" for line in lines)


TARGET = Target(
    name="python",
    says="one file of Python and numpy with simulate()",
    source="automarine effects NAME",
    forms={"simulate": ".py"},
    carries=frozenset({*LINES, PREFIX}),
    laws=frozenset(LAWS),
    si=False,
    uses=frozenset({"newton_metres_per_nu"}),
    write=write,
    planar=Planar({"simulate": ".py"}, ("NED", "ENU"), planar_python.write),
)
