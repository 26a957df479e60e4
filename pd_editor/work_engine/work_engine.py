"""The port behind which many work items are run, and what comes back."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from traceback import format_exception
from typing import Generic, Protocol, TypeVar, runtime_checkable

from pd_editor.errors import PdEditorError

Item = TypeVar("Item")
Value = TypeVar("Value")


@dataclass(frozen=True, kw_only=True)
class WorkFailure:
    """Why an item has no value; text only, so that it crosses any process border."""

    error: str
    """Name of the exception's class; ``ProcessDied`` if its process was lost."""
    message: str
    traceback: str = ""
    """The worker's traceback, for a log."""
    is_users: bool = False
    """Whether it is an error that users can cause (a ``PdEditorError``), not a bug."""

    @property
    def reason(self) -> str:
        """For the user: the message, after the name of the error if it is a bug's."""
        return self.message if self.is_users else f"{self.error}: {self.message}"


def failure_of(error: Exception) -> WorkFailure:
    """An exception as text."""
    return WorkFailure(
        error=type(error).__name__,
        message=str(error),
        traceback="".join(format_exception(error)),
        is_users=isinstance(error, PdEditorError),
    )


@dataclass(frozen=True, kw_only=True)
class WorkResult(Generic[Value]):
    """What became of one item: a value, or a failure."""

    key: str
    value: Value | None = None
    failure: WorkFailure | None = None
    elapsed_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class WorkProgress:
    """How far a run has come; items done in an earlier run count neither way."""

    num_done: int
    num_failed: int
    num_items: int


@runtime_checkable
class WorkEngine(Protocol):
    """Anything that calls a function on many items."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
    ) -> None:
        """Call ``function`` on every item and hand on each result as it comes.

        Function, items and values must be picklable; keys name the items. Results
        come in any order, in the caller's thread. An item that raises gives a
        failure and never stops the rest. If ``on_result`` raises, or on
        KeyboardInterrupt, what runs is stopped and the exception goes on.
        """
        ...


def run_items(
    engine: WorkEngine,
    function: Callable[[Item], Value],
    items: Mapping[str, Item],
    *,
    on_result: Callable[[WorkResult[Value]], None],
    on_progress: Callable[[WorkProgress], None] | None = None,
    done: Collection[str] = (),
) -> WorkProgress:
    """Run the items whose keys are not in ``done``; the final count.

    To resume, a caller stores each result in ``on_result`` and gives the stored keys
    next time. ``on_progress`` is called once before the first result, then after each.
    """
    left = {key: item for key, item in items.items() if key not in done}
    progress = WorkProgress(num_done=0, num_failed=0, num_items=len(left))

    def tell(new: WorkProgress) -> None:
        nonlocal progress
        progress = new
        if on_progress is not None:
            on_progress(new)

    def take(result: WorkResult[Value]) -> None:
        on_result(result)
        tell(
            WorkProgress(
                num_done=progress.num_done + 1,
                num_failed=progress.num_failed + (result.failure is not None),
                num_items=len(left),
            )
        )

    tell(progress)
    engine.run(function, left, on_result=take)
    return progress
