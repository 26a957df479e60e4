"""Makes what is needed next while something else is computed."""

import contextlib
import queue
import threading
from collections.abc import Callable, Generator, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")


@contextlib.contextmanager
def prefetched(
    make: Callable[[int], _Item], *, first: int, ahead: int = 3
) -> Generator[Iterator[_Item], None, None]:
    """Items ``make(first)``, ``make(first + 1)`` and so on, made by another thread.

    Args:
        make: Called in order; what it raises is raised by the iterator.
        first: Where to begin.
        ahead: How many items wait at most.
    """
    waiting: queue.Queue[tuple[_Item | None, BaseException | None]] = queue.Queue(ahead)
    is_over = threading.Event()

    def work() -> None:
        index = first
        while not is_over.is_set():
            try:
                made = (make(index), None)
            except BaseException as error:  # noqa: BLE001 (raised where it is awaited)
                made = (None, error)
            while not is_over.is_set():
                with contextlib.suppress(queue.Full):
                    waiting.put(made, timeout=0.1)
                    break
            index += 1
            if made[1] is not None:
                return

    def items() -> Iterator[_Item]:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            assert item is not None
            yield item

    thread = threading.Thread(target=work, name="prefetch", daemon=True)
    thread.start()
    try:
        yield items()
    finally:
        is_over.set()
        thread.join()
