"""Work over many items: the same results, to the byte, in the same order on any number of processes, and an orderly
end."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from automarine_cli.errors import FitError, SettingError
from automarine_cli.pipeline.parallel import lasting_map, ordered_map


def square(x: int) -> int:
    return x * x


def refuse_from_three(x: int) -> int:
    if x >= 3:
        raise FitError(f"run {x} cannot be fitted")
    return x


def process(x: int) -> int:
    time.sleep(0.05)
    return os.getpid()


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order_and_the_first_item_that_fails_decides_the_error(jobs: int) -> None:
    calls: list[tuple[str, int, int]] = []
    squares = ordered_map(square, range(23), jobs, progress=lambda *call: calls.append(call), stage="fit")
    assert squares == [x * x for x in range(23)] and calls == [("fit", done, 23) for done in range(1, 24)]
    assert ordered_map(square, [], jobs) == []
    with pytest.raises(FitError, match=r"^run 3 cannot be fitted$"):
        ordered_map(refuse_from_three, range(40), jobs)
    with pytest.raises(FitError, match=r"^run 3 cannot be fitted$"), lasting_map(jobs) as each:
        each(refuse_from_three, range(40), "fits")
    assert not multiprocessing.active_children()


def test_rounds_of_work_share_their_processes() -> None:
    with lasting_map(2) as each:
        at_work = {number for _ in range(3) for number in each(process, range(8), "processes")}
        assert each(square, [], "nothing") == []
    assert len(at_work) == 2 and not multiprocessing.active_children()


def test_no_jobs_no_dask_and_a_process_that_dies_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingError, match=r"^one of 2 processes died, .*; try again with fewer"):
        ordered_map(os._exit, range(1, 5), 2)
    with pytest.raises(SettingError, match="jobs is 0; expected 1 or more"):
        ordered_map(square, [1], 0)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SettingError, match=r"install it with: pip install 'automarine\[cluster\]'"):
        ordered_map(square, [1], cluster="tcp://127.0.0.1:8786")


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


@pytest.mark.parametrize("wait_s", [0.1, 1.0])  # while the processes start, and while they work
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_interrupt_and_kill_end_every_process(tmp_path: Path, how: int, wait_s: float) -> None:
    """As a terminal does it: Ctrl-C goes to the whole process group, a kill to the parent alone."""
    script = tmp_path / "sleepers.py"
    script.write_text(SLEEPERS)
    pipe = subprocess.PIPE
    parent = subprocess.Popen([sys.executable, str(script)], stdout=pipe, stderr=pipe, start_new_session=True)
    assert parent.stdout is not None
    parent.stdout.readline()
    time.sleep(wait_s)
    os.killpg(parent.pid, how) if how == signal.SIGINT else parent.kill()
    _, errors = parent.communicate(timeout=600)  # returns when the last process that holds the pipes has gone
    if how == signal.SIGINT:  # by the signal itself where it struck during an import
        assert parent.returncode in (130, -signal.SIGINT) and errors == b""
