import signal
import threading
import time

import pytest

from pd_editor.experiments.work_engine.local_processes import (
    PROCESS_DIED,
    LocalProcesses,
)
from pd_editor.experiments.work_engine.work_engine import TimeLimitError, time_limit


def loop_for_ever() -> None:
    while True:
        pass


def test_a_loop_is_stopped_and_the_signal_is_as_before():
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(TimeLimitError, match=r"within 0\.05 s"), time_limit(0.05):
        loop_for_ever()
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_what_is_done_in_time_goes_on():
    with time_limit(30.0):
        done = sum(range(1000))
    assert done == 499_500
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_loop_in_another_thread_is_stopped_and_what_follows_goes_on():
    found = []

    def run() -> None:
        try:
            with time_limit(0.05):
                loop_for_ever()
        except TimeLimitError as error:
            found.append(str(error))
        with time_limit(30.0):
            found.append("done")

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == ["It gave no answer within 0.05 s.", "done"]


def test_without_a_limit_all_runs_as_it_is():
    before = signal.getsignal(signal.SIGALRM)
    with time_limit(None):
        assert signal.getsignal(signal.SIGALRM) is before
    with time_limit(5.0):
        assert signal.getsignal(signal.SIGALRM) is not before


def deaf(seconds: float) -> str:
    """Like a library that does not come back to Python: signals wait."""
    if not seconds:
        return "done"
    with time_limit(0.1):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
        time.sleep(seconds)
    return "late"


@pytest.mark.slow
def test_a_worker_that_hears_no_signal_ends_and_its_other_items_are_done():
    results = {}
    engine = LocalProcesses(num_workers=2)
    engine.run(
        deaf,
        {"good": 0.0, "hangs": 60.0, "well": 0.0},
        on_result=lambda one: results.__setitem__(one.key, one),
    )
    assert results["hangs"].failure == PROCESS_DIED
    assert [results[key].value for key in ("good", "well")] == ["done", "done"]
