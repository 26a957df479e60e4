import json
from dataclasses import replace

import pytest

from pd_editor.base.errors import ModelError, TrainingError
from pd_editor.experiments.training.run_config import (
    Budget,
    Optimisation,
    RunConfig,
)
from pd_editor.experiments.training.settings import (
    PRESETS,
    RunRequest,
    continued_config,
    new_config,
)
from pd_editor.experiments.training.stage_objective import STAGES

CONFIG = RunConfig(
    stage="traj",
    data=("/a", "/b"),
    weights=(1.0, 2.0),
    seed=3,
    precision="bf16",
    model=PRESETS["traj"]["tiny"].model,
    optimisation=Optimisation(batch_size=5),
    budget=Budget(steps=7),
)


def test_it_comes_back_from_text():
    assert RunConfig.from_json(CONFIG.to_json()) == CONFIG


def test_new_runs_tell_the_settings_of_their_loss():
    request = RunRequest(stage="traj", data=("/a",))
    config = new_config(request, is_gpu=False)
    assert config.loss["starting_weight"] == 1.0
    assert RunConfig.from_json(config.to_json()).loss == config.loss
    for stage in STAGES.values():
        stage.loss({})
        with pytest.raises(ModelError, match="loss"):
            stage.loss({"no_such_weight": 1.0})


def test_a_run_from_before_losses_had_settings_goes_on():
    values = json.loads(CONFIG.to_json())
    del values["loss"]
    assert RunConfig.from_json(json.dumps(values)) == CONFIG


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", json.dumps({"stage": "traj"}), b"\xff\xfe"]
)
def test_other_texts_are_refused(text):
    with pytest.raises(TrainingError, match="configuration"):
        RunConfig.from_json(text)


def test_unknown_and_impossible_fields_are_refused():
    values = json.loads(CONFIG.to_json())
    with pytest.raises(TrainingError, match="another version"):
        RunConfig.from_json(json.dumps({**values, "extra": 1}))
    values["optimisation"]["batch_size"] = "many"
    with pytest.raises(TrainingError, match="impossible"):
        RunConfig.from_json(json.dumps(values))


@pytest.mark.parametrize(
    "values",
    [{"weights": (1.0,)}, {"weights": (0.0, 1.0)}, {"weights": (float("nan"), 1.0)}],
)
def test_weights_must_fit(values):
    with pytest.raises(TrainingError, match="weights"):
        replace(CONFIG, **values)


@pytest.mark.parametrize(
    "part",
    [
        lambda: Optimisation(batch_size=0),
        lambda: Optimisation(ema_decay=1.0),
        lambda: Optimisation(learning_rate=0.0),
        lambda: Budget(minutes=0.0),
        lambda: Budget(minutes=float("nan")),
        lambda: Budget(steps=0),
        lambda: Budget(held_out_share=1.0),
    ],
)
def test_impossible_settings_are_refused(part):
    with pytest.raises(TrainingError):
        part()


@pytest.mark.parametrize("stage", ["init", "traj"])
def test_presets_make_networks(stage):
    for name in PRESETS[stage]:
        config = new_config(
            RunRequest(stage=stage, data=("/a",), preset=name), is_gpu=False
        )
        kind = STAGES[stage].kind
        assert kind.config_type(**config.model) is not None
    gpu = new_config(RunRequest(stage=stage, data=("/a",)), is_gpu=True)
    assert gpu.model == PRESETS[stage]["gpu"].model
    assert gpu.precision == "bf16"


def test_no_data_is_refused():
    with pytest.raises(TrainingError, match="--data"):
        new_config(RunRequest(stage="init"), is_gpu=False)


def test_a_run_goes_on_as_it_was():
    same = RunRequest(stage="traj", data=("/a", "/b"), seed=3, preset="tiny")
    assert continued_config(CONFIG, same) == CONFIG
    longer = continued_config(CONFIG, RunRequest(stage="traj", minutes=9))
    assert longer == replace(CONFIG, budget=Budget(minutes=9))


@pytest.mark.parametrize(
    ("request_", "word"),
    [
        (RunRequest(stage="init"), "stage"),
        (RunRequest(stage="traj", seed=0), "seed"),
        (RunRequest(stage="traj", data=("/a",)), "data"),
        (RunRequest(stage="traj", preset="gpu"), "preset"),
        (RunRequest(stage="traj", batch_size=6), "batch-size"),
    ],
)
def test_a_run_does_not_change_while_it_goes_on(request_, word):
    with pytest.raises(TrainingError, match=word):
        continued_config(CONFIG, request_)
