"""One function over many items, on one core, several, or a cluster: results always in input order.

The processes are started afresh (spawn), never forked: numpy and pyarrow run threads of their own, and a fork
of a process with threads can hang. `function` and the items must therefore be importable and picklable.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, TypeVar

from automarine_cli.errors import SettingError
from automarine_cli.pipeline.cluster import on_cluster
from automarine_cli.pipeline.interrupts import held_back
from automarine_cli.pipeline.progress import Progress, counted, silent

Item = TypeVar("Item")
Result = TypeVar("Result")

Each = Callable[[Callable[[Any], Any], Sequence[Any], str], list[Any]]
"""Maps a function over items, in a stage of that name."""


def alone(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
    """The same in this process."""
    return [function(item) for item in items]


CHUNKS_PER_JOB = 4  # small enough to share the work evenly, large enough to spare the pickling
LARGEST_CHUNK = 32  # items; what a stream holds at a time does not grow with the number of items
AHEAD = 2  # chunks under way for each process


def ordered_map(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int = 1,
    *,
    cluster: str | None = None,
    progress: Progress = silent,
    stage: str = "",
) -> list[Result]:
    """`[function(item) for item in items]` on `jobs` processes, this one among them, or a cluster; see
    `ordered_stream`."""
    work = list(items)
    jobs, cluster = max(1, min(_checked(jobs), len(work))), cluster if work else None
    with lasting_map(jobs, cluster=cluster, progress=progress, stage=stage) as each:
        return each(function, work, stage)


def ordered_stream(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int = 1,
    *,
    cluster: str | None = None,
    progress: Progress = silent,
    stage: str = "",
    prepare: Callable[[Item], Item] | None = None,
    at_once: int | None = None,
) -> Iterator[Result]:
    """The results of `function` on each item, one by one in input order and the same for any `jobs`.

    `prepare` is applied to an item in this process, just before it is handed out; `at_once` items go together (default:
    by their number).

    With the address of a Dask scheduler as `cluster` its workers do the work, whatever `jobs`. Few results are held
    at a time: work that is far ahead of whoever takes the results waits. The first item (in input order) that raises
    decides the error. An interrupt ends the processes at once. Raises SettingError if `jobs` is below one, a process
    dies (usually for want of memory), or there is no cluster.
    """
    work = list(items)
    handing = _Handing(prepare, at_once)
    found = _in_order(function, work, min(_checked(jobs), len(work)), cluster if work else None, stage, handing)
    return counted(progress, stage, found, len(work))


def together_stream(
    function: Callable[[list[Item]], list[Result]],
    parcels: Iterable[list[Item]],
    jobs: int = 1,
    *,
    progress: Progress = silent,
    stage: str = "",
) -> Iterator[Result]:
    """`ordered_stream` of a function that takes several items at once and gives a result for each."""
    work = list(parcels)
    found = chain.from_iterable(ordered_stream(function, work, jobs, stage=stage))
    return counted(progress, stage, found, sum(map(len, work)))


@dataclass(frozen=True)
class _Handing:
    """How items are handed out: what is done to each first, and how many go together."""

    prepare: Callable[[Any], Any] | None = None
    at_once: int | None = None

    def chunks(self, work: list[Item], workers: int) -> Iterator[list[Item]]:
        """The items in the chunks in which they are handed out, prepared as late as can be."""
        size = self.at_once or min(LARGEST_CHUNK, max(1, len(work) // (workers * CHUNKS_PER_JOB)))
        for start in range(0, len(work), size):
            chunk = work[start : start + size]
            yield chunk if self.prepare is None else [self.prepare(item) for item in chunk]


@contextlib.contextmanager
def lasting_map(
    jobs: int = 1,
    *,
    cluster: str | None = None,
    progress: Progress = silent,
    stage: str = "",
    ready: Callable[..., object] | None = None,
) -> Iterator[Each]:
    """Yields `each(function, items, stage)`, an `ordered_map` whose processes, or whose connection to a cluster, last.

    For work that comes in many small rounds, of which each would cost more to begin than to do. The processes start at
    once, and import the module of `ready` while this one does something else.
    """
    with _workers(_checked(jobs), cluster, stage, own=1) as (executor, workers):
        if executor is not None and cluster is None:
            with deaf_to_interrupts():
                for _ in range(workers):
                    executor.submit(callable, ready)

        def each(function: Callable[[Any], Any], items: Sequence[Any], stage: str) -> list[Any]:
            work = list(items)
            found: Iterable[Any] = map(function, work)
            if cluster is not None and executor is not None:
                found = _through(executor, function, _Handing().chunks(work, workers), workers)
            elif executor is not None:
                found = _shared(executor, function, list(_Handing().chunks(work, jobs)), workers)
            return list(counted(progress, stage, found, len(work)))

        yield each


def _checked(jobs: int) -> int:
    if jobs < 1:
        raise SettingError(f"jobs is {jobs}; expected 1 or more processes")
    return jobs


def _in_order(
    function: Callable[[Item], Result], work: list[Item], jobs: int, cluster: str | None, stage: str, handing: _Handing
) -> Iterator[Result]:
    with _workers(jobs, cluster, stage) as (executor, workers):
        chunks = handing.chunks(work, workers)
        if executor is None:
            yield from (function(item) for chunk in chunks for item in chunk)
        else:
            yield from _through(executor, function, chunks, workers)


@contextlib.contextmanager
def _workers(jobs: int, cluster: str | None, stage: str, own: int = 0) -> Iterator[tuple[Executor | None, int]]:
    """What does the work, and how many tasks at once; None for this process itself, which does the work of `own`."""
    if cluster is not None:
        with on_cluster(cluster, stage) as found:
            yield found
    elif jobs <= 1:
        yield None, 1
    else:
        with _processes(jobs, stage, own) as executor:
            yield executor, jobs - own


@contextlib.contextmanager
def _processes(jobs: int, stage: str, own: int) -> Iterator[Executor]:
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(jobs - own, mp_context=context, initializer=_begin_worker)
    try:
        yield executor
    except BrokenProcessPool:
        executor.shutdown()
        raise SettingError(
            f"one of {jobs} processes died while working on {stage or 'the data'}, usually for want of "
            "memory; try again with fewer, for example --jobs 1"
        ) from None
    except BaseException as problem:  # nobody waits for the items under way
        for child in set(multiprocessing.active_children()) - others:
            child.kill()
        executor.shutdown(wait=isinstance(problem, Exception), cancel_futures=True)
        raise
    executor.shutdown()


def _through(
    executor: Executor, function: Callable[[Item], Result], chunks: Iterator[list[Item]], workers: int
) -> Iterator[Result]:
    """Results in input order, a few chunks of items under way for each of `workers`."""
    under_way: deque[Future[tuple[list[Result], BaseException | None]]] = deque()
    while True:
        while len(under_way) < AHEAD * workers and (chunk := next(chunks, None)) is not None:
            with deaf_to_interrupts():
                under_way.append(executor.submit(_work_on, function, chunk))
        if not under_way:
            return
        yield from _results_of(under_way.popleft())


def _shared(
    executor: Executor, function: Callable[[Item], Result], chunks: Sequence[list[Item]], workers: int
) -> Iterator[Result]:
    """Results in input order; this process takes chunks as the `workers` do, each the next one when it has done its
    own."""
    left, done = deque(enumerate(chunks)), dict[int, tuple[list[Result], BaseException | None]]()
    news = threading.Condition()

    def hand_out() -> None:
        while left:
            try:
                at, chunk = left.popleft()
            except IndexError:  # somebody else took the last one
                return
            try:
                outcome = executor.submit(_work_on, function, chunk).result()
            except BaseException as problem:  # the process died
                outcome = [], problem
            with news:
                done[at] = outcome
                news.notify()

    for _ in range(workers):
        threading.Thread(target=hand_out, daemon=True).start()
    for at in range(len(chunks)):
        while at not in done:
            try:
                own, chunk = left.popleft()
            except IndexError:
                with news:
                    news.wait_for(partial(done.__contains__, at))
            else:
                done[own] = _work_on(function, chunk)
        results, problem = done.pop(at)
        yield from results
        if problem is not None:
            raise problem


def _work_on(function: Callable[[Item], Result], chunk: list[Item]) -> tuple[list[Result], BaseException | None]:
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
def deaf_to_interrupts() -> Iterator[None]:
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
