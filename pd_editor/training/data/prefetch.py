"""Makes what is needed next while something else is computed."""

import contextlib
import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
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
    with ThreadPoolExecutor(1, thread_name_prefix="prefetch") as thread:
        waiting = deque(thread.submit(make, first + index) for index in range(ahead))

        def items() -> Iterator[_Item]:
            for index in itertools.count(first + ahead):
                item = waiting.popleft().result()
                waiting.append(thread.submit(make, index))
                yield item

        try:
            yield items()
        finally:
            thread.shutdown(cancel_futures=True)
