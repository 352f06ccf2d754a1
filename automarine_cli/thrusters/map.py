"""The family of thrust curves, the fit of one direction by least squares, and `ThrusterMap`: control signal -> thrust
of one thruster, forward and backward apart; plain data. Through a map the thruster commands of a log become a moment.

Every form is a special case of `f(u) = a max(min(u, n_sat) - n_0, 0)^p` with `u = |n|`: the square law (the source
paper's equation 2) has p = 2, no dead band (n_0 = 0) and no saturation; the others free one, two or three of them.

Many sets of weights are fitted at once (levels left out weigh nothing): a grid over dead band, exponent and saturation
with the amplitude solved for, then bounded Levenberg-Marquardt steps from its best points.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from typing import ClassVar

import numpy as np

from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.effects.thruster_imbalance import PARTS
from automarine_cli.errors import AutomarineError, ModelError, RunError, SettingError
from automarine_cli.estimate import Given
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.models.allocation import twin_forces
from automarine_cli.models.store import number_at
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import Codec, ResultKind, ResultRecord, Source, keyed, read_plain
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import Campaign, load_runs, read_planar, require_usable
from automarine_cli.runs.run import CommandRange, ExcludedRun, Run
from automarine_cli.simulation.specification import Bollard, levels_of, normal, uniform
from automarine_cli.text import Place, format_value, printable

SIDES = (("forward", 1.0), ("backward", -1.0))
SQUARE = 2.0
SUFFIX = "-saturation"


@dataclass(frozen=True)
class Form:
    """One form of the family: which of dead band, exponent and saturation are free beside the amplitude."""

    name: str
    dead_band: bool
    exponent: bool
    saturation: bool

    @property
    def mask(self) -> np.ndarray:
        """Which of amplitude, dead band, exponent and saturation are free, (4,)."""
        return np.array([True, self.dead_band, self.exponent, self.saturation])

    @property
    def free(self) -> tuple[str, ...]:
        return tuple(name for name, on in zip(("a", "n_0", "p", "n_sat"), self.mask) if on)

    @property
    def parameters(self) -> int:
        return len(self.free)

    @property
    def equation(self) -> str:
        level = "min(|n|, n_sat)" if self.saturation else "|n|"
        inner = f"max({level} - n_0, 0)" if self.dead_band else level
        return f"|F| = a {inner}^{'p' if self.exponent else '2'}"


_BASE = (("square", False, False), ("dead-band", True, False), ("power", False, True), ("dead-band-power", True, True))
_ALL = (Form(name + end * SUFFIX, dead, power, end) for end in (False, True) for name, dead, power in _BASE)
FORMS: dict[str, Form] = {form.name: form for form in _ALL}


@dataclass(frozen=True)
class Curve:
    """Thrust in one direction: a [N/n^p], p [1], dead band n_0 and saturation n_sat [unit of n], None where none."""

    a: float
    p: float = SQUARE
    n_0: float = 0.0
    n_sat: float | None = None

    def thrust(self, magnitude: Floats) -> Floats:
        """Size of the thrust [N] for |n| of any shape."""
        level = magnitude if self.n_sat is None else np.minimum(magnitude, self.n_sat)
        return np.asarray(self.a * np.maximum(level - self.n_0, 0.0) ** self.p)

    def signal(self, thrust: float) -> float:
        """Return |n| that gives a thrust [N], if it does not saturate before."""
        return float(self.n_0 + (thrust / self.a) ** (1.0 / self.p))


def thrust_both_ways(forward: Curve | None, backward: Curve | None, n: Floats, unmeasured: float = np.nan) -> Floats:
    """Thrust [N] at control signals n of any shape, `unmeasured` in a direction without a curve."""
    total = np.zeros_like(n)
    for (_, sign), curve in zip(SIDES, (forward, backward)):
        mask = n * sign > 0
        total[mask] = unmeasured if curve is None else sign * curve.thrust(np.abs(n[mask]))
    return np.asarray(total + 0.0)  # no negative zero


# Bounds of (amplitude, dead band, exponent, saturation), the second and fourth as shares of the largest command.
LOW = np.array([0.0, 0.0, 0.3, 0.3])
HIGH = np.array([np.inf, 0.8, 4.0, 1.0])
AS_GOOD = 1e-6  # relative difference of sums of squares that counts as none
STARTS = 5
STEPS = 60
SMALL = 1e-9


@dataclass(frozen=True)
class Fits:
    """Parameters of B weighted fits, shape (B, 4): amplitude [N] at full command, dead band, exponent, saturation;
    dead band and saturation are shares of the largest command `scale` [unit of n]."""

    values: Floats
    scale: float

    @property
    def curve(self) -> Curve:
        """The first fit."""
        amplitude, dead, power, top = map(float, self.values[0])
        a = amplitude / ((1.0 - dead) * self.scale) ** power
        return Curve(a, power, dead * self.scale, None if top >= HIGH[3] else top * self.scale)

    @property
    def at_bound(self) -> np.ndarray:
        """Which parameters of the first fit ended at a bound, (4,)."""
        return np.asarray((self.values[0] <= LOW + 1e-9) | (self.values[0] >= HIGH - 1e-9))

    def thrust(self, magnitude: Floats) -> Floats:
        """Size of the thrust [N], shape (B, N), at |n| of shape (N,)."""
        return _curve(magnitude[None, :] / self.scale, self.values)


def fit_direction(magnitude: Floats, thrust: Floats, weights: Floats, form: Form) -> Fits:
    """Least squares of `thrust` [N] on |n|, both of shape (N,), for each row of `weights`, shape (B, N)."""
    scale = float(np.max(magnitude))
    x = magnitude / scale
    starts = _starts(x, thrust, weights, form)  # (B, S, 4)
    flat, repeated = starts.reshape(-1, 4), np.repeat(weights, starts.shape[1], axis=0)
    if form.parameters > 1:
        flat = _refine(x, thrust, repeated, flat, form.mask)
    values, sse = flat.reshape(starts.shape), _sse(x, thrust, repeated, flat).reshape(starts.shape[:2])
    # of those as good as the best the one with least dead band and saturation: levels left out may not show either
    as_good = sse <= sse.min(axis=1, keepdims=True) * (1.0 + AS_GOOD)
    best = np.argmax(np.where(as_good, values[:, :, 3] - values[:, :, 1], -np.inf), axis=1)
    return Fits(values[np.arange(len(weights)), best], scale)


def _level(x: Floats, values: Floats) -> Floats:
    """Command above the dead band and below saturation, 1 at full command, shape (B, N)."""
    dead, top = values[:, 1:2], values[:, 3:4]
    return np.asarray(np.maximum(np.minimum(x, top) - dead, 0.0) / (1.0 - dead))


def _curve(x: Floats, values: Floats) -> Floats:
    return np.asarray(values[:, :1] * _level(x, values) ** values[:, 2:3])


def _sse(x: Floats, y: Floats, weights: Floats, values: Floats) -> Floats:
    return np.asarray(np.sum(weights * (y - _curve(x[None, :], values)) ** 2, axis=1))


def _grid(x: Floats, form: Form) -> Floats:
    """Grid of (1, dead band, exponent, saturation), shape (G, 4), for the parameters that are free."""
    dead = np.linspace(0.0, min(0.6, 0.95 * float(np.sort(x)[-2])), 16) if form.dead_band else np.array([0.0])
    power = np.array([0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 1.8, 2.0, 2.2, 2.6, 3.2]) if form.exponent else np.array([SQUARE])
    top = np.linspace(0.35, 1.0, 14) if form.saturation else np.array([1.0])
    mesh = np.stack(np.meshgrid([1.0], dead, power, top, indexing="ij"), axis=-1).reshape(-1, 4)
    return mesh[mesh[:, 3] > mesh[:, 1] + 0.1]


def _starts(x: Floats, y: Floats, weights: Floats, form: Form) -> Floats:
    """Best grid points with their amplitudes, shape (B, S, 4), no two of them neighbours in everything."""
    grid = _grid(x, form)
    shape = _curve(x[None, :], grid)  # (G, N)
    cross, square = (weights * y) @ shape.T, weights @ (shape**2).T  # (B, G)
    amplitude = np.maximum(cross / np.maximum(square, 1e-300), SMALL)
    sse = (weights @ y**2)[:, None] - 2.0 * amplitude * cross + amplitude**2 * square
    order = np.argsort(sse, axis=1, kind="stable")[:, :STARTS]
    starts = grid[order]
    starts[:, :, 0] = np.take_along_axis(amplitude, order, axis=1)
    return np.asarray(starts)


def jacobian(x: Floats, values: Floats) -> Floats:
    """Derivative of the thrust by the four parameters, shape (B, N, 4); x is |n| / scale, shape (N,)."""
    amplitude, dead, power, top = (values[:, i : i + 1] for i in range(4))
    level = _level(x[None, :], values)
    on = level > 0.0
    safe = np.where(on, level, 1.0)
    unit = np.where(on, safe**power, 0.0)
    slope = np.where(on, amplitude * power * np.maximum(safe, 1e-6) ** (power - 1.0), 0.0)
    by_dead = slope * (np.minimum(x[None, :], top) - 1.0) / (1.0 - dead) ** 2
    by_power = np.where(on, amplitude * unit * np.log(safe), 0.0)
    by_top = np.where(x[None, :] >= top, slope / (1.0 - dead), 0.0)
    return np.stack([unit, by_dead, by_power, by_top], axis=-1)


def _refine(x: Floats, y: Floats, weights: Floats, values: Floats, free: np.ndarray) -> Floats:
    """Bounded Levenberg-Marquardt on all rows of `values`, (B, 4), at once; no step makes a fit worse."""
    values = np.clip(values, LOW, HIGH)
    sse = _sse(x, y, weights, values)
    damping = np.full(len(values), 1e-3)
    width = int(free.sum())
    for _ in range(STEPS):
        residual = y - _curve(x[None, :], values)
        matrix = jacobian(x, values)[:, :, free]
        weighted = weights[:, :, None] * matrix
        gradient = np.einsum("bnk,bn->bk", weighted, residual)
        at = values[:, free]
        # A parameter that stands at its bound and is pushed outwards stays there.
        fixed = ((at <= LOW[free]) & (gradient < 0)) | ((at >= HIGH[free]) & (gradient > 0))
        gradient = np.where(fixed, 0.0, gradient)
        normal = np.einsum("bnk,bnl->bkl", weighted, matrix)
        normal = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, normal)
        diagonal = np.einsum("bkk->bk", normal)
        damped = damping[:, None] * diagonal + SMALL * diagonal.max(axis=1, keepdims=True) + 1e-300
        normal = normal + np.eye(width) * damped[:, :, None]
        step = np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        trial = values.copy()
        trial[:, free] = np.clip(at + step, LOW[free], HIGH[free])
        trial_sse = _sse(x, y, weights, trial)
        better = trial_sse < sse
        gain = np.where(better, sse - trial_sse, 0.0)
        values = np.where(better[:, None], trial, values)
        settled = np.all((gain <= 1e-12 * sse) & (better | (damping > 1e8)))
        sse = np.where(better, trial_sse, sse)
        damping = np.clip(np.where(better, damping / 5.0, damping * 4.0), 1e-12, 1e12)
        if settled:
            break
    return values


FORCE_DECIMALS = 3


@dataclass(frozen=True)
class CurveEntry:
    unread: ClassVar[tuple[str, ...]] = ()
    a: Given | None = None
    p: Given | None = None
    n_0: Given | None = None
    n_sat: Given | None = None


@dataclass(frozen=True)
class Curves:
    unread: ClassVar[tuple[str, ...]] = ()
    forward: CurveEntry | None = None
    backward: CurveEntry | None = None


@dataclass(frozen=True, kw_only=True)
class ThrusterFile(ResultRecord):
    """`thrusters.json`: a thruster map."""

    unread: ClassVar[tuple[str, ...]] = (
        "per_test", "r2", "rmse_N", "rmse_all_points_N", "rmse_percent_of_full_scale", "cv_rmse_N", "forms",
        "chosen_because", "tare", "flagged", "voltages", "notes", "points", "by",
    )  # fmt: skip
    a_forward: Given | None = field(default=None, metadata=keyed("forward/a"))
    a_backward: Given | None = field(default=None, metadata=keyed("backward/a"))
    form: str
    parameters: Curves
    n_unit: str = ""
    n_range: tuple[float, float] | None = None
    thrusters_per_test: int | None = None
    full_scale_N: float | None = None
    chosen: str = field(default="", metadata=keyed("chosen/form"))
    r2: float | None = field(default=None, metadata=keyed("chosen/r2"))
    rmse_percent: float | None = field(default=None, metadata=keyed("chosen/rmse_percent_of_full_scale"))
    voltage_range_V: tuple[float, float] | None = None
    voltage_exponent: Mapping[str, object] = field(default_factory=dict)


THRUSTER_MAP = ResultKind("thrusters.json", "thruster-map", ThrusterFile, "fit-thrusters", YAW)


@dataclass(frozen=True)
class ThrusterMap:
    """Thrust of one thruster at rest in the water against its control signal n: `forward` for n > 0, `backward` for
    n < 0 (None where never measured), over the `n_range` that was measured (None in maps of old)."""

    form: str
    forward: Curve | None
    backward: Curve | None
    n_unit: str = ""
    n_range: tuple[float, float] | None = None

    @property
    def both_ways(self) -> tuple[Curve, Curve]:
        if self.forward is None or self.backward is None:
            lacking = "forward" if self.forward is None else "backward"
            remedy = "but one thruster pulls each way in a turn; fit the map from a test that pulls both ways"
            raise SettingError(f"the thruster map has no {lacking} direction, {remedy}")
        return self.forward, self.backward

    @property
    def largest(self) -> float | None:
        """Largest control signal, either way, that it tells of: where a curve saturates, how far was measured."""
        ends = [curve.n_sat for curve in (self.forward, self.backward) if curve is not None]
        return min([abs(end) for end in (*ends, *(self.n_range or ())) if end], default=None)

    def compared(self, names: Sequence[str], commands: Sequence[Floats]) -> CommandRange | None:
        """The range of commands (N,) of thrusters beside the map's own; None for a map that does not say its own."""
        if self.n_range is None or not len(commands[0]):
            return None
        return CommandRange.of(commands, names, self.n_range, self.n_unit)

    def force(self, n: Floats | float) -> Floats:
        """Thrust [N] of one thruster, any shape of n; positive drives the vehicle ahead.

        Raises ModelError for a direction that the map does not have, and for a control signal that is not finite."""
        signal = np.asarray(n, dtype=float)
        if not np.all(np.isfinite(signal)):
            raise ModelError("the control signal of a thruster must be finite; leave out the rows without a value")
        for name, sign in SIDES:
            if getattr(self, name) is None and np.any(signal * sign > 0):
                raise ModelError(
                    f"the thruster map has no {name} direction (none was measured), but the log drives "
                    f"a thruster {name}; fit the map from a bollard test that pulls both ways"
                )
        return thrust_both_ways(self.forward, self.backward, signal)

    def to_json(self) -> dict[str, object]:
        """The least that a map file holds; `a` of a direction is the square law's, null for another form."""
        curves = {name: getattr(self, name) for name, _ in SIDES}
        square = self.form == "square"
        return {
            "schema": THRUSTER_MAP.schema,
            **{name: {"a": {"value": curve.a} if curve and square else None} for name, curve in curves.items()},
            "form": self.form,
            "parameters": {
                name: curve and {key: None if value is None else {"value": value} for key, value in vars(curve).items()}
                for name, curve in curves.items()
            },
            "n_unit": self.n_unit,
            **({} if self.n_range is None else {"n_range": list(self.n_range)}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, object], where: str = "thruster map") -> "ThrusterMap":
        """A map from the content of `thrusters.json`; ModelError names the key that is wrong."""
        file, codec = THRUSTER_MAP.of(data, where), THRUSTER_MAP.codec(data, where)
        if file.form not in FORMS:
            raise codec.refusal(("form",), f"found {format_value(file.form)}, expected one of {', '.join(FORMS)}")
        low, high = file.n_range or (0.0, 1.0)
        if not low < high:
            raise codec.refusal(("n_range",), f"found {low:g} and {high:g}, expected the lower one first")
        of = file.parameters
        forward, backward = (_curve_from(getattr(of, side), codec, ("parameters", side)) for side, _ in SIDES)
        if forward is None and backward is None:
            raise codec.refusal((), "parameters has neither a forward nor a backward direction; expected one or both")
        return cls(file.form, forward, backward, file.n_unit, file.n_range)

    @classmethod
    def load(cls, path: Source) -> "ThrusterMap":
        """The map of a `thrusters.json`. Raises ModelError with the file and the key's path."""
        return cls.from_json(read_plain(path, "JSON", ModelError), printable(path.name))


def _curve_from(entry: CurveEntry | None, codec: Codec, place: Place) -> Curve | None:
    if entry is None:
        return None
    a = _positive(entry.a or Given(None), codec, (*place, "a"))
    p = SQUARE if entry.p is None else _positive(entry.p, codec, (*place, "p"))
    dead_band = 0.0 if entry.n_0 is None else number_at(entry.n_0, codec, (*place, "n_0"))
    n_sat = None  # the fit found no saturation within the measured range
    if entry.n_sat is not None and entry.n_sat.value is not None:
        n_sat = _positive(entry.n_sat, codec, (*place, "n_sat"))
    if dead_band < 0:
        raise codec.refusal((*place, "n_0"), f"found {dead_band:g}, expected a dead band of zero or more")
    if n_sat is not None and n_sat <= dead_band:
        raise codec.refusal((*place, "n_sat"), f"found {n_sat:g}, expected more than the dead band, {dead_band:g}")
    return Curve(a, p, dead_band, n_sat)


def _positive(entry: Given, codec: Codec, place: Place) -> float:
    value = number_at(entry, codec, place)
    if value <= 0.0:
        raise codec.refusal(place, f"found {value:g}, expected more than 0")
    return value


def bollard_columns(bollard: Bollard, seed: int) -> dict[str, Floats]:
    """`n` and `force_N` of all thrusters of a test together, shape (levels x repeats,), in random order."""
    levels = np.repeat(np.array(levels_of(bollard.levels)), bollard.repeats)
    order = np.argsort(uniform(len(levels), seed, bollard.file, "order"), kind="stable")
    thrusters = ThrusterMap("square", Curve(bollard.a_f), Curve(bollard.a_b))
    pull = bollard.thrusters_per_test * thrusters.force(levels)
    measured = pull + bollard.noise_N * normal(len(levels), seed, bollard.file, "noise")
    return {"n": levels[order], "force_N": (np.round(measured, FORCE_DECIMALS) + 0.0)[order]}


def thrust_of(run: Run, thrusters: ThrusterMap, arm: float) -> list[Floats]:
    """Thrust [N] of each thruster of a run's motion by its commands.

    Raises RunError for a run without these, and ModelError for an arm [m] that is no length or a direction that the map
    lacks."""
    names = run.dof.thrusters
    if lacking := [name for name in names if name not in run.extras]:
        raise RunError(
            f"{run.source}, run {run.name!r}: no thruster command {' or '.join(lacking)} in the log, which "
            f"--thrusters needs; map the log's columns to {' and '.join(names)} with --columns, or leave "
            "--thrusters out"
        )
    try:
        if run.dof.levered and not (isfinite(arm) and arm > 0):
            raise ModelError(f"the arm of a thruster is {arm!r}; expected a positive length in metres")
        return [thrusters.force(run.extras[name]) for name in names]
    except ModelError as error:
        raise ModelError(f"{run.source}, run {run.name!r}: {error}") from None


def drive_run_by_thrusters(run: Run, thrusters: ThrusterMap, arm: float) -> Run:
    """The run with the moment [N m] that two equal thrusters `arm` [m] off the centre line make of their commands, port
    ahead positive; in surge and heave with the force [N]. A moment in the log gives way. Raises as `thrust_of` does."""
    dof, thrust = run.dof, thrust_of(run, thrusters, arm)
    lever = arm if dof.levered else 1.0
    moment = np.asarray(lever * sum(side * force for side, force in zip(dof.sides, thrust)))
    shares = [side * lever * force for side, force in zip(dof.sides, thrust)]
    commanded = thrusters.compared(dof.thrusters, [run.extras[name] for name in dof.thrusters])
    return run.with_moment(moment, dof.units.forces[1], parts_of(shares, dof), commanded)


def parts_of(shares: Sequence[Floats], dof: Dof) -> dict[str, Floats]:
    """What each thruster gives forward and backward, by the names of PARTS, of its share (N,) of the moment or force;
    none for a motion of another number of thrusters than two."""
    ways = [side * way(side * share, 0.0) for side, share in zip(dof.sides, shares) for way in (np.maximum, np.minimum)]
    return dict(zip(PARTS, ways)) if len(ways) == len(PARTS) else {}


def moment_maker(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> Callable[[Run], Run] | None:
    """What makes the moment or force of thruster commands, None without a map: see `map_and_arm`."""
    drive = map_and_arm(thrusters, arm, columns, dof)
    return None if drive is None else partial(drive_run_by_thrusters, thrusters=drive[0], arm=drive[1])


def map_and_arm(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> tuple[ThrusterMap, float] | None:
    """The map and the lever arm [m] (default: the column map's `arm_m`), or None without a map: then the logs hold the
    moment. Raises SettingError where map or arm is given alone."""
    if not dof.levered and arm is not None:
        levered = " and ".join(motion.name for motion in DOFS.values() if motion.levered)
        raise SettingError(f"--arm is of {levered}; in {dof.name} thrusters push as hard at any arm, so leave it out")
    if thrusters is not None and not dof.thrusters:
        remedy = f"leave it out, and name the {dof.words.force}'s column with --columns"
        raise SettingError(f"--thrusters makes no {dof.words.full_force}; {remedy}")
    if thrusters is None:
        if arm is not None:
            raise SettingError("--arm goes with the thrusters' map; give --thrusters MAP.json too")
        return None
    length = columns.defaults.get("arm_m") if arm is None else arm
    if not dof.levered:
        length = 1.0  # of no account
    if not isinstance(length, int | float):
        force = dof.words.force
        raise SettingError(f"--thrusters makes {force}s only with the thrusters' lever arm; give --arm METRES")
    thruster_map = ThrusterMap.load(thrusters) if isinstance(thrusters, Source) else thrusters
    return thruster_map, float(length)


def load_planar(
    logs: Logs, columns: ColumnMap, thrusters: Source | ThrusterMap | None = None, arm: float | None = None, *,
    strict: bool = False, jobs: int = 1, progress: Progress = silent,
) -> Campaign:  # fmt: skip
    """The runs of the logs, driven by forces ahead and abeam and a moment, which `thrusters` and `arm` [m] make of the
    commands of two. Raises LogError, RunError and SettingError as the fits of one motion do."""
    drive = map_and_arm(thrusters, arm, columns, YAW)
    campaign = load_runs(logs, columns, dof=YAW, strict=strict, jobs=jobs, progress=progress, read=read_planar)
    good, aside = driven_by(campaign.runs, lambda run: driven(run if drive is None else by_two_thrusters(run, *drive)))
    aside = [*campaign.set_aside, *aside]
    require_usable(good, aside, len(campaign.inputs), strict)
    return replace(campaign, runs=tuple(good), set_aside=tuple(aside))


def driven_by(runs: Sequence[Run], drive: Callable[[Run], Run]) -> tuple[list[Run], list[ExcludedRun]]:
    """The runs as `drive` commands them, and those that it refuses, with the reasons."""
    good, aside = list[Run](), list[ExcludedRun]()
    for run in runs:
        try:
            good.append(drive(run))
        except AutomarineError as error:
            why = str(error).removeprefix(f"{run.source}, run {run.name!r}: ")
            aside.append(ExcludedRun(run.source, run.name, why))
    return good, aside


def by_two_thrusters(run: Run, thrusters: ThrusterMap, arm: float) -> Run:
    """The run driven by two equal thrusters `arm` [m] off the centre line; raises as `thrust_of` does."""
    ahead, abeam, moment = twin_forces(np.stack(thrust_of(run, thrusters, arm)), arm)
    extras = {**run.extras, SURGE.command: ahead, SWAY.command: abeam}
    commanded = thrusters.compared(YAW.thrusters, [run.extras[name] for name in YAW.thrusters])
    return replace(run.with_moment(moment, YAW.units.forces[1], commanded=commanded), extras=extras)


def driven(run: Run) -> Run:
    """The run with a force of zero along each axis for which it has none, which its notes tell.

    Raises RunError for a run without any command, or whose commands are all zero."""
    _ = run.command  # refused where there is none
    lacking = [dof for dof in (SURGE, SWAY) if dof.command not in run.extras]
    zero = {dof.command: np.zeros(len(run)) for dof in lacking}
    notes = tuple(f"no {dof.words.full_force} in the log: none is taken to act" for dof in lacking)
    run = replace(run, extras={**run.extras, **zero}, notes=(*run.notes, *notes), reading=(*run.reading, *notes))
    if not any(np.any(run.command_of(dof)) for dof in (SURGE, SWAY, YAW)):
        raise RunError(
            f"{run.source}, run {run.name!r}: every command is zero: something that is not logged steers the vehicle; "
            "log what drives it, or leave the run out"
        )
    return run
