"""Campaigns with a law in them that the library lacks, and with columns that mean nothing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import made_runs
import numpy as np
from effect_contract import long_plans, unmeasured
from made_runs import INERTIA, K_RR

from automarine_cli.diagnosis.diagnose import Diagnosis
from automarine_cli.diagnosis.residual_regions import gap
from automarine_cli.diagnosis.study import elsewhere, learned_term
from automarine_cli.diagnosis.trials import CandidateFit
from automarine_cli.dofs import YAW
from automarine_cli.effects import Effect, Place, State
from automarine_cli.effects.learned import KNOTS, basis
from automarine_cli.models.model import Bound, Model
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

Law = Callable[[State], Floats]

NOISE_DEG, GAIN = 0.5, 0.02
BASE = Model.base("3", INERTIA, (K_RR,), "nu", YAW)
COLUMNS = ("cpu_load", "current_A", "depth_below_m", "humidity", "pressure_hPa", "water_temp_C")

LAWS: Mapping[str, tuple[str, str, Callable[[Floats], Floats]]] = {
    "temperature": ("water_temp_C", "gain", lambda x: 0.12 * np.sin(2.0 * np.pi * (x - 4.0) / 20.0)),
    "rate": ("yaw-rate", "moment", lambda x: -0.35 * np.abs(x) ** 1.5),
    "product": ("depth_below_m", "drag", lambda x: 0.04 * x),
    "depth": ("depth_below_m", "moment", lambda x: 0.1 * np.sin(0.8 * x)),
    "nothing": ("", "moment", lambda x: 0.0 * x),
}
"""The variable, what its curve is, and the curve (of the speed, on its size)."""


def law(name: str) -> Law:
    variable, kind, curve = LAWS[name]
    if name == "rate":
        return lambda state: np.sign(state.relative) * curve(state.relative)
    if name == "nothing":
        return lambda state: 0.0 * state.delivered
    if kind == "drag":
        return lambda state: -curve(state.signals[variable]) * state.relative
    return lambda state: curve(state.signals[variable]) * (state.delivered if kind == "gain" else 1.0)


class Hidden(Effect):
    """What only the truth has."""

    name = "hidden"
    place = Place.MOMENT
    parameters = ()

    def __init__(self, law: Law) -> None:
        self.law = law

    def moment(self, state: State, values: tuple[Floats, ...]) -> Floats:
        return self.law(state)


@dataclass(frozen=True)
class Truth(Model):
    """The vehicle with a law of its own."""

    law: Law = np.zeros_like  # type: ignore[assignment]

    def forces(self, theta: Floats) -> list[Bound]:
        return [*super().forces(theta), Bound(0, Hidden(self.law), ())]


def true_model(name: str) -> Truth:
    """The base model with a law of LAWS."""
    return Truth(BASE.motion, BASE.masses, BASE.terms, BASE.moment_unit, law=law(name))


def true_curve(name: str, diagnosis: Diagnosis) -> Floats:
    """The curve of a law where the learned one has points, less what inertia and drag have of it."""
    model, x = diagnosis.search.final.model, diagnosis.effects[0].learned.x
    at = learned_term(model)
    assert at is not None
    other = elsewhere(model, model.terms[at])
    off = np.eye(KNOTS) - np.linalg.pinv(other) @ other
    return basis(x, x[0], x[-1], closed=False) @ off @ LAWS[name][2](np.linspace(x[0], x[-1], KNOTS))


def true_gap(name: str, diagnosis: Diagnosis) -> float:
    """The gap [rad] on the runs held out of a diagnosis that the true model leaves, refitted to the same runs."""
    study, held_out = replace(diagnosis.search.study, signals=COLUMNS), diagnosis.held_out
    assert held_out is not None
    fit = study.fit(true_model(name))
    trial = CandidateFit((), true_model(name).with_theta(fit.of_model), fit, 0.0)
    return gap(replace(study, runs=held_out.runs), trial, trial).after


def campaign(name: str, seed: int = 0, *, repeats: int = 2, gain: float = GAIN) -> list[Run]:
    """Runs of the vehicle with a law of LAWS; every run logs COLUMNS."""
    random = np.random.default_rng(500 + seed)
    plans = long_plans() * repeats
    runs = [unmeasured(plans[i], number) for number, i in enumerate(random.permutation(len(plans)))]
    runs = [replace(run, extras=_columns(run, number, random)) for number, run in enumerate(runs)]
    truth = true_model(name)
    batch = make_batch(runs, 0.05, COLUMNS)
    start = Start(
        position=random.uniform(-np.pi, np.pi, (1, len(runs))),
        log_gain=gain * random.standard_normal((1, len(runs))),
        switch_delay=batch.interval[None] * random.uniform(-0.5, 0.5, (1, *batch.interval.shape)),
    )
    found = simulate(truth, batch, start=start).position[0]
    found = found + np.deg2rad(NOISE_DEG) * random.standard_normal(found.shape)
    return [replace(run, position=row[: len(run)]) for run, row in zip(runs, found)]


def _columns(run: Run, number: int, random: np.random.Generator) -> dict[str, Floats]:
    """What a run logs beside its motion: some of it constant, some of it walking, some of it noise."""
    count, time = len(run), run.time - run.time[0]
    knots = np.arange(0.0, time[-1] + 4.0, 3.0)
    depth = np.abs(np.cumsum(random.normal(0.0, 0.8, len(knots))))
    return {
        "cpu_load": random.uniform(0.0, 1.0, count),
        "current_A": 2.0 + 8.0 * np.abs(run.command) ** 1.5 + 0.1 * random.standard_normal(count),
        "depth_below_m": np.interp(time, knots, depth),
        "humidity": np.full(count, 40.0 + 0.2 * number),
        "pressure_hPa": 1013.0 + random.standard_normal() + 0.01 * time,
        "water_temp_C": random.uniform(4.0, 24.0) + 0.02 * random.standard_normal(count),
    }


def written(runs: Sequence[Run], folder: Path) -> Path:
    for run in runs:
        made_runs.written(run, folder / f"{run.name}.csv", **run.extras)
    return folder
