"""One function over many items, on one core or several: results always in input order.

The processes are started afresh (spawn), never forked: numpy and pyarrow run threads of their own, and a fork
of a process with threads can hang. `function` and the items must therefore be importable and picklable.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.interrupts import held_back
from automarine_cli.pipeline.progress import Progress, counted, silent

Item = TypeVar("Item")
Result = TypeVar("Result")

CHUNKS_PER_JOB = 4  # small enough to share the work evenly, large enough to spare the pickling


def ordered_map(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int = 1,
    *,
    progress: Progress = silent,
    stage: str = "",
) -> list[Result]:
    """`[function(item) for item in items]` on `jobs` processes, in input order and the same for any `jobs`.

    The first item (in input order) that raises decides the error. An interrupt ends the processes at once.
    Raises SettingError if `jobs` is below one or a process dies (usually for want of memory).
    """
    if jobs < 1:
        raise SettingError(f"jobs is {jobs}; expected 1 or more processes")
    work = list(items)
    workers = min(jobs, len(work))
    if workers <= 1:
        return list(counted(progress, stage, map(function, work), len(work)))
    return _in_processes(function, work, workers, progress, stage)


def _in_processes(
    function: Callable[[Item], Result], work: list[Item], workers: int, progress: Progress, stage: str
) -> list[Result]:
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker)
    size = max(1, len(work) // (workers * CHUNKS_PER_JOB))
    chunks = [work[start : start + size] for start in range(0, len(work), size)]
    try:
        with _deaf_to_interrupts():
            futures = [executor.submit(_work_on, function, chunk) for chunk in chunks]
        coming = (result for future in futures for result in _results_of(future))
        results = list(counted(progress, stage, coming, len(work)))
    except BrokenProcessPool:
        executor.shutdown()
        raise SettingError(
            f"one of {workers} processes died while working on {stage or 'the data'}, usually for want of "
            "memory; try again with fewer, for example --jobs 1"
        ) from None
    except BaseException as problem:  # nobody waits for the items under way
        for child in set(multiprocessing.active_children()) - others:
            child.kill()
        executor.shutdown(wait=isinstance(problem, Exception), cancel_futures=True)
        raise
    executor.shutdown()
    return results


def _work_on(
    function: Callable[[Item], Result], chunk: list[Item]
) -> tuple[list[Result], BaseException | None]:
    """The results of a chunk as far as they go, and the error that ended it."""
    results: list[Result] = []
    try:
        for item in chunk:
            results.append(function(item))
    except Exception as problem:
        return results, problem
    return results, None


def _results_of(future: "Future[tuple[list[Result], BaseException | None]]") -> Iterator[Result]:
    results, problem = future.result()
    yield from results
    if problem is not None:
        raise problem


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started here never hear Ctrl-C, not even while they start; this one hears it afterwards."""
    with held_back():
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent process, and end with it even if it is killed outright."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
