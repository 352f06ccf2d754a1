"""The executor of a Dask cluster, and what is said where there is none."""

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from automarine_cli.errors import SettingError

PATIENCE_S = 20  # for a cluster to answer


@contextlib.contextmanager
def on_cluster(address: str, stage: str) -> Iterator[tuple[Executor, int]]:
    """The standard executor of Dask's client; work of a worker that dies is done again by another."""
    with cluster_executor(address) as (executor, workers):
        try:
            yield executor, workers
        except Exception as problem:
            if type(problem).__name__ not in ("KilledWorker", "CancelledError", "FutureCancelledError"):
                raise
            raise SettingError(
                f"the cluster at {address} gave up {stage or 'the work'}: {problem}; look at its workers' logs, "
                "they usually died for want of memory"
            ) from None


@contextlib.contextmanager
def cluster_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """The executor of the Dask scheduler at `address`, and how many tasks its workers take at once.

    Raises SettingError where Dask is not installed, nobody answers, or there are no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SettingError(
            "--cluster needs Dask, which is not installed; install it with: pip install 'automarine[cluster]'"
        ) from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as problem:
        raise SettingError(
            f"no Dask scheduler answers at {address} ({str(problem) or type(problem).__name__}); start one with "
            "`dask scheduler` and give its address, such as tcp://127.0.0.1:8786"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            raise SettingError(
                f"the scheduler at {address} has no workers; start some with `dask worker {address} --nthreads 1`"
            ) from None
        with client.get_executor(pure=False) as executor:
            yield executor, sum(client.nthreads().values())
