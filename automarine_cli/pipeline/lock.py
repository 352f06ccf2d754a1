"""One process at a time: a lock that the system takes away when its holder ends, however it ends.

A lock file tells nothing by being there, only by being held: one that a killed process left is taken over.
"""

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path

NOT_HERE = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)  # a file system without locks


class HeldElsewhereError(Exception):
    """Somebody else holds the lock."""


@contextlib.contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, which is made and goes again. Raises HeldElsewhereError at once, or OSError."""
    while True:
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _take(number)
            if _still_named(number, path):  # else its holder removed it between our two steps
                break
        except BaseException:
            os.close(number)
            raise
        os.close(number)
    try:
        yield
    finally:
        if os.name == "nt":  # an open file cannot be removed there
            os.close(number)
        with contextlib.suppress(OSError):  # one that stays is taken over by the next
            path.unlink()
        if os.name != "nt":  # here the name goes while the lock is held: nobody takes it just before
            os.close(number)


def is_held(path: Path) -> bool:
    """Whether somebody holds the lock file `path`; False where there is none or it cannot be told."""
    try:
        number = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        _take(number)
    except HeldElsewhereError:
        return True
    except OSError:
        return False
    else:
        return False
    finally:
        os.close(number)


def _still_named(number: int, path: Path) -> bool:
    try:
        there = path.stat()
    except FileNotFoundError:
        return False
    here = os.fstat(number)
    return (here.st_dev, here.st_ino) == (there.st_dev, there.st_ino)


if sys.platform == "win32":
    import msvcrt

    def _take(number: int) -> None:
        try:
            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
        except OSError as problem:
            if problem.errno in (errno.EACCES, errno.EDEADLK):
                raise HeldElsewhereError from None
            raise

else:
    import fcntl

    def _take(number: int) -> None:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise HeldElsewhereError from None
        except OSError as problem:
            if problem.errno not in NOT_HERE:  # there the last whole result wins
                raise
