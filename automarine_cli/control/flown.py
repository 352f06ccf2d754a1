"""A log flown with gains against what was promised of them: the steps of its reference, each beside the same step of
every vehicle that the model allows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automarine_cli.control.flight import fly, step_scores
from automarine_cli.control.search import Crowd, Task
from automarine_cli.control.targets.base import Gains, Target
from automarine_cli.errors import RunError
from automarine_cli.quantities import Floats
from automarine_cli.runs.noise import position_noise
from automarine_cli.runs.run import Run

REFERENCES = ("target", "reference", "desired", "DesYaw", "YDes")
"""Parts of the names of columns that hold a reference."""
SMOOTHED_S, STEADY_S, LEAST = 0.5, 3.0, 5.0
"""Readings are averaged over so long, a reference stays for so long at least, and a step is so many bands large."""


@dataclass(frozen=True)
class Compared:
    """One figure of a step: as flown, and the band of 95 % that was promised; infinite where it never settled."""

    value: float
    band: tuple[float, float]
    held: bool


@dataclass(frozen=True)
class FlownStep:
    """One step of the reference: when it `begins` [s in the log], its size, what came of it by name, and the curves:
    `time` (N,), `position` (N,) as read, `low` and `high` (N,) of the promise, all less the position before."""

    run: str
    begins: float
    size: float
    figures: Mapping[str, Compared]
    time: Floats
    position: Floats
    low: Floats
    high: Floats

    @property
    def held(self) -> bool:
        """Whether all was as promised."""
        return all(one.held for one in self.figures.values())


def reference_of(run: Run, column: str | None) -> Floats:
    """The reference of a run in base units (N,), unwrapped. Raises RunError where no column, or not the one named,
    holds one."""
    dof = run.dof
    names = [column] if column else [n for n in run.extras if any(part.lower() in n.lower() for part in REFERENCES)]
    if not names or names[0] not in run.extras:
        asked = f"column {column!r}" if column else "column with the reference (such as target_heading_deg)"
        raise RunError(
            f"{run.source}, run {run.name!r}: there is no {asked}; name it with --reference, from "
            f"{', '.join(run.extras) or 'none'}"
        )
    values = run.extras[names[0]]
    inner = values if names[0].endswith(("_rad", "_m")) or not dof.wraps else dof.inner(values)
    return np.unwrap(inner) if dof.wraps else inner


def flown_steps(
    runs: Sequence[Run],
    column: str | None,
    target: Target,
    gains: Mapping[str, float],
    crowds: Sequence[Crowd],
    task: Task,
) -> list[FlownStep]:
    """Every step of the runs' references with what was promised of it. Raises RunError where there is none."""
    found = [
        _compared(run, reference, begin, end, target, gains, crowds, task)
        for run in runs
        for reference in [reference_of(run, column)]
        for begin, end in _steps(run.time, reference, task)
    ]
    if not found:
        dof = runs[0].dof
        least = f"{dof.logged(LEAST * task.band):g} {dof.units.log}"
        raise RunError(
            f"{runs[0].source}: no step of the reference of {least} or more with {STEADY_S:g} s after it; make one "
            "step and hold it until the vehicle is at rest"
        )
    return found


def _steps(time: Floats, reference: Floats, task: Task) -> Iterator[tuple[int, int]]:
    """First sample of each step, and the last before the next one."""
    moves = np.flatnonzero(np.abs(np.diff(reference)) > 0.1 * task.band)
    if not len(moves):
        return
    apart = np.flatnonzero(np.diff(time[moves]) > 1.0)
    firsts = moves[np.concatenate([[0], apart + 1])]
    lasts = moves[np.concatenate([apart, [len(moves) - 1]])]
    ends = [*firsts[1:], len(time) - 1]
    for first, last, end in zip(firsts, lasts, ends):
        large = abs(reference[last + 1] - reference[first]) >= LEAST * task.band
        if large and time[end] - time[last + 1] >= STEADY_S:
            yield int(first), int(end)


def _compared(
    run: Run, reference: Floats, begin: int, end: int, target: Target, gains: Mapping[str, float],
    crowds: Sequence[Crowd], task: Task,
) -> FlownStep:  # fmt: skip
    part = slice(begin, end + 1)
    time, before = run.time[part] - run.time[begin], reference[begin]
    turns = np.round((run.position[begin] - before) / (2.0 * np.pi)) if run.dof.wraps else 0.0
    read = run.position - 2.0 * np.pi * turns
    width = max(1, round(SMOOTHED_S / float(np.median(np.diff(run.time)))))
    smooth = np.convolve(np.pad(read, width // 2, mode="edge"), np.ones(width) / width, mode="same")
    smooth = smooth[width // 2 : width // 2 + len(read)][part] - before
    noise = position_noise(run.time, run.position) / np.sqrt(width)
    size = float(reference[end] - before)
    loops = max(2, round(float(time[-1]) / target.period))
    asked = np.interp(np.arange(loops) * target.period, time, reference[part] - before)[None, None]
    own: Gains = {name: np.full((1, 1), value) for name, value in gains.items()}
    flights = [fly(target, own, one.vehicles, asked, np.zeros((1, 1))) for one in crowds]
    flown = np.concatenate([one.position[:, 0] for one in flights])
    clock = flights[0].time
    promised = step_scores(clock, flown, size, task.band)
    did = step_scores(time, smooth[None], size, task.band + 2.5 * noise)
    spare = {
        "overshoot": 3.0 * noise / abs(size),
        "settling": 0.3 + float(np.median(np.diff(time))),
        "rms": 2.0 * noise,
    }
    figures = {}
    for name, values, value in zip(spare, promised, did):
        low, high = (float(np.quantile(values, q, method="inverted_cdf")) for q in (0.025, 0.975))
        mine = float(value[0])
        held = low - spare[name] <= mine <= high + spare[name]
        figures[name] = Compared(mine, (low, high), held)
    edges = np.quantile(flown, [0.025, 0.975], axis=0)
    low, high = (np.interp(time, clock, one) for one in edges)
    return FlownStep(
        run.name, float(run.time[begin] - run.time[0]), size, figures, time, read[part] - before, low, high
    )
