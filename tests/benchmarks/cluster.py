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

from automarine_cli.pipeline.parallel import cluster_executor, ordered_map
from automarine_cli.pipeline.progress import Progress
from automarine_cli.report.tables import Table

Result = tuple[list[Table], dict[str, Any]]

CAMPAIGNS, WORKERS = 10_000, 100
CAMPAIGN_S = 60.0
"""What one campaign takes on one core, for the projection: measure your own with `time automarine run`."""


def _imported(number: int) -> int:
    time.sleep(0.2)
    return number


def cluster(full: bool, progress: Progress) -> Result:
    """What connecting costs, and a task that does nothing, on two workers."""
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
            progress("cluster", 1, 1)
        finally:
            for process in processes:
                process.kill()
                process.wait()
    start_up, task = median(connecting), median(each)
    # the scheduler hands out tasks one after the other, the workers work side by side
    hours = max(CAMPAIGNS * task, CAMPAIGNS / WORKERS * (CAMPAIGN_S + task)) / 3600
    rows = (
        ("connecting, once a command [s]", f"{start_up:.2f}"),
        ("a task costs [ms]", f"{1000 * task:.2f}"),
        (f"{CAMPAIGNS} campaigns of {CAMPAIGN_S:.0f} s on {WORKERS} workers [h], projected", f"{hours:.2f}"),
        ("of which handing out [s]", f"{CAMPAIGNS * task:.0f}"),
    )
    results = {
        "connecting_s": start_up, "task_s": task, "tasks": tasks, "campaign_s": CAMPAIGN_S, "projected_h": hours
    }  # fmt: skip
    return [Table("A Dask cluster of this machine, two workers", ("what", "value"), rows)], results
