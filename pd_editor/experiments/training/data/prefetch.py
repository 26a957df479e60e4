"""Prefetching of items in a background thread."""

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
    """Iterator over ``make(first)``, ``make(first + 1)`` and so on, made in another thread.

    At most ``ahead`` items are ready; exceptions of ``make`` are raised in order.
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
