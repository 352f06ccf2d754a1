"""`Model`: the motion of one vehicle; frozen, `with_...` returns a new one. Step responses in closed form.

    M nu' + C(nu_r) nu_r = tau + forces of the terms,    nu_r = nu - R(psi)' (current north, east, 0)

nu is one velocity, or (u, v, r) in the plane. M holds the rigid body and the added mass, both symmetric; C follows from
M. In a constant current without rotation the equations hold for velocities through the water as they do for those over
ground in still water, so that M serves both. Sources: SNAME (1950), Technical and Research Bulletin 1-5 (names of
forces and derivatives); Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, second edition,
chapters 3 (rigid body), 6 (manoeuvring models) and 10 (current). Signs are those of this tool: every drag counts as
positive where it resists, every added mass where it adds, so that m_v = m - Y_v', m_vr = m x_g - Y_r' and Y_r stands
for what Fossen writes -Y_r.

Exact response of models 1, 2 and 3 to a constant moment, from rest.

With a = |tau|/I, b = k_r/I, c = k_rr/I the rate in the moment's direction obeys the Riccati equation
r' = a - b r - c r². Its solution needs one formula for all three models:

    delta = sqrt(b²/4 + a c),   r_inf = a/(delta + b/2),   z(t) = r_inf (1 - exp(-2 delta t))/(2 delta)
    psi(t) = psi0 + r_inf t + ln(1 - c z)/c,    r(t) = r_inf - r_inf exp(-2 delta t)/(1 - c z)

For c = 0 the logarithm becomes -z, the paper's equation 6; for b = 0 it is the paper's ln cosh (equation 8). The
heading ends on a line through eps = psi0 - sgn(tau) (I/k_rr) ln(1 + r_inf/r_2) at the instant of the step, where
r_2 = (delta + b/2)/c is the size of the other root: equation 9 for k_r = 0, equation 7 for k_rr = 0.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli import effects
from automarine_cli.dofs import Dof, Motion, alone
from automarine_cli.effects import Commands, Effect, Place, State
from automarine_cli.effects.thruster_imbalance import ARM, PARTS, AheadOf, SingleThrusterEffect, acts_singly
from automarine_cli.errors import ModelError
from automarine_cli.models.parameter import SMALLEST, Parameter, Parameters
from automarine_cli.quantities import STEERED, Floats

BASE_TERMS = {"1": ("linear-drag",), "2": ("quadratic-drag", "linear-drag"), "3": ("quadratic-drag",)}
"""The drag terms of the paper's three models: D(r) = k_r; k_rr|r| + k_r; k_rr|r|."""

COMMAND_DELAY = "command_delay_s"
"""Name, for users and in files, of how long [s] after the middle of the sample interval in which a command changed it
acts: beside inertia and drag a parameter of every fit."""
DELAY = "input-delay"  # the effect that means the same
MAX_DELAY_S = effects.get(DELAY).parameters[0].upper
MAX_EARLY_HALF_SAMPLES = 3.0  # before that middle, in which commands act at most: a log may show them a message late
CONSTANT = "bias-moment"  # the term of a moment or force that always acts
RESTORING = "restoring-moment"  # the term by which weight and buoyancy turn the vehicle back
SIDED_DRAG = {"1": "linear-drag-asymmetry", "2": "drag-asymmetry", "3": "drag-asymmetry"}
"""The term by which drag differs between the two ways."""
SWING_SHARE = 0.25  # of a radian of a swing, as fast as which a model may change


def main_drag(number: str) -> str:
    """What the drag is, "linear" or "quadratic", that model `number` has always, and of which ways may differ."""
    return effects.get(BASE_TERMS[number][0]).role


def base_terms(number: str, dof: Dof, sided: bool = False) -> tuple[str, ...]:
    """The terms of model `number` of a motion: drag, a constant force where one acts, what turns it back, and the
    asymmetry if `sided`."""
    constant = (*([CONSTANT] if dof.biased else []), *([RESTORING] if dof.restoring else []))
    return (*BASE_TERMS[number], *constant, *((SIDED_DRAG[number],) if sided else ()))


def base_roles(number: str, dof: Dof, sided: bool = False) -> tuple[str, ...]:
    """What the parameters of these terms are (see `Dof.parameters`), the inertia first."""
    return ("inertia", *(effects.get(term).role for term in base_terms(number, dof, sided)))


PLANAR_FORCES, PLANAR_VELOCITIES = "XYN", "uvr"
INERTIA_COUPLINGS = {"m_vr": (1, 2, "kg m"), "m_ur": (0, 2, "kg m"), "m_uv": (0, 1, "kg")}
"""Inertia that couples two motions of the plane, where it stands in the matrix, and its unit: zero of a vehicle alike
fore and aft, the last two of one alike on both sides."""
CURRENT = ("current.north", "current.east")
MAX_CURRENT_M_S = 5.0  # no tidal current of a place where vehicles are tested is faster
_DERIVATIVE = re.compile(rf"([{PLANAR_FORCES}])_([{PLANAR_VELOCITIES}]{{1,2}})")


@dataclass(frozen=True)
class CrossDrag(Effect):
    """Resistance to one degree of freedom by the flow along others: -c b or -c |a| b, such as Y_r r or N_vr |v| r.

    `along` is the place of b in the motion, `size` that of a; Fossen (2021), chapter 6. No effect of the library: one
    motion alone knows no other's flow.
    """

    along: int
    size: int | None
    unit: str

    name = "cross-drag"

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        (size,) = values
        if self.size is not None:
            size = size * np.abs(state.flow[self.size])
        return -size * state.flow[self.along]

    off = (0.0,)

    def held(self, values: tuple[float, ...]) -> tuple[bool, ...]:
        return (False,)


@lru_cache
def derivative(name: str) -> tuple[int, CrossDrag]:
    """Return what a derivative such as N_v or N_vr acts on, and the drag that it is. Raises ModelError."""
    match = _DERIVATIVE.fullmatch(name)
    place = PLANAR_FORCES.index(match[1]) if match else 0
    if match is None or set(match[2]) == {PLANAR_VELOCITIES[place]}:
        raise ModelError(f"{name!r}: expected X, Y or N by the velocities of other motions, such as Y_r or N_vr")
    *size, along = (PLANAR_VELOCITIES.index(letter) for letter in match[2])
    metres = (match[1] == "N") - sum(letter != "r" for letter in match[2])
    of_metres = {1: " m", 0: "", -1: "/m", -2: "/m²"}[metres]
    of_seconds = "s²" if size else "s"
    unit = f"N m {of_seconds}" if metres == 1 else f"N {of_seconds}{of_metres}"
    return place, CrossDrag(along, size[0] if size else None, unit)


@dataclass(frozen=True)
class Term:
    """An effect that acts on the degree of freedom in place `dof` of a motion, with the values of its parameters, in
    the effect's order; `base` where it belongs to the motion's own equation, and was not added to it.

    In the plane it may be a drag by the velocities of others, `name` then being a derivative such as N_v.
    """

    name: str
    values: tuple[float, ...]
    base: bool = False
    dof: int = 0

    @classmethod
    def cross(cls, name: str, value: float = 0.0) -> "Term":
        """Return a drag by the velocities of others. Raises ModelError for a derivative that is none."""
        return cls(name, (value,), True, derivative(name)[0])

    @property
    def is_cross(self) -> bool:
        return _DERIVATIVE.fullmatch(self.name) is not None

    @property
    def effect(self) -> Effect:
        return derivative(self.name)[1] if self.is_cross else effects.get(self.name)


def label_of(name: str, added: Sequence[str]) -> str:
    """Return an effect's name with the letters of what it adds to a model, and its motion where it may be in another:
    cross-coupling N_v, bias-moment b in yaw."""
    letters = ", ".join(dict.fromkeys(parameter.rpartition(".")[2] for parameter in added))
    motions = {parameter.partition(".")[0] for parameter in added if parameter.count(".") > 1}
    alone = len(motions) == 1 and not isinstance(effects.get(name), SingleThrusterEffect)
    return f"{name} {letters}{f' in {motions.pop()}' if alone else ''}".rstrip()


@dataclass(frozen=True)
class Bound:
    """An effect that acts on the degree of freedom in place `dof`, with its parameters, each (P, 1); an actuator of a
    logged `signal`, a rudder beside thrusters, acts on that and on no command."""

    dof: int
    effect: Effect
    values: tuple[Floats, ...]
    signal: str = ""

    def wide(self) -> tuple[Floats, ...]:
        return tuple(value[..., None] for value in self.values)


def actuators(terms: Sequence[Bound], signal: str = "") -> list[Bound]:
    """Return the terms that act on commands, or on a `signal`, in the order in which they do."""
    acting = [term for term in terms if term.effect.place is Place.ACTUATOR and term.signal == signal]
    return sorted(acting, key=lambda term: term.effect.stage)


def turned(terms: Sequence[Bound], signals: Mapping[str, Floats], like: Commands) -> dict[str, Floats]:
    """Return those of the logged `signals` (R, M) that actuators act on as they deliver them, (P, R, M), on the steps
    of commands `like` theirs."""
    answer = dict[str, Floats]()
    for name in dict.fromkeys(term.signal for term in terms if term.signal):
        length = np.maximum(like.length, 0.0)  # a gear only knows time to pass
        commands = replace(like, force=signals[name][None], before=signals[name][:, :1], length=length)
        for term in actuators(terms, name):
            commands = replace(commands, force=term.effect.deliver(commands, term.wide()))
        answer[name] = commands.force
    return answer


@dataclass(frozen=True)
class Model:
    """A `motion` with its inertia and terms; what actuators, water and sensors do are terms too.

    `masses` are the inertia of each degree of freedom [force s² per unit] and, in the plane, the INERTIA_COUPLINGS;
    `water` is the velocity north and east [m/s] of the water, None where it is still. Parameters called `fixed` are not
    estimated, and `ties` say which is which other times a factor. theta is (masses, values of the first term, values of
    the second, ..., current), in the plane term by term of surge, of sway, of yaw, then drags by others' velocities.
    """

    motion: Motion
    masses: tuple[float, ...]
    terms: tuple[Term, ...]
    moment_unit: str
    water: tuple[float, float] | None = None
    fixed: tuple[str, ...] = ()
    ties: tuple[tuple[str, str, float], ...] = ()

    def __post_init__(self) -> None:
        last = len(self.motion.dofs)
        ordered = sorted(self.terms, key=lambda term: last if term.is_cross else term.dof)
        object.__setattr__(self, "terms", tuple(ordered))

    @classmethod
    def base(cls, number: str, inertia: float, values: Sequence[float] | Floats, moment_unit: str, dof: Dof) -> "Model":
        """Model "1", "2" or "3" of the paper; `values` in the order of `base_terms`, sided if there is one more."""
        sided = len(values) > len(base_terms(number, dof))
        names = base_terms(number, dof, sided)
        terms = tuple(Term(name, (float(value),), base=True) for name, value in zip(names, values, strict=True))
        return cls(alone(dof), (float(inertia),), terms, moment_unit)

    @property
    def dof(self) -> Dof:
        """The degree of freedom; in the plane the heading's."""
        return self.motion.dofs[-1]

    @property
    def inertia(self) -> float:
        """Inertia of the only degree of freedom."""
        (inertia,) = self.masses
        return inertia

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Qualified names of the entries of theta: "yaw.I_r", "yaw.k_rr", "input-delay.t_d" of what was added; in the
        plane "planar.m_vr", "sway.Y_r", "yaw.input-delay.t_d", "current.north" too."""
        return self.parameters().names

    def names_of(self, term: Term) -> tuple[str, ...]:
        """Return the qualified names of a term's parameters; by the letter of their role in the motion's equation."""
        dof, effect = self.motion.dofs[term.dof], term.effect
        if term.is_cross:
            return (f"{dof.name}.{term.name}",)
        if term.base:
            return (dof.parameter(effect.role),)
        prefix = f"{dof.name}." if len(self.motion.dofs) > 1 else ""
        return tuple(f"{prefix}{term.name}.{name}" for name in effect.names_in(dof))

    @property
    def short_names(self) -> tuple[str, ...]:
        """The same as files have them: without motion or effect, unless an earlier one is called so."""
        names: list[str] = []
        for name in self.parameter_names:
            short = name.partition(".")[2]
            names.append(name if short in names else short)
        return tuple(names)

    def index(self, name: str) -> int:
        """Return the place in theta of a parameter by its qualified name; ModelError says what there is."""
        if name not in self.parameter_names:
            raise ModelError(f"the model has no parameter {name!r}; it has {', '.join(self.parameter_names)}")
        return self.parameter_names.index(name)

    @property
    def signals(self) -> tuple[str, ...]:
        """Logged columns that its effects read, in the order of its terms; states of the motion are none."""
        states = {dof.velocity for dof in self.motion.dofs}
        every = dict.fromkeys(name for term in self.terms for name in term.effect.needs_at(term.values))
        arm = {ARM} if len(self.motion.dofs) > 1 and {*PARTS} & {*every} else set[str]()
        return tuple(name for name in (*every, *arm) if name not in states)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are neither fixed nor tied, nor say by which law an effect acts."""
        flags = [flag for t in self.terms for flag in zip(self.names_of(t), t.effect.held(t.values))]
        stay = {*self.fixed, *(name for name, *_ in self.ties), *(name for name, stays in flags if stays)}
        return tuple(name for name in self.parameter_names if name not in stay)

    def parameters(
        self, largest: ArrayLike = 1.0, *, log_drag: bool = False, signed_drag: bool = False,
        least_delay: float = -np.inf, longest_period: float = np.inf, dropped: Collection[str] = (),
    ) -> Parameters:  # fmt: skip
        """Give the entries of theta as a fit searches them; steps are for the `largest` moment, or that of each motion.

        If `log_drag` the drag that the model always has and what turns it back are on a logarithm; if `signed_drag`
        linear drag beside quadratic drag has either sign, as in Table 1. Effects that make all commands late do so by
        `least_delay` [s] or more, what varies from run to run has periods up to `longest_period` [s], and terms that
        were `dropped` stay as they are.
        """
        base = [term.effect.role for term in self.terms if term.base]
        main = "quadratic" if "quadratic" in base else "linear"
        has_both_drags = {term.name for term in self.terms} >= set(BASE_TERMS["2"])
        # a hull may turn by itself until its other drag holds it: ships are often unstable on their course
        steers = self.steered and any((term.effect.power or 0) > 1 for term in self.terms)
        dofs, entries = self.motion.dofs, list[Parameter]()
        units = [dof.units.forces[1] if len(dofs) > 1 else self.moment_unit for dof in dofs]
        size = np.broadcast_to(np.asarray(largest, dtype=float), len(dofs)).tolist()
        for dof, mass, unit in zip(dofs, self.masses, units):
            name = dof.parameter("inertia")
            entries.append(Parameter(name, mass, 0.0, log=True, role="inertia", unit=dof.unit_of("inertia", unit)))
        for (name, (*_, unit)), mass in zip(INERTIA_COUPLINGS.items(), self.masses[len(dofs) :]):
            entries.append(Parameter(f"{self.motion.name}.{name}", mass, step=0.1 * self.masses[2], unit=unit))
        for term in self.terms:
            effect, dof, names = term.effect, dofs[term.dof], self.names_of(term)
            if isinstance(effect, CrossDrag):
                step = 0.1 * size[term.dof]
                entries.append(Parameter(names[0], term.values[0], step=step, unit=effect.unit))
                continue
            stay = zip(effect.held(term.values), effect.placed(term.values))
            fixed = [term.name in dropped or any(either) for either in stay]
            angle = bool(self.signal_of(term))
            for name, law, value, stays in zip(names, effect.parameters, term.values, fixed):
                lower, upper = max(law.lower, least_delay if effect.shifts(term.values) else -np.inf), law.upper
                if law.scan and effect.varies(term.values):
                    upper = min(upper, longest_period)
                if effect.role == "linear" and ((signed_drag and has_both_drags) or steers):
                    lower = -np.inf
                log = law.log or (log_drag and term.base and effect.role in (main, "restoring") and not stays)
                step = max(law.scaled(law.start, 1.0 if angle else size[term.dof]), 1e-6)
                unit = dof.unit_in(law.unit, STEERED if angle else units[term.dof])
                entry = Parameter(name, value, lower, upper, log, step, effect.role, unit)
                entries.append(entry.at(value) if stays else entry)
        for name, speed in zip(CURRENT, self.water or ()):
            entries.append(Parameter(name, speed, -MAX_CURRENT_M_S, MAX_CURRENT_M_S, step=0.05, unit="m/s"))
        entries = [p.at(p.value) if p.name in self.fixed else p for p in entries]
        for name, source, factor in self.ties:
            entries = [replace(p, log=False, tie=(source, factor)) if p.name == name else p for p in entries]
        return Parameters(tuple(entries))

    @property
    def hull(self) -> "Model":
        """The model without what acts on commands before they are forces."""
        acting = [t for t in self.terms if t.effect.place is Place.ACTUATOR and not self.signal_of(t)]
        return replace(self, terms=tuple(term for term in self.terms if term not in acting))

    @property
    def steered(self) -> bool:
        """Whether the angle of a rudder is what is commanded."""
        return self.moment_unit == STEERED

    @property
    def theta(self) -> Floats:
        return np.array([*self.masses, *(x for term in self.terms for x in term.values), *(self.water or ())])

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters by qualified name."""
        return dict(zip(self.parameter_names, self.theta.tolist()))

    def with_theta(self, theta: ArrayLike) -> "Model":
        """Return the same terms with other values. Raises ModelError unless there is one for each parameter."""
        numbers, names = [float(value) for value in np.asarray(theta)], self.parameter_names
        if len(numbers) != len(names):
            raise ModelError(f"{len(numbers)} values given for the {len(names)} parameters {names}; give one for each")
        values = iter(numbers)
        masses = tuple(next(values) for _ in self.masses)
        terms = tuple(replace(term, values=tuple(next(values) for _ in term.values)) for term in self.terms)
        water = None if self.water is None else (next(values), next(values))
        return replace(self, masses=masses, terms=terms, water=water)

    def drawn(self, covariance: Floats, count: int, rng: np.random.Generator) -> Floats:
        """Draw theta (count, p) about the model's own, which comes first, by its `covariance` (p, p), within bounds.

        Positive entries that are surely so are drawn on their logarithm; what has no variance stays as it is.
        """
        theta, variance = self.theta, np.diagonal(covariance)
        values, vectors = np.linalg.eigh(covariance)
        moved = rng.standard_normal((count, len(theta))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        moved[0] = 0.0
        positive = (theta > 0) & (np.sqrt(variance) < theta)
        size = np.where(positive, theta, 1.0)
        drawn = np.where(positive, size * np.exp(np.where(positive, moved / size, 0.0)), theta + moved)
        lower, upper = self.parameters(signed_drag=True).bounds.T
        lower = np.minimum(np.where(np.arange(len(theta)) < len(self.motion.dofs), SMALLEST, lower), theta)
        return np.where(variance > 0, np.clip(drawn, lower, np.maximum(upper, theta)), theta)

    def with_term(self, term: Term) -> "Model":
        return replace(self, terms=(*self.terms, term))

    def with_effect(self, name: str, values: Sequence[float] | Floats) -> "Model":
        """The same model with one more effect; laws, and what only they use, may be left out at the end."""
        parameters = effects.get(name).parameters
        count, size = len(parameters), len(values)
        values = [*values, *(p.start for p in parameters[size:] if p.optional)]
        if len(values) != count:
            raise ModelError(f"effect {name!r} has {count} parameters, {size} values were given; give one for each")
        return self.with_term(Term(name, tuple(float(v) for v in values)))

    def delayed(self, seconds: float) -> "Model":
        """Return the same model whose commands act later by `seconds`, by an input delay in each motion, without one
        where nothing is left of it."""
        if not seconds:
            return self
        terms = [term for term in self.terms if term.name != DELAY]
        values = {term.dof: term.values for term in self.terms if term.name == DELAY}
        for place in range(len(self.motion.dofs)):
            before = values.get(place, (0.0, 0.0, 0.0))
            late = (before[0] + seconds, before[1], before[2] + seconds if before[1] else 0.0)
            if late[0] or late[2]:
                terms.append(Term(DELAY, late, dof=place))
        return replace(self, terms=tuple(terms))

    def inertia_matrix(self, theta: Floats) -> Floats:
        """Return rigid and added inertia for theta (P, p): (P, D, D), symmetric."""
        dofs = len(self.motion.dofs)
        matrices = np.zeros((len(theta), dofs, dofs))
        places = [*((i, i) for i in range(dofs)), *((i, j) for i, j, _ in INERTIA_COUPLINGS.values())]
        for column, (i, j) in enumerate(places[: len(self.masses)]):
            matrices[:, i, j] = matrices[:, j, i] = theta[:, column]
        return matrices

    def forces(self, theta: Floats) -> list[Bound]:
        """Return each effect with the degree of freedom on which it acts; in the plane what single thrusters do to the
        moment and to the force ahead."""
        columns, bound = iter(theta.T[len(self.masses) :, :, None]), list[Bound]()
        for term in self.terms:
            values, effect = tuple(next(columns) for _ in term.values), term.effect
            bound.append(Bound(term.dof, effect, values, self.signal_of(term)))
            if len(self.motion.dofs) > 1 and acts_singly(effect, term.values):
                bound.append(Bound(0, AheadOf(effect), values))
        return bound

    def signal_of(self, term: Term) -> str:
        """Return the logged column on which a term acts; empty for the commands, of which a steering rudder is one."""
        return "" if self.steered else term.effect.acts_on

    def current(self, theta: Floats) -> Floats | None:
        """Return the velocity of the water north and east [m/s], (2, P, 1), constant and without swirl; None for still
        water: one degree of freedom alone cannot tell a current from its start velocity."""
        return None if self.water is None else theta[:, -2:].T[..., None]

    def fastest(self, moment: float) -> float:
        """Shortest time constant [s] on the way to the steady rate under |moment|, of the base drag alone; of a swing
        SWING_SHARE of the time in which its phase moves on by a radian."""
        linear, quadratic = self.drag()
        rate = steady_rate(abs(moment), linear, quadratic)
        answer = float(self.inertia / max(linear + 2.0 * quadratic * float(rate), 1e-12))
        return min(answer, SWING_SHARE * float(np.sqrt(self.inertia / self.restoring))) if self.restoring else answer

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What moves the vehicle under each `moment`: that with the constant force, and the drags on its way."""
        linear, quadratic = self.drag()
        if not (self.dof.has_constant or self.dof.directional):
            return moment, linear, quadratic
        moment = moment + self.coefficient("constant")
        apart = [np.sign(moment) * self.coefficient("difference", power) for power in (1, 2)]
        return moment, linear + apart[0], quadratic + apart[1]

    @property
    def restoring(self) -> float:
        """Restoring moment over the sine of the angle, zero where nothing turns the vehicle back."""
        return self.coefficient("restoring")

    def drag(self) -> tuple[float, float]:
        """Linear and quadratic drag, zero where the model has no such term."""
        return self.coefficient("linear"), self.coefficient("quadratic")

    def coefficient(self, role: str, power: int | None = None) -> float:
        """Return the value of the last term of a role, of that power of the speed if given; zero if there is none."""
        of_role = [term for term in self.terms if effects.get(term.name).role == role]
        values = [term.values[0] for term in of_role if power in (None, effects.get(term.name).power)]
        return values[-1] if values else 0.0


def steady_rate(moment: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> Floats:
    """Rate at which drag balances the moment [rad/s]: root of k_rr |r| r + k_r r = tau; inputs broadcast.

    Not a number where a negative k_rr leaves no such rate.
    """
    size, linear = np.abs(np.asarray(moment, dtype=float)), np.asarray(k_r, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(linear**2 + 4.0 * np.asarray(k_rr, dtype=float) * size)
        rate = np.sign(np.asarray(moment, dtype=float)) * 2.0 * size / (linear + root)
    return np.where(size > 0, rate, 0.0)


def response(
    time: ArrayLike, moment: ArrayLike, inertia: ArrayLike, k_r: ArrayLike = 0.0, k_rr: ArrayLike = 0.0
) -> tuple[Floats, Floats]:
    """Heading [rad] less its start and rate [rad/s] at `time` [s] after a constant moment was switched on, from rest.

    All inputs broadcast. Drag must be positive somewhere (k_r > 0 or k_rr > 0). Source: module docstring.
    """
    arrays = (np.asarray(x, dtype=float) for x in (time, moment, inertia, k_r, k_rr))
    with np.errstate(divide="ignore", invalid="ignore"):
        angle, rate = response_slopes(*arrays)
    return angle.value, rate.value


class Slopes(NamedTuple):
    """A reading and its derivatives by time, by the logarithms of force and inertia, and by both drags."""

    value: Floats
    time: Floats
    log_force: Floats
    log_inertia: Floats
    linear: Floats
    quadratic: Floats


def response_slopes(
    time: Floats, force: Floats, inertia: Floats | float, k_r: Floats, k_rr: Floats
) -> tuple[Slopes, Slopes]:
    """Give heading less its start [rad] and rate [rad/s] of `response` with their derivatives, by the module's formula.

    Stretching time, psi(s t; a, b, c) = psi(t; s² a, s b, c), and angle, psi(t; s a, b, c/s) = s psi(t; a, b, c), give
    all derivatives from the one by log a, which is that of the formula.
    """
    way, t = np.sign(force), np.maximum(time, 0.0)
    a, b, c = _scaled(force, inertia, k_r, k_rr)
    delta = np.maximum(np.sqrt(b * b / 4 + a * c), 1e-12)
    final = np.where((b < 0) & (c > 0), (delta - b / 2) / np.where(c > 0, c, 1.0), a / (delta + np.maximum(b, 0.0) / 2))
    by_final, by_delta = a / (2 * delta), a * c / (2 * delta)
    decay = np.exp(-2 * delta * t)
    mean = -np.expm1(-2 * delta * t) / (2 * delta)
    by_mean = by_delta * (t * decay - mean) / delta
    z, by_z = final * mean, by_final * mean + final * by_mean
    share = decay / (1 - c * z)
    angle, rate = final * t + _log_ratio(c, z), final - final * share
    speeding = np.where(time < 0, 0.0, a - b * rate - c * rate**2)
    angle_a = by_final * t - by_z / (1 - c * z)
    rate_a = by_final * (1 - share) + final * share * (2 * t * by_delta - c * by_z / (1 - c * z))
    slopes = []
    for value, by_time, by_a, by_b in (
        (angle, rate, angle_a, t * rate - 2 * angle_a),
        (rate, speeding, rate_a, rate + t * speeding - 2 * rate_a),
    ):
        by_c = by_a - value
        linear = np.divide(by_b, k_r, out=np.zeros_like(by_b), where=k_r != 0)
        quadratic = np.divide(by_c, k_rr, out=np.zeros_like(by_c), where=k_rr != 0)
        slopes.append(Slopes(*(way * x for x in (value, by_time, by_a, -by_a - by_b - by_c, linear, quadratic))))
    return slopes[0], slopes[1]


def velocity_error(moment: ArrayLike, inertia: ArrayLike, k_r: ArrayLike = 0.0, k_rr: ArrayLike = 0.0) -> Floats:
    """Intercept at the step's instant of the line on which the heading ends, start heading removed [rad].

    -sgn(tau) (I/k_rr) ln(1 + r_inf/r_2); equation 7 for k_rr = 0, equation 9 for k_r = 0. Not a number where a
    negative k_rr leaves no steady rate.
    """
    a, b, c = _scaled(moment, inertia, k_r, k_rr)
    with np.errstate(divide="ignore", invalid="ignore"):
        delta = np.sqrt(b * b / 4 + a * c)
        gap = np.where(a > 0, a / (delta + b / 2) / (2 * delta), 0.0)
        return np.sign(moment) * _log_ratio(c, gap)


def inertia_from_velocity_error(eps: ArrayLike, moment: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> Floats:
    """Inertia that gives the velocity error `eps` [rad] of the size expected for `moment`; inverse of
    `velocity_error`.

    eps is proportional to the inertia: I = |eps| k_r²/|tau| (equation 7), |eps| k_rr/ln 2 (equation 9), and
    between them for model 2. The sign is kept: a velocity error on the wrong side gives a negative inertia.
    """
    return np.asarray(eps) / velocity_error(moment, 1.0, k_r, k_rr)


def _scaled(moment: ArrayLike, inertia: ArrayLike, k_r: ArrayLike, k_rr: ArrayLike) -> tuple[Floats, Floats, Floats]:
    size, linear, quadratic = (np.asarray(x, dtype=float) for x in (np.abs(moment), k_r, k_rr))
    mass = np.asarray(inertia, dtype=float)
    return size / mass, linear / mass, quadratic / mass


def _log_ratio(c: Floats, z: Floats) -> Floats:
    """ln(1 - c z)/c, by its series where c z is tiny (no quadratic drag)."""
    product = np.asarray(c * z)
    tiny = np.abs(product) < 1e-7
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.asarray(np.log1p(-product) / c)
    ratio[tiny] = -np.broadcast_to(z, product.shape)[tiny] * (1 + product[tiny] / 2)
    return ratio
