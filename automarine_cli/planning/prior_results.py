"""What is known before the campaign: a model's estimates, its fit's noise and scatter, and what a diagnosis left
open."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automarine_cli import effects
from automarine_cli.effects.learned import PREFIX
from automarine_cli.errors import ModelError
from automarine_cli.estimate import Estimate, Given
from automarine_cli.models.store import StoredModels, file_and_models
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.records import Source, read_plain, told
from automarine_cli.pipeline.result_files import DIAGNOSIS, DiagnosisFile, ModelFile
from automarine_cli.pipeline.words import printable
from automarine_cli.planning.information import ANGLE, OFFSET, Fitting
from automarine_cli.quantities import Floats

NOISE_DEG, SCATTER = 1.0, 0.03  # where a model's file does not say: a compass in a pool, the thrust of small motors
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
    fit rests on; what is `random` in driven runs, by name, in base units, empty for a pool; effects that the fit
    `proposed` and no diagnosis has judged, with the deviance that each gains."""

    stored: StoredModels
    model: YawModel
    now: Mapping[str, Estimate]
    noise_deg: float | None
    scatter: float | None
    used: int
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()
    rate_noise_deg_s: float | None = None
    random: Mapping[str, float] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)
    file: ModelFile | None = None
    diagnosis: DiagnosisFile | None = None


def read_prior_results(model: Source, diagnosis: Source | None) -> PriorResults:
    """Read the files. Raises ModelError with file and key."""
    name = printable(model.name)
    file, stored = file_and_models(read_plain(model, "JSON", ModelError), name)
    chosen = stored.models[stored.preferred]
    entry, symbols = file.chosen, file.dof.symbols
    drag = {symbols.inertia: entry.inertia, symbols.quadratic: entry.quadratic, symbols.linear: entry.linear}
    added = {f"{effect.name} {n}": given for effect in file.effects for n, given in effect.parameters.items()}
    now = _some({**drag, ANGLE: entry.ratio or file.ratio, **added})
    spread = file.gain_scatter.value if file.gain_scatter else None
    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    judged = None
    if diagnosis is not None:
        judged, named, estimates, open_rivals = _read_diagnosis(diagnosis, stored)
        named = {effect: values for effect, values in named.items() if effect not in stored.effects}
        base = _some({name: moved.after for name, moved in judged.base.items()}) if named else {}
        if base:
            at = [base[n].value if n in base else v for n, v in zip(chosen.short_names, chosen.theta)]
            chosen = chosen.with_theta(at)
        for effect, values in named.items():
            chosen = chosen.with_effect(effect, values)
        now = {**now, **base, **estimates}
        if named:
            now.pop(ANGLE, None)
        doubts = tuple(doubt for doubt in open_rivals if not lacking(doubt.rival))
        notes = tuple(
            f"{doubt.rival} is left open: it needs the column {lacking(doubt.rival)[0]!r}, which planned runs do not "
            "have."
            for doubt in open_rivals
            if doubt not in doubts
        )
        if not doubts:
            notes = (*notes, NO_RIVALS)
    for term in (term for term in chosen.terms if lacking(term.name)):
        chosen = replace(chosen, terms=tuple(other for other in chosen.terms if other is not term))
        by = f"the column {lacking(term.name)[0]!r}"
        notes = (*notes, f"{term.name} is left out: it acts by {by}, which planned runs, on the spot, do not have.")
    rates = (sensor.noise for sensor in file.channels if sensor.used and sensor.quantity == stored.dof.velocity)
    rate = next((noise.value for noise in rates if noise is not None), None)
    random = {name: given.value for name, given in file.random.items() if given.value is not None}
    noise, scatter, rate = (value if value is not None and value > 0 else None for value in (file.noise, spread, rate))
    return PriorResults(
        stored, chosen, now, noise, scatter, file.runs.used, doubts, notes, rate, random,
        {} if diagnosis is not None else file.proposed, file, judged,
    )  # fmt: skip


def covariance_now(fitting: Fitting, now: Mapping[str, Estimate]) -> Floats | None:
    """Return the covariance (p, p) of the search's coordinates as the model's file tells it, without the offset; None
    where a parameter has no standard error.

    Files hold no correlations; that of inertia and quadratic drag follows from the interval of their ratio.
    """
    names = [name for name in fitting.names if name != OFFSET]
    logs = dict(zip((*fitting.labels, OFFSET), fitting.on_log))
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
    """Return the information (p, p) before the campaign: the earlier runs' if they are to be `use`d and known, else
    next to none."""
    loose = fitting.loose_information
    loose[-1, -1] = 1.0
    covariance = covariance_now(fitting, now) if use else None
    if covariance is not None:
        loose[:-1, :-1] += np.linalg.inv(covariance)
    return loose


def wanted_directions(fitting: Fitting, names: tuple[str, ...]) -> Floats:
    """Return the directions (p, m) whose intervals count, in shares of the parameters: of `names`, or of every
    parameter. Raises ModelError for another name."""
    known = fitting.relative_directions
    for name in names:
        if name not in known:
            raise ModelError(f"the model has no parameter {name!r} to plan for; it has {', '.join(known)}")
    return np.stack([known[name] for name in names or [n for n in known if n != ANGLE]], axis=1)


def lacking(effect: str) -> list[str]:
    """List the columns that an effect needs and planned runs do not have."""
    return [need for need in effects.get(effect).columns if need != "voltage"]


def _some(entries: Mapping[str, Given | None]) -> dict[str, Estimate]:
    """Those of which the interval is known; a file written by hand may have none."""
    known = {name: given.estimate for name, given in entries.items() if given is not None}
    return {name: estimate for name, estimate in known.items() if estimate is not None}


def _read_diagnosis(
    path: Source, stored: StoredModels
) -> tuple[DiagnosisFile, dict[str, tuple[float, ...]], dict[str, Estimate], list[Doubt]]:
    """The file, the effects with their values, estimates by label, and what is open."""
    file, force, where = DIAGNOSIS.read(path), stored.dof.words.force, printable(path.name)
    if file.dof is not stored.dof or file.force_unit is None:
        raise ModelError(
            f"{where}: expected the diagnosis.json that `automarine diagnose` writes of {stored.dof.name} runs"
        )
    if file.force_unit != stored.moment_unit:
        raise ModelError(
            f"{where}: a diagnosis of {force}s in {told(file.force_unit)}, but {stored.source} is a model of {force}s "
            f"in {stored.moment_unit}; give the diagnosis of this model"
        )
    named, estimates, doubts = dict[str, tuple[float, ...]](), dict[str, Given | None](), []
    for i, entry in enumerate(file.effects):
        name = _known(entry.name, f"{where}: effects[{i}]")
        values, effect = [], effects.get(name)
        for key, parameter in zip(effect.names_in(stored.dof), effect.parameters):
            given = estimates[f"{name} {key}"] = entry.parameters.get(key)
            if given is not None and given.estimate is not None:
                values.append(given.estimate.value)
            elif parameter.optional:
                values.append(parameter.start)
            else:
                raise ModelError(f"{where}: effects[{i}].parameters: {key} has no value; expected an estimate")
        named[name] = tuple(values)
        for j, rival in enumerate(entry.rivals):
            if not rival.name.startswith(PREFIX):  # a curve that was not fitted has no size to look for
                doubts.append(Doubt(name, _known(rival.name, f"{where}: effects[{i}].rivals[{j}]")))
    return file, named, _some(estimates), doubts


def _known(name: str, where: str) -> str:
    if name not in effects.names() and not name.startswith(PREFIX):
        raise ModelError(f"{where}: name: found {told(name)}, expected one of {', '.join(effects.names())}")
    return name
