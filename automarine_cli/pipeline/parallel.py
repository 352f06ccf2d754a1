"""One function over many items, in this process, in several, or on a Dask cluster: results always in input order.

Processes are started afresh (spawn), never forked: numpy and pyarrow run threads of their own, and a fork of a process
with threads can hang. `function` and the items must therefore be importable and picklable.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, InvalidStateError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.progress import Progress, counted, silent

Item = TypeVar("Item")
Result = TypeVar("Result")
Each = Callable[[Callable[[Any], Any], Sequence[Any], str], list[Any]]
"""Maps a function over items, in a stage of that name."""

CHUNKS_PER_JOB, LARGEST_CHUNK = 4, 32  # small enough to share the work evenly, large enough to spare the pickling
PATIENCE_S = 20  # for a cluster to answer


def alone(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
    return [function(item) for item in items]


def ordered_map(function: Callable[[Item], Result], items: Iterable[Item], jobs: int = 1, **how: Any) -> list[Result]:
    """Return `[function(item) for item in items]`; see `ordered_stream`."""
    return list(ordered_stream(function, items, jobs, **how))


def ordered_stream(
    function: Callable[[Item], Result], items: Iterable[Item], jobs: int = 1, *, cluster: str | None = None,
    progress: Progress = silent, stage: str = "",
) -> Iterator[Result]:  # fmt: skip
    """Yield the results of `function` in input order, the same on any number of `jobs` and on a Dask `cluster`.

    The first item that raises decides the error. Raises SettingError if `jobs` is below one, a process dies (usually
    for want of memory), or there is no cluster at the address.
    """
    work = list(items)
    with _executor(min(jobs, len(work) or 1), cluster if work else None) as pair:
        yield from counted(progress, stage, _mapped(*pair, function, work), len(work))


@contextlib.contextmanager
def lasting_map(jobs: int = 1, *, cluster: str | None = None, progress: Progress = silent) -> Iterator[Each]:
    """Yield `each(function, items, stage)`, an `ordered_map` whose processes last over many small rounds of work."""
    with _executor(jobs, cluster) as pair:

        def each(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
            return list(counted(progress, stage, _mapped(*pair, function, items), len(items)))

        yield each


def _mapped(
    executor: Executor | None, workers: int, function: Callable[[Any], Any], work: Sequence[Any]
) -> Iterable[Any]:
    if executor is None:
        return map(function, work)
    with deaf_to_interrupts():
        size = min(LARGEST_CHUNK, max(1, len(work) // (workers * CHUNKS_PER_JOB)))
        return executor.map(function, work, chunksize=size)


@contextlib.contextmanager
def _executor(jobs: int, cluster: str | None) -> Iterator[tuple[Executor | None, int]]:
    """Yield what does the work (None: this process) and how many tasks it does at once."""
    if jobs < 1:
        raise SettingError(f"jobs is {jobs}; expected 1 or more processes")
    if cluster is not None:
        with cluster_executor(cluster) as pair:
            yield pair
    elif jobs == 1:
        yield None, 1
    else:
        others = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _end_with_parent)
        try:
            yield executor, jobs
        except BrokenProcessPool:
            raise SettingError(
                f"one of {jobs} processes died, usually for want of memory; try again with fewer, for example --jobs 1"
            ) from None
        except BaseException:  # nobody waits for the items under way
            hook = threading.excepthook
            # the executor's own thread may give the news to items that are cancelled already, which is none of a user's
            threading.excepthook = lambda args: None if args.exc_type is InvalidStateError else hook(args)
            for child in set(multiprocessing.active_children()) - others:
                child.kill()
            executor.shutdown(cancel_futures=True)
            threading.excepthook = hook
            raise
        finally:
            executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def cluster_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """Yield the executor of the Dask scheduler at `address`, and how many tasks its workers do at once.

    Work of a worker that dies is done again by another. Raises SettingError where Dask is not installed, nobody
    answers, there are no workers, or several workers died of the same task.
    """
    try:
        from distributed import Client, KilledWorker
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
    try:
        with client:
            client.wait_for_workers(1, timeout=PATIENCE_S)
            with client.get_executor(pure=False) as executor:
                yield executor, sum(client.nthreads().values())
    except TimeoutError:
        raise SettingError(
            f"the scheduler at {address} has no workers; start some with `dask worker {address} --nthreads 1`"
        ) from None
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

    def wait() -> None:
        multiprocessing.parent_process().join()  # type: ignore[union-attr]
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
