"""Memory that the process keeps instead of handing it back to the system."""

import ctypes
import sys
from typing import Final

_TRIM_THRESHOLD: Final = -1
_TOP_PAD: Final = -2
_MMAP_THRESHOLD: Final = -3
_TAKEN_AT_ONCE: Final = 1 << 26

WHEN_DRAWING: Final = 1 << 28
WHEN_TRAINING: Final = 1 << 30


def keep_freed_memory(most_bytes: int) -> bool:
    """Have the C library keep freed memory for what comes next, up to some bytes.

    Tensors of some megabytes come and go at each step; by default each time the system
    clears their pages anew, which is 6 % of the time of drawing futures.

    Returns:
        Whether it does; only the GNU library can be told to.
    """
    if not sys.platform.startswith("linux"):
        return False
    tell = getattr(ctypes.CDLL(None), "mallopt", None)
    if tell is None:
        return False
    # All three: each one set switches off the library's own adaption of the others.
    wishes = {
        _MMAP_THRESHOLD: most_bytes,
        _TRIM_THRESHOLD: most_bytes,
        _TOP_PAD: _TAKEN_AT_ONCE,
    }
    answers = [tell(name, size) for name, size in wishes.items()]
    return all(answers)
