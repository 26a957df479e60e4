"""A guard around code of others: its faults become sentences, the process stays as it is."""

import contextlib
import importlib
import os
import re
import signal
import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Final, TypeVar

from pd_editor.base.errors import GenerationError, LargeSceneError, PdEditorError
from pd_editor.base.plain_text import nearest_or_all

Value = TypeVar("Value")

_OWN_CODE: Final = str(Path(__file__).parents[1])
_REFERENCE: Final = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
_WAYS_OUT: Final = "_exit", "execv", "execve"
"""Functions of ``os`` that end this program without an exception."""
_INSIDE: Final = threading.local()
"""Has the id of the process while the thread runs foreign code."""


def asked(
    ask: Callable[[], Value],
    place: str,
    failed: str,
    kind: type[PdEditorError] = GenerationError,
) -> Value:
    """What foreign code answers.

    Raises:
        PdEditorError: of this kind: it raised anything, or tried to end the program;
            ``place`` and ``failed`` say whose code and what it did not do.
        KeyboardInterrupt: the user interrupted it.
    """
    with _unchanged_process() as was_interrupted:
        try:
            return ask()
        except LargeSceneError:
            raise  # A part can be opened.
        except PdEditorError as error:
            told = str(error)
            is_placed = told.startswith(f"{place}:")
            raise kind(told if is_placed else f"{place}: {told}") from error
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt) and was_interrupted():
                raise
            raise kind(f"{place}{failed} ({described(error)}).") from error


def is_reference(name: str) -> bool:
    """Whether a name has the form ``package.module:attribute``."""
    return _REFERENCE.fullmatch(name) is not None


def object_of_reference(
    reference: str, kind: type[PdEditorError] = GenerationError
) -> Any:
    """The object that ``package.module:attribute`` names.

    Modules are looked for in the current folder as well.

    Raises:
        PdEditorError: of this kind: it cannot be imported, or is not there.
    """
    module_name, _, attribute = reference.partition(":")
    folder = os.getcwd()
    if folder not in sys.path:
        # A console script has its own folder there, not the one that it was run in.
        sys.path.append(folder)
    failed = ": cannot be imported"
    load = partial(importlib.import_module, module_name)
    found: Any = asked(load, reference, failed, kind)
    for part in attribute.split("."):
        missing = object()
        inner = asked(partial(getattr, found, part, missing), reference, failed, kind)
        if inner is missing:
            public = [name for name in dir(found) if not name.startswith("_")]
            raise kind(
                f"{reference}: {module_name} has no attribute {attribute!r}; "
                f"{nearest_or_all(part, public)}."
            )
        found = inner
    return found


def origin_of(entry_point: EntryPoint) -> str:
    """Where an entry point is from, in words."""
    package = entry_point.dist.name if entry_point.dist else "an unknown package"
    return f"{entry_point.value} of the package {package}"


def described(error: BaseException) -> str:
    """Class and text of an exception, and the line of the user's file, in one line."""
    places = [
        (frame.filename, frame.lineno)
        for frame in traceback.extract_tb(error.__traceback__)
    ]
    if isinstance(error, SyntaxError) and error.filename:
        places.append((error.filename, error.lineno))
    own = [place for place in places if _is_users(place[0])]
    at = f" in {Path(own[-1][0]).name}:{own[-1][1]}" if own else ""
    try:
        text = str(error.msg if isinstance(error, SyntaxError) else error)
    except BaseException:  # noqa: BLE001  (its class is foreign code as well)
        text = "its text cannot be read"
    return f"{type(error).__name__}{': ' if text else ''}{text}{at}"


def _is_users(file: str) -> bool:
    """Whether code of a file is the user's, not ours, a library's or Python's."""
    return not (
        file.startswith(("<", _OWN_CODE, sysconfig.get_path("stdlib")))
        or "site-packages" in Path(file).parts
    )


@contextlib.contextmanager
def _unchanged_process() -> Iterator[Callable[[], bool]]:
    """Keep working folder, signals, output and life of the process.

    In the main thread, what is printed goes to stderr, since stdout has the results.
    Yields a function that tells whether the user has interrupted.
    """
    _guard_ways_out()
    folder, outer = _working_folder(), getattr(_INSIDE, "process", None)
    is_main = threading.current_thread() is threading.main_thread()
    former = {one: signal.getsignal(one) for one in signal.valid_signals() if is_main}
    interrupts: list[int] = []

    def interrupted(number: int, frame: Any) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    if former.get(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupted)
    elif is_main:
        # Another handler does not tell; only the main thread can be interrupted.
        interrupts.append(signal.SIGINT)
    _INSIDE.process = os.getpid()
    try:
        with contextlib.redirect_stdout(sys.stderr if is_main else sys.stdout):
            yield lambda: bool(interrupts)
    finally:
        _INSIDE.process = outer
        for number, handler in former.items():
            if handler is not None and signal.getsignal(number) is not handler:
                signal.signal(number, handler)
        if folder is not None and _working_folder() != folder:
            os.chdir(folder)


@cache
def _guard_ways_out() -> None:
    """Let ways out of the program raise inside of foreign code, and nowhere else."""

    def staying(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def stay(*values: Any) -> Any:
            # A forked child of the code may leave.
            if getattr(_INSIDE, "process", None) == os.getpid():
                raise SystemExit(f"os.{name} would end the program")
            return real(*values)

        return stay

    for name in _WAYS_OUT:
        setattr(os, name, staying(name, getattr(os, name)))


def _working_folder() -> str | None:
    """The working folder; None if it was deleted."""
    try:
        return os.getcwd()
    except OSError:
        return None
