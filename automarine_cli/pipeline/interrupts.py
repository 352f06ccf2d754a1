"""Ctrl-C and its kin: one orderly end, within a second, and never in the middle of a step that must be whole."""

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import NoReturn

INTERRUPTED = 130  # the exit status that shells give for Ctrl-C
SENTENCE = "Interrupted; nothing was left half written."
PATIENCE_S = 0.6  # an end that takes longer than this is not waited for
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_whole = threading.RLock()  # held by a step that must be whole
_struck = threading.Event()
_told = threading.Event()
_chores: list[Callable[[], object]] = []


def heed() -> None:
    """From here on the first Ctrl-C, SIGTERM or hang-up raises KeyboardInterrupt; later ones change nothing.

    If that does not end the process soon (some C code turns the exception into another one, or works on for
    seconds), a thread does. What is ignored already (by nohup, or by a shell for work in the background) stays
    ignored. For the main thread of a program.
    """
    if signal.getsignal(signal.SIGINT) is _strike:
        return
    for number in SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _strike)
    if os.name != "nt":  # where only a socket would do
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        threading.Thread(target=_see_to_the_end, args=(reader,), daemon=True).start()


def struck() -> bool:
    """Whether an interrupt has come: whatever fails after that is no defect."""
    return _struck.is_set()


def tell() -> None:
    """Say on standard error that the work was interrupted."""
    _told.set()
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{SENTENCE}\n")
        sys.stderr.flush()


def end() -> NoReturn:
    """Leave with the status for an interrupt and no other, after the work has been ended in order.

    `sys.exit` does not do: where the interrupt struck while Python executed a text (as dataclasses make it do),
    Python remembers that and ends by a signal of its own.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(INTERRUPTED)


def disregard() -> None:
    """Interrupts change nothing any more: the work is done and the process about to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Interrupts that come inside the block act at its end: for steps that take no time and must be whole."""
    if threading.current_thread() is not threading.main_thread():  # interrupts act in the main thread only
        yield
        return
    came: list[int] = []
    before = {}
    for number in SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, lambda number, frame: came.append(number))
    try:
        with _whole:
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


@contextlib.contextmanager
def last_chore(chore: Callable[[], object]) -> Iterator[None]:
    """An end that cannot be waited for does `chore` first, while the block lasts."""
    _chores.append(chore)
    try:
        yield
    finally:
        _chores.remove(chore)


def _strike(number: int, frame: object) -> None:
    _struck.set()
    disregard()  # the end has begun; impatience must not cut it short
    raise KeyboardInterrupt


def _see_to_the_end(reader: int) -> None:
    """Wait for an interrupt (the system writes its number into the pipe), then for the end; else make one."""
    while os.read(reader, 1)[0] not in SIGNALS:
        continue
    time.sleep(PATIENCE_S)
    with _whole:
        processes = sys.modules.get("multiprocessing")  # without it there are none
        for child in processes.active_children() if processes else ():
            child.kill()
        for chore in _chores:
            chore()
        if not _told.is_set():
            tell()
        os._exit(INTERRUPTED)
