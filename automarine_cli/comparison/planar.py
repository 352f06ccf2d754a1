"""Free runs of a planar model from the start of each log, and their errors channel by channel."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from automarine_cli.dofs.motion import PLANAR
from automarine_cli.fits.planar_structure import CHANNELS, PLACES, rough_velocities
from automarine_cli.models.planar import PlanarModel
from automarine_cli.models.planar_store import StoredPlanar
from automarine_cli.pipeline.records import Shown
from automarine_cli.pipeline.result_files import VALIDATION
from automarine_cli.quantities import Floats
from automarine_cli.runs.run import Run, SetAside, runs_json
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import Start, simulate

STEP = 0.05  # longest step of the simulation [s]
BEGINNING = 2.0  # s of a run from which its start is told
FEWEST = 3  # samples of a rest, and of a start under way
NOISE = {"heading": 0.02, "yaw_rate": 0.02, "surge": 0.03, "sway": 0.03, "north": 0.05, "east": 0.05}
"""What readings of a start count for [rad, m, s]."""
ROUNDS, NUDGE, LOOSE = 4, 1e-4, 3.0
FAR = 1e6  # m, or rad: a simulation that gets there diverges
DEGREES = 180.0 / np.pi


def rms(error: Floats) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def largest(error: Floats) -> float:
    return float(np.nanmax(np.abs(error)))


SCORES: Mapping[str, tuple[str, Callable[[Floats], float], float, str]] = {
    "heading_rmse_deg": (
        "heading",
        rms,
        DEGREES,
        "measured less simulated heading from the start of each run to its end",
    ),
    "heading_max_abs_deg": ("heading", largest, DEGREES, "the largest heading error"),
    "position_rmse_m": ("position", rms, 1.0, "distance between measured and simulated position"),
    "position_max_abs_m": ("position", largest, 1.0, "the largest such distance"),
    "surge_rmse_m_s": ("surge", rms, 1.0, "measured less simulated surge speed"),
    "sway_rmse_m_s": ("sway", rms, 1.0, "measured less simulated sway speed"),
    "yaw_rate_rmse_deg_s": ("yaw_rate", rms, DEGREES, "measured less simulated yaw rate"),
}
"""What is scored of free runs, by which size, in which unit, and what that means."""
START = ("north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")


@dataclass(frozen=True)
class PlanarFree:
    """One run as it was measured and as the model simulates it by the commands alone.

    `simulated` (N,) by channel [base units]; `start` is that of the simulation: north, east, heading, and the
    velocities over ground, in the order of the motion.
    """

    run: Run
    start: tuple[float, ...]
    simulated: Mapping[str, Floats]

    @property
    def diverged(self) -> bool:
        return any(not np.isfinite(one).all() or np.abs(one).max() > FAR for one in self.simulated.values())

    def error(self, channel: str) -> Floats | None:
        """Measured less simulated, (N,), NaN where nothing was read; None where the log has no such channel."""
        read = self.run.channel(channel)
        unread = read is None or (channel == self.run.dof.position and self.run.summed_up)
        if unread or read is None or not np.isfinite(read).any():
            return None
        return np.asarray(read - self.simulated[channel])

    @cached_property
    def distance(self) -> Floats | None:
        north, east = (self.error(name) for name in PLACES)
        return None if north is None or east is None else np.hypot(north, east)

    @cached_property
    def scores(self) -> dict[str, float | None]:
        """Every one of `SCORES`; None where the log lacks the channel, or the simulation diverges."""
        if self.diverged:
            return dict.fromkeys(SCORES)
        errors = {name: self.error(name) for name in ("heading", "surge", "sway", "yaw_rate")}
        errors["position"] = self.distance
        return {
            name: None if (error := errors[channel]) is None else factor * size(error)
            for name, (channel, size, factor, _) in SCORES.items()
        }


def free_runs(model: PlanarModel, runs: Sequence[Run]) -> tuple[PlanarFree, ...]:
    """Every run simulated by its commands from the state with which its log begins."""
    found = []
    for run in runs:
        start = start_of(run, model)
        batch = make_batch([run], STEP, motion=PLANAR, channels=CHANNELS)
        shown = simulate(model, batch, start=_start(start[None]))
        simulated = {one.quantity: shown.reading(one)[0, 0] for one in batch.channels}
        found.append(PlanarFree(run, tuple(start.tolist()), simulated))
    return tuple(found)


def _start(states: Floats) -> Start:
    return Start(states[:, :3].T[..., None], states[:, 3:].T[..., None])


def start_of(run: Run, model: PlanarModel) -> Floats:
    """North, east, heading and velocities (u, v, r) with which a run begins, (6,); what is not read is zero.

    At rest the means of the readings before the first command; under way the state that follows the first `BEGINNING`
    best under the model.
    """
    commands = np.stack([run.command_of(dof) for dof in PLANAR.dofs])
    quiet = int(np.argmax(np.append(np.any(commands != commands[:, :1], axis=0), True)))
    still = not commands[:, 0].any() and quiet >= FEWEST
    until = run.time <= run.time[0] + BEGINNING
    if still:
        until &= np.arange(len(run)) < quiet
    place = [_begun(run, name, until) for name in PLANAR.positions]
    if still:
        return np.array([*place, 0.0, 0.0, 0.0])
    rough = rough_velocities(run)
    velocity = [_mean(rough.get(dof.velocity), until) for dof in PLANAR.dofs]
    first = run.cut(0, max(int(np.count_nonzero(until)), FEWEST))
    return _followed(model, first, np.array([*place, *velocity]))


def _followed(model: PlanarModel, run: Run, state: Floats) -> Floats:
    """The start (6,) that follows a run best, near `state`; Gauss and Newton's method, differences by simulation."""
    batch = make_batch([run], STEP, motion=PLANAR, channels=CHANNELS)
    channels = [one for one in batch.channels if one.counts and one.seen.any()]
    near = state.copy()
    for _ in range(ROUNDS):
        tried = state + NUDGE * np.vstack([np.zeros(6), np.eye(6)])
        shown = simulate(model, batch, start=_start(tried))
        columns = [shown.reading(one)[:, 0, one.seen[0]] / NOISE[one.quantity] for one in channels]
        read = np.concatenate([one.values[0, one.seen[0]] / NOISE[one.quantity] for one in channels])
        found = np.concatenate(columns, axis=1)
        slopes = (found[1:] - found[:1]).T / NUDGE
        wide = np.vstack([slopes, np.eye(6) / LOOSE])  # what is not read stays where it is
        left = np.concatenate([read - found[0], (near - state) / LOOSE])
        if not np.isfinite(wide).all():
            return near
        state = state + np.linalg.lstsq(wide, left, rcond=None)[0]
    return state


def _begun(run: Run, channel: str, until: NDArray[np.bool_]) -> float:
    """A position at the beginning: the mean of its readings then, or the first one."""
    return 0.0 if run.summed_up and channel == run.dof.position else _mean(run.channel(channel), until)


def _mean(values: Floats | None, until: NDArray[np.bool_]) -> float:
    """Mean of the readings at the beginning, or the first reading; zero where there is none."""
    if values is None or not np.isfinite(values).any():
        return 0.0
    here = values[until & np.isfinite(values)]
    return float(np.mean(here)) if len(here) else float(values[np.isfinite(values)][0])


def overall(free: Sequence[PlanarFree]) -> dict[str, float | None]:
    """Scores over all runs: root of the mean square, each run counting alike, and the largest of the largest."""
    found: dict[str, float | None] = {}
    for name in SCORES:
        values = np.array([value for one in free if (value := one.scores[name]) is not None])
        if not len(values) or any(one.diverged for one in free):
            found[name] = None
        else:
            found[name] = float(values.max() if "max" in name else np.sqrt(np.mean(values**2)))
    return found


@dataclass(frozen=True, repr=False)
class PlanarValidation(Shown):
    """A planar model, every run simulated by it, and the runs left out."""

    stored: StoredPlanar
    free: tuple[PlanarFree, ...]
    set_aside: tuple[SetAside, ...]

    def to_json(self) -> dict[str, object]:
        runs, name = [free.run for free in self.free], PLANAR.name
        return {
            "schema": VALIDATION.schema,
            "motion": name,
            "models": {
                name: {
                    **overall(self.free),
                    "diverged": [free.run.name for free in self.free if free.diverged],
                    "runs": {free.run.name: {**free.scores, "start": dict(zip(START, free.start))}
                             for free in self.free},
                }
            },
            "best": name,
            "scores": {name: f"free run: {meaning}" for name, (*_, meaning) in SCORES.items()},
            "logs": {
                run.name: {
                    "file": run.source, "samples": len(run), "duration_s": float(run.time[-1] - run.time[0]),
                }
                for run in runs
            },
            "runs": runs_json(len(runs), self.set_aside, runs),
        }  # fmt: skip
