import itertools
import math

import pytest
import torch

from pd_editor.base.errors import ModelError, TrainingError
from pd_editor.experiments.training.run_config import Budget, Optimisation
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.train_loop import (
    TrainState,
    learning_rate,
    spent,
)
from tests.experiments.training.fake_stage import (
    Numbers,
    config_of,
    fresh_model,
    loop_of,
    noisy_loss,
    number_data,
)


def weights_of(loop) -> torch.Tensor:
    return torch.cat([one.flatten() for one in loop.averaged_model.parameters()])


def stops_after(count):
    asked = itertools.count(1)
    return lambda: next(asked) >= count


def test_training_lowers_the_held_out_loss(tmp_path):
    loop = loop_of(tmp_path, 400)
    assert list(loop.run())[-1].fraction == 1
    short = loop_of(tmp_path / "short", 1)
    list(short.run())
    assert loop.held_out_loss < 0.8 * short.held_out_loss


@pytest.mark.parametrize("stop", [1, 26, 59])
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, stop):
    whole = loop_of(tmp_path / "whole")
    list(whole.run())
    first = loop_of(tmp_path / "parts")
    list(first.run(is_stopped=stops_after(stop)))
    assert first.train_state.step == stop
    second = loop_of(tmp_path / "parts")
    second.resume()
    list(second.run())
    assert second.train_state.step == whole.train_state.step == 60
    assert torch.equal(weights_of(second), weights_of(whole))
    assert second.held_out_loss == whole.held_out_loss
    # A run that has nothing left to do lost its loss, and its model's card did.
    third = loop_of(tmp_path / "parts")
    third.resume()
    assert not list(third.run())
    assert third.held_out_loss == whole.held_out_loss


def test_a_killed_run_goes_on_from_its_checkpoint(tmp_path):
    whole = loop_of(tmp_path / "whole")
    list(whole.run())
    first = loop_of(tmp_path / "parts")
    list(first.run(is_stopped=stops_after(20)))
    lost = loop_of(tmp_path / "parts")
    lost.resume()
    for progress in lost.run():
        if progress.train_state.step >= 45:
            break
    again = loop_of(tmp_path / "parts")
    again.resume()
    assert again.train_state.step == 20
    assert RunFolder(tmp_path / "parts").logged()[-1]["step"] == 20
    list(again.run())
    assert torch.equal(weights_of(again), weights_of(whole))


def test_equal_runs_are_equal_and_seeds_count(tmp_path):
    from dataclasses import replace

    one, two = (loop_of(tmp_path / name, 20) for name in "ab")
    other = loop_of(tmp_path / "c", config=replace(config_of(20), seed=1))
    for loop in (one, two, other):
        list(loop.run())
    assert torch.equal(weights_of(one), weights_of(two))
    assert not torch.equal(weights_of(one), weights_of(other))


def test_global_random_numbers_do_not_count(tmp_path):
    state = torch.random.get_rng_state()
    one = loop_of(tmp_path / "a", 10)
    list(one.run())
    assert torch.equal(torch.random.get_rng_state(), state)


def test_a_batch_without_a_finite_gradient_is_left_out(tmp_path):
    calls = itertools.count()

    def loss(model, batch, random, progress):
        value, parts = noisy_loss(model, batch, random, progress)
        bad = math.nan if next(calls) == 3 else 1.0
        return value * bad, parts

    loop = loop_of(tmp_path, 10, loss=loss)
    list(loop.run())
    assert torch.isfinite(weights_of(loop)).all()
    assert RunFolder(tmp_path).logged()[0]["left_out"] == 1


def test_a_loss_that_stays_no_number_ends_the_run(tmp_path):
    def loss(model, batch, random, progress):
        value, parts = noisy_loss(model, batch, random, progress)
        return value * math.nan, parts

    with pytest.raises(TrainingError, match="lower learning rate"):
        list(loop_of(tmp_path, 50, loss=loss).run())


def test_what_fails_in_the_background_is_raised(tmp_path):
    from dataclasses import replace

    def batch(rows):
        raise TrainingError("broken")

    data = replace(number_data(), batch=batch)
    with pytest.raises(TrainingError, match="broken"):
        list(loop_of(tmp_path, data=data).run())


def test_checkpoints_come_in_time_and_at_the_end(tmp_path):
    from dataclasses import replace

    config = replace(config_of(30), budget=Budget(steps=30, checkpoint_minutes=1e-9))
    written = []
    loop = loop_of(tmp_path, config=config)
    list(loop.run(on_checkpoint=lambda: written.append(loop.train_state.step)))
    assert written == list(range(1, 31))
    list(loop.run(on_checkpoint=lambda: written.append(0)))
    assert len(written) == 30


def test_a_state_of_another_network_is_refused(tmp_path):
    list(loop_of(tmp_path, 5).run())
    other = loop_of(tmp_path, 5)
    first = other._model.get_submodule("0")
    first.weight = torch.nn.Parameter(torch.zeros(9, 4))
    with pytest.raises(ModelError, match="shape"):
        other.resume()


def test_the_learning_rate_warms_up_stays_and_falls():
    law = Optimisation(learning_rate=2.0, warmup_steps=9, constant_share=0.5)
    assert learning_rate(law, 0, 0.0) == pytest.approx(0.2)
    assert learning_rate(law, 9, 0.1) == 2.0
    assert learning_rate(law, 50, 0.5) == 2.0
    assert learning_rate(law, 75, 0.75) == pytest.approx(1.0)
    assert learning_rate(law, 100, 1.0) == pytest.approx(0.0)
    rates = [learning_rate(law, 50 + k, 0.5 + k / 100) for k in range(51)]
    assert all(later <= rate for rate, later in itertools.pairwise(rates))


def test_the_warm_up_of_a_short_run_is_over_after_a_tenth_of_it():
    law = Optimisation(learning_rate=2.0, warmup_steps=100)
    assert learning_rate(law, 3, 0.1) == 2.0
    assert learning_rate(law, 2, 0.05) == 1.0
    assert learning_rate(law, 10, 0.01) == pytest.approx(2.0 * 11 / 101)


def test_steps_count_before_minutes():
    train_state = TrainState(step=5, trained_s=30)
    assert spent(Budget(steps=10, minutes=0.1), train_state) == 0.5
    assert spent(Budget(minutes=2), train_state) == 0.25


def test_the_data_is_seen_in_all_processes_parts(tmp_path):
    batch = number_data().batch(torch.arange(3).numpy())
    assert isinstance(batch, Numbers)
    assert fresh_model()(batch.values).shape == (3, 4)
