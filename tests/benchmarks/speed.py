"""Speed: simulated samples a second, and the fit, each against the plain way to do it."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from campaigns import BOTH_SIDES, INERTIA, K_RR, known_half_turns, make_campaign
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from automarine_cli.dofs import YAW
from automarine_cli.fits.half_turns import StepData, half_turn_data
from automarine_cli.fits.known import Known
from automarine_cli.fits.whole_runs import fit_half_turns
from automarine_cli.models.yaw_model import YawModel
from automarine_cli.pipeline.parallel import Progress
from automarine_cli.report.tables import Table
from automarine_cli.runs.half_turn import half_turns
from automarine_cli.runs.run import Run
from automarine_cli.simulation.batch import make_batch
from automarine_cli.simulation.rollout import simulate

Floats = NDArray[np.float64]
Result = tuple[list[Table], dict[str, Any]]

START = (1.2 * INERTIA, 0.8 * K_RR)
ACCURACY = {"rtol": 1e-6, "atol": 1e-8}  # of solve_ivp: as accurate as a hundredth of a degree needs, and easily


def simulator(repeats: int, progress: Progress) -> Result:
    """72 and 2,000 runs x 250 samples together, against `solve_ivp` run by run."""
    parts = [_simulator(runs, sets, repeats, progress) for runs, sets in ((72, 20), (2000, 4))]
    return [table for tables, _ in parts for table in tables], {
        str(runs): found for runs, (_, found) in zip((72, 2000), parts)
    }


def _simulator(runs: int, sets: int, repeats: int, progress: Progress) -> Result:
    samples = 250
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
            dof=YAW,
        )
        for i, moment in enumerate(moments)
    ]
    batch = make_batch(made, 0.1)
    model = YawModel.base("3", INERTIA, [K_RR], "nu", YAW)
    theta = model.theta * (1.0 + 0.02 * random.standard_normal((sets, 2)))
    together = []
    for i in range(repeats):
        together.append(_seconds(lambda: simulate(model, batch, theta)))
        progress("simulator", i + 1, repeats)
    heading = simulate(model, batch, theta).position
    some = range(0, runs, runs // 12)  # these runs, the first parameter set; the rest takes as long
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
    note = f"Ratio {fast / slow:.0f}. Largest difference of a heading between the two: {np.degrees(worst):.1e} degrees."
    title = f"Simulator: {runs} runs x {samples} samples x {sets} parameter sets"
    header = ("simulation", "seconds", "samples x sets a second")
    results = {"a_second": fast, "solve_ivp_a_second": slow, "ratio": fast / slow, "largest_difference_rad": worst}
    return [Table(title, header, rows, notes=(note,))], results


def fit(repeats: int, progress: Progress) -> Result:
    """`fit_half_turns` of 48 runs against `least_squares` over `solve_ivp`, for the same question and for ours."""
    campaign = make_campaign([4, 0])
    known, unknown = known_half_turns(campaign), half_turn_data(half_turns(campaign.runs)[0])
    all_known = Known(start_heading=True, switch_instant=True, gain=True)
    begin = (START[0], 0.0, START[1])
    alike: list[float] = []
    taken: list[float] = []
    for i in range(repeats):
        begun = time.perf_counter()
        same = fit_half_turns(known, "3", begin, "nu", all_known)
        alike.append(time.perf_counter() - begun)
        begun = time.perf_counter()
        fit_half_turns(unknown, "3", begin, "nu", Known())
        taken.append(time.perf_counter() - begun)
        progress("fit", i + 1, repeats)
    one_round = _seconds(lambda: _plain_residuals(np.array(START), unknown))
    begun = time.perf_counter()
    plain = least_squares(_plain_residuals, START, args=(known,), x_scale=START, xtol=1e-10, ftol=1e-12)
    whole = time.perf_counter() - begun
    theirs, own = plain.nfev * 51 * one_round, float(np.median(taken))
    apart = float(np.abs(same.mixed.theta[:2] / plain.x - 1.0).max())
    rows = (
        ("I and k, all else known: fit_half_turns", f"{np.median(alike):.3f}", ""),
        (f"the same: least_squares + solve_ivp ({plain.nfev} rounds of 3 simulations)", f"{whole:.3f}",
         f"{whole / np.median(alike):.0f}"),
        ("start headings, instants and gains of the runs too: fit_half_turns", f"{own:.3f}", ""),
        ("start headings too: least_squares + solve_ivp (scaled from one simulation)", f"{theirs:.3f}",
         f"{theirs / own:.0f}"),
    )  # fmt: skip
    notes = (f"Estimates of I and k where all else is known differ by {apart:.1e}; asked for is 10 times, to 1e-4.",)
    results = {
        "same_question": {"fit_s": float(np.median(alike)), "plain_s": whole, "relative_difference": apart},
        "whole_question": {"fit_s": own, "plain_s": theirs},
    }
    header = ("fit", "seconds", "times slower")
    return [Table("Fit of model 3 to 48 half-turns", header, rows, notes=notes)], results


def _plain_residuals(theta: Floats, data: StepData) -> Floats:
    """Heading errors [rad] of every sample, each run solved by itself."""
    parts = []
    for time_row, heading, seen, moment in zip(data.time, data.heading, data.observed, data.moment):
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
