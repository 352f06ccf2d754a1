"""Beyond one machine: what a task costs on a Dask cluster of this machine, and what that means for a fleet."""

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import many_logs

from automarine_cli.commands.run import run_campaign
from automarine_cli.pipeline.parallel import cluster_executor, ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report.tables import Table

Result = tuple[list[Table], dict[str, Any]]

CAMPAIGNS, WORKERS = 10_000, 100
CAMPAIGN_S = 60.0
"""What one campaign takes on one core, for the projection: measure your own with `time automarine run`."""
SENT, LOGS = 24, 20
"""Campaigns sent for their cost, and the logs of 1,000 samples in each."""


def _imported(number: int) -> int:
    time.sleep(0.2)
    return number


def _fleet(folder: Path) -> list[Path]:
    """Campaigns of which nothing but `check` is asked."""
    files = []
    for number in range(SENT):
        home = folder / f"day_{number:02d}"
        many_logs.small_csv(home / "steps", LOGS)
        files.append(home / "campaign.toml")
        files[-1].write_text('schema = "automarine/campaign/1"\n[logs]\nsteps = ["steps"]\n', encoding="utf-8")
    return files


def _campaign_seconds(files: list[Path], out: Path, **how: Any) -> float:
    begun = time.perf_counter()
    run_campaign(files, out=out, until="check", **how)
    return (time.perf_counter() - begun) / len(files)


def cluster(full: bool, progress: Progress) -> Result:
    """What connecting costs, a task that does nothing, and a campaign on its way, on two workers."""
    if find_spec("distributed") is None:
        return [Table("Cluster", ("what", "value"), (("skipped", "pip install 'automarine[cluster]'"),))], {}
    tasks = 10_000 if full else 1000
    each: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        note = Path(folder, "scheduler.json")
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, (Path(__file__).parents[2], Path(__file__).parent)))
        }
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--port", "0"]
        options: dict[str, Any] = {"cwd": folder, "env": environment, "stderr": subprocess.DEVNULL}
        processes = [subprocess.Popen([*command, "--scheduler-file", str(note)], **options)]
        try:
            while not (note.exists() and note.stat().st_size):
                time.sleep(0.1)
            address = json.loads(note.read_text())["address"]
            worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"]
            worker += ["--no-nanny", "--no-dashboard", "--local-directory", folder]
            processes += [subprocess.Popen(worker, **options) for _ in range(2)]
            ordered_map(_imported, range(8), cluster=address)  # both workers have started and imported
            connecting = []
            for _ in range(3):
                begun = time.perf_counter()
                with cluster_executor(address) as (executor, _):
                    connecting.append(time.perf_counter() - begun)
                    begun = time.perf_counter()
                    for future in [executor.submit(abs, -i) for i in range(tasks)]:
                        future.result()
                    each.append((time.perf_counter() - begun) / tasks)
            progress("cluster", 1, 2)
            fleet = _fleet(Path(folder, "fleet"))
            megabytes = sum(log.stat().st_size for log in (fleet[0].parent / "steps").iterdir()) / 1e6
            _campaign_seconds(fleet[:2], Path(folder, "warm"), cluster=address)
            there = _campaign_seconds(fleet, Path(folder, "there"), cluster=address)
            here = _campaign_seconds(fleet, Path(folder, "here"))
            progress("cluster", 2, 2)
        finally:
            for process in processes:
                process.kill()
                process.wait()
    start_up, task = median(connecting), median(each)
    # one machine hands out campaigns one after the other, the workers work side by side
    handing = max(there - here / 2.0, task)
    hours = max(CAMPAIGNS * handing, CAMPAIGNS / WORKERS * (CAMPAIGN_S + handing)) / 3600
    rows = (
        ("connecting, once a command [s]", f"{start_up:.2f}"),
        ("a task costs [ms]", f"{1000 * task:.2f}"),
        (f"a campaign of {LOGS} logs, {megabytes:.1f} MB, `check` alone: here, there [s]", f"{here:.2f}, {there:.2f}"),
        ("of which beyond half of that here [ms]", f"{1000 * handing:.0f}"),
        (f"{CAMPAIGNS} campaigns of {CAMPAIGN_S:.0f} s on {WORKERS} workers [h], projected", f"{hours:.2f}"),
        ("of which handing out [h]", f"{CAMPAIGNS * handing / 3600:.2f}"),
    )
    results = {
        "connecting_s": start_up, "task_s": task, "tasks": tasks, "here_s": here, "there_s": there,
        "handing_s": handing, "campaign_s": CAMPAIGN_S, "projected_h": hours
    }  # fmt: skip
    return [Table("A Dask cluster of this machine, two workers", ("what", "value"), rows)], results
