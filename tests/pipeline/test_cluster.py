"""Work on a Dask cluster: a real scheduler, two workers, one of them killed in the middle; the same bytes."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner
from few_candidates import few_candidates
from repository import ROOT, tree
from small_campaign import make_small_campaign

from automarine_cli.commands import automarine
from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import FitError, SettingError
from automarine_cli.pipeline.parallel import ordered_map

distributed = pytest.importorskip("distributed", reason="the extra automarine[cluster] is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("default"),  # Dask's own warnings are none of ours
    pytest.mark.usefixtures("drawn_figures"),
]


class Cluster:
    """A scheduler and two workers of this machine, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        here = Path(__file__).parent
        paths = os.pathsep.join(map(str, (ROOT, here, here.with_name("helpers"))))
        self.environment = os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"}
        self.processes: list[subprocess.Popen[bytes]] = []
        note = folder / "scheduler.json"
        quiet = ["--no-dashboard", "--port", "0", "--scheduler-file", str(note)]
        self.start("distributed.cli.dask_scheduler", *quiet)
        self.address = _address(note)
        self.workers = [self.worker(), self.worker()]

    def start(self, module: str, *arguments: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", module, *arguments]
        process = subprocess.Popen(
            command, cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.processes.append(process)
        return process

    def worker(self) -> "subprocess.Popen[bytes]":
        options = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", str(self.folder))
        return self.start("distributed.cli.dask_worker", self.address, *options)

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


def _address(note: Path) -> str:
    import json

    for _ in range(300):
        if note.exists() and note.stat().st_size:
            return str(json.loads(note.read_text())["address"])
        time.sleep(0.1)
    raise AssertionError("the scheduler did not start")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


def slowly(x: int) -> tuple[int, int]:
    time.sleep(0.02)
    return x * x, os.getpid()


def refuse_from_three(x: int) -> int:
    if x >= 3:
        raise FitError(f"run {x} cannot be fitted")
    return x


def test_first_item_that_fails_decides_the_error(cluster: Cluster) -> None:
    with pytest.raises(FitError, match=r"^run 3 cannot be fitted$"):
        ordered_map(refuse_from_three, range(40), cluster=cluster.address)


def test_nothing_is_lost_with_a_worker_that_is_killed(cluster: Cluster) -> None:
    done = 0

    def count(stage: str, now: int, total: int) -> None:
        nonlocal done
        done = now
        if now == 60:
            cluster.workers[0].send_signal(signal.SIGKILL)

    found = ordered_map(slowly, range(300), cluster=cluster.address, progress=count)
    assert done == 300 and [square for square, _ in found] == [x * x for x in range(300)]
    assert os.getpid() not in {process for _, process in found}
    assert cluster.workers[0].wait(10) == -signal.SIGKILL
    cluster.workers[0] = cluster.worker()


def test_diagnosis_on_a_cluster_is_the_same_bytes_even_if_a_worker_dies(cluster: Cluster, tmp_path: Path) -> None:
    logs = str(ROOT / "sample_runs/hidden_one")
    run = partial(CliRunner().invoke, automarine, catch_exceptions=False)
    fitted = run(["fit-yaw", logs, "--fit-to", "whole-runs", "-o", str(tmp_path / "model"), "-q"])
    assert fitted.exit_code == 0, fitted.output
    model = str(tmp_path / "model/yaw_model.json")

    def struck(stage: str, now: int, total: int) -> None:
        if stage == "trying effects" and now == 1:
            cluster.workers[1].send_signal(signal.SIGKILL)

    with few_candidates(("tether-spring", "bias-moment", "dead-band", "input-delay"), curves=False):
        diagnose([logs], model=model, out=tmp_path / "here")
        diagnose([logs], model=model, out=tmp_path / "there", cluster=cluster.address, progress=struck)
    assert cluster.workers[1].wait(10) == -signal.SIGKILL
    cluster.workers[1] = cluster.worker()
    for file in sorted((tmp_path / "here").iterdir()):
        assert file.read_bytes() == (tmp_path / "there" / file.name).read_bytes(), file.name


def test_campaigns_on_a_cluster_are_the_same_bytes_even_if_a_worker_dies(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named from here: the workers have another working directory."""
    first = make_small_campaign(tmp_path / "season" / "day_0")
    days = [Path("season", f"day_{number}", "campaign.toml") for number in range(4)]
    for day in days[1:]:
        shutil.copytree(first.parent, tmp_path / day.parent)
    monkeypatch.chdir(tmp_path)
    done = 0

    def struck(stage: str, now: int, total: int) -> None:
        nonlocal done
        done = now
        if now == 1:
            cluster.workers[0].send_signal(signal.SIGKILL)

    how = {"until": "fit-yaw"}
    run_campaign(days, out="there", cluster=cluster.address, progress=struck, **how)
    assert cluster.workers[0].wait(10) == -signal.SIGKILL
    cluster.workers[0] = cluster.worker()
    run_campaign(days, out=tmp_path / "here", **how)
    assert done == 4 and tree(tmp_path / "here") == tree(tmp_path / "there")


def test_no_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.pipeline.parallel.PATIENCE_S", 0.5)
    with pytest.raises(SettingError, match=r"no Dask scheduler with workers answers at tcp://127.0.0.1:9 .*`dask"):
        ordered_map(slowly, [1], cluster="tcp://127.0.0.1:9")
