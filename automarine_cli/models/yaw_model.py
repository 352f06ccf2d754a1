"""`YawModel`: inertia and a tuple of effects with values; frozen, `with_...` returns a new one.

Exact response of models 1, 2 and 3 to a constant moment, from rest.

With a = |tau|/I, b = k_r/I, c = k_rr/I the rate in the moment's direction obeys the Riccati equation
r' = a - b r - c r². Its solution needs one formula for all three models:

    delta = sqrt(b²/4 + a c),   r_inf = a/(delta + b/2),   z(t) = r_inf (1 - exp(-2 delta t))/(2 delta)
    psi(t) = psi0 + r_inf t + ln(1 - c z)/c,    r(t) = r_inf - r_inf exp(-2 delta t)/(1 - c z)

For c = 0 the logarithm becomes -z, the paper's equation 6; for b = 0 it is the paper's ln cosh (equation 8). The
heading ends on a line through eps = psi0 - sgn(tau) (I/k_rr) ln(1 + r_inf/r_2) at the instant of the step, where
r_2 = (delta + b/2)/c is the size of the other root: equation 9 for k_r = 0, equation 7 for k_rr = 0.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from automarine_cli import effects
from automarine_cli.dofs import Dof
from automarine_cli.dofs.motion import Motion, alone
from automarine_cli.errors import ModelError
from automarine_cli.models.allocation import Bound
from automarine_cli.models.parameter import Parameter, Parameters
from automarine_cli.quantities import Floats

BASE_TERMS = {"1": ("linear-drag",), "2": ("quadratic-drag", "linear-drag"), "3": ("quadratic-drag",)}
"""The drag terms of the paper's three models: D(r) = k_r; k_rr|r| + k_r; k_rr|r|."""

COMMAND_DELAY = "command_delay_s"
"""Name, for users and in files, of how long [s] after the middle of the sample interval in which a command changed it
acts: beside inertia and drag a parameter of every fit."""
DELAY = "input-delay"  # the effect that means the same
MAX_DELAY_S = effects.get(DELAY).parameters[0].upper
CONSTANT = "bias-moment"  # the term of a moment or force that always acts
ASYMMETRY = {"1": "linear-drag-asymmetry", "2": "drag-asymmetry", "3": "drag-asymmetry"}
"""The term by which drag differs between the two ways."""


def main_drag(number: str) -> str:
    """What the drag is, "linear" or "quadratic", that model `number` has always, and of which ways may differ."""
    return effects.get(BASE_TERMS[number][0]).role


def base_terms(number: str, dof: Dof, sided: bool = False) -> tuple[str, ...]:
    """The terms of model `number` of a motion: drag, a constant force where one acts, and the asymmetry if `sided`."""
    constant = (CONSTANT,) if dof.has_constant else ()
    return (*BASE_TERMS[number], *constant, *((ASYMMETRY[number],) if sided else ()))


def base_roles(number: str, dof: Dof, sided: bool = False) -> tuple[str, ...]:
    """What the parameters of these terms are (see `Dof.parameters`), the inertia first."""
    return ("inertia", *(effects.get(term).role for term in base_terms(number, dof, sided)))


@dataclass(frozen=True)
class Term:
    """One effect with the values of its parameters, in the effect's order; `base` where it belongs to the motion's own
    equation, and was not added to it."""

    name: str
    values: tuple[float, ...]
    base: bool = False


def values_for(names: Sequence[str], theta: ArrayLike) -> Iterator[float]:
    """The entries of theta one after the other. Raises ModelError unless there is one for each of `names`."""
    values = [float(value) for value in np.asarray(theta)]
    if len(values) != len(names):
        raise ModelError(f"{len(values)} values given for the {len(names)} parameters {names}; give one for each")
    return iter(values)


def delayed_terms(terms: tuple[Term, ...], seconds: float) -> tuple[Term, ...]:
    """Return the terms with an input delay longer by `seconds`, without one where nothing is left of it."""
    if not seconds:
        return terms
    values = {term.name: term.values for term in terms}.get(DELAY, (0.0, 0.0, 0.0))
    others = tuple(term for term in terms if term.name != DELAY)
    late = (values[0] + seconds, values[1], values[2] + seconds if values[1] else 0.0)
    return (*others, Term(DELAY, late)) if late[0] or late[2] else others


def with_values(terms: tuple[Term, ...], values: Iterator[float]) -> tuple[Term, ...]:
    return tuple(replace(term, values=tuple(next(values) for _ in term.values)) for term in terms)


@dataclass(frozen=True)
class YawModel:
    """I_r r' = tau + moments of the terms; actuator, water and sensor effects are terms too. Of any motion (`dof`).

    The parameter vector theta is (inertia, values of the first term, values of the second, ...).
    """

    inertia: float
    terms: tuple[Term, ...]
    moment_unit: str
    dof: Dof

    @classmethod
    def base(
        cls, number: str, inertia: float, values: Sequence[float] | Floats, moment_unit: str, dof: Dof
    ) -> "YawModel":
        """Model "1", "2" or "3" of the paper; `values` in the order of `base_terms`, sided if there is one more."""
        sided = len(values) > len(base_terms(number, dof))
        names = base_terms(number, dof, sided)
        terms = tuple(Term(name, (float(value),), base=True) for name, value in zip(names, values, strict=True))
        return cls(float(inertia), terms, moment_unit, dof)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Qualified names of the entries of theta: "yaw.I_r", "yaw.k_rr", and "input-delay.t_d" of what was added."""
        names = [self.dof.parameter("inertia")]
        for term in self.terms:
            effect = effects.get(term.name)
            if term.base:
                names.append(self.dof.parameter(effect.role))
            else:
                names += [f"{term.name}.{name}" for name in effect.names_in(self.dof)]
        return tuple(names)

    @property
    def short_names(self) -> tuple[str, ...]:
        """The same as files have them: without motion or effect, unless an earlier one is called so."""
        names: list[str] = []
        for name in self.parameter_names:
            short = name.partition(".")[2]
            names.append(name if short in names else short)
        return tuple(names)

    def index(self, name: str) -> int:
        """Place in theta of a parameter by its qualified name; ModelError says what there is."""
        if name not in self.parameter_names:
            raise ModelError(f"the model has no parameter {name!r}; it has {', '.join(self.parameter_names)}")
        return self.parameter_names.index(name)

    @property
    def theta(self) -> Floats:
        return np.array([self.inertia, *(value for term in self.terms for value in term.values)])

    def parameters(
        self,
        largest: float = 1.0,
        *,
        log_drag: bool = False,
        signed_drag: bool = False,
        least_delay: float = -np.inf,
        longest_period: float = np.inf,
        fixed: Collection[str] = (),
    ) -> Parameters:
        """Give the entries of theta as a fit searches them; steps are for a `largest` moment.

        If `log_drag` the drag that the model always has is on a logarithm; if `signed_drag` linear drag beside
        quadratic drag has either sign, as in Table 1. Effects that make all commands late do so by `least_delay` [s] or
        more, what varies from run to run has periods up to `longest_period` [s], and the terms called `fixed` stay as
        they are.
        """
        base = [effects.get(term.name).role for term in self.terms if term.base]
        main = "quadratic" if "quadratic" in base else "linear"
        both = {term.name for term in self.terms} >= set(BASE_TERMS["2"])
        names = iter(self.parameter_names)
        entries = [Parameter(next(names), self.inertia, 0.0, log=True, role="inertia")]
        for term in self.terms:
            effect = effects.get(term.name)
            for law, value, held in zip(effect.parameters, term.values, effect.held(term.values)):
                lower, upper = max(law.lower, least_delay if effect.shifts(term.values) else -np.inf), law.upper
                if law.scan and effect.varies(term.values):
                    upper = min(upper, longest_period)
                if signed_drag and both and effect.role == "linear":
                    lower = -np.inf
                log = law.log or (log_drag and term.base and effect.role == main)
                step = max(law.scaled(law.start, largest), 1e-6)
                entry = Parameter(next(names), value, lower, upper, log, step, effect.role)
                entries.append(replace(entry.at(value), log=law.log) if held or term.name in fixed else entry)
        return Parameters(tuple(entries))

    def with_theta(self, theta: ArrayLike) -> "YawModel":
        values = values_for(self.parameter_names, theta)
        return replace(self, inertia=next(values), terms=with_values(self.terms, values))

    def with_effect(self, name: str, values: Sequence[float] | Floats) -> "YawModel":
        """The same model with one more effect; laws, and what only they use, may be left out at the end."""
        parameters = effects.get(name).parameters
        count, size = len(parameters), len(values)
        values = [*values, *(p.start for p in parameters[size:] if p.optional)]
        if len(values) != count:
            raise ModelError(f"effect {name!r} has {count} parameters, {size} values were given; give one for each")
        return replace(self, terms=(*self.terms, Term(name, tuple(float(v) for v in values))))

    def delayed(self, seconds: float) -> "YawModel":
        """The same model whose commands act later by `seconds`, by an input delay of its own."""
        return replace(self, terms=delayed_terms(self.terms, seconds))

    @property
    def motion(self) -> Motion:
        return alone(self.dof)

    def inertia_matrix(self, theta: Floats) -> Floats:
        return theta[:, :1, None]

    def forces(self, theta: Floats) -> list[Bound]:
        column, bound = 1, []
        for term in self.terms:
            count = len(term.values)
            values = tuple(theta[:, column + i, None] for i in range(count))
            bound.append(Bound(0, effects.get(term.name), values))
            column += count
        return bound

    def current(self, theta: Floats) -> None:
        """Still water: one degree of freedom alone cannot tell a current from its start velocity."""
        return

    def fastest(self, moment: float) -> float:
        """Shortest time constant [s] on the way to the steady rate under |moment|, of the base drag alone."""
        linear, quadratic = self.drag()
        rate = steady_rate(abs(moment), linear, quadratic)
        return float(self.inertia / max(linear + 2.0 * quadratic * float(rate), 1e-12))

    def acting(self, moment: Floats) -> tuple[Floats, Floats | float, Floats | float]:
        """What moves the vehicle under each `moment`: that with the constant force, and the drags on its way."""
        linear, quadratic = self.drag()
        if not (self.dof.has_constant or self.dof.directional):
            return moment, linear, quadratic
        moment = moment + self._value("constant")
        way = np.sign(moment)
        return (moment, linear + way * self._value("difference", 1), quadratic + way * self._value("difference", 2))

    def drag(self) -> tuple[float, float]:
        """Linear and quadratic drag, zero where the model has no such term."""
        return self._value("linear"), self._value("quadratic")

    def _value(self, role: str, power: int | None = None) -> float:
        """Value of the last term of a role, and of a power of the speed where that is asked; zero if there is none."""
        value = 0.0
        for term in self.terms:
            effect = effects.get(term.name)
            if effect.role == role and power in (None, effect.power):
                value = term.values[0]
        return value


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
    time: ArrayLike,
    moment: ArrayLike,
    inertia: ArrayLike,
    k_r: ArrayLike = 0.0,
    k_rr: ArrayLike = 0.0,
    heading0: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Heading [rad] and rate [rad/s] at `time` [s] after a constant moment was switched on, from rest.

    All inputs broadcast. Drag must be positive somewhere (k_r > 0 or k_rr > 0). Source: module docstring.
    """
    time, way = np.asarray(time, dtype=float), np.sign(np.asarray(moment, dtype=float))
    t = np.maximum(time, 0.0)
    a, b, c = _scaled(moment, inertia, k_r, k_rr)
    delta = np.sqrt(b * b / 4 + a * c)
    decayed = np.expm1(-2 * delta * t)
    with np.errstate(divide="ignore", invalid="ignore"):
        final = np.where(a > 0, a / (delta + b / 2), 0.0)
        final = np.where((b < 0) & (c > 0), (delta - b / 2) / c, final)  # the same, where that would cancel
        # (1 - exp(-2 delta t))/(2 delta), and t where delta is zero (no moment, and quadratic drag alone)
        mean_decay = decayed * (-0.5 / delta) if np.all(delta > 0) else np.where(delta > 0, decayed / (-2 * delta), t)
    z = final * mean_decay
    rate = final - final * (1 + decayed) / (1 - c * z)
    return heading0 + way * (final * t + _log_ratio(c, z)), np.where(time < 0, 0.0, way * rate)


class Slopes(NamedTuple):
    """A reading and its derivatives by time, by the logarithms of force and inertia, and by both drags."""

    value: Floats
    time: Floats
    log_force: Floats
    log_inertia: Floats
    linear: Floats
    quadratic: Floats


def response_slopes(time: Floats, force: Floats, inertia: float, k_r: Floats, k_rr: Floats) -> tuple[Slopes, Slopes]:
    """Give heading less its start [rad] and rate [rad/s] of `response` with their derivatives; time is (R, N).

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
