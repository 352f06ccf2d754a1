"""What is known of a vehicle from a model's file or a diagnosis, and what both leave open."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.control.actuators import needs_columns
from automarine_cli.control.members import UNKNOWN, Spread
from automarine_cli.errors import ModelError
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.records import Source, read_plain
from automarine_cli.pipeline.words import printable
from automarine_cli.planning.campaign import fitting_of
from automarine_cli.planning.candidates import paper_grid
from automarine_cli.planning.limits import Limits
from automarine_cli.planning.prior_results import NO_RIVALS, NOISE_DEG, SCATTER, PriorResults, read_prior_results
from automarine_cli.planning.rivals import closest, with_effect
from automarine_cli.quantities import Floats
from automarine_cli.results.kinds import DIAGNOSIS

LATE = ("input-delay", "thruster-lag", "sensor-lag")
"""Effects that make a vehicle answer late."""
WILD, CURVED = 0.25, 0.1
"""Scatter of the thrust from run to run, and power of the command's size that it goes with, from which on the thrust is
not known: fits take no more than 0.3 for scatter."""
IDLE = 0.1
"""Share of the whole output below which thrusters give nothing where nobody looked: Blue Robotics T200 performance data
(2019), 7 to 10 %."""
CURVE = ("dead-band", "thrust-exponent")
"""What the curve of the thrust against its command is made of."""
OWN_LAWS = 0.03
"""Share by which parameters are off beyond their errors: no vehicle follows the laws of a library to the letter."""
FAINT = 0.5
"""Largest standard error of an effect, as a share of its size: of what is less sure a diagnosis says nothing."""
EXTENDED = "extended_model.json"
SUPPLY = (0.88, 1.08)
"""Voltage of the supply, lowest and highest, in shares of that of the logs: four lithium cells about 15 V."""


@dataclass(frozen=True)
class Explanation:
    """One model that the logs allow; `instead` of which effect it has which other, empty for what was named."""

    model: YawModel
    covariance: Floats
    name: str
    instead: str = ""


@dataclass(frozen=True)
class Knowledge:
    """The stored model, every explanation (the named one first), how uncertain thrust, delay and supply are, `largest`
    moment of the logs or None, splits by rival, notes; and what has to be `settled` before anything can be promised: a
    sentence and the effect to be settled, or None."""

    stored: StoredModels
    explanations: tuple[Explanation, ...]
    spread: Spread
    largest: float | None
    splits: Mapping[str, str]
    notes: tuple[str, ...]
    settled: tuple[str, str] | None = None

    @property
    def model(self) -> YawModel:
        """The model as it was named."""
        return self.explanations[0].model


def is_diagnosis(source: Source) -> bool:
    """Whether a file is a diagnosis."""
    return read_plain(source, "JSON", ModelError).get("schema") == DIAGNOSIS.schema


def read_knowledge(
    model: Source, diagnosis: Source | None, delay: float | None, supply: tuple[float, float]
) -> Knowledge:
    """What the files say; `delay` [s] is the longest that the logs cannot show, where the user knows better.

    Raises ModelError for a file that is none, for drag that drives, and for an effect that no controller can be
    designed with.
    """
    data = read_plain(model, "JSON", ModelError)
    known = read_prior_results(model, diagnosis)
    name = printable(model.name)
    said = {} if diagnosis is None else read_plain(diagnosis, "JSON", ModelError)
    _refuse(known.model, name, known)
    main = Explanation(known.model, _covariance(known, known.model, data, said), "the model as it was named")
    bare = known.stored.models[known.stored.preferred]
    largest = _largest(data)
    others = [_rival(known, main, doubt.effect, doubt.rival, largest or 1.0) for doubt in known.doubts]
    if len(bare.terms) < len(known.model.terms):
        names = [term.name for term in known.model.terms if term not in bare.terms and not term.own]
        others.append(
            Explanation(bare, _covariance(known, bare, data, said), f"the model without {', '.join(names)}", names[0])
        )
    others += _idle(main, said, largest or 1.0)
    late, unknown, note = _late(known.model, said, delay)
    logged = next((term.values[1] for term in known.model.terms if term.name == "voltage-exponent"), 1.0)
    volts = (logged, supply[0] * logged, supply[1] * logged)
    scatter = SCATTER if known.scatter is None else known.scatter
    heavy = 0.0 if any(term.name in LATE for term in known.model.terms) else _inflated(known.model, largest or 1.0)
    spread = Spread(np.zeros((0, 0)), scatter, late, volts, _noise(known), heavy)
    without = (
        f"Without {effect}: it acts by the column {column!r}, which no controller has; the gains are for the rest."
        for effect, column in needs_columns([term.name for term in bare.terms])
    )
    told = (note for note in (*known.notes, note) if note and note != NO_RIVALS and "planned runs" not in note)
    have = {term.name for term in known.model.terms} | ({LATE[0]} if delay is not None else set())
    proposed = {name: gain for name, gain in known.proposed.items() if name not in have}
    settled = _proposed(proposed) or _unsettled_thrust(known, data) or ((UNDIAGNOSED, LATE[0]) if unknown else None)
    return Knowledge(known.stored, (main, *others), spread, largest, _splits(said), (*without, *told), settled)


UNDIAGNOSED = (
    "How late the vehicle answers is not known, and an unknown delay inflates the fitted inertia. Diagnose the logs "
    "(automarine diagnose) and tune its diagnosis.json, or give --delay."
)


def _proposed(proposed: Mapping[str, float]) -> tuple[str, str] | None:
    """What the fit's own evidence asks for beside the model."""
    if not proposed:
        return None
    names = " and ".join(f"{name} ({gain:.0f} in deviance)" for name, gain in proposed.items())
    why = (
        f"The fit's own evidence asks for {names}, which the model lacks. Fit it with --with {','.join(proposed)}, and "
        "tune that model."
    )
    return why, next(iter(proposed))


def _unsettled_thrust(known: PriorResults, data: Mapping[str, object]) -> tuple[str, str] | None:
    """Why the thrust is not known well enough for promises: it scatters as no thruster does, or goes with the size of
    the command as the model does not say."""
    power = data.get("gain_exponent")
    low, high = power["ci95"] if isinstance(power, Mapping) else (0.0, 0.0)
    if low > CURVED or high < -CURVED:
        why = "The gain of the thrust goes with the size of the command, as with a dead-band or a curve of the thrust"
    elif known.scatter is not None and known.scatter >= WILD:
        why = f"The thrust seems to scatter by {known.scatter:.0%} from run to run, more than thrusters do"
    else:
        return None
    named = {term.name for term in known.model.terms}
    effect = next((name for name in CURVE if name not in named), CURVE[0])
    return f"{why}. Such a vehicle may hunt for ever: {_REMEDY}", effect


_REMEDY = "diagnose its logs, with runs of small commands among them."


def _idle(main: Explanation, said: Mapping[str, object], largest: float) -> list[Explanation]:
    """The model with the widest dead-band that the logs would not have shown, where its thrust is a curve: nearly flat
    about rest, such a curve hides one."""
    names = {term.name for term in main.model.terms}
    if "thrust-exponent" not in names or "dead-band" in names:
        return []
    seen = said.get("smallest_visible")
    width = seen.get("dead-band") if isinstance(seen, Mapping) else None
    width = min(float(width), IDLE * largest) if isinstance(width, int | float) else IDLE * largest
    model = main.model.with_effect("dead-band", (width, 0.0, 0.5))
    covariance = np.zeros((len(model.theta), len(model.theta)))
    there = [model.parameter_names.index(name) for name in main.model.parameter_names]
    covariance[np.ix_(there, there)] = main.covariance
    return [Explanation(model, covariance, f"a dead-band of {width:.2g}, which the logs allow", "dead-band")]


def _inflated(model: YawModel, largest: float) -> float:
    """By how much a delay that no model has inflates the inertia of steps, per second of it: sqrt(k tau)/ln 2 to first
    order, tau half the largest moment."""
    _, quadratic = model.drag()
    return float(np.sqrt(quadratic * 0.5 * largest) / np.log(2.0))


def _noise(known: PriorResults) -> tuple[float, float]:
    """Noise of the readings of position and velocity [base units]: as the fit found it; of a position of which the file
    does not say, one of the units that people read."""
    sizes = (known.noise_deg or NOISE_DEG, known.rate_noise_deg_s or 0.0)
    unit = float(known.model.dof.shown(1.0))
    return sizes[0] / unit, sizes[1] / unit


def _refuse(model: YawModel, name: str, known: PriorResults) -> None:
    linear, quadratic = model.drag()
    own = model.dof.symbols
    for symbol, value in ((own.linear, linear), (own.quadratic, quadratic)):
        if value < 0:
            raise ModelError(
                f"{name}: {symbol} is {value:.4g}, drag that drives the vehicle; expected zero or more: fit again with "
                "more runs, or prefer another of the file's models"
            )


def _covariance(known: PriorResults, model: YawModel, data: Mapping[str, object], said: Mapping[str, object]) -> Floats:
    """Covariance of theta (p, p): the file's own, and standard errors where it says no more."""
    names, size = model.short_names, len(model.theta)
    found = np.diag([_error(known, model, k) ** 2 for k in range(size)])
    held = _stored_covariance(data, known.stored.preferred)
    if held is not None:
        order, matrix = held
        there = [k for k, one in enumerate(names) if one in order]
        rows = [order.index(names[k]) for k in there]
        found[np.ix_(there, there)] = matrix[np.ix_(rows, rows)]
    added = [name.partition(".")[0] in known.stored.effects for name in model.parameter_names]
    free = np.count_nonzero(np.diagonal(found)[added])
    most = np.where(added, (_faint(said) if free == 1 else FAINT) * _sizes(model), np.inf)
    share = np.minimum(most / np.maximum(np.sqrt(np.diagonal(found)), 1e-300), 1.0)
    found = found * np.outer(share, share)
    fitted = np.diagonal(found) > 0
    return found + np.diag(np.where(fitted, (OWN_LAWS * model.theta) ** 2, 0.0))


def _faint(said: Mapping[str, object]) -> float:
    """Largest standard error of the size that a diagnosis named alone, as a share of it: half of it, and less where it
    gained far more than chance does, for a size that is off by all of itself loses all that it gained."""
    effects, threshold, tried = (said.get(key) for key in ("effects", "threshold", "candidates"))
    if not (isinstance(effects, list) and isinstance(tried, list) and isinstance(threshold, float)):
        return FAINT
    names = [one.get("name") for one in effects]
    gain = max((float(one["gain"]) for one in tried if [one["name"]] == names), default=0.0)
    return min(FAINT, (threshold / gain) ** 0.5) if gain > 0.0 else FAINT


def _error(known: PriorResults, model: YawModel, place: int) -> float:
    """Standard error of one parameter of theta."""
    value = float(model.theta[place])
    label = model.parameter_names[place].partition(".")[2]
    effect = model.parameter_names[place].partition(".")[0]
    one = known.now.get(label) or known.now.get(f"{effect} {label}")
    if one is not None and one.stderr >= 0:
        return one.stderr
    return UNKNOWN * abs(value) if place < 3 and effect == model.dof.name else 0.0


def _stored_covariance(data: Mapping[str, object], number: str) -> tuple[list[str], Floats] | None:
    """Names and matrix as the file has them, or None."""
    here: object = data
    for key in ("models", number, "output_error", "covariance"):
        here = here.get(key) if isinstance(here, Mapping) else None
    if not isinstance(here, Mapping):
        return None
    names, matrix = here.get("parameters"), np.array(here.get("matrix"), dtype=np.float64)
    if not isinstance(names, list) or matrix.shape != (len(names), len(names)):
        return None
    return [str(one) for one in names], matrix


def _rival(known: PriorResults, main: Explanation, effect: str, rival: str, largest: float) -> Explanation:
    """The model with another effect in the place of the one that was named, as like it as it can be."""
    fitting = fitting_of(known, Limits())
    grid = paper_grid(fitting.base, largest)[:24:3]
    bare = replace(known.model, terms=tuple(term for term in known.model.terms if term.name != effect))
    found, _ = closest(replace(fitting, fit="diagnosis"), with_effect(fitting, bare, rival, largest), grid)
    model, kept = found.model, [k for k, n in enumerate(main.model.parameter_names) if not n.startswith(f"{effect}.")]
    size = len(model.theta)
    covariance = np.zeros((size, size))
    there = [model.parameter_names.index(main.model.parameter_names[k]) for k in kept]
    covariance[np.ix_(there, there)] = main.covariance[np.ix_(kept, kept)]
    size_of, error_of = _sizes(main.model), np.sqrt(np.diagonal(main.covariance))
    known_by = [error_of[k] / size_of[k] for k in range(len(size_of)) if k not in kept and error_of[k] * size_of[k] > 0]
    share = min([*known_by, FAINT])
    covariance += np.diag([0.0 if k in there else (share * x) ** 2 for k, x in enumerate(_sizes(model))])
    return Explanation(model, covariance, f"{rival} in the place of {effect}", rival)


def _nothing(model: YawModel) -> Floats:
    """Values of theta (p,) at which its effects do nothing."""
    own = [parameter.off for term in model.terms for parameter in effects.get(term.name).parameters]
    return np.nan_to_num(np.array([0.0, *own]), posinf=0.0, neginf=0.0)


def _sizes(model: YawModel) -> Floats:
    """How far the values of theta (p,) are from doing nothing; zero for what is not fitted."""
    held = [parameter.held for term in model.terms for parameter in effects.get(term.name).parameters]
    return np.where([False, *held], 0.0, np.abs(model.theta - _nothing(model)))


def _late(model: YawModel, said: Mapping[str, object], delay: float | None) -> tuple[float, bool, str]:
    """The longest delay beyond the model's, whether nothing is known of it, and a sentence on it."""
    if delay is not None:
        return delay, False, f"Delays up to {delay:g} s beyond the model's are allowed for, as asked."
    if any(term.name in LATE for term in model.terms):
        return 0.0, False, ""
    seen = said.get("smallest_visible")
    sizes = [seen.get(name) for name in LATE[:2]] if isinstance(seen, Mapping) else []
    known = [float(one) for one in sizes if isinstance(one, int | float)]
    if known:
        late = max(known)
        return late, False, f"Delays up to {late:.2g} s are allowed for: longer ones the diagnosis would have seen."
    return 0.0, True, ""


def _largest(data: Mapping[str, object]) -> float | None:
    """Largest moment or force of the logs."""
    held = data.get("valid_range")
    ends = next(iter(held.values()), None) if isinstance(held, Mapping) else None
    return max(abs(float(end)) for end in ends) if isinstance(ends, list) and ends else None


def _splits(said: Mapping[str, object]) -> dict[str, str]:
    """The run that tells each rival apart, by rival."""
    found: dict[str, str] = {}
    effects = said.get("effects")
    for entry in effects if isinstance(effects, list) else ():
        for rival in entry.get("rivals") or ():
            found[str(rival.get("name"))] = str(rival.get("split_by", ""))
    return found
