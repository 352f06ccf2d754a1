"""One function over many items, in this process, in several, or on a Dask cluster: results always in input order.

Processes are started afresh (spawn), never forked: numpy and pyarrow run threads of their own, and a fork of a process
with threads can hang. The function and the items must therefore be importable and picklable.
"""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from automarine_cli.errors import SettingError

if TYPE_CHECKING:  # what most commands never need takes its time to import
    from concurrent.futures import Executor

Item = TypeVar("Item")
Result = TypeVar("Result")
Each = Callable[[Callable[[Any], Any], Sequence[Any], str], list[Any]]
"""Maps a function over items, in a stage of that name."""
Progress = Callable[[str, int, int], None]
"""Called as `progress(stage, done, total)`, so that no room knows about terminals; `done == total` ends the stage. A
`total` of 0 is no stage, but a sentence that people are to read."""

CHUNKS_PER_JOB, LARGEST_CHUNK = 4, 32  # small enough to share the work evenly, large enough to spare the pickling
CLUSTER_PATIENCE_S = 20  # for a cluster to answer


def silent(stage: str, done: int, total: int) -> None:
    """The progress that says nothing: the default everywhere outside the command line."""


def counted(progress: Progress, stage: str, items: Iterable[Item], total: int) -> Iterator[Item]:
    """Yield `items`, telling `progress` after each one how many of `total` are done."""
    for done, item in enumerate(items, start=1):
        yield item
        progress(stage, done, total)


def alone(function: Callable[[Any], Any], items: Sequence[Any], stage: str = "") -> list[Any]:
    return [function(item) for item in items]


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], jobs: int = 1, *, cluster: str | None = None,
    progress: Progress = silent, stage: str = "",
) -> list[Result]:  # fmt: skip
    """Return `[function(item) for item in items]`, the same on any number of `jobs` and on a Dask `cluster`. The first
    item that raises decides the error. Raises SettingError if `jobs` is below one, a process dies (usually for want of
    memory), or there is no cluster at the address."""
    work = list(items)
    with lasting_map(min(jobs, len(work) or 1), cluster=cluster if work else None, progress=progress) as mapped:
        return mapped(function, work, stage)


@contextlib.contextmanager
def lasting_map(jobs: int = 1, *, cluster: str | None = None, progress: Progress = silent) -> Iterator[Each]:
    """Yield `each(function, items, stage)`, an `ordered_map` whose processes last over many small rounds of work."""

    def each(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
        results: Iterable[Any] = map(function, items)
        if executor is not None:
            size = min(LARGEST_CHUNK, max(1, len(items) // (jobs * CHUNKS_PER_JOB))) if jobs > 1 else 1
            chunks = [items[start : start + size] for start in range(0, len(items), size)]
            with deaf_to_interrupts():
                futures = [executor.submit(alone, function, chunk) for chunk in chunks]
            results = (result for future in futures for result in future.result())
        return list(counted(progress, stage, results, len(items)))

    if jobs < 1:
        raise SettingError(f"jobs is {jobs}; expected 1 or more processes")
    workers = contextlib.nullcontext() if jobs == 1 else _processes(jobs)
    with workers if cluster is None else _dask(cluster) as executor:
        yield each


@contextlib.contextmanager
def _processes(jobs: int) -> Iterator["Executor"]:
    import multiprocessing
    from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor

    before = set(multiprocessing.active_children())
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _end_with_parent) as pool:
        try:
            yield pool
        except BrokenProcessPool:
            raise SettingError(
                f"one of {jobs} processes died, usually for want of memory; try again with fewer, for example --jobs 1"
            ) from None
        except BaseException:  # nobody waits for the items under way
            for child in set(multiprocessing.active_children()) - before:
                child.kill()
            raise


@contextlib.contextmanager
def _dask(address: str) -> Iterator["Executor"]:
    """Yield the executor of the Dask scheduler at `address`; work of a worker that dies is done again by another."""
    try:
        from concurrent.futures import CancelledError

        from distributed import Client, KilledWorker
    except ImportError:
        raise SettingError(
            "--cluster needs Dask, which is not installed; install it with: pip install 'automarine[cluster]'"
        ) from None
    with contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(Client(address, timeout=CLUSTER_PATIENCE_S, set_as_default=False))
            client.wait_for_workers(1, timeout=CLUSTER_PATIENCE_S)
        except (OSError, TimeoutError, ValueError) as problem:
            raise SettingError(
                f"no Dask scheduler with workers answers at {address} ({str(problem) or type(problem).__name__}); "
                f"start one with `dask scheduler`, and workers with `dask worker {address} --nthreads 1`"
            ) from None
        try:
            yield client.get_executor(pure=False)
        except (KilledWorker, CancelledError) as problem:
            raise SettingError(f"the cluster at {address} gave up: {problem}; look at its workers' logs") from None


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Processes started here never hear Ctrl-C, not even while they start; this one hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process with the one that started it, even if that is killed outright."""
    import multiprocessing

    def wait() -> None:
        multiprocessing.parent_process().join()  # type: ignore[union-attr]
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
