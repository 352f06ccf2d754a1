"""Work over many items: the same results in the same order on any number of processes."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from automarine_cli.errors import FitError, SettingError
from automarine_cli.pipeline.parallel import AHEAD, LARGEST_CHUNK, lasting_map, ordered_map, ordered_stream


def square(x: int) -> int:
    return x * x


def refuse_from_three(x: int) -> int:
    if x >= 3:
        raise FitError(f"run {x} cannot be fitted")
    return x


def die(x: int) -> int:
    """Ends the process that works on it, but for the one that runs the tests."""
    if multiprocessing.parent_process() is None:
        until = time.monotonic() + 60  # the other has its item by then, and is gone
        while any(child.is_alive() for child in multiprocessing.active_children()) and time.monotonic() < until:
            time.sleep(0.01)
        return x
    os._exit(1)


def own_process(x: int, folder: Path, processes: int) -> int:
    """The process that works on it: none goes on before all have begun."""
    (folder / str(os.getpid())).touch()
    until = time.monotonic() + 60
    while len(list(folder.iterdir())) < processes and time.monotonic() < until:
        time.sleep(0.01)
    return os.getpid()


def leave_a_note(x: int, folder: Path) -> int:
    (folder / str(x)).touch()
    return x


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_input_order(jobs: int) -> None:
    assert ordered_map(square, range(23), jobs) == [x * x for x in range(23)]
    assert ordered_map(square, [], jobs) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_first_item_that_fails_decides_the_error(jobs: int) -> None:
    with pytest.raises(FitError, match=r"^run 3 cannot be fitted$"):
        ordered_map(refuse_from_three, range(40), jobs)
    assert not any(child.is_alive() for child in multiprocessing.active_children())


@pytest.mark.parametrize("jobs", [1, 2])
def test_progress_counts_to_the_end(jobs: int) -> None:
    said: list[tuple[str, int, int]] = []
    ordered_map(square, range(3), jobs, progress=lambda *words: said.append(words), stage="fit")
    assert said == [("fit", 1, 3), ("fit", 2, 3), ("fit", 3, 3)]


def test_a_process_that_dies_is_one_sentence() -> None:
    with pytest.raises(SettingError, match="one of 2 processes died while working on fits"):
        ordered_map(die, range(4), 2, stage="fits")


@pytest.mark.parametrize("jobs", [0, -1])
def test_no_jobs_is_refused(jobs: int) -> None:
    with pytest.raises(SettingError, match=f"jobs is {jobs}; expected 1 or more"):
        ordered_map(square, [1], jobs)


@pytest.mark.parametrize("jobs", [1, 2])
def test_rounds_of_work_share_their_processes(jobs: int, tmp_path: Path) -> None:
    own = partial(own_process, folder=tmp_path, processes=jobs)
    with lasting_map(jobs) as each:
        assert each(square, range(23), "squares") == [x * x for x in range(23)]
        assert each(square, [], "nothing") == []
        at_work = {one for _ in range(3) for one in each(own, range(8), "processes")}
    assert len(at_work) == jobs and os.getpid() in at_work
    assert not any(child.is_alive() for child in multiprocessing.active_children())


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_round_that_fails_ends_them(jobs: int) -> None:
    with pytest.raises(FitError, match=r"^run 3 cannot be fitted$"), lasting_map(jobs) as each:
        each(square, range(4), "squares")
        each(refuse_from_three, range(40), "fits")
    assert not any(child.is_alive() for child in multiprocessing.active_children())


def test_a_lasting_process_that_dies_is_one_sentence() -> None:
    with pytest.raises(SettingError, match="one of 2 processes died"), lasting_map(2) as each:
        each(die, range(4), "fits")


SLEEPERS = """
import sys, time
from automarine_cli.pipeline.parallel import ordered_map
if __name__ == "__main__":
    print("ready", flush=True)
    try:
        ordered_map(time.sleep, [3600.0] * 4, 2)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.parametrize("wait_s", [0.03, 0.1, 1.0])  # while the processes start, and while they work
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_interrupt_and_kill_end_every_process_soon(tmp_path: Path, how: int, wait_s: float) -> None:
    """As a terminal does it: Ctrl-C goes to the whole process group, a kill to the parent alone."""
    script = tmp_path / "sleepers.py"
    script.write_text(SLEEPERS)
    pipe = subprocess.PIPE
    parent = subprocess.Popen([sys.executable, str(script)], stdout=pipe, stderr=pipe, start_new_session=True)
    assert parent.stdout is not None
    parent.stdout.readline()
    time.sleep(wait_s)
    if how == signal.SIGINT:
        os.killpg(parent.pid, how)
    else:
        parent.kill()
    _, said = parent.communicate(timeout=600)  # returns when the last process that holds the pipes has gone
    if how == signal.SIGINT:  # by the signal itself where it struck during an import; see `interrupts.end`
        assert parent.returncode in (130, -signal.SIGINT)
        assert said == b""


def test_a_cluster_without_dask_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SettingError, match=r"not installed; install it with: pip install 'automarine\[cluster\]'"):
        ordered_map(square, [1], cluster="tcp://127.0.0.1:8786")


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_stream_is_never_far_ahead_of_who_takes_it(jobs: int, tmp_path: Path) -> None:
    stream = ordered_stream(partial(leave_a_note, folder=tmp_path), range(400), jobs)
    taken = [next(stream) for _ in range(40)]
    time.sleep(0.5)
    begun = len(list(tmp_path.iterdir()))
    stream.close()
    assert taken == list(range(40))
    assert begun <= 40 + (AHEAD + 1) * jobs * LARGEST_CHUNK
    until = time.monotonic() + 600
    while multiprocessing.active_children() and time.monotonic() < until:
        time.sleep(0.05)
    assert not multiprocessing.active_children()
