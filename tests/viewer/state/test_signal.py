"""Signals tell all that have subscribed, in their order, on one thread."""

import threading

import pytest

from pd_editor.viewer.state.events import Signal


def test_an_error_of_one_subscriber_does_not_stop_the_others():
    told, signal = [], Signal[int]()

    def fails(value: int) -> None:
        told.append(-value)
        raise ValueError(f"first, {value}")

    def fails_too(value: int) -> None:
        raise KeyError(value)

    signal.subscribe(told.append, fails, fails_too, told.append)
    with pytest.raises(ValueError, match="first, 3"):
        signal.emit(3)
    assert told == [3, -3, 3]


def test_an_offer_ends_with_the_first_that_takes_it():
    asked, signal = [], Signal[str]()
    assert not signal.offer("nobody is there")
    for name, takes in (("a", False), ("b", True), ("c", True)):
        signal.subscribe(lambda _, name=name, takes=takes: asked.append(name) or takes)
    assert signal.offer("x")
    assert asked == ["a", "b"]


def test_another_thread_tells_only_when_that_of_the_tab_has_ended():
    told, signal, refused = [], Signal[()](), []
    go_on = threading.Event()

    def tab() -> None:
        signal.subscribe(lambda: told.append(1))
        subscribed.set()
        go_on.wait(20)

    subscribed = threading.Event()
    thread = threading.Thread(target=tab)
    thread.start()
    subscribed.wait(20)
    try:
        signal.emit()
    except AssertionError as error:
        refused.append(error)
    go_on.set()
    thread.join()
    assert refused
    signal.emit()
    assert told == [1]
