"""The fit of surge, sway and yaw together: which structure the logs ask for, its parameters, and what they rest on."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from scipy import special
from scipy.integrate import cumulative_trapezoid

from automarine_cli import effects
from automarine_cli.dofs import PLANAR, SURGE, SWAY, YAW, Dof
from automarine_cli.effects import Commands, Place
from automarine_cli.effects.rudder_offset import RudderOffset
from automarine_cli.effects.rudder_race import RudderRace
from automarine_cli.effects.sensor_lag import SensorLag
from automarine_cli.effects.thruster_dead_band import ThrusterDeadBand
from automarine_cli.effects.thruster_imbalance import ARM, PARTS, ThrusterImbalance, acts_singly
from automarine_cli.effects.thruster_lag import OF_EACH
from automarine_cli.effects.thruster_limit import ThrusterLimit
from automarine_cli.errors import FitError
from automarine_cli.estimate import Estimate
from automarine_cli.filters.course import Course, make_course
from automarine_cli.fits.driven import (
    MIN_PROPOSED_GAIN,
    PLACE,
    STEERING_GEAR,
    THRUSTER_LAG,
    ForecastScore,
    Judgement,
    large_disturbance,
    left_out_predictions,
    start_of,
    starts_near,
    worth_of,
)
from automarine_cli.fits.innovations import (
    ITERATIONS,
    SETTLED_GAIN,
    DrivenProblem,
    Fit,
    fit_innovations,
    fits_of,
    randomness,
)
from automarine_cli.fits.linear_mixed import bounded_solution
from automarine_cli.fits.stepwise import Judge, stepwise_search
from automarine_cli.fits.whole_runs import OutputErrorFit, covariance_json, result_of
from automarine_cli.models.model import COMMAND_DELAY, CURRENT, INERTIA_COUPLINGS, Model, Term, label_of
from automarine_cli.models.parameter import Parameter, Parameters, Priors
from automarine_cli.models.store import planar_json
from automarine_cli.pipeline.records import Document, Shown, json_document
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import ExcludedRun, Run, filled, runs_json

CHANNELS = ("heading", "yaw_rate", "surge", "sway", "north", "east")
NORTH_EAST = ("north", "east")
PLANE_DRAG_LAWS = ("linear-drag", "quadratic-drag")
CROSS_DRAGS = ("Y_r", "N_v", "N_ur", "Y_uv")
"""Forces by the velocities of others that a hull alike on both sides has: sway force by turning, moment by drifting,
turns that are damped by the speed ahead, and the lift of a hull at an angle (Fossen 2021, chapter 6)."""
STEERED_BY = ("N_uv", "N_ur")  # a hull that its rudder alone turns has both: else drifting would turn it about
WITH_WAY_ON = (*STEERED_BY, "Y_ur", "Y_uv")
"""What such a hull may have, as it always has way on: all by lift, which grows with the speed ahead. Beside them no
inertia in yaw can be told from Munk's moment."""
OWN = tuple(dof.parameter(role) for dof in PLANAR.dofs for role in ("inertia", "linear", "quadratic"))
"""Qualified names of inertias and drags, which are above zero."""
SKEW = "planar.m_vr"
DEAD_BAND, STALL = "dead-band", "rudder-stall"
ACTUATORS = (
    (THRUSTER_LAG, 0), (THRUSTER_LAG, OF_EACH), (THRUSTER_LAG, 1), (DEAD_BAND, 0), (ThrusterDeadBand.name, 0),
    (ThrusterLimit.name, 0), (ThrusterImbalance.name, 0), (SensorLag.name, 0), (STEERING_GEAR, 0), (STEERING_GEAR, 1),
    (STALL, 0),
)  # fmt: skip
"""What may stand between command and reading, each in one law: a lag in propeller speed, that of each of two thrusters
if these are logged, or in thrust; a dead band, of the force or of each thruster; what else these may do; a heading that
is read late; a steering gear with a largest rate, or with a lag as well; a rudder that stalls."""
OF_RUDDERS = (STEERING_GEAR, STALL)
OF_BOTH = ((THRUSTER_LAG, 0), (DEAD_BAND, 0))  # what each of two thrusters does by itself where these are logged
LAGS = (THRUSTER_LAG, SensorLag.name)  # a delay stands for them as long as they are not known
STALL_SHARE = 0.65  # of the largest angle, from which a stall starts
GEARS = (
    tuple((float(rate), 0.0, 1.0) for rate in np.geomspace(0.05, 3.2, 25)),
    tuple((5.0, 1.0, float(lag)) for lag in np.geomspace(0.05, 1.6, 21)),
)
"""Steering gears from which a fit may start, by law: largest rate [rad/s], law, time constant [s]."""
RUDDER_EFFECTS = ("rudder", "rudder-drag")
START_LAG_S = 0.01  # from which a lag starts at least
IDLE_SHARE = 0.05  # of its usual size at which nothing is left of it
STEADY_LEVEL = 0.975  # at which the mean gain of a run has to exceed zero, by Student's t
DECAY_S = 1.0  # s in which an unmeasured translation dies out, as in the Otter of Fossen's MSS (T_sway)
SLOPE_WINDOW_S = 1.0  # s over which velocities are told from positions


@dataclass(frozen=True)
class Assumption:
    """What the logs do not tell: `parameter` is taken as `equals` says, because."""

    parameter: str
    equals: str
    because: str

    def __str__(self) -> str:
        return f"{self.parameter} = {self.equals}: {self.because}"


@dataclass(frozen=True)
class Observed:
    """What the logs of a campaign hold: the `channels` that have readings, the translations that these show, and
    whether a `rudder_alone` steers, as neither a moment nor a force abeam is logged."""

    channels: tuple[str, ...]
    rudder_alone: bool = False

    @property
    def dofs(self) -> tuple[Dof, ...]:
        return tuple(dof for dof in PLANAR.dofs if dof is YAW or self.over_ground or dof.velocity in self.channels)

    @property
    def over_ground(self) -> bool:
        """Whether places are measured: velocities alone may be those through the water."""
        return set(NORTH_EAST) <= set(self.channels)

    @property
    def unread(self) -> list[tuple[Dof, Dof]]:
        """The translation that the logs do not show, with the one that stands for it."""
        return [pair for pair in ((SURGE, SWAY), (SWAY, SURGE)) if pair[0] not in self.dofs]

    @property
    def ties(self) -> tuple[tuple[str, str, float], ...]:
        """What the logs do not tell, and which parameter stands for it times which factor."""
        factors = {"inertia": 1.0, "linear": 1.0 / DECAY_S}
        return tuple(
            (dof.parameter(role), other.parameter("inertia"), factor)
            for dof, other in self.unread
            for role, factor in factors.items()
        )

    def assumptions(self, model: Model) -> tuple[Assumption, ...]:
        """What stands in for measurements that the logs lack."""
        lacking: list[Assumption] = []
        for dof, other in self.unread:
            why = f"the logs hold no {dof.name} speed and no position on the water"
            its, dies_out = other.parameter("inertia"), f"{dof.name} is taken to die out in {DECAY_S:g} s"
            lacking.append(Assumption(dof.parameter("inertia"), its, why))
            lacking.append(Assumption(dof.parameter("linear"), f"{its} / {DECAY_S:g} s", dies_out))
        if SKEW in model.fixed:
            lacking.append(Assumption(SKEW, "0", "sway and yaw are taken about the centre of both masses"))
        for name, source, factor in model.ties:
            if name == YAW.parameter("inertia"):
                why = "a rudder alone gives no moment of known size; all moments are as large as for a usual hull"
                lacking.append(Assumption(name, f"{factor:.3g} m² {source}", why))
        lacking.append(Assumption("planar.m_ur, planar.m_uv", "0", "the vehicle is taken to be alike on both sides"))
        return tuple(lacking)

    def simplest(self, sizes: Mapping[str, float]) -> Model:
        """The model with quadratic drag of everything that is measured, and what turns a hull that its rudder alone
        steers, nothing else, from `rough_sizes`."""
        values = {**sizes, **{name: factor * sizes[source] for name, source, factor in self.ties}}
        masses = tuple(values[dof.parameter("inertia")] for dof in PLANAR.dofs)
        terms = []
        for place, dof in enumerate(PLANAR.dofs):
            role = "quadratic" if dof in self.dofs else "linear"
            terms.append(Term(f"{role}-drag", (values[dof.parameter(role)],), True, place))
        if self.rudder_alone and SWAY in self.dofs:
            terms += map(Term.cross, STEERED_BY)
        couplings = tuple(f"{PLANAR.name}.{name}" for name in INERTIA_COUPLINGS)
        return Model(PLANAR, (*masses, *(0.0 for _ in couplings)), tuple(terms), "N m", fixed=couplings, ties=self.ties)

    def names(self) -> dict[str, str]:
        """Qualified names of the parameters that models of these logs may have, by what users write."""
        free = widest(self.simplest(dict.fromkeys(OWN, 1.0)), partial(candidates, observed=self)).free
        known = [SKEW] if SWAY in self.dofs else []  # by who has weighed a vehicle, also where no log can tell
        names = {name if name in CURRENT else name.partition(".")[2]: name for name in (*free, *known)}
        return names | {COMMAND_DELAY: COMMAND_DELAY}


def observed(runs: Sequence[Run]) -> Observed:
    """The channels of which any run has readings. Raises FitError where nothing but the heading is measured."""
    rudder_alone = not any(run.command_of(dof).any() for run in runs for dof in (SWAY, YAW))
    channels = Observed(tuple(name for name in CHANNELS if any(_read(run, name) for run in runs)), rudder_alone)
    if len(channels.dofs) == 1:
        raise FitError(
            "the logs hold no surge or sway speed (surge_m_s, sway_m_s) and no position on the water (north_m and "
            "east_m): their coupling with yaw cannot be identified. Name the columns with --columns, or give "
            "the logs to "
            "automarine fit-yaw"
        )
    return channels


def with_rudder(names: Sequence[str], runs: Sequence[Run], observed: Observed) -> tuple[str, ...]:
    """Effects that are asked for, and those of a rudder where nothing else steers and every run logs it."""
    steered = observed.rudder_alone and all("rudder" in run.extras for run in runs)
    return tuple(dict.fromkeys((*names, *(RUDDER_EFFECTS if steered else ()))))


def _read(run: Run, quantity: str) -> bool:
    column = run.channel(quantity)
    summed = run.summed_up and quantity == run.dof.position
    return column is not None and not summed and bool(np.isfinite(column).any())


@dataclass(frozen=True)
class Candidate:
    """An effect by its name, the parameters that it adds, and the model with it, which begins as the model without it,
    or so near to that that slopes are those there; where it stands for another drag, with as much at usual speed."""

    name: str
    added: tuple[str, ...]
    model: Model

    @property
    def label(self) -> str:
        return label_of(self.name, self.added)

    @property
    def dof(self) -> Dof:
        """The motion in which it acts; yaw where it does in several."""
        names = {name.partition(".")[0] for name in self.added}
        return next((dof for dof in reversed(PLANAR.dofs) if dof.name in names), YAW)

    @classmethod
    def of_term(cls, model: Model, term: Term) -> "Candidate":
        return cls.of_terms("cross-coupling" if term.is_cross else term.name, model.with_term(term), term)

    @classmethod
    def of_terms(cls, name: str, model: Model, *terms: Term) -> "Candidate":
        """The candidate of a `model` that has its `terms`, all of its name if none is given."""
        terms = terms or tuple(term for term in model.terms if term.name == name)
        added = [parameter for term in terms for parameter in model.names_of(term) if parameter in model.free]
        return cls(name, tuple(added), model)


Begin = tuple[Model, Mapping[str, float]]
"""Where a fit begins: a model, and the sizes of what is random."""
Family = Callable[[Model], Iterator[Candidate]]


def candidates(model: Model, observed: Observed, rough: Mapping[str, float] | None = None) -> Iterator[Candidate]:
    """What logs may tell of a hull and a model lacks: couplings, laws of drag, a propeller's race past the rudder, a
    current; given `rough_sizes`, linear drag in place of quadratic drag too, which gains there at most what it gains
    beside it.

    No m_vr where a rudder alone steers: as long as motions are small any m_vr answers the rudder alike, with other
    derivatives, and it would take whatever else the model lacks."""
    have, yaw = {(term.dof, term.name) for term in model.terms}, PLANAR.index(YAW)
    for term in map(Term.cross, WITH_WAY_ON if observed.rudder_alone else CROSS_DRAGS):
        if (term.dof, term.name) not in have and (SWAY in observed.dofs or term.name == "N_ur"):
            yield Candidate.of_term(model, term)
    if SWAY in observed.dofs and SKEW in model.fixed and not observed.rudder_alone:
        fixed = tuple(name for name in model.fixed if name != SKEW)
        yield Candidate("cross-coupling", (SKEW,), replace(model, fixed=fixed))
    steering = [term.dof for term in model.terms if term.name == "rudder"]
    if unraced := [place for place in steering if (place, RudderRace.name) not in have]:
        raced = model
        for place in unraced:
            raced = raced.with_term(Term(RudderRace.name, (0.0,), dof=place))
        added = tuple(name for name in raced.parameter_names if name not in model.parameter_names)
        yield Candidate(RudderRace.name, added, raced)
    if steering and (yaw, RudderOffset.name) not in have:
        yield Candidate.of_term(model, Term(RudderOffset.name, (0.0,), dof=yaw))
    for dof in observed.dofs:
        lacking = [law for law in PLANE_DRAG_LAWS if (PLANAR.index(dof), law) not in have]
        for law in lacking:
            yield Candidate.of_term(model, Term(law, (0.0,), True, PLANAR.index(dof)))
        if rough is not None and lacking == ["linear-drag"]:
            linear = dof.parameter("linear")
            share = rough[linear] / rough[dof.parameter("quadratic")]
            terms = tuple(
                replace(term, name="linear-drag", values=(share * term.values[0],))
                if (term.dof, term.name) == (PLANAR.index(dof), "quadratic-drag") else term
                for term in model.terms
            )  # fmt: skip
            yield Candidate("linear-drag", (linear,), replace(model, terms=terms))
    if model.water is None and observed.over_ground:
        yield Candidate("current", CURRENT, replace(model, water=(0.0, 0.0)))


def widest(model: Model, family: Family) -> Model:
    """The model with everything that a family of candidates knows."""
    following = next(family(model), None)
    while following is not None:
        model = following.model
        following = next(family(model), None)
    return model


def inertia_tied(model: Model, gyration: float) -> Model:
    """The model with its inertia in yaw as its mass abeam times a square of the radius of `gyration` [m²]."""
    ahead, abeam, inertia = (dof.parameter("inertia") for dof in PLANAR.dofs)
    mass = ahead if abeam in [name for name, *_ in model.ties] else abeam
    tied = replace(model, ties=(*model.ties, (inertia, mass, gyration)))
    return tied.with_theta([*model.theta[:2], gyration * model.values[mass], *model.theta[3:]])


def structure_of(model: Model, observed: Observed) -> str:
    """Say which drags, couplings and current a model has."""
    have, parts = {(term.dof, term.name) for term in model.terms}, list[str]()
    for dof in observed.dofs:
        laws = [law.removesuffix("-drag") for law in PLANE_DRAG_LAWS if (PLANAR.index(dof), law) in have]
        parts.append(f"{dof.name} drag {' and '.join(laws)}")
    parts += [term.name for term in model.terms if term.is_cross]
    parts += dict.fromkeys(term.name for term in model.terms if not term.base)
    parts += [] if SKEW in model.fixed else [SKEW.partition(".")[2]]
    return ", ".join([*parts, *(["current"] if model.water else [])])


def rough_velocities(run: Run) -> dict[str, Floats]:
    """Surge, sway [m/s] and yaw rate [rad/s] of a run, each (N,): as read, else from places and heading over
    `SLOPE_WINDOW_S`; NaN where neither tells."""
    velocities: dict[str, Floats] = {}
    if _read(run, YAW.position):
        velocities[YAW.velocity] = _slope(run.time, run.position)
    if all(_read(run, name) for name in NORTH_EAST):
        north, east = (_slope(run.time, np.asarray(run.channel(name))) for name in NORTH_EAST)
        cosine, sine = np.cos(run.position), np.sin(run.position)
        velocities[SURGE.velocity] = cosine * north + sine * east
        velocities[SWAY.velocity] = cosine * east - sine * north
    for dof in PLANAR.dofs:
        if _read(run, dof.velocity):
            velocities[dof.velocity] = np.asarray(run.channel(dof.velocity))
    return velocities


def _slope(time: Floats, values: Floats) -> Floats:
    """Central difference over `SLOPE_WINDOW_S`, (N,)."""
    finite = np.isfinite(values)
    ahead, behind = (np.clip(time + side * SLOPE_WINDOW_S / 2, time[0], time[-1]) for side in (1, -1))
    there, back = (np.interp(at, time[finite], values[finite]) for at in (ahead, behind))
    return np.asarray((there - back) / np.maximum(ahead - behind, 1e-9))


RUDDER_ARM_M = 0.1  # m


def rough_sizes(runs: Sequence[Run]) -> dict[str, float]:
    """Orders of size from which fits start, by qualified name: drag that balances the usual force at the usual
    velocity, and an inertia that takes `DECAY_S` to get there; `by_momentum` is nearer where velocities are known."""
    sizes: dict[str, float] = {}
    for dof in PLANAR.dofs:
        forces = np.concatenate([run.command_of(dof) for run in runs])
        columns = [v[dof.velocity] for run in runs if dof.velocity in (v := rough_velocities(run))]
        speeds = np.abs(np.concatenate(columns)) if columns else np.zeros(0)
        speeds = speeds[np.isfinite(speeds)]
        speed = max(float(np.quantile(speeds, 0.9)) if len(speeds) else 0.0, dof.limits.unmoved)
        force = float(np.sqrt(np.mean(forces**2)))
        if force == 0.0 and dof is YAW:  # by a rudder: as much as the thrust ahead gives at a small arm
            force = RUDDER_ARM_M * float(np.sqrt(np.mean(np.concatenate([r.command_of(SURGE) for r in runs]) ** 2)))
        linear = max(force, 1e-3) / speed
        sizes |= {
            dof.parameter("linear"): linear,
            dof.parameter("quadratic"): linear / speed,
            dof.parameter("inertia"): linear * DECAY_S,
        }
    for dof, other in ((SURGE, SWAY), (SWAY, SURGE)):
        if not any(run.command_of(dof).any() for run in runs):  # moved by the others alone
            for role in ("linear", "quadratic", "inertia"):
                sizes[dof.parameter(role)] = sizes[other.parameter(role)]
    return sizes


MOMENTUM_S = 5.0  # over which what forces sum up to is compared with the change of momentum
HULL_KG_M3 = 10.0  # mass with added mass, ahead, over the cube of the length, as of tankers and of slender AUVs


def usual_gyration(ahead: float) -> float:
    """Square of the radius of gyration in yaw [m²], for the mass abeam, of a hull of usual proportions: a quarter of
    the length, which follows from the mass ahead [kg] (a 7 m model of a tanker: 3.1 for 2.8)."""
    return ((ahead / HULL_KG_M3) ** (1.0 / 3.0) / 4.0) ** 2


def by_momentum(runs: Sequence[Run], names: Sequence[str]) -> dict[str, float]:
    """Values from which fits start of those parameters of a model that are called `names`, by least squares; without
    motions whose inertia, and without drags that, come out below zero.

    Over windows of `MOMENTUM_S` the forces sum up to the change of momentum, in axes that turn, and to what drag,
    couplings and rudder take. Motions with a logged force come first; the others take their inertias as known. Where no
    moment is logged the inertia is that of usual proportions.
    """
    balances, sizes = [momentum_balance(run) for run in runs], dict[str, float]()
    driven = {dof.name: any(run.command_of(dof).any() for run in runs) for dof in PLANAR.dofs}
    for dof in sorted(PLANAR.dofs, key=lambda dof: not driven[dof.name]):
        own, inertia = f"{dof.name}.", dof.parameter("inertia")
        if dof is YAW and not driven[dof.name] and (ahead := sizes.get(SURGE.parameter("inertia"))):
            sizes[inertia] = sizes.get(SWAY.parameter("inertia"), ahead) * usual_gyration(ahead)
        columns = {name: np.concatenate([each[dof.name][name] for each in balances]) for name in balances[0][dof.name]}
        force = columns.pop(dof.command) - sum(sizes[name] * columns[name] for name in columns if name in sizes)
        if not (free := [name for name in columns if name in names and name not in sizes]):
            continue
        solution = np.linalg.lstsq(np.stack([columns[name] for name in free], axis=1), force)[0].tolist()
        values = {name: value for name, value in zip(free, solution) if value > 0 or name not in OWN}
        if inertia in sizes or inertia in values:
            sizes |= {name: value for name, value in values.items() if name.startswith(own)}
    return sizes


def momentum_balance(run: Run) -> dict[str, dict[str, Floats]]:
    """Sums over each window of a run, (W,), for surge, sway and yaw: what parameters multiply, by qualified name, and
    the command. A velocity that is not read counts as zero."""
    rough, time = rough_velocities(run), run.time
    u, v, r = (filled(time, rough.get(dof.velocity, 0.0 * time)) for dof in PLANAR.dofs)
    length = min(MOMENTUM_S, time[-1] - time[0])
    first = np.searchsorted(time, np.arange(time[0], time[-1] - 0.999 * length, 0.5 * length))
    last = np.minimum(np.searchsorted(time, time[first] + length), len(time) - 1)

    def over(values: Floats) -> Floats:
        total = cumulative_trapezoid(values, time, initial=0.0)
        return np.asarray(total[last] - total[first])

    rudder, passing = np.asarray(run.extras.get("rudder", 0.0 * time)), u * np.abs(u)
    steering = -over(rudder * passing)
    balances = {
        SURGE.name: {
            "surge.m_u": u[last] - u[first], "sway.m_v": -over(v * r), "surge.X_uu": over(passing),
            "surge.rudder-drag.X_deltadelta": over(rudder**2 * passing),
        },
        SWAY.name: {
            "surge.m_u": over(u * r), "sway.m_v": v[last] - v[first], "sway.Y_vv": over(v * np.abs(v)),
            "sway.rudder.Y_delta": steering,
        },
        YAW.name: {
            "surge.m_u": -over(u * v), "sway.m_v": over(u * v), "yaw.I_r": r[last] - r[first],
            "yaw.k_rr": over(r * np.abs(r)), "yaw.rudder.N_delta": steering, "yaw.N_ur": over(np.abs(u) * r),
            "yaw.N_v": over(v), "yaw.N_uv": over(np.abs(u) * v),
        },
    }  # fmt: skip
    return {dof.name: {**balances[dof.name], dof.command: over(run.command_of(dof))} for dof in PLANAR.dofs}


def unbalanced(runs: Sequence[Run], sizes: Mapping[str, float]) -> float:
    """Sum over sway and yaw of the logarithm of the mean square of what momenta leave over by these `sizes` of
    parameters, as a share of all that goes in; infinity where these are none."""
    balances, total = [momentum_balance(run) for run in runs], 0.0
    for dof in (SWAY, YAW):
        columns = {name: np.concatenate([b[dof.name][name] for b in balances]) for name in balances[0][dof.name]}
        force = columns.pop(dof.command)
        parts = np.stack([sizes.get(name, 0.0) * column for name, column in columns.items()])
        left_over, size = np.mean((force - parts.sum(axis=0)) ** 2), np.mean(np.abs(parts).sum(axis=0) ** 2)
        total += float(np.log(left_over / size)) if size > 0 and left_over > 0 else np.inf
    return total


def put_over(run: Run, gear: tuple[float, ...]) -> Run:
    """The run with the angle that a steering gear gives its rudder."""
    angle, length = run.extras["rudder"], np.diff(run.time, append=run.time[-1])
    commands = Commands(
        angle[None, None], run.time[None, None], length[None, None], angle[None, :1], np.zeros((1, 1)), {}
    )
    values = tuple(np.full((1, 1, 1), value) for value in gear)
    return replace(run, extras={**run.extras, "rudder": effects.get(STEERING_GEAR).deliver(commands, values)[0, 0]})


def forecasts_of(problem: DrivenProblem, fit: Fit) -> Judgement:
    """Predictions of each run by the parameters that the other runs give, of all that is judged."""
    at = {channel.quantity: c for c, channel in enumerate(problem.course.channels)}
    placed = set(NORTH_EAST) <= at.keys()
    names = [YAW.position, *(NORTH_EAST if placed else [n for n in (SURGE.velocity, SWAY.velocity) if n in at])]
    heading, *remaining = left_out_predictions(problem, fit, [at[name] for name in names], thinned=True)
    with np.errstate(over="ignore", invalid="ignore"):  # where predictions run away
        worth = {name: worth_of(predicted) for name, predicted in zip(names[1:], remaining)}
        if placed:
            worth = {PLACE: _distances(list(worth.values()))}
    (inertia,) = problem.model.inertia_matrix(fit.of_model[None])
    large = large_disturbance(problem.course, np.diagonal(inertia), fit.of_chance)
    runs = len(problem.course.names)
    return Judgement({YAW.position: worth_of(heading), **worth}, runs, heading, problem.course, large=large)


def _distances(by_axis: Sequence[tuple[ForecastScore, ...]]) -> tuple[ForecastScore, ...]:
    """Root mean squares of distances on the water, from those along its axes."""
    sizes = ("error", "constant_rate", "constant")
    return tuple(
        replace(
            north,
            count=min(north.count, east.count),
            **{name: float(np.hypot(getattr(north, name), getattr(east, name))) for name in sizes},
        )
        for north, east in zip(*by_axis)
    )


MAX_NEIGHBOURS_FITTED = 2  # neighbours of a structure that are fitted, at most
ROUGHLY = 0.3  # gain in log likelihood to be expected below which a search goes on; what is chosen is fitted to its end
HOW = "by the innovations of a filter"


def price_of(fit: OutputErrorFit) -> float:
    """Give what a parameter has to gain in deviance; Schwarz (1978), doi 10.1214/aos/1176344136."""
    return float(np.log(max(sum(fit.mixed.readings.values()), 2)))


def criterion(fit: OutputErrorFit) -> float:
    """Give the Bayesian information criterion, the smaller the better."""
    return float(-2.0 * fit.mixed.log_likelihood + len(fit.model.free) * price_of(fit))


def model_content(fit: OutputErrorFit) -> dict[str, object]:
    """Give what every file of a planar model that was fitted holds: parameters with their intervals, and the covariance
    of the free ones with the run as the unit."""
    at = [fit.model.index(name) for name in fit.model.free]
    log, covariance = fit.mixed.parameters.log[at], fit.covariance[np.ix_(at, at)]
    return {
        **planar_json(fit.model, {name: estimate.to_json() for name, estimate in fit.by_name.items()}),
        "covariance": covariance_json(fit.model.free, fit.mixed.theta[at], log, covariance),
    }


@dataclass(frozen=True)
class Promise:
    """What more parameters promise: a `gain` in log likelihood, and all parameters by name where it is expected."""

    gain: float
    theta: Mapping[str, float]


def as_promised(candidate: Candidate, promise: Promise, fit: OutputErrorFit) -> bool:
    """Whether a linear drag is promised as the candidate has it: beside a quadratic one, of which most stays then, or
    in its place; true of every other candidate."""
    quadratic = dict(zip(OWN[1::3], OWN[2::3])).get(candidate.added[0])
    if quadratic not in fit.model.free:
        return True
    stays = promise.theta[quadratic] > 0.5 * fit.model.values[quadratic]
    return stays == (quadratic in candidate.model.free)


def both(leaders: Sequence[tuple[Candidate, Promise]], model: Model, family: Family) -> list[tuple[Candidate, Promise]]:
    """Return what two leading candidates for a `model` make together, and where it begins; nothing if they are two ways
    to have the same."""
    (first, promise), (second, more) = leaders
    wanted = {*first.model.free, *second.added} - ({*model.free} - {*second.model.free})
    theta = {**promise.theta, **{name: more.theta[name] for name in second.added}}
    together = [candidate for candidate in family(first.model) if {*candidate.model.free} == wanted]
    return [(candidate, Promise(promise.gain + more.gain, theta)) for candidate in together]


@dataclass(frozen=True)
class Round:
    """One look for what a model lacks: the model `before`, and the best one that was fitted, if any was."""

    before: OutputErrorFit
    best: OutputErrorFit | None


@dataclass(frozen=True)
class ByEvidence(Judge[OutputErrorFit, Round]):
    """Takes what improves the information criterion; `tried` collects what was fitted, by structure.

    Those candidates are fitted briefly that promise most by the slope and curvature of the likelihood, two of them also
    together, and the best to the end. Where none promises enough, linear drags take the place of quadratic ones: a
    slope tells little of what such an exchange gains.
    """

    likelihood: "PlanarLikelihood"
    tried: dict[str, OutputErrorFit] = field(default_factory=dict)
    most = 50

    def look(self, model: OutputErrorFit, number: int) -> Round:
        likelihood, price = self.likelihood, price_of(model)
        self.tried.setdefault(likelihood.structure_of(model.model), model)
        worth, swaps = list[tuple[float, Candidate, Promise]](), list[tuple[float, Candidate, Promise]]()
        for candidate, promise in likelihood.promised(model, likelihood.family):
            if likelihood.structure_of(candidate.model) in self.tried:
                continue
            more = len(candidate.model.free) - len(model.model.free)
            entry = 2.0 * promise.gain - price * more, candidate, promise
            if 2.0 * promise.gain > price * len(candidate.added) and as_promised(candidate, promise, model):
                worth.append(entry)
            elif more < len(candidate.added):
                swaps.append(entry)
        worth.sort(key=lambda entry: -entry[0])
        leaders = [(candidate, promise) for _, candidate, promise in worth[:MAX_NEIGHBOURS_FITTED] or swaps]
        together = both(leaders, model.model, likelihood.family) if len(worth) > 1 else []
        brief = likelihood.tried([*leaders, *together], model, NEIGHBOUR_ITERATIONS)
        best = min((estimated for _, estimated in brief), key=criterion, default=None)
        singly = [estimated for candidate, estimated in brief if candidate in [leader for leader, _ in leaders]]
        self.tried.update({likelihood.structure_of(estimated.model): estimated for estimated in singly})
        if best is not None and (worth or criterion(best) < criterion(model)):
            best = likelihood.estimate(best.model, best.mixed.of_chance, settled=ROUGHLY)
            self.tried[likelihood.structure_of(best.model)] = best
        return Round(model, best)

    def admissible(self, look: Round, first: Round) -> list[OutputErrorFit]:
        return [look.best] if look.best is not None and criterion(look.best) < criterion(look.before) else []


def with_actuators(likelihood: "PlanarLikelihood", base: OutputErrorFit) -> OutputErrorFit:
    """The fit with what stands between command and force, if the evidence asks for it, and in the mean of runs; else
    `base`."""
    tried, runs = likelihood.actuated(base, NEIGHBOUR_ITERATIONS), len(likelihood.runs)
    if not tried or runs < 2:
        return base
    best = min((estimated for _, estimated in tried), key=criterion)
    gained = best.mixed.density - base.mixed.density
    doubt = special.stdtrit(runs - 1, STEADY_LEVEL) * gained.std(ddof=1) / np.sqrt(runs)
    if gained.mean() <= doubt or criterion(best) > criterion(base) - MIN_PROPOSED_GAIN:
        return base
    return likelihood.estimate(best.model, best.mixed.of_chance, settled=ROUGHLY)


def search(likelihood: "PlanarLikelihood") -> tuple[OutputErrorFit, ...]:
    """Return what was tried, the best one first, then in the order of their criterion, from the simplest model on."""
    judge, base = ByEvidence(likelihood), likelihood.estimate(likelihood.simplest, settled=ROUGHLY)
    while (wide := with_actuators(likelihood, base)) is not base:
        judge.tried[likelihood.structure_of(base.model)], base = base, wide
    stepwise_search(judge, base)
    return tuple(sorted([*judge.tried.values(), *without_needless(likelihood, judge.tried.values())], key=criterion))


def without_needless(likelihood: "PlanarLikelihood", tried: Iterable[OutputErrorFit]) -> Iterator[OutputErrorFit]:
    """Fit the best of what was `tried` without an actuator's term that the evidence asked for before it knew the hull,
    and does not any more; until it asks for all."""
    best: OutputErrorFit | None = min(tried, key=criterion)
    while best is not None:
        model, random = best.model, best.mixed.of_chance
        added = [term for term in model.terms if term.name in {*dict(ACTUATORS)} - {*likelihood.with_effects}]
        fewer = [(replace(model, terms=tuple(t for t in model.terms if t is not term)), random) for term in added]
        fits = [fit for fit in likelihood.brief(fewer, NEIGHBOUR_ITERATIONS) if fit is not None]
        best = min((fit for fit in fits if criterion(fit) < criterion(best)), key=criterion, default=None)
        if best is not None:
            yield best


@dataclass(frozen=True, repr=False)
class PlanarFit(Shown):
    """A model of surge, sway and yaw together. `best` is the fit, `estimates` its parameters by name, `model` and
    `structure` what it contains, `use` what it predicts, `valid_range` where it was fitted, `fitted_because` and
    `because` the sentences that say why. `tried` are all models, the likeliest first. `runs` are those fitted,
    `observed` the sensors, `set_aside` the runs left out, each with its reason; `of_logs` are warnings of what was
    logged; `priors` were known beforehand; `warnings` are what a report says. `to_json()` is
    planar_model.json.

    Frame, a row per parameter: `parameter`, `value`, `stderr`, `low`, `high`, `unit`.

    Keys: `schema`, `force_unit`, `moment_unit`, `parameters`, `covariance`, `command_delay_s`, `fitted_to`,
    `structure`, `structure_because`, `estimated`, `estimated_because`, `assumptions`, `channels`, `random`,
    `prediction`, `log_likelihood`, `valid_range`, `warnings`, `runs`.
    """

    tried: tuple[OutputErrorFit, ...]
    best: OutputErrorFit
    use: Judgement
    fitted_because: str
    runs: tuple[Run, ...]
    observed: Observed
    set_aside: tuple[ExcludedRun, ...] = ()
    of_logs: tuple[str, ...] = ()
    priors: Priors = field(default_factory=dict)

    @property
    def structure(self) -> str:
        return structure_of(self.model, self.observed)

    @property
    def model(self) -> Model:
        return self.best.model

    @property
    def estimates(self) -> dict[str, Estimate]:
        return self.best.by_name

    @property
    def because(self) -> str:
        if len(self.tried) == 1:
            return "No other structure was tried."
        first, second = (structure_of(estimated.model, self.observed) for estimated in self.tried[:2])
        which = "this one" if first == self.structure else first
        behind = f"{second}, is {criterion(self.tried[1]) - criterion(self.tried[0]):.1f} behind"
        best = f"{which} has the best evidence (Bayesian information criterion)"
        return f"Of {len(self.tried)} structures {best}; the next, {behind}."

    @cached_property
    def valid_range(self) -> dict[str, list[float]]:
        """Smallest and largest velocity and command of the runs, by keys such as surge_m_s and force_X_N."""
        ranges: dict[str, list[float]] = {}
        rough = [rough_velocities(run) for run in self.runs]
        for dof in PLANAR.dofs:
            columns = [rates[dof.velocity] for rates in rough if dof.velocity in rates]
            if columns:
                velocities = np.concatenate(columns)
                ranges[dof.velocity_key] = [float(np.nanmin(velocities)), float(np.nanmax(velocities))]
            commands = np.concatenate([run.command_of(dof) for run in self.runs])
            column = dof.column(dof.command, dof.units.forces[1])
            ranges[column] = [float(commands.min()), float(commands.max())]
        return ranges

    def document(self, option: str) -> Document:
        return json_document("planar_model.json", self.to_json())

    def to_json(self) -> dict[str, object]:
        return {
            **model_content(self.best),
            COMMAND_DELAY: self.best.delay.to_json(),
            "fitted_to": "whole runs",
            "structure": self.structure,
            "structure_because": self.because,
            "estimated": HOW,
            "estimated_because": self.fitted_because,
            "assumptions": [asdict(assumption) for assumption in self.observed.assumptions(self.model)],
            "channels": list(self.observed.channels),
            "random": {name: size for name, size in self.best.mixed.of_chance.items() if name != COMMAND_DELAY},
            "prediction": self.use.to_json(YAW),
            "log_likelihood": self.best.mixed.log_likelihood,
            "valid_range": self.valid_range,
            "warnings": list(self.warnings),
            "runs": runs_json(len(self.runs), self.set_aside, self.runs),
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        sentences = [*self.use.warnings(YAW)]
        if not self.best.mixed.converged:
            sentences.append("The fit did not converge; give more or longer runs.")
        for term in self.model.terms:
            if isinstance(term.effect, ThrusterImbalance):
                least, *_, most = sorted(term.effect.gains(*term.values))
                sentences.append(
                    f"The thrusters pull {least:.2f} to {most:.2f} times what their map says, if the mean of that is "
                    "right; else all masses and drags are off alike. Test each thruster ahead and astern."
                )
        tied = {name for name, *_ in self.model.ties}
        masses = {name: self.estimates[name] for dof in PLANAR.dofs if (name := dof.parameter("inertia")) not in tied}
        loose = [name for name, mass in masses.items() if mass.stderr > 0.5 * abs(mass.value)]
        if loose:
            names = f"The logs hardly determine {', '.join(loose)}: the standard error is more than half the value"
            sentences.append(f"{names}. Add runs in which the commands change more often.")
        return (*self.of_logs, *sentences)


INERTIAS = (0.5, 1.0, 2.0)  # shares of rough inertias from which a first fit starts
SIZES = (0.02, 0.2)  # disturbances, as shares of the acceleration of the largest command, to start from
NEIGHBOUR_ITERATIONS = 4  # iterations of a brief fit
GEAR_ITERATIONS = 16  # with a steering gear, which changes what the hull is taken for
WORTH_IT = 0.02  # share of the errors of predictions that is worth another structure


@dataclass(frozen=True)
class PlanarLikelihood:
    """Fits of planar models to `runs`, of which the logs hold what is `observed`; `priors` are parameters that are
    known beforehand, by qualified name."""

    runs: tuple[Run, ...]
    observed: Observed
    priors: Priors = field(default_factory=dict)
    with_effects: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()

    @cached_property
    def simplest(self) -> Model:
        """The model with which a search begins, with the effects that were asked for in each motion that is read."""
        model = self.observed.simplest(self.rough)
        for name, (place, dof) in product(self.with_effects, enumerate(PLANAR.dofs)):
            effect = effects.get(name)
            law = OF_EACH if name == THRUSTER_LAG and ARM in self.course.signals else 0
            start = tuple(start_of(name, self.course, place, law))
            idle = effect.place is Place.ACTUATOR and not effect.acts_on and place not in self.commanded
            idle |= acts_singly(effect, start) and dof is not YAW  # it acts on both motions
            if effect.acts_in(dof) and dof in self.observed.dofs and not idle:
                model = model.with_term(Term(name, start, dof=place))
        if SKEW in self.priors:
            model = replace(model, fixed=tuple(name for name in model.fixed if name != SKEW))
        sizes = by_momentum(self.runs, model.free)
        model = model.with_theta([sizes.get(name, value) for name, value in model.values.items()])
        inertia = YAW.parameter("inertia")
        if not self.observed.rudder_alone or inertia in self.priors:
            return model
        return inertia_tied(model, usual_gyration(model.masses[0]))

    @cached_property
    def rough(self) -> dict[str, float]:
        return rough_sizes(self.runs)

    def structure_of(self, model: Model) -> str:
        return structure_of(model, self.observed)

    def family(self, model: Model) -> Iterator[Candidate]:
        return candidates(model, self.observed, self.rough)

    @cached_property
    def course(self) -> Course:
        moving = np.zeros(len(self.runs), dtype=bool)  # the first readings tell who is at rest
        columns = {*self.signals, *(need for name in self.with_effects for need in effects.get(name).needs)}
        columns |= {*RudderRace.needs} if "rudder" in columns else set()
        columns |= {*PARTS, ARM} if all(ARM in run.extras for run in self.runs) else set()
        signals = sorted(columns - {dof.velocity for dof in PLANAR.dofs})
        return make_course(self.runs, moving, signals, motion=PLANAR, channels=self.observed.channels)

    def problem(self, model: Model) -> DrivenProblem:
        largest = np.abs(self.course.commanded).max(axis=(1, 2))
        parameters = Parameters((*model.parameters(np.where(largest > 0, largest, 1.0)), *self._random))
        return DrivenProblem(model, self.course, parameters.informed(self.priors))

    def starts(self, problem: DrivenProblem, random: Mapping[str, float] | None) -> Floats:
        """Where a fit begins, (S, p): about the model's own values, with what is known of the `random` ones."""
        model = problem.model
        middle = {chance.name: chance.value for chance in problem.parameters.nuisance}
        if random is not None:
            return starts_near(problem, [model.theta], random)
        heavy = np.array([parameter.role == "inertia" for parameter in problem.parameters[problem.parameters.of_model]])
        starts = []
        for inertia, size in product(INERTIAS, SIZES):
            pushed = {
                name: size / 0.05 * value / inertia if name.endswith("disturbance") else value
                for name, value in middle.items()
            }
            starts.append([*np.where(heavy, inertia * model.theta, model.theta), *pushed.values()])
        return problem.parameters.within(starts)

    def estimate(
        self, model: Model, random: Mapping[str, float] | None = None, iterations: int = ITERATIONS,
        settled: float = SETTLED_GAIN,
    ) -> OutputErrorFit:  # fmt: skip
        """The model fitted, from its own values and what is known of the `random` ones; one of few `iterations` leaves
        no run out. Raises FitError where no start leads anywhere."""
        problem = self.problem(model)
        starts, brief = self.starts(problem, random), iterations < ITERATIONS
        return result_of("", model, fit_innovations(problem, starts, iterations, brief, settled))

    def choose(self, tried: Sequence[OutputErrorFit]) -> tuple[OutputErrorFit, Judgement, str]:
        """The likeliest structure, with its predictions, and why. Where disturbances are as large as the commands, or
        it predicts no better than constants, the one that predicts runs left out best, if by a share of WORTH_IT.

        There one reading after the other tells little of what the commands do: whatever answers within a reading or
        two goes for the disturbance. Elsewhere a likelihood tells structures apart better than predictions of few runs.
        """

        def judged(fit: OutputErrorFit) -> tuple[OutputErrorFit, Judgement]:
            return fit, forecasts_of(self.problem(fit.model), fit.mixed)

        def finished(fit: OutputErrorFit) -> tuple[OutputErrorFit, Judgement]:
            return judged(self.estimate(fit.model, fit.mixed.of_chance))

        chosen = finished(tried[0])
        doubtful = chosen[1].large or chosen[1].score >= 0.0
        others = map(judged, tried[1:] if doubtful else tried[1:2])
        rival = min(others, key=lambda pair: pair[1].score, default=chosen)
        if doubtful and chosen[1].score - rival[1].score >= WORTH_IT:
            chosen, rival = sorted((chosen, finished(rival[0])), key=lambda pair: pair[1].score)
        scores = chosen[1].score, rival[1].score
        if not np.isfinite(scores[0]):  # a model whose predictions run away has no known parameters
            chosen = replace(chosen[0], covariance=np.full_like(chosen[0].covariance, np.inf)), chosen[1]
        if len(tried) == 1 or not chosen[1].worth[YAW.position] or not np.isfinite(scores[1]):
            return (*chosen, f"Fitted {HOW}.")
        share = float(np.expm1(scores[1] - scores[0]))
        misses = f"{100 * abs(share):.0f} % {'more' if share >= 0 else 'less'}"
        return (*chosen, f"Fitted {HOW}: of runs left out, 2 to 15 s ahead, the next best fit misses by {misses}.")

    @np.errstate(over="ignore", invalid="ignore")  # where a fit ran away
    def promises(self, wide: Model, neighbour: OutputErrorFit, added: Sequence[tuple[str, ...]]) -> list[Promise]:
        """What each group of free parameters of `wide` is to be expected to gain beside those of an estimated
        `neighbour`, and where: half of the score statistic within bounds, Rao (1948), doi 10.1017/S0305004100023987."""
        problem = self.problem(wide)
        (phi,) = problem.parameters.search(self.starts(problem, neighbour.mixed.of_chance))
        (slopes,) = problem.slopes(phi[None])
        point = problem.point(phi, slopes)
        names = [problem.parameters.names[i] for i in problem.free]
        free = {*neighbour.model.free, *neighbour.mixed.of_chance}
        limits, origin = problem.parameters.limits[problem.free], phi[problem.free]

        def promise(more: tuple[str, ...]) -> Promise:
            chosen = np.array([name in free or name in more for name in names])
            h, g = point.curvature[np.ix_(chosen, chosen)], point.gradient[chosen]
            step = bounded_solution(h, g + h @ origin[chosen], limits[chosen]) - origin[chosen]
            there = phi.copy()
            there[problem.free[chosen]] += step
            theta = dict(zip(problem.parameters.names, problem.parameters.natural(there).tolist()))
            return Promise(float(g @ step - 0.5 * step @ h @ step), theta)

        without = promise(()).gain
        return [replace(expected, gain=expected.gain - without) for expected in map(promise, added)]

    def promised(self, current: OutputErrorFit, family: Family) -> list[tuple[Candidate, Promise]]:
        """The candidates for a model with what their scores promise, all of one pass of the filter."""
        every = list(family(current.model))
        wide = widest(current.model, family)
        return list(zip(every, self.promises(wide, current, [candidate.added for candidate in every])))

    def tried(
        self, promised: Sequence[tuple[Candidate, Promise]], current: OutputErrorFit, iterations: int
    ) -> list[tuple[Candidate, OutputErrorFit]]:
        """Candidates fitted briefly side by side, each from where it promises most; those that lead anywhere."""
        begins = [self.toward(candidate.model, current.mixed.of_chance, promise) for candidate, promise in promised]
        fits = zip(promised, self.brief(begins, iterations))
        return [(candidate, fit) for (candidate, _), fit in fits if fit is not None]

    def brief(self, begins: Sequence[Begin], iterations: int) -> list[OutputErrorFit | None]:
        """Models fitted briefly side by side, each from its own values and those of what is random; None for one that
        leads nowhere."""
        problems = [self.problem(model) for model, _ in begins]
        starts = [self.starts(problem, random) for problem, (_, random) in zip(problems, begins)]
        fits = fits_of(problems, starts, iterations, brief=True)
        return [None if fit is None else result_of("", model, fit) for (model, _), fit in zip(begins, fits)]

    def actuated(self, fit: OutputErrorFit, iterations: int) -> list[tuple[Candidate, OutputErrorFit]]:
        """The model with each of ACTUATORS that it lacks, in all motions whose command changes, fitted briefly. Also
        without the motions in which nothing is left of it.

        A slope tells nothing of a lag where a delay stands for it: it begins with the delay's time in its place."""
        course, model, chances = self.course, fit.model, fit.mixed.of_chance
        delay, at_once = fit.delay.value, {**chances, COMMAND_DELAY: min(fit.delay.value, self.course.half_width)}
        lacking, begins = list[tuple[str, int]](), list[Begin]()
        for name, law in ACTUATORS:
            if name in [term.name for term in model.terms] or not (places := self._acting(model, name, law)):
                continue
            wide = model
            for i in places:
                first, *more = start_of(name, course, i, law)
                first *= STALL_SHARE if name == STALL else 1.0
                first = max(delay, START_LAG_S) if name in LAGS else first
                wide = wide.with_term(Term(name, (first, *more), dof=i))
            if name == STEERING_GEAR and (wide := self._geared(model, law)) is model:
                continue
            lacking.append((name, law))
            begins.append((wide, at_once if name in (*LAGS, STEERING_GEAR) else chances))
        thrusters = sum(name not in OF_RUDDERS for name, _ in lacking)  # they come first
        fits = list(zip(lacking, self.brief(begins[:thrusters], iterations)))
        fits += zip(lacking[thrusters:], self.brief(begins[thrusters:], max(iterations, GEAR_ITERATIONS)))
        fewer = [(law, self.without_idle(of.model, law[0]), of.mixed.of_chance) for law, of in fits if of is not None]
        fewer = [
            (law, of, random) for law, of, random in fewer
            if 0 < len(of.terms) - len(model.terms) < len(self._acting(model, *law))
        ]  # fmt: skip
        fits += zip([law for law, *_ in fewer], self.brief([(of, random) for _, of, random in fewer], iterations))
        return [(Candidate.of_terms(name, of.model), of) for (name, _), of in fits if of is not None]

    def _geared(self, model: Model, law: int) -> Model:
        """The model with a steering gear, of GEARS that whose rudder balances the momentum of the runs best, and the
        hull that does so: beside a gear it is another one than without. The model itself where none does so better than
        the rudder as it is logged."""
        trials = []
        for gear in GEARS[law]:
            runs = [put_over(run, gear) for run in self.runs]
            sizes = by_momentum(runs, model.free)
            trials.append((unbalanced(runs, sizes), gear, sizes))
        least, gear, sizes = min(trials)
        if least >= unbalanced(self.runs, by_momentum(self.runs, model.free)):
            return model
        inertia, values = YAW.parameter("inertia"), model.values
        scale = values[inertia] / sizes.get(inertia, values[inertia])
        sizes = {name: (scale if name.startswith("yaw.") else 1.0) * size for name, size in sizes.items()}
        theta = [value if name in self.priors else sizes.get(name, value) for name, value in values.items()]
        return model.with_theta(theta).with_term(Term(STEERING_GEAR, gear, dof=PLANAR.index(YAW)))

    def _acting(self, model: Model, name: str, law: int) -> list[int]:
        """Places of the motions in which runs may show what acts on commands: those whose command changes, of a dead
        band those whose command is zero at times or changes sides, of what a rudder, a compass or single thrusters do
        that of the heading."""
        if name == SensorLag.name:
            return [PLANAR.index(YAW)]
        if name in OF_RUDDERS:
            return [PLANAR.index(YAW)] if "rudder" in [term.name for term in model.terms] else []
        singly = ARM in self.course.signals
        if acts_singly(effects.get(name), start_of(name, self.course, law=law)):
            return [PLANAR.index(YAW)] if singly else []
        if singly and (name, law) in OF_BOTH:
            return []
        if name == DEAD_BAND:
            return [i for i, of in self.commanded.items() if of.min() <= 0.0 <= of.max()]
        return [*self.commanded]

    @cached_property
    def commanded(self) -> dict[int, Floats]:
        """The commands of all runs, by the places of those motions whose command changes."""
        commands = [np.concatenate([run.command_of(dof) for run in self.runs]) for dof in PLANAR.dofs]
        return {i: command for i, command in enumerate(commands) if np.ptp(command)}

    def without_idle(self, model: Model, name: str) -> Model:
        """The model without what is called `name` in motions in which nothing is left of it."""
        if acts_singly(effects.get(name)):
            return model
        least = {i: IDLE_SHARE * start_of(name, self.course, i)[0] for i in range(len(PLANAR.dofs))}
        return replace(model, terms=tuple(t for t in model.terms if t.name != name or t.values[0] >= least[t.dof]))

    def toward(self, model: Model, random: Mapping[str, float], promised: Promise) -> tuple[Model, Mapping[str, float]]:
        """The model, and what is `random`, as promised, where that is likelier than as they are."""
        problem = self.problem(model)
        (start,) = self.starts(problem, random)
        there = np.array([promised.theta.get(name, value) for name, value in zip(problem.parameters.names, start)])
        if not np.isfinite(there).all():
            return model, random
        phis = problem.parameters.search(np.stack([start, there]))
        value, reached = problem.value(phis)
        if not reached > value:
            return model, random
        there = problem.parameters.natural(phis[1])
        of_model = there[problem.parameters.of_model]
        return model.with_theta(of_model), dict(zip(problem.parameters.names, there.tolist()))

    @cached_property
    def _random(self) -> tuple[Parameter, ...]:
        """What is random, within the same bounds for all models; next to nothing of what is not read."""
        m = np.diagonal(self.simplest.inertia_matrix(self.simplest.theta[None])[0])
        rough = self.rough
        forces = [rough[dof.parameter("linear")] ** 2 / rough[dof.parameter("quadratic")] for dof in PLANAR.dofs]
        largest = np.abs(self.course.commanded).max(axis=(1, 2))
        pushes = np.maximum(largest, forces) / np.maximum(m, 1e-9)
        chances = randomness(self.course, pushes.tolist(), (), quiet=False)
        unread = tuple(f"{dof.name}." for dof in PLANAR.dofs if dof not in self.observed.dofs)
        return tuple(replace(c, upper=c.lower) if c.name.startswith(unread) else c for c in chances)
