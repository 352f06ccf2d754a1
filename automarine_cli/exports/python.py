"""Plain Python: one file with numpy, readable in one go, that simulates the model.

The equation is ours, effects included, by classical Runge-Kutta on sub-steps. Source: `automarine effects NAME` has
the equation of each effect; `python_terms` has it as the file writes it. In the templates {x} and {v} stand for the
letters of position and rate, {F} for that of force or moment, {force} for its word, {given} for the logged one.
"""

from textwrap import indent

from automarine_cli import effects
from automarine_cli.effects.base import Parameter
from automarine_cli.effects.learned import PREFIX, Learned
from automarine_cli.exports.base import Planar, Target, Written, YawSubject, commented, head, number, plain
from automarine_cli.exports.planar import MEANING, PlanarSubject
from automarine_cli.exports.python_terms import LAWS, LINES, STATES, Lines, curve_constants, curve_lines
from automarine_cli.models.planar import VELOCITIES
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
    inertia = subject.dof.symbols.inertia.upper()  # I_R, M_U, M_W
    written = [lines_of(subject, term) for term in terms]
    more = ["n"] * ("thruster-lag" in values) + ["water"] * ("water-swirl" in values)
    logged = [name for term in terms for name in effects.get(term.name).needs]
    laws = [(term.name, effects.get(term.name).law(term.values)) for term in terms]
    more += [name for law in laws for name in STATES.get(law, ())]
    lag, *_, fall = values.get("thruster-lag", (STEP / SHARE, 1.0))
    lag *= min(1.0, fall)
    top = own | {
        "head": commented(head(subject, equation(subject), ()), "#"),
        "constants": f"{inertia} = {number(subject.model.inertia)}  # {subject.unit}: rigid and added together\n"
        + "".join(constants(subject, term) for term in terms),
        "title": own["position"].capitalize(),
        "unit": subject.model.moment_unit,
        "more": ", **columns" if logged else "",
        "columns": f" So does columns[{logged[0]!r}][i]." if logged else "",
    }
    body = own | {
        "slope": indent("\n".join(slope_of(subject, inertia, written, more)) + "\n", " " * 8),
        "state": ", ".join([f"{own['x']}0", f"{own['v']}0", *["0.0"] * len(more)]),
        "step": number(min(STEP, SHARE * lag)),
        "command": command(subject),
        "reading": "".join(f"    {line}\n" for lines in written for line in lines.reading),
    }
    return Written(FILE.format_map(top) + BODY.format_map(body))


def letters(subject: YawSubject) -> dict[str, str]:
    """What stands in the templates; force or moment as logged has its own letter, or where that is taken its word."""
    own, force = subject.dof.symbols.force, subject.force
    return {**subject.dof.vocabulary, "F": force, "given": subject.dof.words.force if own == force else own}


def slope_of(subject: YawSubject, inertia: str, written: list[Lines], more: list[str]) -> list[str]:
    """The right-hand side: the states `more` stand beside position and rate; the moments in one line or one a term."""
    words, x, v, force = subject.dof.words, subject.dof.symbols.position, subject.dof.symbols.velocity, subject.force
    slopes = [v, f"{words.force} / {inertia}", *(f"{name}_dot" for name in more)]
    water = f" - water  # the {words.speed} through water that moves as well"
    moments = [lines.moment for lines in written if lines.moment]
    total = [" ".join([f"{words.force} = {force}", *moments])]
    if len(total[0]) >= WIDE:
        total = [f"{words.force} = (", *(f"    {moment}" for moment in (force, *moments)), ")"]
    return [
        f"{', '.join([x, v, *more])} = state",
        f"s = {v}{water if 'water' in more else '  # the water stands'}",
        *(line for lines in written for line in lines.command),
        *total,
        *(line for lines in written for line in lines.state),
        f"return np.array([{', '.join(slopes)}])",
    ]


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


PLANAR_FILE = '''{head}import numpy as np

M = np.array([{inertia}])  # kg, kg m, kg m^2: rigid and added together
CURRENT = {current}  # m/s north, east: the water of the runs
{constants}

def simulate(time, X, Y, N, north=0.0, east=0.0, psi=0.0, u=0.0, v=0.0, r=0.0, current=CURRENT):
    """Positions (north, east [m], psi [rad]) and velocities over ground (u, v [m/s], r [rad/s]) at `time` [s], (n, 3)
    both, under forces `X`, `Y` [N] and a moment `N` [N m], all (n,).

    Element i of a command holds from time[i] to time[i + 1]. {axes}
    """
    time = np.asarray(time, float)
    tau = np.stack([np.broadcast_to(np.asarray(one, float), time.shape) for one in (X, Y, N)], axis=1)
    inverse = np.linalg.inv(M)

    def water(psi):
        c, s = np.cos(psi), np.sin(psi)
        return np.array([{water}, 0.0])

    def slope(state, force):
        psi, (u, v, r) = state[2], state[3:]
        p = M @ state[3:]
        c_nu = np.array([-p[1] * r, p[0] * r, p[1] * u - p[0] * v])
        drag = np.array([
{drags}
        ])
        ground = state[3:] + water(psi)
        c, s = np.cos(psi), np.sin(psi)
        moved = np.array([{moved}, ground[2]])
        return np.concatenate([moved, inverse @ (force - c_nu - drag)])

    state = np.array([north, east, psi, u, v, r], float)
    state[3:] -= water(psi)
    found = [state]
    for i in range(len(time) - 1):
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / {step})))
        h = (time[i + 1] - time[i]) / steps
        for _ in range(steps):
            a = slope(state, tau[i])
            b = slope(state + h / 2 * a, tau[i])
            c = slope(state + h / 2 * b, tau[i])
            state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c, tau[i]))
        found.append(state)
    found = np.array(found)
    over_ground = np.array([row[3:] + water(row[2]) for row in found])
    return found[:, :3], over_ground
'''
AXES = {
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
    """The text of the file."""
    rows = [", ".join(number(one) for one in line) for line in subject.inertia]
    sums: list[list[str]] = [[], [], []]
    constants = []
    for name, places, value in subject.drags():
        along = VELOCITIES[places[-1]]
        size = f" * abs({VELOCITIES[places[1]]})" if len(places) == 3 else ""
        sums[places[0]].append(f"{name.upper()}{size} * {along}")
        constants.append(f"{name.upper()} = {number(value)}  # {MEANING.get(name, 'coupling')}")
    for i, value in enumerate(subject.constant.tolist()):
        if value:
            sums[i].append(f"- {'XYN'[i]}_0")
            constants.append(f"{'XYN'[i]}_0 = {number(value)}  # always acts")
    drags = "\n".join(f"            {_sum(one)}," for one in sums)
    north, east = subject.water or (0.0, 0.0)
    text = PLANAR_FILE.format(
        head=commented(subject.head(), "#"),
        inertia=", ".join(f"[{row}]" for row in rows),
        current=f"({number(north)}, {number(east)})",
        constants="\n".join(constants) + "\n" * bool(constants),
        drags=drags,
        step=number(STEP),
        axes=AXES[subject.frame],
        water=WATER[subject.frame],
        moved=MOVED[subject.frame],
    )
    return Written(text, subject.about_water())


def _sum(parts: list[str]) -> str:
    """A sum of terms, some of which bring their sign along."""
    return " + ".join(parts).replace("+ - ", "- ") or "0.0"


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
    planar=Planar({"simulate": ".py"}, ("NED", "ENU"), write_planar),
)
