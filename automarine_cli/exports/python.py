"""Plain Python: one file with numpy, readable in one go, that simulates the model.

The equation is ours, effects included, by classical Runge-Kutta on sub-steps. Source: `automarine effects NAME` has
the equation of each effect; `python_terms` has it as the file writes it.
"""

from automarine_cli import effects
from automarine_cli.effects.base import Parameter
from automarine_cli.exports.base import Target, Written, YawSubject, commented, head, number, plain
from automarine_cli.exports.python_terms import CUT, LINES, SWIRL, Lines
from automarine_cli.models.yaw_model import Term

STEP = 0.02  # s: the longest step of the integrator
WIDE = 90  # characters of a line that is still read at a glance
SHARE = 0.25  # of a propeller's time constant, where that is shorter


def write(subject: YawSubject) -> Written:
    """The text of the file."""
    values, written = subject.values, [lines_of(term) for term in subject.model.terms]
    lag, swirl = "thruster-lag" in values, "water-swirl" in values
    states = ["psi", "r", *["n"] * lag, *["w"] * swirl]
    slopes = ["r", "moment / I_R", *["n_dot"] * lag, *["w_dot"] * swirl]
    slope = [
        f"{', '.join(states)} = x",
        "s = r - w  # the rate through water that turns as well" if swirl else "s = r  # the water stands",
        *(line for one in written for line in one.command),
        *total([one.moment for one in written if one.moment]),
        *(line for one in written for line in one.state),
        f"return np.array([{', '.join(slopes)}])",
    ]
    reading = [line for one in written for line in one.reading]
    step = min(STEP, SHARE * values["thruster-lag"][0]) if lag and values["thruster-lag"][0] else STEP
    unit = subject.model.moment_unit
    text = f'''{commented(head(subject, equation(subject), ()), "#")}import numpy as np

I_R = {number(subject.model.inertia)}  # {subject.unit}: inertia, rigid and added
{"".join(constants(term, unit) for term in subject.model.terms)}

def simulate(time, tau, psi0=0.0, r0=0.0):
    """Heading as it is read [rad] and yaw rate [rad/s] at `time` [s] under the moment `tau` [{unit}], all (N,).

    tau[i] holds from time[i] to time[i + 1]; before time[0] there is none.
    """
    time, tau = np.asarray(time, float), np.asarray(tau, float)

    def slope(t, x, u):
{indented(slope, 8)}
    x = np.array([{", ".join(["psi0", "r0", *["0.0"] * (lag + swirl)])}])
    found = [x]
    for i in range(len(time) - 1):
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / {number(step)})))
        h = (time[i + 1] - time[i]) / steps
        for t in time[i] + h * np.arange(steps):
            u = {command(subject)}
            a = slope(t, x, u)
            b = slope(t + h / 2, x + h / 2 * a, u)
            c = slope(t + h / 2, x + h / 2 * b, u)
            x = x + h / 6 * (a + 2 * b + 2 * c + slope(t + h, x + h * c, u))
        found.append(x)
    psi, r = np.array(found).T[:2]
{indented(reading, 4)}    return psi, r
'''
    return Written(text)


def equation(subject: YawSubject) -> str:
    """The sum of moments in words of the effects."""
    moments = [effects.get(term.name) for term in subject.model.terms]
    shown = [plain(one.equation) for one in moments if one.place.value == "moment"]
    return " ".join(["I_r r' = u", *shown])


def total(moments: list[str]) -> list[str]:
    """The sum of moments, in one line or one line a term."""
    line = " ".join(["moment = u", *moments])
    return [line] if len(line) < WIDE else ["moment = (", "    u", *(f"    {one}" for one in moments), ")"]


def lines_of(term: Term) -> Lines:
    """The lines of one term with the names of its constants in them."""
    lines = LINES[term.name]
    if term.name == "dead-band" and term.values[1] > 0:
        lines = CUT
    if term.name == "water-swirl":
        lines = SWIRL[term.values[2] > 0]
    names = {p.name: constant(term, p) for p in effects.get(term.name).parameters}
    return lines.named(names)


def command(subject: YawSubject) -> str:
    """The moment held over a sub-step from t to t + h."""
    if "input-delay" not in subject.values:
        return "tau[i]"
    (term,) = (term for term in subject.model.terms if term.name == "input-delay")
    late = constant(term, effects.get(term.name).parameters[0])
    return f"np.append(tau, 0.0)[np.searchsorted(time, t + h / 2 - {late}, 'right') - 1]"


def constants(term: Term, unit: str) -> str:
    """One line for each parameter that counts: name, value, unit and meaning. Choices of law are in the equation."""
    parameters = effects.get(term.name).parameters
    return "".join(
        f"{constant(term, p)} = {number(value)}  # {plain(p.unit_for(unit))}: {plain(p.meaning)}\n"
        for p, value in zip(parameters, term.values)
        if not p.choices
    )


def constant(term: Term, parameter: Parameter) -> str:
    """The constant's name: K_RR of the drags, THRUST_LOSS_B of others."""
    name = parameter.name if parameter.name.startswith("k_r") else f"{term.name}_{parameter.name}"
    return name.replace("-", "_").upper()


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
    write=write,
)
