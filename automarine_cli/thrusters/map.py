"""`ThrusterMap`: control signal -> thrust of one thruster, forward and backward apart; plain data, written and read.
Through a map the thruster commands of a log become a moment.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from typing import ClassVar

import numpy as np

from automarine_cli.dofs import DOFS, SURGE, SWAY, YAW, Dof
from automarine_cli.effects.thruster_imbalance import ARM, PARTS
from automarine_cli.errors import AutomarineError, ModelError, RunError, SettingError
from automarine_cli.estimate import Given
from automarine_cli.logs import ColumnMap, Logs
from automarine_cli.pipeline.parallel import Progress, silent
from automarine_cli.pipeline.records import Document, ResultKind, ResultRecord, Source, json_document, keyed, read_plain
from automarine_cli.quantities import Floats
from automarine_cli.runs.load import LoadedRuns, load_runs, require_usable
from automarine_cli.runs.run import CommandRange, ExcludedRun, Run
from automarine_cli.simulation.specification import Bollard, levels_of, normal, uniform
from automarine_cli.text import format_value, printable
from automarine_cli.thrusters.curves import FORMS, Curve, CurveEntry, PowerCurve

SIDES = (("forward", 1.0), ("backward", -1.0))
FORCE_DECIMALS = 3
OUTPUT_STEP = 1.0 / 800.0


def thrust_both_ways(forward: Curve | None, backward: Curve | None, n: Floats, unmeasured: float = np.nan) -> Floats:
    """Return thrust [N] at control signals n of any shape, `unmeasured` in a direction without a curve."""
    total = np.zeros_like(n)
    for (_, sign), curve in zip(SIDES, (forward, backward)):
        mask = n * sign > 0
        total[mask] = unmeasured if curve is None else sign * curve.thrust(np.abs(n[mask]))
    return np.asarray(total + 0.0)  # no negative zero


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
        "chosen_because", "beyond_n_range", "tare", "flagged", "voltages", "notes", "points", "by",
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
    error_percent: float | None = field(
        default=None, metadata=keyed("chosen/error_percent_of_full_scale", "chosen/rmse_percent_of_full_scale")
    )
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
        result: dict[str, object] = {"schema": THRUSTER_MAP.schema, "form": self.form, "n_unit": self.n_unit}
        result |= {} if self.n_range is None else {"n_range": list(self.n_range)}
        parameters = dict[str, object]()
        for (name, _), curve in zip(SIDES, (self.forward, self.backward)):
            values = {key: value and {"value": value} for key, value in (curve.values if curve else {}).items()}
            result[name] = {"a": values["a"] if curve and self.form == "square" else None}
            parameters[name] = curve and curve.layout(values)
        return result | {"parameters": parameters}

    @classmethod
    def from_json(cls, data: Mapping[str, object], where: str = "thruster map") -> "ThrusterMap":
        """A map from the content of `thrusters.json`; ModelError names the key that is wrong."""
        file, codec = THRUSTER_MAP.of(data, where), THRUSTER_MAP.codec(data, where)
        if file.form not in FORMS:
            raise codec.refusal(("form",), f"found {format_value(file.form)}, expected one of {', '.join(FORMS)}")
        low, high = file.n_range or (0.0, 1.0)
        if not low < high:
            raise codec.refusal(("n_range",), f"found {low:g} and {high:g}, expected the lower one first")
        forward, backward = (
            FORMS[file.form].read(entry, codec, ("parameters", side)) if entry else None
            for (side, _), entry in zip(SIDES, (file.parameters.forward, file.parameters.backward))
        )
        if forward is None and backward is None:
            raise codec.refusal((), "parameters has neither a forward nor a backward direction; expected one or both")
        return cls(file.form, forward, backward, file.n_unit, file.n_range)

    @classmethod
    def of_newtons(cls) -> Document:
        """The file of a map of commands that are thrusts in newtons."""
        curve = PowerCurve(1.0, p=1.0)
        return replace(json_document("newtons", cls("power", curve, curve, "N").to_json()), built_in=True)

    @classmethod
    def load(cls, path: Source) -> "ThrusterMap":
        """The map of a `thrusters.json`. Raises ModelError with the file and the key's path."""
        return cls.from_json(read_plain(path, "JSON", ModelError), printable(path.name))


@dataclass(frozen=True)
class TwinThrusters:
    """Two equal thrusters off the centre line, of which one pulls ahead and one astern, with control signals up to
    `most`; `arm` [m] is the moment by newton, in whatever unit the moment has.

    With `equal_thrust` one pulls ahead as much as the other astern, so that the vehicle is not pushed ahead; else both
    get the same size of signal."""

    ahead: Curve
    astern: Curve
    arm: float
    most: float
    equal_thrust: bool = False

    @property
    def largest(self) -> float:
        ahead, astern = self.thrusts(self.most, self.most)
        return self.arm * (2.0 * min(ahead, astern) if self.equal_thrust else ahead + astern)

    def scaled_to(self, largest: float) -> "TwinThrusters":
        """Return the thrusters with another largest moment."""
        return replace(self, arm=self.arm * largest / self.largest)

    def moment(self, output: Floats) -> Floats:
        """Return the moment of both at the same size of signal; `output` of any shape is its share of `most`."""
        size = self.most * np.abs(output)
        return np.asarray(np.sign(output) * self.arm * (self.ahead.thrust(size) + self.astern.thrust(size)))

    def slope(self, output: Floats) -> Floats:
        """Return the change of the moment per change of an output between 0 and 1, over a small step of it."""
        low, high = output - OUTPUT_STEP, np.minimum(output + OUTPUT_STEP, 1.0)
        return np.asarray((self.moment(high) - self.moment(low)) / (high - low))

    def signals(self, moment: float) -> tuple[float, float]:
        """Return the sizes of the signals of the thruster that pulls ahead and of the one that pulls astern."""
        force = abs(moment) / self.arm
        if self.equal_thrust:
            return self.ahead.signal(force / 2.0), self.astern.signal(force / 2.0)
        if abs(moment) >= self.largest:
            return self.most, self.most
        from scipy.optimize import brentq  # takes long to import

        n = brentq(lambda n: sum(self.thrusts(n, n)) - force, 0.0, self.most, xtol=1e-12 * self.most)
        return float(n), float(n)

    def output(self, moment: float) -> float:
        """Return the share of `most` that gives a moment; in the dead band it jumps to its edge."""
        return self.commands(moment)[0] / self.most

    def commands(self, moment: float) -> tuple[float, float]:
        """Return control signals (n_port, n_stbd) that give the moment; positive turns to starboard."""
        if moment == 0.0:
            return 0.0, 0.0
        ahead, astern = self.signals(moment)
        return (ahead, -astern) if moment > 0 else (-astern, ahead)

    def thrusts(self, ahead: float, astern: float) -> tuple[float, float]:
        """Return the sizes of the thrusts [N] at these sizes of the signals, ahead and astern."""
        return float(self.ahead.thrust(np.asarray(ahead))), float(self.astern.thrust(np.asarray(astern)))


def bollard_columns(bollard: Bollard, seed: int) -> dict[str, Floats]:
    """`n` and `force_N` of all thrusters of a test together, shape (levels x repeats,), in random order."""
    levels = np.repeat(np.array(levels_of(bollard.levels)), bollard.repeats)
    order = np.argsort(uniform(len(levels), seed, bollard.file, "order"), kind="stable")
    pull = thrust_both_ways(PowerCurve(bollard.a_f), PowerCurve(bollard.a_b), levels)
    noise = bollard.noise_N * normal(len(levels), seed, bollard.file, "noise")
    measured = np.round(bollard.thrusters_per_test * pull + noise, FORCE_DECIMALS) + 0.0
    return {"n": levels[order], "force_N": measured[order]}


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
    shares = [side * (arm if dof.levered else 1.0) * force for side, force in zip(dof.sides, thrust)]
    commanded = thrusters.compared(dof.thrusters, [run.extras[name] for name in dof.thrusters])
    return run.with_moment(np.sum(shares, axis=0), dof.units.forces[1], parts_of(shares, dof), commanded)


def parts_of(shares: Sequence[Floats], dof: Dof) -> dict[str, Floats]:
    """What each thruster gives forward and backward, by the names of PARTS, of its share (N,) of the moment or force;
    none for a motion of another number of thrusters than two."""
    ways = [side * way(side * share, 0.0) for side, share in zip(dof.sides, shares) for way in (np.maximum, np.minimum)]
    return dict(zip(PARTS, ways)) if len(ways) == len(PARTS) else {}


def moment_maker(
    thrusters: Source | ThrusterMap | None, arm: float | None, columns: ColumnMap, dof: Dof
) -> Callable[[Run], Run] | None:
    """What makes the moment or force of thruster commands, None without a map: see `map_and_arm`."""
    drive = map_and_arm(thrusters or _of_logged_forces(arm, columns, dof), arm, columns, dof)
    return None if drive is None else partial(drive_run_by_thrusters, thrusters=drive[0], arm=drive[1])


def _of_logged_forces(arm: float | None, columns: ColumnMap, dof: Dof) -> Document | None:
    """Return the map file of thrusters that the column map says are forces (`unit = "N"`); None for others, and where a
    moment needs a lever arm that nobody gave."""
    rules = [columns.columns.get(name) for name in dof.thrusters]
    in_newtons = bool(rules) and all(rule is not None and rule.unit == "N" for rule in rules)
    armed = not dof.levered or arm is not None or "arm_m" in columns.defaults
    return ThrusterMap.of_newtons() if in_newtons and armed else None


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
) -> LoadedRuns:  # fmt: skip
    """The runs of the logs, driven by forces ahead and abeam and a moment, which `thrusters` and `arm` [m] make of the
    commands of two. Raises LogError, RunError and SettingError as the fits of one motion do."""
    drive = map_and_arm(thrusters or _of_logged_forces(arm, columns, YAW), arm, columns, YAW)
    campaign = load_runs(logs, columns, dof=YAW, strict=strict, jobs=jobs, progress=progress, planar=True)
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
    """The run driven by two equal thrusters `arm` [m] off the centre line: X = F_port + F_stbd, N = arm (F_port -
    F_stbd), clockwise; Fossen (2021), control allocation. Raises as `thrust_of` does."""
    port, starboard = thrust_of(run, thrusters, arm)
    forces = {SURGE.command: port + starboard, SWAY.command: np.zeros(len(run)), ARM: np.full(len(run), arm)}
    turned = drive_run_by_thrusters(run, thrusters, arm)
    return replace(turned, extras={**turned.extras, **forces})


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
