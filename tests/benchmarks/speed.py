"""Speed: start-up of the command, simulated samples a second, and the fit, each against the plain way to do it."""

import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from campaigns import BOTH_SIDES, INERTIA, K_RR, make_campaign
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from automarine_cli.fits.output_error import fit_half_turns
from automarine_cli.fits.step_response import Known, StepData, half_turn_data
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import Batch, make_batch
from automarine_cli.simulation.rollout import simulate

Floats = NDArray[np.float64]
Result = tuple[list[Table], dict[str, Any]]

START = (1.2 * INERTIA, 0.8 * K_RR)
ACCURACY = {
    "rtol": 1e-6,
    "atol": 1e-8,
}  # of solve_ivp: as accurate as a hundredth of a degree needs, and easily


def startup(count: int, progress: Progress) -> Result:
    """`automarine --help` against a bare `import click`, in turns so that both see the same machine."""
    commands = {
        "import click": [sys.executable, "-c", "import click"],
        "automarine --help": [sys.executable, "-m", "automarine_cli", "--help"],
    }
    taken: dict[str, list[float]] = {name: [] for name in commands}
    for i in range(count + 2):
        for name, command in commands.items():
            seconds = _seconds(partial(subprocess.run, command, check=True, capture_output=True))
            if i >= 2:  # the first two fill the caches
                taken[name].append(seconds)
        progress("start-up", i + 1, count + 2)
    bare, own = (float(np.median(taken[name])) for name in commands)
    ratio = float(np.median(np.array(taken["automarine --help"]) / np.array(taken["import click"])))
    rows = tuple((name, f"{1000 * np.median(values):.0f}") for name, values in taken.items())
    note = f"Ratio {ratio:.2f} (median of {count} pairs); required: below 2: {'reached' if ratio < 2 else 'MISSED'}."
    table = Table("Start-up", ("command", "median ms"), rows, notes=(note,))
    return [table], {"runs": count, "import_click_s": bare, "help_s": own, "ratio": ratio}


def simulator(repeats: int, progress: Progress) -> Result:
    """72 runs x 250 samples x 20 parameter sets together, against `solve_ivp` run by run."""
    sets, samples, runs = 20, 250, 72
    random = np.random.default_rng(3)
    moments = [BOTH_SIDES[i % len(BOTH_SIDES)] for i in range(runs)]
    clock = np.linspace(0.0, 0.1 * (samples - 1), samples)
    made = [
        Run(
            f"run {i}",
            "simulated",
            clock,
            np.zeros(samples),
            np.where(np.arange(samples) > 30, moment, 0.0),
            "nu",
        )
        for i, moment in enumerate(moments)
    ]
    batch = make_batch(made, 0.1)
    model = YawModel.base("3", INERTIA, [K_RR])
    theta = model.theta * (1.0 + 0.02 * random.standard_normal((sets, 2)))
    together = []
    for i in range(repeats):
        together.append(_seconds(lambda: simulate(model, batch, theta)))
        progress("simulator", i + 1, repeats)
    heading = simulate(model, batch, theta).heading
    compiled = _compiled(batch, theta, repeats)
    some = range(0, runs, 6)  # these runs, the first parameter set; the rest takes as long
    worst, one_by_one = 0.0, 0.0
    for i in some:
        begun = time.perf_counter()
        exact = _solved(clock, 3.05, moments[i], theta[0])  # in the middle of the interval
        one_by_one += time.perf_counter() - begun
        worst = max(worst, float(np.abs(exact - heading[0, i]).max()))
    points = runs * samples * sets
    fast, slow = points / float(np.median(together)), len(some) * samples / one_by_one
    rows = (
        ("simulate, all together", f"{np.median(together):.3f}", f"{fast:.3g}"),
        (f"solve_ivp run by run (from {len(some)} of {runs * sets})", f"{points / slow:.3f}", f"{slow:.3g}"),
    )
    if compiled is not None:
        rows += (("a loop compiled by numba", f"{compiled:.3f}", f"{points / compiled:.3g}"),)
    note = f"Ratio {fast / slow:.0f}. Largest difference of a heading between the two: {np.degrees(worst):.1e} degrees."
    title = f"Simulator: {runs} runs x {samples} samples x {sets} parameter sets"
    header = ("simulation", "seconds", "samples x sets a second")
    results = {
        "a_second": fast,
        "solve_ivp_a_second": slow,
        "ratio": fast / slow,
        "largest_difference_rad": worst,
        "numba_a_second": None if compiled is None else points / compiled,
        "slower_than_numba": None if compiled is None else float(np.median(together)) / compiled,
    }
    return [Table(title, header, rows, notes=(note,))], results


def _compiled(batch: Batch, theta: Floats, repeats: int) -> float | None:
    """Median seconds of the same steps in a compiled loop, sample by sample; None without numba."""
    if find_spec("numba") is None:
        return None
    from numba import njit

    @njit
    def advance(theta: Floats, length: Floats, moment: Floats, heading: Floats) -> None:
        for p in range(theta.shape[0]):
            inertia, drag = theta[p]
            for run in range(length.shape[0]):
                psi, rate = 0.0, 0.0
                for m in range(length.shape[1]):
                    h, tau = length[run, m], moment[run, m]
                    a = (tau - drag * abs(rate) * rate) / inertia
                    two = rate + 0.5 * h * a
                    b = (tau - drag * abs(two) * two) / inertia
                    three = rate + 0.5 * h * b
                    c = (tau - drag * abs(three) * three) / inertia
                    four = rate + h * c
                    d = (tau - drag * abs(four) * four) / inertia
                    psi += h / 6.0 * (rate + 2.0 * two + 2.0 * three + four)
                    rate += h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                    heading[p, run, m] = psi

    heading = np.empty((len(theta), *batch.length.shape))
    advance(theta, batch.length, batch.moment, heading)  # compiles
    return float(
        np.median(
            [_seconds(lambda: advance(theta, batch.length, batch.moment, heading)) for _ in range(repeats)]
        )
    )


def fit(repeats: int, progress: Progress) -> Result:
    """`fit_half_turns` of 48 runs against `least_squares` over `solve_ivp`, start headings as parameters."""
    turns, _ = half_turns(make_campaign([4, 0]).runs)
    data = half_turn_data(turns)
    taken, iterations = [], 0
    for i in range(repeats):
        begun = time.perf_counter()
        iterations = fit_half_turns(data, "3", (START[0], 0.0, START[1]), "nu", Known()).mixed.iterations
        taken.append(time.perf_counter() - begun)
        progress("fit", i + 1, repeats)
    own = float(np.median(taken))
    one_round = _seconds(lambda: _plain_residuals(np.array(START), data))
    begun = time.perf_counter()
    plain = least_squares(_plain_residuals, START, args=(data,), x_scale=START)
    whole = time.perf_counter() - begun
    rows = (
        ("fit_half_turns, start headings, instants and gains of the runs included", f"{own:.3f}"),
        (f"least_squares + solve_ivp, I and k alone ({plain.nfev} rounds of 3 simulations)", f"{whole:.3f}"),
        ("the same with 48 start headings, by differences (scaled from one simulation)",
         f"{plain.nfev * 51 * one_round:.3f}"),
    )  # fmt: skip
    notes = (
        f"Ratio {whole / own:.0f} at least: the plain fit knows nothing of what differs from run to run.",
    )
    results = {
        "fit_s": own, "iterations": iterations, "plain_s": whole, "ratio": whole / own,
        "plain_with_start_headings_s": plain.nfev * 51 * one_round,
    }  # fmt: skip
    return [Table("Fit of model 3 to 48 half-turns", ("fit", "seconds"), rows, notes=notes)], results


def _plain_residuals(theta: Floats, data: StepData) -> Floats:
    """Heading errors [rad] of every sample, each run solved by itself."""
    parts = []
    for time_row, heading, seen, moment in zip(data.time, data.heading, data.seen, data.moment):
        parts.append(_solved(time_row[seen], 0.0, moment, theta) - heading[seen])
    return np.concatenate(parts)


def _solved(clock: Floats, switch: float, moment: float, theta: Floats) -> Floats:
    """Headings [rad] at `clock` (N,) by `solve_ivp` for a step of `moment` at `switch` [s]."""
    inertia, k_rr = theta
    after = clock[clock > switch]

    def slope(_: float, state: Floats) -> tuple[float, float]:
        return state[1], (moment - k_rr * abs(state[1]) * state[1]) / inertia

    found = solve_ivp(slope, (switch, after[-1]), (0.0, 0.0), t_eval=after, **ACCURACY)
    return np.concatenate([np.zeros(len(clock) - len(after)), found.y[0]])


def _seconds(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun
