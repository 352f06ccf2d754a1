"""Two folders change places in one step, where the system can do that: nobody ever sees neither."""

import ctypes
import os
import sys
from pathlib import Path

AT_FDCWD = -100  # Linux: relative to the working directory
RENAME_EXCHANGE = 2  # Linux, linux/fs.h
RENAME_SWAP = 2  # macOS, sys/stdio.h


def exchanged(one: Path, other: Path) -> bool:
    """Whether the two paths have changed places; False where system or file system cannot do it at once."""
    first, second = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform.startswith("linux"):
            return library.renameat2(AT_FDCWD, first, AT_FDCWD, second, RENAME_EXCHANGE) == 0
        if sys.platform == "darwin":
            return library.renamex_np(first, second, RENAME_SWAP) == 0
    except (AttributeError, OSError, TypeError):  # a C library that does not know the call, or none at all
        return False
    return False
