"""Background generation of the newest request only."""

import threading
from dataclasses import replace

import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.editor import live_regeneration
from pd_editor.editor.live_regeneration import NewestRun
from pd_editor.scene.generation import GenerationRequest
from tests.editor.command_strategies import busy_scenario
from tests.editor.fake_generators import DriftGenerator

REQUEST = GenerationRequest(scenario=busy_scenario(), agent_ids=("100",))


class Gate:
    """A generator that waits at its first step until it is opened."""

    def __init__(self, num_steps: int = 4) -> None:
        self.reached, self.opened = threading.Event(), threading.Event()
        self.generator = DriftGenerator(num_steps=num_steps, on_step=self._at)

    def _at(self, step: int) -> None:
        if step == 0:
            self.reached.set()
            assert self.opened.wait(10)


class Heard:
    """Results and errors of requests, by their seeds."""

    def __init__(self) -> None:
        self.seeds: list[int] = []
        self.errors: list[str] = []
        self.threads: set[threading.Thread] = set()
        self.changed = threading.Condition()

    def ask(self, run: NewestRun, generator, seed: int) -> None:
        run.ask(
            generator,
            replace(REQUEST, seed=seed),
            lambda traffic: self._note(self.seeds, traffic.seed),
            lambda error: self._note(self.errors, str(error)),
        )

    def _note(self, where: list, what: object) -> None:
        with self.changed:
            self.threads.add(threading.current_thread())
            where.append(what)
            self.changed.notify_all()

    def wait_for(self, count: int) -> None:
        with self.changed:
            assert self.changed.wait_for(
                lambda: len(self.seeds) + len(self.errors) >= count, 10
            )


@pytest.fixture
def run():
    made = NewestRun()
    yield made
    made.close(10)


def test_of_waiting_requests_only_the_live_regenerations(run, monkeypatch):
    monkeypatch.setattr(live_regeneration, "LONGEST_GAP_S", 60.0)
    heard, gate = Heard(), Gate()
    heard.ask(run, DriftGenerator(), 0)
    heard.wait_for(1)
    heard.ask(run, gate.generator, 1)
    assert gate.reached.wait(10)
    for seed in (2, 3, 4):
        heard.ask(run, DriftGenerator(), seed)
    gate.opened.set()
    heard.wait_for(2)
    assert heard.seeds == [0, 4]
    assert gate.generator.steps_begun == [0], "cancelled between its steps"
    assert gate.generator.was_closed.is_set()
    (thread,) = heard.threads
    assert thread is not threading.main_thread()


def test_frequent_requests_do_not_prevent_results(run, monkeypatch):
    """An obsolete run is completed if the last result is old."""
    monkeypatch.setattr(live_regeneration, "LONGEST_GAP_S", 0.0)
    heard, gate = Heard(), Gate()
    heard.ask(run, gate.generator, 1)
    assert gate.reached.wait(10)
    heard.ask(run, DriftGenerator(), 2)
    gate.opened.set()
    heard.wait_for(2)
    assert heard.seeds == [1, 2]


def test_an_obsolete_run_near_its_end_is_completed(run, monkeypatch):
    monkeypatch.setattr(live_regeneration, "LONGEST_GAP_S", 60.0)
    heard, gate = Heard(), Gate(num_steps=2)
    heard.ask(run, DriftGenerator(), 0)
    heard.wait_for(1)
    heard.ask(run, gate.generator, 1)
    assert gate.reached.wait(10)
    heard.ask(run, DriftGenerator(), 2)
    gate.opened.set()
    heard.wait_for(3)
    assert heard.seeds == [0, 1, 2]


def test_nothing_is_told_after_a_drop(run):
    heard, gate = Heard(), Gate()
    heard.ask(run, gate.generator, 1)
    assert gate.reached.wait(10)
    heard.ask(run, DriftGenerator(), 2)
    run.drop()
    gate.opened.set()
    heard.ask(run, DriftGenerator(), 3)
    heard.wait_for(1)
    assert heard.seeds == [3]
    assert heard.errors == []


def test_errors_and_bugs_are_told(run, caplog):
    heard = Heard()

    def refuse(_step: int) -> None:
        raise GenerationError("No.")

    def break_down(_step: int) -> None:
        raise ZeroDivisionError

    heard.ask(run, DriftGenerator(on_step=refuse), 1)
    heard.wait_for(1)
    heard.ask(run, DriftGenerator(on_step=break_down), 2)
    heard.wait_for(2)
    assert heard.errors == [
        "No.",
        "drift failed by a fault of its own; the log has details.",
    ]
    assert "drift failed" in caplog.text


def test_a_closed_run_takes_no_requests(run):
    heard = Heard()
    threads: set[threading.Thread] = set()
    note = lambda _step: threads.add(threading.current_thread())  # noqa: E731
    heard.ask(run, DriftGenerator(on_step=note), 1)
    heard.wait_for(1)
    run.close(10)
    heard.ask(run, DriftGenerator(), 2)
    assert heard.seeds == [1]
    (thread,) = threads
    assert not thread.is_alive()
