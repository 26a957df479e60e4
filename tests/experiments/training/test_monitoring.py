import time

import pytest

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.monitoring import (
    FOLDER_NAME,
    Monitoring,
    tensorboard_log,
)
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.train_loop import TrainState
from tests.experiments.training.fake_stage import loop_of

# TensorBoard's libraries use what NumPy and protobuf advise against.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
FIGURES = {"samples": {"min_ade": 1.5}, "recorded": {"speed": 2.0}}
EVERY_FIVE = Monitoring(
    evaluate_minutes=5.0, check_of=lambda _roots, _stage: lambda _folder: FIGURES
)


def minutes_looked(run: RunFolder, minutes, *, last: float | None = None) -> list:
    """Minutes at which samples are evaluated, if the run is looked at at some times."""
    watch = EVERY_FIVE.watch([run.path], "traj", run)
    assert watch is not None
    for one in minutes:
        state = TrainState(step=int(10 * one), trained_s=60.0 * one)
        watch.look(state, is_over=one == last)
    return [entry["minutes"] for entry in run.logged() if "samples" in entry]


def test_samples_are_evaluated_every_few_minutes_and_at_the_end(tmp_path):
    run = RunFolder(tmp_path)
    assert minutes_looked(run, [3, 6, 9, 12], last=12) == [6, 12]
    assert minutes_looked(run, [14, 17, 18], last=18) == [6, 12, 17, 18]
    assert run.logged()[0]["samples"] == {"min_ade": 1.5}
    run.forget_after(130)
    assert minutes_looked(run, [13, 16.5, 17]) == [6, 12, 17]


def test_samples_without_scenes_of_their_own_are_refused(tmp_path):
    with pytest.raises(TrainingError, match="needs --validate"):
        EVERY_FIVE.watch([], "traj", RunFolder(tmp_path))
    with pytest.raises(TrainingError, match="--evaluate-every is 0"):
        Monitoring(evaluate_minutes=0.0)


def test_the_time_of_an_evaluation_is_no_training(tmp_path):
    loop = loop_of(tmp_path, 5)
    began = time.perf_counter()
    list(loop.run(on_checkpoint=lambda: time.sleep(0.5)))
    loop_of_more = loop_of(tmp_path, 10)
    loop_of_more.resume()
    list(loop_of_more.run(on_checkpoint=lambda: time.sleep(0.5)))
    took_s = time.perf_counter() - began
    assert loop_of_more.train_state.trained_s < took_s - 0.9


def test_tensorboard_reads_losses_and_samples(tmp_path):
    events = pytest.importorskip(
        "tensorboard.backend.event_processing.event_accumulator"
    )
    run = RunFolder(tmp_path)
    with tensorboard_log(run, 1):
        for step in (1, 2):
            run.log(
                {
                    "step": step,
                    "minutes": 1.0,
                    "held_out": step == 2,
                    "loss": 0.5,
                    "parts": {"noise": 0.25},
                }
            )
        run.log({"step": 2, "minutes": 1.0, "samples": {"ade": 3.0}, "recorded": {}})
    with tensorboard_log(run, 2):  # A resumed run hides what it repeats.
        run.log({"step": 2, "minutes": 1.0, "samples": {"ade": 2.0}, "recorded": {}})
    found = events.EventAccumulator(str(tmp_path / FOLDER_NAME))
    found.Reload()
    assert set(found.Tags()["scalars"]) == {
        "loss/training",
        "loss/held out",
        "training/noise",
        "held out/noise",
        "samples/ade",
    }
    assert found.Scalars("loss/held out") == []
    assert [one.value for one in found.Scalars("samples/ade")] == [2.0]
