import math

import pytest
import torch
from lightning_fabric import Fabric

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.shards import shard_bytes
from pd_editor.experiments.training.run_config import (
    Budget,
    Optimisation,
    Precision,
    RunConfig,
)
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.settings import PRESETS
from pd_editor.experiments.training.stage_objective import STAGES
from pd_editor.experiments.training.train_loop import TrainLoop
from pd_editor.experiments.training.training_data import (
    prepared_data,
    training_data,
)
from pd_editor.generation.checkpoints.model_folder import load_model
from pd_editor.generation.stages import STAGE_KINDS
from tests.experiments.recordings.recordings import drive


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corpus")
    recording = drive(num_agents=16)
    windows = choose_windows(recording, seed=3, num_windows=8)
    (folder / "one.shard").write_bytes(shard_bytes([(recording, windows)]))
    return prepared_data([folder], tmp_path_factory.mktemp("cache"), workers=1)


def loop_of(
    name, prepared, folder, *, steps, precision: Precision = "32", optimisation=None
):
    preset = PRESETS[name]["tiny"]
    stage = STAGES[name]
    config = RunConfig(
        stage=name,
        data=("corpus",),
        model=preset.model,
        precision=precision,
        optimisation=optimisation or preset.optimisation,
        budget=Budget(steps=steps, held_out_share=0.0),
    )
    folder.mkdir(exist_ok=True)
    return TrainLoop(
        config,
        stage.fresh_model(stage.kind.config_type(**preset.model), prepared.basis, 0),
        stage.loss({}),
        training_data(prepared.store, config.budget, 0),
        RunFolder(folder),
        Fabric(
            accelerator="cpu",
            devices=1,
            precision="32-true" if precision == "32" else "bf16-mixed",
        ),
    )


@pytest.mark.parametrize("name", ["init", "traj"])
def test_a_resumed_run_equals_an_uninterrupted_one(name, prepared, tmp_path):
    whole = loop_of(name, prepared, tmp_path / "whole", steps=6)
    list(whole.run())
    first = loop_of(name, prepared, tmp_path / "parts", steps=6)
    list(first.run(is_stopped=lambda: first.train_state.step >= 2))
    second = loop_of(name, prepared, tmp_path / "parts", steps=6)
    second.resume()
    assert 0 < second.train_state.step < 6
    list(second.run())
    for one, two in zip(
        whole.averaged_model.state_dict().values(),
        second.averaged_model.state_dict().values(),
        strict=True,
    ):
        assert torch.equal(one, two)


@pytest.mark.parametrize("name", ["init", "traj"])
def test_own_samples_add_to_the_loss_of_denoising(name, prepared):
    stage = STAGES[name]
    config = stage.kind.config_type(**PRESETS[name]["tiny"].model)
    model = stage.fresh_model(config, prepared.basis, 3)
    data = training_data(prepared.store, Budget(), 0)
    scene = data.batch(data.training_rows[0])

    def loss(**settings):
        random = torch.Generator().manual_seed(0)
        return stage.loss({}, settings)(model, scene, random, 1.0)

    alone, parts = loss()
    both, more = loss(weight=2.0, num_samples=1)
    assert more.keys() == {*parts, "own_collision"}
    added = 2.0 * float(more["own_collision"].detach())
    assert float(both.detach()) == pytest.approx(float(alone.detach()) + added)
    with pytest.raises(TrainingError, match="own_samples has no field 'colision'"):
        loss(colision=1.0)


@pytest.mark.parametrize("name", ["init", "traj"])
def test_bf16_trains_too(name, prepared, tmp_path):
    loop = loop_of(name, prepared, tmp_path, steps=3, precision="bf16")
    last = list(loop.run())[-1]
    assert math.isfinite(last.loss)
    assert all(one.dtype == torch.float32 for one in loop.averaged_model.parameters())


# The first stage's last losses count overlaps as well.
@pytest.mark.slow
@pytest.mark.parametrize(("name", "share"), [("init", 0.7), ("traj", 0.5)])
def test_a_tiny_network_learns_few_scenes_within_a_minute(
    name, share, prepared, tmp_path
):
    law = Optimisation(
        batch_size=8, learning_rate=5e-3, warmup_steps=10, ema_decay=0.98
    )
    loop = loop_of(name, prepared, tmp_path, steps=600, optimisation=law)
    losses = [progress.loss for progress in loop.run()]
    assert losses[-1] < share * losses[0]


@pytest.mark.parametrize("name", ["init", "traj"])
def test_shipped_weights_give_nearly_the_same_loss(name, prepared, tmp_path):
    from pd_editor.generation.checkpoints.model_folder import TrainedStage, save_model

    stage = STAGES[name]
    config = stage.kind.config_type(**PRESETS[name]["tiny"].model)
    model = stage.fresh_model(config, prepared.basis, 3)
    trained = TrainedStage(kind=stage.kind, config=config, model=model, about={})
    save_model(tmp_path, {name: trained}, half=True)
    loaded = load_model(tmp_path, STAGE_KINDS).stage(name).model
    data = training_data(prepared.store, Budget(), 0)
    scene = data.batch(data.training_rows[0])
    with torch.no_grad():
        first, second = (
            stage.loss({})(one, scene, torch.Generator().manual_seed(0), 1.0)[0]
            for one in (model, loaded)
        )
    assert float(second) == pytest.approx(float(first), rel=5e-3)
