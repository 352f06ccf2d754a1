"""Work on a Dask cluster: a real scheduler, two workers, one of them killed in the middle; the same bytes."""

import os
import shutil
import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from few_candidates import few_candidates
from repository import ROOT, tree
from small_campaign import make_small_campaign

from automarine_cli.commands import automarine
from automarine_cli.commands.diagnose import diagnose
from automarine_cli.commands.run import run_campaign
from automarine_cli.errors import SettingError
from automarine_cli.pipeline.parallel import Progress, ordered_map

distributed = pytest.importorskip("distributed", reason="the extra automarine[cluster] is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("default"),  # Dask's own warnings are none of ours
    pytest.mark.usefixtures("drawn_figures"),
]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A scheduler and two workers, each of these a process of its own, and begun anew when it dies."""
    folder = str(tmp_path_factory.mktemp("cluster"))
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None, local_directory=folder) as workers:
        yield workers


def killing(cluster: Any, when: int, stage: str = "") -> tuple[list[int], Progress]:
    """What takes a progress and kills a worker as `when` items of a stage are done; how many are done, each time."""
    counts: list[int] = []

    def progress(now_at: str, done: int, total: int) -> None:
        counts.append(done)
        if done == when and stage in now_at:
            os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

    return counts, progress


def slowly(x: int) -> tuple[int, int]:
    time.sleep(0.02)
    return x * x, os.getpid()


def test_diagnosis_on_a_cluster_is_the_same_bytes_even_if_a_worker_dies(cluster: Any, tmp_path: Path) -> None:
    logs = str(ROOT / "sample_runs/hidden_one")
    run = partial(CliRunner().invoke, automarine, catch_exceptions=False)
    fitted = run(["fit-yaw", logs, "--fit-to", "whole-runs", "-o", str(tmp_path / "model"), "-q"])
    assert fitted.exit_code == 0, fitted.output
    model = str(tmp_path / "model/yaw_model.json")

    _, struck = killing(cluster, 1, "trying effects")
    with few_candidates(("tether-spring", "bias-moment", "dead-band", "input-delay"), curves=False):
        diagnose([logs], model=model, out=tmp_path / "here")
        diagnose([logs], model=model, out=tmp_path / "there", cluster=cluster.scheduler_address, progress=struck)
    for file in sorted((tmp_path / "here").iterdir()):
        assert file.read_bytes() == (tmp_path / "there" / file.name).read_bytes(), file.name


def test_campaigns_are_the_same_bytes_if_a_worker_dies(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named from here: the workers have another working directory."""
    first = make_small_campaign(tmp_path / "season" / "day_0")
    days = [Path("season", f"day_{number}", "campaign.toml") for number in range(3)]
    for day in days[1:]:
        shutil.copytree(first.parent, tmp_path / day.parent)
    monkeypatch.chdir(tmp_path)
    counts, struck = killing(cluster, 1)
    how = {"until": "fit-yaw"}
    run_campaign(days, out="there", cluster=cluster.scheduler_address, progress=struck, **how)
    run_campaign(days, out=tmp_path / "here", **how)
    assert counts[-1] == 3 and tree(tmp_path / "here") == tree(tmp_path / "there")


def test_no_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automarine_cli.pipeline.parallel.CLUSTER_PATIENCE_S", 0.5)
    with pytest.raises(SettingError, match=r"no Dask scheduler with workers answers at tcp://127.0.0.1:9 .*`dask"):
        ordered_map(slowly, [1], cluster="tcp://127.0.0.1:9")
