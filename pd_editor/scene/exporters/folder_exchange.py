"""Atomic exchange of two folders."""

import ctypes
import os
import sys
from pathlib import Path
from typing import Final

_EXCHANGE: Final = 2
"""RENAME_EXCHANGE of Linux, and RENAME_SWAP of macOS."""
_AT_WORKING_FOLDER: Final = -100


def exchange(one: Path, other: Path) -> bool:
    """Swap two folders of the same disk; return False where the system cannot."""
    paths = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            done = library.renameat2(
                _AT_WORKING_FOLDER, paths[0], _AT_WORKING_FOLDER, paths[1], _EXCHANGE
            )
        elif sys.platform == "darwin":
            done = library.renamex_np(*paths, _EXCHANGE)
        else:
            return False
    # Old C libraries lack the function, and Windows lacks the library.
    except (AttributeError, OSError, TypeError):
        return False
    return done == 0
