import json
import os
import resource
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from pd_editor.base.errors import ModelError
from pd_editor.base.installed_files import models_folder
from pd_editor.generation.checkpoints.model_folder import (
    StageKind,
    TrainedStage,
    load_model,
    made_model,
    save_model,
)
from pd_editor.generation.checkpoints.tensor_file import read_tensors, write_tensors
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.stages import STAGE_KINDS
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance


@dataclass(frozen=True, kw_only=True)
class Config:
    width: int = 4


def kind_of(name: str) -> StageKind:
    return StageKind(
        name=name,
        file_name=f"{name}.safetensors",
        config_type=Config,
        make_model=lambda config: nn.Linear(3, config.width),
    )


KINDS = {name: kind_of(name) for name in ("one", "two")}


def trained(name: str, seed: int = 0, width: int = 4) -> TrainedStage:
    config = Config(width=width)
    return TrainedStage(
        kind=KINDS[name],
        config=config,
        model=made_model(KINDS[name], config, seed=seed),
        about={"steps": seed},
    )


@pytest.fixture
def folder(tmp_path):
    save_model(tmp_path / "mine", {name: trained(name) for name in KINDS})
    return tmp_path / "mine"


def changed(folder, change):
    path = folder / "config.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def test_a_model_comes_back(folder):
    model = load_model(folder, KINDS)
    assert (model.name, set(model.stages)) == ("mine", {"one", "two"})
    stage = model.stage("one")
    assert (stage.config, stage.about) == (Config(), {"steps": 0})
    assert torch.equal(stage.model.weight, trained("one").model.weight)
    assert not stage.model.training
    assert not stage.model.weight.requires_grad


def test_statistics_may_be_missing(tmp_path):
    """Folders of earlier versions do not hold them; they stay as in a new network."""

    class Measured(nn.Linear):
        def __init__(self, width: int) -> None:
            super().__init__(3, width)
            self.register_buffer("errors", torch.full((2,), 7.0))

    earlier = kind_of("one")
    now = replace(
        earlier,
        make_model=lambda config: Measured(config.width),
        statistics=frozenset({"errors"}),
    )
    save_model(tmp_path, {"one": trained("one")})
    model = load_model(tmp_path, {"one": now}).stage("one").model
    assert torch.equal(model.weight, trained("one").model.weight)
    assert model.errors.tolist() == [7.0, 7.0]
    with pytest.raises(ModelError, match="1 tensors missing"):
        load_model(tmp_path, {"one": replace(now, statistics=frozenset())})


def test_the_hash_is_that_of_the_weights(folder, tmp_path):
    before = load_model(folder, KINDS).sha256
    shutil.copytree(folder, tmp_path / "other-name")
    assert load_model(tmp_path / "other-name", KINDS).sha256 == before
    save_model(folder, {"one": trained("one", seed=1), "two": trained("two")})
    assert load_model(folder, KINDS).sha256 != before


def test_a_stage_may_be_absent(tmp_path):
    save_model(tmp_path, {"one": trained("one")})
    model = load_model(tmp_path, KINDS)
    with pytest.raises(ModelError, match="no weights of the stage 'two', only of one"):
        model.stage("two")


def test_half_precision_is_smaller_and_near(tmp_path):
    stage = trained("one", width=500)
    for half in (False, True):
        save_model(tmp_path / str(half), {"one": stage}, half=half)
    full, small = (
        (tmp_path / str(half) / "one.safetensors").stat().st_size
        for half in (False, True)
    )
    assert small < 0.6 * full
    weights = load_model(tmp_path / "True", KINDS).stage("one").model.weight
    assert weights.dtype == torch.float32
    assert torch.allclose(weights, stage.model.weight, atol=1e-3)


def test_missing_and_foreign_folders_are_refused(folder, tmp_path):
    with pytest.raises(ModelError, match="is no model"):
        load_model(tmp_path / "none", KINDS)
    for text, words in (
        ("{", "not valid JSON"),
        ("[1]", "does not describe"),
        ('{"format": "other"}', "does not describe"),
        ('{"format": "pd-editor-model", "version": 99}', "version 99"),
        ('{"format": "pd-editor-model", "version": 2, "stages": {}}', "no stage"),
    ):
        (folder / "config.json").write_text(text)
        with pytest.raises(ModelError, match=words):
            load_model(folder, KINDS)


def test_unknown_stages_are_refused(folder):
    with pytest.raises(ModelError, match="lists the stage"):
        load_model(folder, STAGE_KINDS)


def test_mixed_folders_are_refused(folder, tmp_path):
    save_model(tmp_path / "other", {"one": trained("one", seed=5)})
    shutil.copy(tmp_path / "other" / "one.safetensors", folder)
    with pytest.raises(ModelError, match="mixed from several"):
        load_model(folder, KINDS)


def test_a_missing_weight_file_is_refused(folder):
    (folder / "two.safetensors").unlink()
    with pytest.raises(ModelError, match=r"two\.safetensors: cannot be read"):
        load_model(folder, KINDS)


def test_a_configuration_that_does_not_fit_is_refused(folder):
    changed(folder, lambda c: c["stages"]["one"]["config"].update(width=5))
    with pytest.raises(ModelError, match="shape"):
        load_model(folder, KINDS)
    changed(folder, lambda c: c["stages"]["one"]["config"].update(width=-5))
    with pytest.raises(ModelError, match="no network can be made"):
        load_model(folder, KINDS)
    changed(folder, lambda c: c["stages"]["one"].pop("config"))
    with pytest.raises(ModelError, match="no configuration"):
        load_model(folder, KINDS)


@pytest.fixture
def shipped_copy(tmp_path):
    return shutil.copytree(models_folder() / SHIPPED_MODEL, tmp_path / "model")


@pytest.mark.parametrize(
    ("stage", "field", "value"),
    [
        ("init", "num_heads", 0),
        ("init", "width", -128),
        ("init", "num_layers", 100_000),
        ("init", "num_near_pieces", 10**21),
        ("init", "relation_width", 0),
        ("traj", "num_heads", 3),
        ("traj", "num_blocks", 0),
        ("traj", "width", 100_000),
        ("traj", "edge_width", None),
        ("traj", "width", 128.0),
    ],
)
def test_sizes_out_of_range_are_told_with_file_and_field(
    shipped_copy, stage, field, value
):
    """Zero, negative and huge sizes are refused before anything is made (fault 4)."""
    changed(shipped_copy, lambda c: c["stages"][stage]["config"].update({field: value}))
    with pytest.raises(
        ModelError, match=rf"config\.json, {stage}: .*{field} is"
    ) as told:
        load_model(shipped_copy, STAGE_KINDS)
    assert "\n" not in str(told.value)


def test_sizes_other_than_those_of_the_weights_take_no_memory(shipped_copy):
    """A wide network is refused by its shapes, not made first (fault 4)."""
    changed(
        shipped_copy,
        lambda c: c["stages"]["init"]["config"].update(width=1024, num_layers=128),
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ModelError, match="does not fit the model"):
        load_model(shipped_copy, STAGE_KINDS)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 500 * 1024, f"{grown} KiB"


def test_weights_that_are_not_numbers_are_refused(shipped_copy):
    """NaN weights are refused with the tensor's name (fault 4)."""
    path = shipped_copy / "trajectories.safetensors"
    tensors = dict(read_tensors(path, "traj").tensors)
    tensors["embed.weight"] = torch.full_like(tensors["embed.weight"], torch.nan)
    digest = write_tensors(path, "traj", tensors, {})
    changed(shipped_copy, lambda c: c["stages"]["traj"].update(sha256=digest))
    with pytest.raises(ModelError, match=r"embed\.weight holds NaN or infinity"):
        load_model(shipped_copy, STAGE_KINDS)


def test_metadata_of_another_form_is_refused(shipped_copy):
    """A list where the file should say what it holds is told, not raised (fault 4)."""
    path = shipped_copy / "trajectories.safetensors"
    save_file({"a": torch.zeros(1)}, path, {"pd-editor": "[1, 2]"})
    with pytest.raises(ModelError, match="another program"):
        load_model(shipped_copy, STAGE_KINDS)


def test_a_pipe_as_configuration_is_refused_at_once(shipped_copy):
    """Nothing waits for a writer (fault 7)."""
    (shipped_copy / "config.json").unlink()
    os.mkfifo(shipped_copy / "config.json")
    with pytest.raises(ModelError, match="not a regular file"):
        load_model(shipped_copy, STAGE_KINDS)


def test_making_a_network_leaves_global_chance_alone():
    state = torch.random.get_rng_state()
    one, two = (made_model(KINDS["one"], Config(), seed=s) for s in (1, 2))
    assert torch.equal(torch.random.get_rng_state(), state)
    assert not torch.equal(one.weight, two.weight)


def test_the_real_stages_have_files_of_their_own():
    files = {kind.file_name for kind in STAGE_KINDS.values()}
    assert files == {"initial_states.safetensors", "trajectories.safetensors"}


def test_sampling_settings_are_stored_with_the_model(shipped_copy):
    listed = json.loads((shipped_copy / "config.json").read_text())["stages"]
    assert listed["traj"]["sampling"]["guidance"]["weight"] == 0.8
    changed(
        shipped_copy,
        lambda c: c["stages"]["traj"]["sampling"]["sampler"].update(num_steps=7),
    )
    sampling = load_model(shipped_copy, STAGE_KINDS).stage("traj").sampling
    assert sampling["sampler"].num_steps == 7
    assert sampling["guidance"].weight == 0.8
    assert sampling["terms"] == TermGuidance()


def test_models_with_former_settings_open_if_these_had_no_effect(shipped_copy):
    """A value of its own would be lost without a word."""
    sampler = {"num_steps": 7, "eta": 0.0, "standing_noise": 1.0}
    changed(
        shipped_copy,
        lambda c: c["stages"]["traj"]["sampling"].update(sampler=sampler),
    )
    loaded = load_model(shipped_copy, STAGE_KINDS).stage("traj")
    assert loaded.sampling["sampler"].num_steps == 7
    sampler["eta"] = 0.5
    changed(
        shipped_copy,
        lambda c: c["stages"]["traj"]["sampling"].update(sampler=sampler),
    )
    with pytest.raises(ModelError, match=r"eta can no longer be set; expected 0\.0"):
        load_model(shipped_copy, STAGE_KINDS)


@pytest.mark.parametrize(("was_on", "share"), [(False, 0.0), (True, 0.6)])
def test_a_former_switch_that_was_off_makes_its_number_zero(
    shipped_copy, was_on, share
):
    former = {"is_last_step_guided": was_on, "last_step_share": 0.6}
    changed(
        shipped_copy,
        lambda c: c["stages"]["traj"]["sampling"]["guidance"].update(former),
    )
    loaded = load_model(shipped_copy, STAGE_KINDS).stage("traj")
    assert loaded.sampling["guidance"].last_step_share == share


def test_noise_that_was_switched_off_opens_without_stochasticity(shipped_copy):
    def change(content, eta):
        sampler = content["stages"]["init"]["sampling"]["sampler"]
        sampler.update(adds_missing_noise=False, eta=eta)

    changed(shipped_copy, lambda c: change(c, 0.0))
    loaded = load_model(shipped_copy, STAGE_KINDS).stage("init")
    assert loaded.sampling["sampler"].eta == 0.0
    changed(shipped_copy, lambda c: change(c, 1.0))
    with pytest.raises(ModelError, match="adds_missing_noise can no longer be set"):
        load_model(shipped_copy, STAGE_KINDS)


@pytest.mark.parametrize(
    ("sampling", "message"),
    [
        ([], "must hold guidance, sampler, terms"),
        ({"sampler": {}}, "must hold guidance, sampler, terms"),
        ({"strange": {}}, "must hold guidance, sampler, terms"),
    ],
)
def test_sampling_settings_of_other_parts_are_refused(shipped_copy, sampling, message):
    changed(shipped_copy, lambda c: c["stages"]["traj"].update(sampling=sampling))
    with pytest.raises(ModelError, match=message):
        load_model(shipped_copy, STAGE_KINDS)


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        ("sampler", 3, "sampler: holds no fields"),
        ("sampler", {}, "sampler: lacks the field"),
        ("sampler", {"steps": 3}, "has an unknown field 'steps'"),
        ("sampler", {"num_steps": "many"}, "num_steps is 'many'"),
        ("sampler", {"num_steps": 0}, "num_steps is 0; expected a finite number"),
        ("guidance", {"weight": -1.0}, "weight is -1; expected a finite number"),
        ("guidance", {"stays_m": float("nan")}, "stays_m is nan; expected"),
    ],
)
def test_unknown_sampling_settings_are_refused(shipped_copy, part, values, message):
    def change(content):
        sampling = content["stages"]["traj"]["sampling"]
        is_change = isinstance(values, dict) and values
        sampling[part] = sampling[part] | values if is_change else values

    changed(shipped_copy, change)
    with pytest.raises(ModelError, match=message):
        load_model(shipped_copy, STAGE_KINDS)


def test_trajectories_from_before_signals_and_of_fewer_steps_open(
    model_folder: Path, tmp_path: Path
):
    folder = tmp_path / "old"
    shutil.copytree(model_folder, folder)
    config = json.loads((folder / "config.json").read_text())
    del config["stages"]["traj"]["config"]["sees_signals"]
    (folder / "config.json").write_text(json.dumps(config))
    found = load_model(folder, STAGE_KINDS).stage("traj")
    assert not found.config.sees_signals
    assert found.model.decoder.num_steps == 59
