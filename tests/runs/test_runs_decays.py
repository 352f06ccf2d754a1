"""A log of free decays begins, and begins again, where the vehicle is let go."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_swings import NOISE, PERIOD_S, decay, decays, heeled, write_swings

from automarine_cli.dofs import ROLL
from automarine_cli.logs.find import find_logs
from automarine_cli.runs import checks
from automarine_cli.runs.load import NO_HAND, read_runs
from automarine_cli.runs.run import Run

SIDES = (1.0, -1.0)


def read(path: Path) -> list[Run]:
    runs, aside = read_runs(find_logs([path])[0], dof=ROLL)
    assert not aside
    return runs


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("rise_s", "hold_s"), [(0.0, 0.5), (0.0, 3.0), (4.0, 0.0), (2.0, 1.0)])
def test_what_a_hand_does_is_cut_away(rise_s: float, hold_s: float, side: float, tmp_path: Path) -> None:
    for angle, seed in ((0.5, 1), (0.1, 2)):
        position = side * heeled(decay(angle, seed), rise_s, hold_s)
        write_swings(tmp_path / f"{seed}.csv", position)
        (run,) = read(tmp_path / f"{seed}.csv")
        assert 0.0 <= run.time[0] - rise_s - hold_s < 0.3 and NO_HAND in run.notes
        assert run.position[-1] == pytest.approx(position[-1], abs=1e-4)


def test_free_swings_stay_as_they_are(tmp_path: Path) -> None:
    moving = [decay(0.1, 7, rate=0.8), decay(-0.3, 8, rate=-0.4), decay(0.02, 9, rate=1.0)]
    waves = [
        replace(run, position=run.position + 0.02 * np.sin(1.3 * run.time + i) * np.sin(0.31 * run.time))
        for i, run in enumerate(decays(4))
    ]
    still = replace(moving[0], position=NOISE * np.random.default_rng(1).standard_normal(200), time=np.arange(200) / 20)
    for run in (*decays(3), *moving, *waves, still):
        (same,) = checks.decays(run)
        np.testing.assert_array_equal(same.position, run.position)
    write_swings(tmp_path / "free.csv", decays(3)[0].position)
    assert NO_HAND not in read(tmp_path / "free.csv")[0].notes


def test_a_log_of_several_decays_is_as_many_runs(tmp_path: Path) -> None:
    parts = [heeled(run, 2.0 + i, 1.0) for i, run in enumerate([*decays(5, count=3), decay(0.12, 1), decay(-0.6, 2)])]
    write_swings(tmp_path / "log.csv", np.concatenate([parts[0][-200:] * 0.0, *parts]))
    runs = read(tmp_path / "log.csv")
    assert [run.name for run in runs] == [f"log.{i}" for i in (1, 2, 3, 4, 5)]
    ends = 200 * PERIOD_S + PERIOD_S * np.cumsum([len(part) for part in parts])
    for i, (run, end) in enumerate(zip(runs, ends)):
        assert 0.0 <= run.time[0] - (end - 12.0) < 0.3
        assert run.time[-1] < end + 1.0 + i
