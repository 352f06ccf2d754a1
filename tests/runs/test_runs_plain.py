"""The short way for runs that need no cleaning: it gives what the thorough way gives, or stands aside."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import mirrored, step_run

from automarine_cli.dofs import YAW
from automarine_cli.errors import RunError
from automarine_cli.logs import LogTable
from automarine_cli.runs.clean import Split, clean, plain_rows
from automarine_cli.runs.run import Run

Columns = dict[str, np.ndarray]


def logged(run: Run, wrap: str) -> Columns:
    """Columns as a logger writes them, the heading wrapped at 0 or at half a turn, or not at all."""
    heading = {"0..360": np.mod(run.position, 2 * np.pi), "-180..180": np.mod(run.position + np.pi, 2 * np.pi) - np.pi,
               "none": run.position}[wrap]  # fmt: skip
    return {"time": run.time, "heading": heading, "moment": run.command}


def table(columns: Columns) -> LogTable:
    count = len(columns["time"])
    return LogTable("log.csv", columns, np.arange(1, count + 1), moment_unit="nu", dof=YAW)


def plain_position(columns: Columns) -> np.ndarray | None:
    """The position that needs no cleaning, None where it may."""
    ((found,),) = plain_rows([Split(table(columns), ["run"], None, np.array([0, len(columns["time"])]))])
    return found


def both_ways(columns: Columns) -> tuple[object, object]:
    """What cleaning makes of a log with the short way and without it: runs, or the refusal."""

    def outcome(plain: np.ndarray | None) -> object:
        try:
            return clean(table(columns), slice(0, len(columns["time"])), "run", plain)
        except RunError as refusal:
            return str(refusal)

    return outcome(plain_position(columns)), outcome(None)


@given(
    moment=st.sampled_from([-1.2, -0.4, 0.1, 0.7, 1.2]),
    noise=st.sampled_from([0.0, 0.2, 1.0, 3.0]),
    wrap=st.sampled_from(["0..360", "-180..180", "none"]),
    mirror=st.booleans(),
    spikes=st.lists(st.tuples(st.integers(0, 40), st.floats(-4, 4)), max_size=3),
    jitter=st.sampled_from([0.0, 0.02, 0.045]),
    seed=st.integers(0, 1000),
)
def test_both_ways_agree(
    moment: float, noise: float, wrap: str, mirror: bool, spikes: list[tuple[int, float]], jitter: float, seed: int
) -> None:
    run = step_run(moment, noise_deg=noise, seed=seed)
    columns = logged(mirrored(run) if mirror else run, wrap)
    random = np.random.default_rng(seed)
    columns["time"] = columns["time"] + jitter * random.uniform(-1, 1, len(run))
    columns["heading"] = columns["heading"].copy()
    for place, size in spikes:
        columns["heading"][place] += size
    quick, thorough = both_ways(columns)
    if isinstance(thorough, str):
        assert quick == thorough
        return
    assert len(quick) == len(thorough)
    for one, other in zip(quick, thorough):
        assert one.counts == other.counts and one.notes == other.notes
        assert one.position == pytest.approx(other.position, abs=1e-12)
        assert np.array_equal(one.time, other.time) and np.array_equal(one.command, other.command)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_plain_run_takes_the_short_way(sign: int) -> None:
    run = step_run(0.7, length=12.0)
    columns = logged(run if sign == 1 else mirrored(run), "0..360")
    found = plain_position(columns)
    assert found is not None
    turned = found - found[0]
    assert turned == pytest.approx(sign * (run.position - run.position[0]), abs=1e-12)
    assert np.abs(turned).max() > 2 * np.pi


def spoil(name: str, place: int | slice, value: float) -> Callable[[Columns], None]:
    def spoiled(columns: Columns) -> None:
        columns[name][place] = value

    return spoiled


@pytest.mark.parametrize(
    "fault",
    [
        spoil("time", 12, np.nan),
        spoil("heading", 12, np.nan),
        spoil("moment", 12, np.nan),
        spoil("moment", 12, 1e13),
        spoil("time", 12, 0.0),
        spoil("heading", slice(30, 55), 1.0),
        spoil("heading", 12, 2.5),
        lambda columns: columns.update(time=columns["time"] * 1000),
        lambda columns: columns.update(heading=columns["heading"] * 57),
        lambda columns: columns.update(heading=columns["heading"] / 57),
        lambda columns: columns.update({name: values[:7] for name, values in columns.items()}),
    ],
)
def test_whatever_may_need_cleaning_takes_the_thorough_way(fault: Callable[[Columns], None]) -> None:
    columns = {name: values.copy() for name, values in logged(step_run(0.7, length=8.0), "0..360").items()}
    assert plain_position(columns) is not None
    fault(columns)
    assert plain_position(columns) is None
