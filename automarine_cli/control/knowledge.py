"""What is known of a vehicle from a model's file or a diagnosis, what both leave open, what the whole output gives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.control.targets.base import Target
from automarine_cli.control.vehicles import Spread
from automarine_cli.errors import ModelError, SettingError
from automarine_cli.models.model import DELAY, Model
from automarine_cli.models.store import DiagnosisFile, ModelFile, StoredModels
from automarine_cli.pipeline.records import Source
from automarine_cli.planning.campaign import fitting_of
from automarine_cli.planning.candidates import Limits, paper_grid
from automarine_cli.planning.information import NO_RIVALS, PriorResults, lacking, read_prior_results
from automarine_cli.planning.rivals import closest, with_effect, without
from automarine_cli.quantities import STEERED, Floats
from automarine_cli.text import printable
from automarine_cli.thrusters.map import ThrusterMap, TwinThrusters

LATE_EFFECTS = (DELAY, "thruster-lag", "sensor-lag")  # effects that make a vehicle answer late
WILD_SCATTER, WILD_EXPONENT = 0.25, 0.1  # from which on the thrust is not known: fits allow a scatter of 0.3
MAX_DEAD_BAND_SHARE = 0.1  # of the whole output: Blue Robotics T200 data (2019), 7 to 10 %
CURVE_EFFECTS = ("dead-band", "thrust-exponent")  # what the curve of the thrust against its command is made of
LAW_ERROR_SHARE = 0.03  # of parameters beyond their errors: no vehicle follows a law to the letter
MAX_STDERR = 0.5  # of an effect, as a share of its size: of what is less sure a diagnosis says nothing
UNKNOWN_ERROR_SHARE = 0.1  # standard error, as a share, of a parameter of which the file tells none
MAX_RUDDER_DEG = 90.0  # no rudder goes further
EXTENDED = "extended_model.json"
SUPPLY_SHARES = (0.88, 1.08)  # lowest and highest voltage in shares of that of the logs: four lithium cells about 15 V
OUTPUT_TOLERANCE = 1.02  # how far beyond the whole output moments of a log may seem to go
UNKNOWN_DELAY = (
    "How late the vehicle answers is not known: the model's file has no command_delay_s. Fit its logs again, or give "
    "--delay."
)


@dataclass(frozen=True)
class Explanation:
    """One model that the logs allow; `instead` of which effect it has which other, empty for what was named."""

    model: Model
    covariance: Floats
    name: str
    instead: str = ""


@dataclass(frozen=True)
class Knowledge:
    """The stored model, every explanation (the named one first), what is uncertain, `largest` moment of the logs,
    splits by rival, notes; what has to be `settled` before any promise: a sentence and the effect; and of what is
    steered the `speed` [m/s] and `side` of `PriorResults`."""

    stored: StoredModels
    explanations: tuple[Explanation, ...]
    spread: Spread
    largest: float | None
    splits: Mapping[str, str]
    notes: tuple[str, ...]
    settled: tuple[str, str] | None = None
    speed: float | None = None
    side: int | None = None

    @property
    def model(self) -> Model:
        return self.explanations[0].model


def read_knowledge(
    model: Source, diagnosis: Source | None, delay: float | None, supply: tuple[float, float]
) -> Knowledge:
    """Read the files; `delay` [s] is the longest that the logs cannot show, where the user knows better. Raises
    ModelError for a file that is none, and for drag that drives."""
    prior = read_prior_results(model, diagnosis)
    file, judged, stored = prior.file, prior.diagnosis, prior.stored
    assert file is not None
    if prior.command_delay > 0.0:  # a logger that is late itself gives the controller nothing
        estimate = file.command_delay_s.estimate if file.command_delay_s else None
        now = {**prior.now, **({f"{DELAY} t_d": estimate} if estimate else {})}
        prior = replace(prior, model=prior.model.delayed(prior.command_delay), now=now)
    unit, steered = float(prior.model.dof.shown(1.0)), stored.model.moment_unit == STEERED
    symbols, (linear, quadratic) = prior.model.dof.symbols, prior.model.drag()
    for symbol, value in ((symbols.linear, linear), (symbols.quadratic, quadratic)):
        if value < 0 and not (symbol == symbols.linear and steered):  # ships are often unstable on their course
            raise ModelError(
                f"{printable(model.name)}: {symbol} is {value:.4g}, drag that drives the vehicle; expected zero or "
                "more: fit again with more runs, or prefer another of the file's models"
            )
    main = Explanation(prior.model, _covariance(prior, prior.model), "the model as it was named")
    bare = stored.models[stored.preferred] if stored.command_delay > 0.0 else stored.undelayed
    largest = max(map(abs, file.force_range)) if file.force_range else None
    models = [_rival(prior, main, doubt.effect, doubt.rival, largest or 1.0) for doubt in prior.doubts]
    present = {term.name for term in prior.model.terms} | ({DELAY} if delay is not None else set())
    had = {term.name for term in bare.terms}
    if names := [term.name for term in prior.model.terms if term.name not in had]:
        models.append(Explanation(bare, _covariance(prior, bare), f"the model without {', '.join(names)}", names[0]))
    models += _idle(main, judged, largest or 1.0)
    late, note = _late(prior, judged, delay)
    logged = next((term.values[1] for term in prior.model.terms if term.name == "voltage-exponent"), 1.0)
    volts = (logged, supply[0] * logged, supply[1] * logged)
    noise = (prior.noise_deg / unit, (prior.rate_noise_deg_s or 0.0) / unit)
    spread = Spread(prior.scatter, late or 0.0, volts, noise)
    without = [
        f"Without {term.name}: it acts by the column {column!r}, which no controller has; the gains are for the rest."
        for term in bare.terms
        for column in lacking(term.name, stored.model.moment_unit)[:1]
    ]
    noted = (note for note in (*prior.notes, note) if note and note != NO_RIVALS and "planned runs" not in note)
    proposed = {name: gain for name, gain in prior.proposed.items() if name not in present}
    settled = _unsettled_thrust(prior, file) or ((UNKNOWN_DELAY, DELAY) if late is None else None)
    if proposed:
        asks = " and ".join(f"{name} ({gain:.0f} in deviance)" for name, gain in proposed.items())
        why = f"The fit's own evidence asks for {asks}, which the model lacks. Fit it with --with {','.join(proposed)}"
        settled = f"{why}, and tune that model.", next(iter(proposed))
    rivals = (rival for effect in (judged.effects if judged else ()) for rival in effect.rivals)
    splits = {rival.name: rival.split_by for rival in rivals}
    notes = (*without, *noted, *([_of_speed(prior)] if steered else []))
    return Knowledge(stored, (main, *models), spread, largest, splits, notes, settled, prior.speed, prior.side)


def _of_speed(prior: PriorResults) -> str:
    """At which speed a rudder's gains hold, and which way it turns. Raises ModelError for an effect without a speed."""
    needy = [term.name for term in prior.model.terms if "surge" in effects.get(term.name).needs]
    if needy and prior.speed is None:
        raise ModelError(
            f"{prior.stored.source}: {needy[0]} needs the speed, and no nomoto.speed_m_s is in it; fit again"
        )
    speed = "a constant speed, that of the logs" if prior.speed is None else f"{prior.speed:.3g} m/s, the logs' mean"
    turns = {1: "positive rudder turns to starboard", -1: "positive rudder turns to port"}.get(prior.side or 0)
    return f"The promise is for {speed}; an output of 1 turns to starboard{f', {turns}' if turns else ''}."


def _unsettled_thrust(prior: PriorResults, file: ModelFile) -> tuple[str, str] | None:
    """Why the thrust is not known well enough for promises: its wild scatter, or a curve that the model lacks."""
    power = file.gain_exponent
    low, high = power.ci95 if power and power.ci95 else (0.0, 0.0)
    if low > WILD_EXPONENT or high < -WILD_EXPONENT:
        why = "The gain of the thrust goes with the size of the command, as with a dead-band or a curve of the thrust"
    elif prior.scatter >= WILD_SCATTER:
        why = f"The thrust seems to scatter by {100 * prior.scatter:.0f} % from run to run, more than thrusters do"
    else:
        return None
    names = {term.name for term in prior.model.terms}
    effect = next((name for name in CURVE_EFFECTS if name not in names), CURVE_EFFECTS[0])
    remedy = "diagnose its logs, with runs of small commands among them."
    return f"{why}. Such a vehicle may oscillate without end: {remedy}", effect


def _idle(main: Explanation, judged: DiagnosisFile | None, largest: float) -> list[Explanation]:
    """The model with the widest dead-band that logs would not have shown, where a curve may hide one about rest."""
    names = {term.name for term in main.model.terms}
    if "thrust-exponent" not in names or "dead-band" in names:
        return []
    visible = judged.smallest_visible.get("dead-band", np.inf) if judged else np.inf
    width = min(visible, MAX_DEAD_BAND_SHARE * largest)
    model = main.model.with_effect("dead-band", (width, 0.0, 0.5))
    covariance = _moved(main, model, main.model.parameter_names)
    return [Explanation(model, covariance, f"a dead-band of {width:.2g}, which the logs allow", "dead-band")]


def _moved(main: Explanation, model: Model, names: Sequence[str]) -> Floats:
    """The covariance of these parameters, in the places that they have in another model; zero elsewhere."""
    covariance = np.zeros((len(model.theta), len(model.theta)))
    there, before = ([owner.parameter_names.index(name) for name in names] for owner in (model, main.model))
    covariance[np.ix_(there, there)] = main.covariance[np.ix_(before, before)]
    return covariance


def _covariance(prior: PriorResults, model: Model) -> Floats:
    """Covariance of theta (p, p): the file's own, and standard errors where it says no more."""
    covariance = np.diag([_error(prior, model, k) ** 2 for k in range(len(model.theta))])
    if prior.file is not None and (stored := prior.file.chosen.covariance) is not None:
        there = [k for k, name in enumerate(model.short_names) if name in stored.parameters]
        rows = [stored.parameters.index(model.short_names[k]) for k in there]
        covariance[np.ix_(there, there)] = np.array(stored.matrix)[np.ix_(rows, rows)]
    added = [name.partition(".")[0] in prior.stored.effects for name in model.parameter_names]
    free = np.count_nonzero(np.diagonal(covariance)[added])
    most = np.where(added, (_faint(prior.diagnosis) if free == 1 else MAX_STDERR) * _sizes(model), np.inf)
    share = np.minimum(most / np.maximum(np.sqrt(np.diagonal(covariance)), 1e-300), 1.0)
    covariance = covariance * np.outer(share, share)
    return covariance + np.diag(np.where(np.diagonal(covariance) > 0, (LAW_ERROR_SHARE * model.theta) ** 2, 0.0))


def _faint(judged: DiagnosisFile | None) -> float:
    """Largest standard error of a size that was named alone, as a share of it: less than half where it gained far more
    than chance does, for one that is off by all of itself loses all that it gained."""
    if judged is None or judged.threshold is None:
        return MAX_STDERR
    names = [effect.name for effect in judged.effects]
    gain = max((trial.gain for trial in judged.candidates if [trial.name] == names), default=0.0)
    return min(MAX_STDERR, (judged.threshold / gain) ** 0.5) if gain > 0.0 else MAX_STDERR


def _error(prior: PriorResults, model: Model, place: int) -> float:
    effect, _, label = model.parameter_names[place].partition(".")
    estimate = prior.now.get(label) or prior.now.get(f"{effect} {label}")
    if estimate is not None and estimate.stderr >= 0:
        return estimate.stderr
    return UNKNOWN_ERROR_SHARE * abs(float(model.theta[place])) if place < 3 and effect == model.dof.name else 0.0


def _rival(prior: PriorResults, main: Explanation, effect: str, rival: str, largest: float) -> Explanation:
    """The model with another effect in the place of the one that was named, as like it as it can be."""
    fitting = fitting_of(prior, Limits())
    grid = paper_grid(fitting.base, largest)[::3]
    starts = with_effect(fitting, without(prior.model, effect), rival, largest)
    nearest, _ = closest(replace(fitting, fit="diagnosis"), starts, grid)
    model, names = nearest.model, [n for n in main.model.parameter_names if not n.startswith(f"{effect}.")]
    covariance = _moved(main, model, names)
    errors = zip(main.model.parameter_names, _sizes(main.model), np.sqrt(np.diagonal(main.covariance)))
    share = min([MAX_STDERR, *(error / size for name, size, error in errors if name not in names and error * size > 0)])
    new = [name not in names for name in model.parameter_names]
    covariance += np.diag(np.where(new, (share * _sizes(model)) ** 2, 0.0))
    return Explanation(model, covariance, f"{rival} in the place of {effect}", rival)


def _sizes(model: Model) -> Floats:
    """How far the values of theta (p,) are from doing nothing; zero for what is not fitted."""
    parameters = [parameter for term in model.terms for parameter in effects.get(term.name).parameters]
    off = np.nan_to_num(np.array([0.0, *(p.off for p in parameters)]), posinf=0.0, neginf=0.0)
    return np.where([False, *(p.held for p in parameters)], 0.0, np.abs(model.theta - off))


def _late(prior: PriorResults, judged: DiagnosisFile | None, delay: float | None) -> tuple[float | None, str]:
    """The longest delay beyond the model's, None where nothing is known of it, and a sentence on it."""
    if delay is not None:
        return delay, f"The gains allow for delays up to {delay:g} s beyond the model's (--delay)."
    # A diagnosis confines the delay to half a sample interval: a longer one it shows only as an effect.
    fitted = judged is None and prior.file is not None and prior.file.command_delay_s is not None
    if fitted or any(term.name in LATE_EFFECTS for term in prior.model.terms):
        return 0.0, ""
    visible = judged.smallest_visible if judged else {}
    late = max((visible[name] for name in LATE_EFFECTS[:2] if name in visible), default=None)
    if late is None:
        return None, ""
    return late, f"The gains allow for delays up to {late:.2g} s. The diagnosis would have detected longer ones."


def authority(
    target: Target, knowledge: Knowledge, full: float | None, drive: tuple[ThrusterMap, float] | None
) -> tuple[float, TwinThrusters | None]:
    """Return the moment or force at the whole output in the model's unit, and the map from output to it if there is
    one.

    Raises ModelError for a unit or a map that does not fit the model, and SettingError for a map of one direction."""
    unit, source, dof = knowledge.stored.model.moment_unit, knowledge.stored.source, knowledge.model.dof
    if unit == STEERED:
        return _rudder(target, knowledge, full, drive is not None), None
    twins = None if drive is None else turning(*drive)
    most = None if twins is None else twins.largest
    if full is None and most is not None and unit != "nu":
        full = most
    if full is None and unit == "nu":
        if knowledge.largest is not None and knowledge.largest > OUTPUT_TOLERANCE:
            raise ModelError(
                f"{source}: its {dof.words.force}s reach {knowledge.largest:g} nu, which is no output of "
                f"{target.name}, from -1 to 1; give --full with the {dof.words.force} [nu] of the whole output"
            )
        full = 1.0
    if full is None:
        also = " or --thrusters MAP.json and --arm METRES" if dof.levered else ""
        raise ModelError(
            f"{source}: its {dof.words.force}s are in {unit}, and {target.name} commands outputs from -1 to 1; give "
            f"--full with the {dof.words.force} [{unit}] of the whole output{also}"
        )
    if knowledge.largest is not None and full < knowledge.largest / 1.25:
        giver = "the thruster map gives" if most is not None and full == most else "--full is"
        raise ModelError(
            f"{source}: it was fitted to {dof.words.force}s up to {knowledge.largest:.4g} {unit}, and {giver} "
            f"{full:.4g} {unit} at the whole output; give the map and the arm of the thrusters of these logs"
        )
    if most is not None and unit != "nu" and abs(full / most - 1.0) > 0.1:
        raise ModelError(
            f"{source}: --full is {full:.4g} {unit}, and the thruster map gives {most:.4g} {unit} at the whole output; "
            "leave out one of them"
        )
    return full, twins and twins.scaled_to(full)


def _rudder(target: Target, knowledge: Knowledge, full: float | None, mapped: bool) -> float:
    """The angle [rad] of the rudder at the whole output, of `full` degrees."""
    logged, source = np.rad2deg(knowledge.largest or 0.0), knowledge.stored.source
    if mapped or not target.rudder:
        other = "--thrusters" if mapped else target.name
        raise SettingError(f"{source} is a model of a rudder, and {other} is for thrusters; leave it out")
    if full is None or not max(logged / OUTPUT_TOLERANCE, 1.0) <= full <= MAX_RUDDER_DEG:
        values = "is not given" if full is None else f"is {full:g}"
        raise SettingError(
            f"{source} is a model of a rudder and --full {values}; give the rudder angle of the whole output in "
            f"degrees, from the {logged:.3g} of the logs to {MAX_RUDDER_DEG:g}"
        )
    return float(np.deg2rad(full))


def turning(thruster_map: ThrusterMap, arm: float) -> TwinThrusters:
    """Return two thrusters `arm` [m] off the centre line at the same size of signal, at most 1 or the largest that the
    map tells of. Raises SettingError for a map without thrust there."""
    twins = TwinThrusters(*thruster_map.both_ways, arm, max(thruster_map.largest or 1.0, 1.0))
    if not twins.largest > 0:
        raise SettingError(
            "the thruster map gives no thrust at the whole output; give a map whose control signal goes from -1 to 1, "
            "or that says how far it was measured (fit it again)"
        )
    return twins
