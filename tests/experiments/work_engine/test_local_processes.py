import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import (
    InThisProcess,
    WorkEngine,
    run_items,
)
from tests.experiments.work_engine.work_functions import (
    cannot_travel_back,
    dies_on_three,
    fails_for_the_user,
    process_id,
    sleep,
    square,
    square_of_odd,
    threads,
)

ROOT = Path(__file__).parents[3]
ENGINE = LocalProcesses(num_workers=2)


def results_of(function, numbers, **options) -> dict:
    """Values by key, or failures."""
    found = {}

    def keep(key, value) -> None:
        assert key not in found
        found[key] = value

    items = {str(number): number for number in numbers}
    engine = options.pop("engine", ENGINE)
    failures = run_items(engine, function, items, on_value=keep, **options)
    assert not found.keys() & failures
    return found | failures


def test_it_is_a_work_engine():
    assert isinstance(ENGINE, WorkEngine)


def test_every_item_gives_its_value():
    found = results_of(square, range(20))
    assert found == {str(number): number**2 for number in range(20)}


def test_items_that_are_done_already_are_not_told_as_failed():
    """A second run said that scenes had failed, which had been done before."""
    for harmless, failed in (("", 3), ("ValueError", 0)):
        seen: list[int] = []
        results_of(
            square_of_odd,
            range(6),
            engine=InThisProcess(),
            harmless=harmless,
            on_progress=lambda one, seen=seen: seen.append(one.num_failed),
        )
        assert seen[-1] == failed


def test_no_items_need_no_process():
    assert results_of(square, []) == {}


def test_a_failing_item_stops_no_other():
    found = results_of(square_of_odd, range(6))
    assert [found[str(k)] for k in (1, 3, 5)] == [1, 9, 25]
    failure = found["4"]
    assert (failure.error, failure.message) == ("ValueError", "4 is even")
    assert "square_of_odd" in failure.traceback
    assert not failure.is_users


def test_errors_of_users_are_told_apart():
    failure = results_of(fails_for_the_user, [0])["0"]
    assert failure.is_users
    assert failure.message == "The map has no lanes."


def test_a_dying_process_fails_its_own_item_only():
    found = results_of(dies_on_three, range(7))
    assert found.pop("3").error == "ProcessDied"
    assert found == {str(number): number for number in (0, 1, 2, 4, 5, 6)}


def test_what_cannot_be_pickled_fails_alone():
    found = results_of(cannot_travel_back, [0, 1])
    assert found["0"] == 0
    assert "pickle" in found["1"].message
    found = {}
    ENGINE.run(
        lambda number: number,
        {"local": 0},
        on_result=lambda result: found.update({result.key: result}),
    )
    assert found["local"].failure is not None


def test_work_is_spread_over_other_processes():
    ids = set(results_of(process_id, range(4)).values())
    assert len(ids) == 2
    assert os.getpid() not in ids


def test_workers_have_one_thread():
    before = dict(os.environ)
    assert results_of(threads, [0])["0"] == ("1", 1)
    assert dict(os.environ) == before


def test_done_items_are_left_out_and_progress_counts_the_rest():
    said = []
    found = results_of(
        square_of_odd, range(5), done={"0", "1", "other"}, on_progress=said.append
    )
    assert sorted(found) == ["2", "3", "4"]
    assert list(dict.fromkeys(one.num_done for one in said)) == [0, 1, 2, 3]
    assert {progress.num_items for progress in said} == {3}
    assert said[-1].num_failed == 2


def test_an_error_of_the_caller_stops_the_run():
    seen = []

    def refuse(key, _) -> None:
        seen.append(key)
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        run_items(ENGINE, square, {str(k): k for k in range(50)}, on_value=refuse)
    assert len(seen) == 1


def test_a_run_can_be_ended_while_its_items_run():
    class Ended(Exception):
        pass

    began = time.monotonic()

    def end(_) -> None:
        if time.monotonic() - began > 1.0:
            raise Ended

    with pytest.raises(Ended):
        results_of(sleep, [300.0, 301.0], on_progress=end)
    assert time.monotonic() - began < 100.0


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to a child")
@pytest.mark.parametrize("kill", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_whoever_started_them(kill: signal.Signals):
    run = subprocess.Popen(
        [sys.executable, "-m", "tests.experiments.work_engine.interrupted_run"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with run:
        assert run.stdout is not None
        worker = int(run.stdout.readline())
        assert run.stdout.readline() == "sleeping\n"
        time.sleep(1.0)
        if kill is signal.SIGINT:
            os.killpg(run.pid, kill)
            assert run.wait(60) == 130
            with pytest.raises(ProcessLookupError):
                os.kill(worker, 0)
        else:
            run.send_signal(kill)
            assert run.wait(60) == -kill
    # The resource tracker of multiprocessing goes a moment after its parent.
    end = time.monotonic() + 60
    while _group_lives(run.pid):
        assert time.monotonic() < end, "a worker was left behind"
        time.sleep(0.1)


def _group_lives(leader: int) -> bool:
    try:
        os.killpg(leader, 0)
    except ProcessLookupError:
        return False
    return True


UNGUARDED = """
import sys
from pathlib import Path
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import run_items
from pd_editor.experiments.work_engine.work_folder import WorkFolder
from tests.experiments.work_engine.work_functions import square

print("runs", flush=True)
Path("begun").open("a").write("x")
WorkFolder(Path("out"))
Path("began-work").open("a").write("x")
run_items(LocalProcesses(num_workers=2), square, {"1": 1}, on_value=print)
"""


@pytest.mark.parametrize("is_file", [True, False])
def test_a_script_that_its_workers_would_run_again_is_told(tmp_path, is_file: bool):
    """It was said that the worker died, and may have run out of memory."""
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, script.name if is_file else "-"],
        input=UNGUARDED,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    told = "below if __name__ ==" if is_file else "save it as a file"
    assert told in done.stderr.splitlines()[-1], done.stderr
    assert "memory" not in done.stderr
    # Workers ended before the work of their caller, which ran once.
    assert (tmp_path / "began-work").read_text() == "x"
