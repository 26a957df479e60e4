"""Runs one input in a forked process of its own, within limits, and judges the end."""

import contextlib
import os
import re
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pd_editor.base.errors import PdEditorError

Verdict = Literal["refused", "accepted", "unclear", "crash", "hang", "memory"]
VERDICTS: tuple[Verdict, ...] = (
    "refused",
    "accepted",
    "unclear",
    "crash",
    "hang",
    "memory",
)
LIMIT_S = 20
"""Of processor time; a busy machine may take longer."""
LONGEST_WAIT_S = 120
"""In all, for an input that waits and does nothing."""
LIMIT_BYTES = 2**30


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How an input was taken."""

    verdict: Verdict
    said: str
    elapsed_s: float
    """Processor time, or all of the time where it waited in vain."""
    peak_bytes: int


def ending_of(action: Callable[[], object], folder: Path) -> Ending:
    """Run an action in a fork; an int that it returns is its exit code.

    Errors on purpose count as one line and exit code 2, as in the shell.
    """
    log = folder / "said"
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        # Processes that it starts end with it.
        os.setsid()
        _run(action, log)
    deadline = began + LONGEST_WAIT_S
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            break
        time.sleep(0.005)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    waited = time.monotonic() - began
    used = usage.ru_utime + usage.ru_stime
    elapsed = waited if waited > LONGEST_WAIT_S else used
    said = log.read_text(errors="replace") if log.exists() else ""
    # The whole process counts: the interpreter and what it has imported as well.
    peak = usage.ru_maxrss * 1024
    return Ending(
        verdict=_verdict(os.waitstatus_to_exitcode(status), said, elapsed, peak),
        said=said,
        elapsed_s=elapsed,
        peak_bytes=peak,
    )


def _verdict(code: int, said: str, elapsed_s: float, peak_bytes: int) -> Verdict:
    if elapsed_s >= LIMIT_S or code == -signal.SIGXCPU:
        return "hang"
    if peak_bytes > LIMIT_BYTES or "MemoryError" in said:
        return "memory"
    if "Traceback" in said or "never retrieved" in said or code not in (0, 2):
        return "crash"
    if code == 0:
        return "accepted"
    # A reader goes on without a bad note, and may then meet what it refuses.
    said = re.sub("WARNING A part of the description is left out: .*\n(?=.)", "", said)
    is_sentence = re.fullmatch(r"(pd-editor: |WARNING ).*\.\)?\n", said) is not None
    return "refused" if is_sentence and len(said) < 1000 else "unclear"


def _run(action: Callable[[], object], log: Path) -> None:
    """Never returns."""
    code = 1
    try:
        number = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(number, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stderr = os.fdopen(2, "w", errors="backslashreplace", closefd=False)
        sys.stdout = os.fdopen(1, "w", errors="backslashreplace", closefd=False)
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S + 1))
        # Address space, for bombs; what counts is the peak of what is used.
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        limit = used + 4 * LIMIT_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        result = action()
        code = result if isinstance(result, int) else 0
    except PdEditorError as error:
        sys.stderr.write(f"pd-editor: {error}\n")
        code = 2
    except BaseException:  # noqa: BLE001  (what a fork ends with must be told)
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
