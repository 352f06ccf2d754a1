"""What is known before the campaign: a model's estimates, its fit's noise and scatter, and what a diagnosis left
open."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from automarine_cli import effects
from automarine_cli.errors import ModelError
from automarine_cli.models.store import StoredModels, yaw_models_from_json
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.plain_data import Source, read_plain, told
from automarine_cli.pipeline.words import printable
from automarine_cli.planning.fitting import Fitting
from automarine_cli.planning.information import ANGLE, LOOSE, OFFSET, labels, names_of, relative_directions
from automarine_cli.quantities import Floats
from automarine_cli.results.estimate import Estimate

DIAGNOSIS = "automarine/diagnosis/1"
NOISE_DEG, SCATTER = 1.0, 0.03
"""Of a model whose file does not say: a compass in a pool, and the thrust of small motors."""
NO_RIVALS = "The diagnosis leaves no rivals open to split, so the runs are chosen to narrow the intervals."


@dataclass(frozen=True)
class Doubt:
    """An effect that a diagnosis named, and another that its runs cannot exclude."""

    effect: str
    rival: str


@dataclass(frozen=True)
class PriorResults:
    """The model with all that is believed to act, its estimates by label, the logs' noise [degrees] and scatter (None
    where the file does not say), how many runs were fitted, the doubts that are open, and the noise of a gyro that the
    fit rests on."""

    stored: StoredModels
    model: YawModel
    now: Mapping[str, Estimate]
    noise_deg: float | None
    scatter: float | None
    used: int
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()
    rate_noise_deg_s: float | None = None


@dataclass(frozen=True)
class Diagnosed:
    """What a diagnosis says: effects with their values, estimates by label, base values, doubts."""

    effects: tuple[tuple[str, tuple[float, ...]], ...]
    estimates: Mapping[str, Estimate]
    base: Mapping[str, Estimate] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()


def read_prior_results(model: Source, diagnosis: Source | None) -> PriorResults:
    """What the files say. Raises ModelError with file and key."""
    name = printable(model.name)
    data = read_plain(model, "JSON", ModelError)
    stored = yaw_models_from_json(data, name)
    chosen = stored.models[stored.preferred]
    now = _stored_estimates(data, stored)
    noise, scatter = (data.get(f"{stored.dof.words.position}_noise_{stored.dof.units.key}"), data.get("gain_scatter"))
    runs = data.get("runs")
    used = runs.get("used") if isinstance(runs, Mapping) else None
    spread = scatter.get("value") if isinstance(scatter, Mapping) else scatter
    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    if diagnosis is not None:
        found = _read_diagnosis(diagnosis, stored)
        added = [(effect, values) for effect, values in found.effects if effect not in stored.effects]
        if added and found.base:
            at = [found.base[n].value if n in found.base else v for n, v in zip(chosen.short_names, chosen.theta)]
            chosen = chosen.with_theta(at)
        for effect, values in added:
            chosen = chosen.with_effect(effect, values)
        now = {**now, **(found.base if added else {}), **found.estimates}
        if added:
            now.pop(ANGLE, None)
        doubts = tuple(one for one in found.doubts if not _lacking(one.rival))
        notes = tuple(
            f"{one.rival} is left open: it needs the column {_lacking(one.rival)[0]!r}, which planned runs do not have."
            for one in found.doubts
            if one not in doubts
        )
        if not doubts:
            notes = (*notes, NO_RIVALS)
    for term in chosen.terms:
        if _lacking(term.name):
            raise ModelError(
                f"{name}: {term.name} needs the column {_lacking(term.name)[0]!r}, which planned runs do not have; "
                "plan from the model without it"
            )
    return PriorResults(
        stored, chosen, now, _size(noise), _size(spread), used if isinstance(used, int) else 0, doubts, notes,
        _noise_of(data.get("channels"), stored.dof.velocity),
    )  # fmt: skip


def covariance_now(fitting: Fitting, now: Mapping[str, Estimate]) -> Floats | None:
    """Covariance of the search's coordinates as the model's file tells it, (p, p) with the offset left open; None
    where a parameter has no standard error.

    Files hold no correlations; that of inertia and quadratic drag follows from the interval of their ratio.
    """
    names = [name for name in names_of(fitting) if name != OFFSET]
    logs = dict(zip((*labels(fitting), OFFSET), fitting.on_log))
    if any(name not in now or not now[name].stderr > 0 for name in names):
        return None
    size = {n: now[n].stderr / (abs(now[n].value) if logs[n] else 1.0) for n in names}
    covariance = np.diag([size[n] ** 2 for n in names])
    own = fitting.model.dof.symbols
    if ANGLE in now and own.quadratic in names:
        i, k = names.index(own.inertia), names.index(own.quadratic)
        relative = now[ANGLE].stderr / now[ANGLE].value
        shared = 0.5 * (size[own.inertia] ** 2 + size[own.quadratic] ** 2 - relative**2)
        most = 0.999 * size[own.inertia] * size[own.quadratic]
        covariance[i, k] = covariance[k, i] = float(np.clip(shared, -most, most))
    return covariance


def information_now(fitting: Fitting, now: Mapping[str, Estimate], use: bool) -> Floats:
    """Information (p, p) before the campaign: the earlier runs' if they are to be `use`d and known, else next to
    none."""
    values = np.append(fitting.model.theta, 0.3)
    free = dict(zip((*labels(fitting), OFFSET), zip(values, fitting.on_log)))
    sizes = [1.0 if on else max(abs(value), 1e-3) for value, on in (free[name] for name in names_of(fitting))]
    loose = np.diag(1.0 / (LOOSE * np.array(sizes)) ** 2)
    loose[-1, -1] = 1.0
    covariance = covariance_now(fitting, now) if use else None
    if covariance is not None:
        loose[:-1, :-1] += np.linalg.inv(covariance)
    return loose


def wanted_directions(fitting: Fitting, names: tuple[str, ...]) -> Floats:
    """The directions (p, m) whose intervals count, in shares of the parameters: of `names`, or of every parameter.

    Raises ModelError for another name.
    """
    known = relative_directions(fitting)
    for name in names:
        if name not in known:
            raise ModelError(f"the model has no parameter {name!r} to plan for; it has {', '.join(known)}")
    return np.stack([known[name] for name in names or [n for n in known if n != ANGLE]], axis=1)


def _noise_of(channels: object, quantity: str) -> float | None:
    """The noise of a sensor that a file says it rests on."""
    for one in channels if isinstance(channels, list) else ():
        if isinstance(one, Mapping) and one.get("quantity") == quantity and one.get("used") is True:
            noise = _estimate(one.get("noise"))
            return None if noise is None else _size(noise.value)
    return None


def _lacking(effect: str) -> list[str]:
    """Columns that an effect needs and planned runs do not have."""
    return [need for need in effects.get(effect).columns if need != "voltage"]


def _size(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) and value > 0 else None


def _estimate(data: object) -> Estimate | None:
    """An estimate of a result file, or None where it is a plain number or nothing."""
    if not isinstance(data, Mapping):
        return None
    numbers = [data.get("value"), data.get("stderr")]
    ends, unit = data.get("ci95"), data.get("unit")
    if not (isinstance(ends, list) and len(ends) == 2 and isinstance(unit, str)):
        return None
    if any(isinstance(one, bool) or not isinstance(one, int | float) for one in (*numbers, *ends)):
        return None
    return Estimate(float(numbers[0]), float(numbers[1]), (float(ends[0]), float(ends[1])), unit)  # type: ignore[arg-type]


def _some(found: Mapping[str, Estimate | None]) -> dict[str, Estimate]:
    return {name: one for name, one in found.items() if one is not None}


def _stored_estimates(data: Mapping[str, object], stored: StoredModels) -> dict[str, Estimate]:
    """Estimates of the preferred model by label; a file written by hand may have none."""
    entry = data["models"][stored.preferred]  # type: ignore[index]
    dof, own = stored.dof, stored.dof.symbols
    found = {name: _estimate(entry.get(name)) for name in (own.inertia, own.quadratic, own.linear)}
    found[ANGLE] = _estimate(entry.get(dof.ratio_key) or data.get(dof.ratio_key))
    for effect in data.get("effects") or ():  # type: ignore[attr-defined]
        for name, one in effect["parameters"].items():
            found[f"{effect['name']} {name}"] = _estimate(one)
    return _some(found)


def _read_diagnosis(path: Source, stored: StoredModels) -> Diagnosed:
    where, force = printable(path.name), stored.dof.words.force
    data, key = read_plain(path, "JSON", ModelError), f"{force}_unit"
    if data.get("schema") != DIAGNOSIS or key not in data:
        raise ModelError(
            f"{where}: found {told(data.get('schema'))}, expected the diagnosis.json that `automarine diagnose` "
            f"writes of {stored.dof.name} runs"
        )
    if data[key] != stored.moment_unit:
        raise ModelError(
            f"{where}: a diagnosis of {force}s in {told(data[key])}, but {stored.source} is a model of {force}s in "
            f"{stored.moment_unit}; give the diagnosis of this model"
        )
    named, estimates, doubts = [], dict[str, Estimate | None](), []
    entries = data.get("effects")
    for i, entry in enumerate(entries if isinstance(entries, list) else ()):
        name = _effect_name(entry, f"{where}: effects[{i}]")
        given = entry.get("parameters") or {}
        values = []
        effect = effects.get(name)
        for key, parameter in zip(effect.names_in(stored.dof), effect.parameters):
            estimate = _estimate(given.get(key)) if isinstance(given, Mapping) else None
            if estimate is None and not parameter.optional:
                raise ModelError(f"{where}: effects[{i}].parameters: {key} has no value; expected an estimate")
            values.append(parameter.start if estimate is None else estimate.value)
            estimates[f"{name} {key}"] = estimate
        named.append((name, tuple(values)))
        for j, rival in enumerate(entry.get("rivals") or ()):
            doubts.append(Doubt(name, _effect_name(rival, f"{where}: effects[{i}].rivals[{j}]")))
    base = data.get("base")
    after = {
        str(name): _estimate(one.get("after")) for name, one in (base.items() if isinstance(base, Mapping) else ())
        if isinstance(one, Mapping)
    }  # fmt: skip
    return Diagnosed(tuple(named), _some(estimates), _some(after), tuple(doubts))


def _effect_name(entry: object, where: str) -> str:
    name = entry.get("name") if isinstance(entry, Mapping) else None
    if not isinstance(name, str) or name not in effects.names():
        raise ModelError(f"{where}: name: found {told(name)}, expected one of {', '.join(effects.names())}")
    return name
