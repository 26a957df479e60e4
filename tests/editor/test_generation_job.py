"""A generator on its own thread."""

import logging
import threading

import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.editor.background_job import GenerationJob
from pd_editor.scene.generation import GenerationRequest
from tests.editor.command_strategies import busy_scenario
from tests.editor.fake_generators import DriftGenerator

REQUEST = GenerationRequest(scenario=busy_scenario(), agent_ids=("100",))


class Heard:
    """What a job told, and from which threads."""

    def __init__(self):
        self.progress, self.done, self.errors = [], [], []
        self.threads = set()

    def job(self, generator) -> GenerationJob:
        return GenerationJob(
            generator.name,
            lambda: generator.generate(REQUEST),
            on_progress=lambda one: self.note(self.progress, one),
            on_done=lambda one: self.note(self.done, one),
            on_error=lambda one: self.note(self.errors, one),
        )

    def note(self, where: list, what: object) -> None:
        self.threads.add(threading.current_thread())
        where.append(what)


def test_progress_then_the_result():
    heard = Heard()
    working: set[threading.Thread] = set()
    generator = DriftGenerator(num_steps=3)
    generator.on_step = lambda _step: working.add(threading.current_thread())
    job = heard.job(generator)
    job.start()
    job.wait(10)
    assert [one.message for one in heard.progress] == ["step 0", "step 1", "step 2"]
    (traffic,) = heard.done
    assert traffic.generator == "drift"
    assert heard.errors == []
    assert heard.threads == working
    assert threading.current_thread() not in working
    assert not job.is_running


def test_cancel_stops_within_one_step():
    inside, go_on = threading.Event(), threading.Event()

    def wait_in_second(step: int) -> None:
        if step == 1:
            inside.set()
            assert go_on.wait(10)

    heard = Heard()
    generator = DriftGenerator(num_steps=100, on_step=wait_in_second)
    job = heard.job(generator)
    job.start()
    assert inside.wait(10)
    job.cancel()
    go_on.set()
    job.wait(10)
    assert not job.is_running
    assert generator.steps_begun == [0, 1]
    assert len(heard.progress) == 1
    assert heard.done == heard.errors == []
    assert generator.was_closed.is_set()


def test_cancel_in_the_last_step_gives_no_result():
    heard = Heard()
    job = heard.job(DriftGenerator(num_steps=1, on_step=lambda _: job.cancel()))
    job.start()
    job.wait(10)
    assert heard.done == heard.errors == heard.progress == []


def test_a_refusal_is_passed_on_as_it_is():
    def refuse(step: int) -> None:
        raise GenerationError("No lane for agent 100.")

    heard = Heard()
    job = heard.job(DriftGenerator(on_step=refuse))
    job.start()
    job.wait(10)
    assert [str(error) for error in heard.errors] == ["No lane for agent 100."]
    assert heard.done == []


@pytest.mark.parametrize("fault", [ValueError("secret"), MemoryError(), KeyError(1)])
def test_a_fault_is_logged_and_told_once(fault, caplog):
    def fail(step: int) -> None:
        if step == 2:
            raise fault

    heard = Heard()
    with caplog.at_level(logging.ERROR):
        job = heard.job(DriftGenerator(on_step=fail))
        job.start()
        job.wait(10)
    (error,) = heard.errors
    assert isinstance(error, GenerationError)
    assert str(error) == "drift failed by a fault of its own; the log has details."
    assert caplog.records[0].exc_info[1] is fault
    assert heard.done == []


def test_a_generator_that_fails_before_its_first_step(caplog):
    class Broken:
        name = "broken"

        def generate(self, request):
            raise RuntimeError

    heard = Heard()
    job = heard.job(Broken())
    job.start()
    job.wait(10)
    assert len(heard.errors) == 1
