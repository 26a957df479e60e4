import queue
import threading

from pd_editor.viewer.state.events import Inbox


def make(on_error=None, tick=None):
    errors = []
    inbox = Inbox(tick=tick or (lambda: None), on_error=on_error or errors.append)
    return inbox, errors


def test_messages_run_in_order_on_one_thread():
    inbox, errors = make()
    seen, done = [], threading.Event()
    inbox.start()
    for number in range(200):
        inbox.post(lambda n=number: seen.append((n, threading.get_ident())))
    inbox.post(done.set)
    assert done.wait(5)
    assert [n for n, _ in seen] == list(range(200))
    assert len({thread for _, thread in seen}) == 1
    assert not errors
    inbox.close()


def test_only_the_newest_of_neighbours_with_one_key_is_kept():
    inbox, _ = make()
    seen, done = [], threading.Event()
    inbox.post(lambda: seen.append("start"))
    for number in range(5):
        inbox.post(lambda n=number: seen.append(n), "drag")
    inbox.post(lambda: seen.append("other"))
    inbox.post(lambda: seen.append(99), "drag")
    inbox.post(done.set)
    inbox.start()
    assert done.wait(5)
    assert seen == ["start", 4, "other", 99]
    inbox.close()


def test_an_error_is_reported_and_the_next_message_still_runs():
    inbox, errors = make()
    done = threading.Event()
    inbox.post(lambda: 1 / 0)
    inbox.post(done.set)
    inbox.start()
    assert done.wait(5)
    assert [type(error) for error in errors] == [ZeroDivisionError]
    inbox.close()


def test_ticks_come_while_nothing_is_posted():
    ticks, enough = [], threading.Event()

    def tick() -> float:
        ticks.append(1)
        if len(ticks) >= 5:
            enough.set()
        return 0.01

    inbox, _ = make(tick=tick)
    inbox.start()
    assert enough.wait(5)
    inbox.close()


def test_nothing_runs_after_close():
    inbox, _ = make()
    seen = []
    worker: queue.Queue[threading.Thread] = queue.Queue()
    inbox.post(lambda: worker.put(threading.current_thread()))
    inbox.start()
    thread = worker.get(timeout=5)
    inbox.close()
    inbox.post(lambda: seen.append(1))
    assert not thread.is_alive()
    assert not seen


def test_the_worker_outlives_an_error_that_cannot_be_shown():
    def refuse(error: Exception) -> None:
        raise RuntimeError("no screen") from error

    inbox, _ = make(on_error=refuse)
    done = threading.Event()
    inbox.post(lambda: 1 / 0)
    inbox.post(done.set)
    inbox.start()
    assert done.wait(5)
    inbox.close()
