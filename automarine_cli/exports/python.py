"""Plain Python: one file with numpy, readable in one go, that simulates the model.

The equation is ours, effects included, by classical Runge-Kutta on sub-steps. Source: `automarine effects NAME` has
the equation of each effect; `python_terms` has it as the file writes it. The code is yaw's, with the letters of the
motion for psi, r and N.
"""

import re

from automarine_cli import effects
from automarine_cli.effects.base import Parameter
from automarine_cli.exports.base import Target, Written, YawSubject, commented, head, number, plain
from automarine_cli.exports.python_terms import CUT, LINES, SWIRL, Lines
from automarine_cli.models.yaw_model import Term

POSITIONS = {"yaw": "psi", "surge": "x", "heave": "z"}
STEP = 0.02  # s: the longest step of the integrator
SHARE = 0.25  # of a propeller's time constant, where that is shorter
WIDE = 90  # characters of a line that is still read at a glance

FILE = '''{head}import numpy as np

{constants}

def simulate(time, tau, {start}):
    """{position} as it is read [{its_unit}] and rate [{rate_unit}] at `time` [s] under `tau` [{unit}], all (N,).

    tau[i] holds from time[i] to time[i + 1]; before time[0] there is none.
    """
'''
BODY = """    time, tau = np.asarray(time, float), np.asarray(tau, float)

    def slope(t, state, N):
{slope}
    state = np.array([{state}])
    found = [state]
    for i in range(len(time) - 1):
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / {step})))
        h = (time[i + 1] - time[i]) / steps
        for t in time[i] + h * np.arange(steps):
            N = {command}
            a = slope(t, state, N)
            b = slope(t + h / 2, state + h / 2 * a, N)
            c = slope(t + h / 2, state + h / 2 * b, N)
            state = state + h / 6 * (a + 2 * b + 2 * c + slope(t + h, state + h * c, N))
        found.append(state)
    psi, r = np.array(found).T[:2]
{reading}    return psi, r
"""


def write(subject: YawSubject) -> Written:
    """The text of the file."""
    terms, values = subject.model.terms, subject.values
    written = [lines_of(subject, term) for term in terms]
    more = ["n"] * ("thruster-lag" in values) + ["water"] * ("water-swirl" in values)
    lag = values.get("thruster-lag", (STEP / SHARE,))[0]
    top = FILE.format(
        head=commented(head(subject, equation(subject), ()), "#"),
        constants=inertia(subject) + "".join(constants(subject, term) for term in terms),
        start=in_letters(subject, "psi0=0.0, r0=0.0"),
        position=subject.dof.say("heading").capitalize(),
        its_unit=subject.names.position,
        rate_unit=subject.names.rate,
        unit=subject.model.moment_unit,
    )
    body = BODY.format(
        slope=indented(slope_of(subject, written, more), 8),
        state=", ".join(["psi0", "r0", *["0.0"] * len(more)]),
        step=number(min(STEP, SHARE * lag)),
        command=command(subject),
        reading=indented([line for one in written for line in one.reading], 4),
    )
    return Written(top + in_letters(subject, body))


def slope_of(subject: YawSubject, written: list[Lines], more: list[str]) -> list[str]:
    """The right-hand side: the states `more` stand beside position and rate."""
    slopes = ["r", f"moment / {constant_of_inertia(subject)}", *(f"{one}_dot" for one in more)]
    water = " - water  # the rate through water that moves as well"
    return [
        f"{', '.join(['psi', 'r', *more])} = state",
        f"s = r{water if 'water' in more else '  # the water stands'}",
        *(line for one in written for line in one.command),
        *total([one.moment for one in written if one.moment]),
        *(line for one in written for line in one.state),
        f"return np.array([{', '.join(slopes)}])",
    ]


def total(moments: list[str]) -> list[str]:
    """The sum of moments, in one line or one line a term."""
    line = " ".join(["moment = N", *moments])
    return [line] if len(line) < WIDE else ["moment = (", "    N", *(f"    {one}" for one in moments), ")"]


def in_letters(subject: YawSubject, text: str) -> str:
    """Code or an equation of yaw with what the motion has for psi, r, N and moment."""
    names, moment = subject.names, subject.dof.say("moment")
    own = {"psi": POSITIONS[subject.dof.name], "r": names.rate_letter, "N": names.force, "moment": moment}
    return re.sub(r"\b(psi|r|N|moment)(0?)\b", lambda one: own[one[1]] + one[2], text)


def equation(subject: YawSubject) -> str:
    """The sum of moments in words of the effects."""
    moments = [term.name for term in subject.model.terms if effects.get(term.name).place.value == "moment"]
    first = in_letters(subject, f"{subject.names.inertia} r' = N")
    return " ".join([first, *map(subject.equation_of, moments)])


def lines_of(subject: YawSubject, term: Term) -> Lines:
    """The lines of one term with the names of its constants in them."""
    lines = LINES[term.name]
    if term.name == "dead-band" and term.values[1] > 0:
        lines = CUT
    if term.name == "water-swirl":
        lines = SWIRL[term.values[2] > 0]
    # a name that is a symbol of the motion stands in the lines by what it is
    names = {p.name.strip("{}"): constant(subject, term, p) for p in effects.get(term.name).parameters}
    return lines.named(names)


def command(subject: YawSubject) -> str:
    """The moment held over a sub-step from t to t + h."""
    if "input-delay" not in subject.values:
        return "tau[i]"
    (term,) = (term for term in subject.model.terms if term.name == "input-delay")
    late = constant(subject, term, effects.get(term.name).parameters[0])
    return f"np.append(tau, 0.0)[np.searchsorted(time, t + h / 2 - {late}, 'right') - 1]"


def inertia(subject: YawSubject) -> str:
    """The line of the inertia."""
    value = number(subject.model.inertia)
    return f"{constant_of_inertia(subject)} = {value}  # {subject.unit}: rigid and added together\n"


def constant_of_inertia(subject: YawSubject) -> str:
    """The inertia's name: I_R, M_U, M_W."""
    return subject.names.inertia.upper()


def constants(subject: YawSubject, term: Term) -> str:
    """One line for each parameter that counts: name, value, unit and meaning. Choices of law are in the equation."""
    effect = effects.get(term.name)
    lines = zip(
        effect.parameters, effect.card(subject.dof, subject.model.moment_unit).parameters, term.values
    )
    return "".join(
        f"{constant(subject, term, p)} = {number(value)}  # {plain(told.unit)}: {plain(told.meaning)}\n"
        for p, told, value in lines
        if not p.choices
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
    carries=frozenset(LINES),
    si=False,
    uses=frozenset({"newton_metres_per_nu"}),
    axes=tuple(POSITIONS),
    write=write,
)
