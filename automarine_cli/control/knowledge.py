"""What is known of a vehicle from a model's file or a diagnosis, and what both leave open."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.control.actuators import needs_columns
from automarine_cli.control.members import UNKNOWN, Spread
from automarine_cli.errors import ModelError
from automarine_cli.models.store import StoredModels
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.plain_data import Source, read_plain
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
UNKNOWN_DELAY = 0.3
"""Longest delay [s] of a vehicle of which no diagnosis says how short one would have been seen."""
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
    moment of the logs or None, whether the delay is `guessed`, splits by rival, notes, and effects that the fit itself
    `proposed` and the model lacks, with the deviance that each gains."""

    stored: StoredModels
    explanations: tuple[Explanation, ...]
    spread: Spread
    largest: float | None
    guessed: bool
    splits: Mapping[str, str]
    notes: tuple[str, ...]
    proposed: Mapping[str, float] = field(default_factory=dict)

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
    main = Explanation(known.model, _covariance(known, known.model, data), "the model as it was named")
    bare = known.stored.models[known.stored.preferred]
    largest = _largest(data)
    others = [_rival(known, main, doubt.effect, doubt.rival, largest or 1.0) for doubt in known.doubts]
    if len(bare.terms) < len(known.model.terms):
        names = [term.name for term in known.model.terms if term not in bare.terms and not term.own]
        others.append(
            Explanation(bare, _covariance(known, bare, data), f"the model without {', '.join(names)}", names[0])
        )
    late, guessed, note = _late(known.model, said, delay)
    logged = next((term.values[1] for term in known.model.terms if term.name == "voltage-exponent"), 1.0)
    volts = (logged, supply[0] * logged, supply[1] * logged)
    scatter = SCATTER if known.scatter is None else known.scatter
    spread = Spread(np.zeros((0, 0)), scatter, late, volts, _noise(known))
    have = {term.name for term in known.model.terms} | ({"input-delay"} if delay is not None else set())
    proposed = {name: gain for name, gain in known.proposed.items() if name not in have}
    without = (
        f"Without {effect}: it acts by the column {column!r}, which no controller has; the gains are for the rest."
        for effect, column in needs_columns([term.name for term in bare.terms])
    )
    told = (one for one in (*known.notes, note) if one and one != NO_RIVALS and "planned runs" not in one)
    notes = (*without, *told)
    return Knowledge(known.stored, (main, *others), spread, largest, guessed, _splits(said), notes, proposed)


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


def _covariance(known: PriorResults, model: YawModel, data: Mapping[str, object]) -> Floats:
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
    most = np.where(added, FAINT * _sizes(model), np.inf)
    share = np.minimum(most / np.maximum(np.sqrt(np.diagonal(found)), 1e-300), 1.0)
    found = found * np.outer(share, share)
    fitted = np.diagonal(found) > 0
    return found + np.diag(np.where(fitted, (OWN_LAWS * model.theta) ** 2, 0.0))


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
    """The longest delay beyond the model's, whether it is a guess, and a sentence on it."""
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
    return UNKNOWN_DELAY, True, f"Nothing says how late the vehicle answers: up to {UNKNOWN_DELAY:g} s are allowed for."


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
