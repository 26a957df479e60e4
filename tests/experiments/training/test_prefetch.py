import threading

import pytest

from pd_editor.experiments.training.train_loop import prefetched


def test_items_come_in_order_from_where_it_begins():
    with prefetched(lambda index: index * index, first=3) as items:
        assert [next(items) for _ in range(20)] == [k * k for k in range(3, 23)]


def test_it_works_ahead_but_not_without_end():
    made = []
    with prefetched(lambda index: made.append(index) or index, first=0, ahead=2) as it:
        next(it)
    assert len(made) <= 5


def test_the_thread_ends_with_it():
    before = threading.active_count()
    with prefetched(lambda index: index, first=0):
        assert threading.active_count() == before + 1
    assert threading.active_count() == before


def test_errors_come_when_their_item_is_due():
    def make(index):
        if index == 2:
            raise ValueError("two")
        return index

    with prefetched(make, first=0) as items:
        assert [next(items), next(items)] == [0, 1]
        with pytest.raises(ValueError, match="two"):
            next(items)
