"""Weights from before an input was added give the samples that they gave then.

A folder of that time does not name the input; the network is then built without it.
"""

import json
from dataclasses import fields, replace
from pathlib import Path

import pytest
import torch

from pd_editor.diffusion.checkpoints.model_folder import (
    TrainedStage,
    load_model,
    save_model,
)
from pd_editor.diffusion.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.diffusion.initial_state.sampler import sample_initial_states
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.diffusion.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.diffusion.trajectory.sampler import sample_trajectories
from tests.diffusion.initial_state.scenes import scene_batch as initial_state_scenes
from tests.diffusion.initial_state.scenes import trained_a_little
from tests.diffusion.trajectory.scenes import arc_basis
from tests.diffusion.trajectory.scenes import scene_batch as trajectory_scenes


def added(config_type: type) -> dict[str, object]:
    """Fields of a configuration that came later, as networks were before them."""
    return {
        one.name: one.metadata["when_absent"]
        for one in fields(config_type)
        if "when_absent" in one.metadata
    }


def initial_states(**inputs: object) -> InitialStateDenoiser:
    torch.manual_seed(3)
    sizes = {"width": 32, "num_heads": 2, "num_layers": 2, "relation_width": 16}
    config = InitialStateConfig(**sizes, num_near_pieces=6, **inputs)
    return trained_a_little(InitialStateDenoiser(config).eval())


def trajectories(**inputs: object) -> TrajectoryDenoiser:
    torch.manual_seed(3)
    sizes = {"width": 32, "num_heads": 2, "num_blocks": 2, "edge_width": 16}
    model = TrajectoryDenoiser(TrajectoryConfig(**sizes, **inputs), arc_basis()).eval()
    torch.nn.init.normal_(model.map_tokens.null_token)
    return model


def sample(model: torch.nn.Module, scene: SceneTensors) -> torch.Tensor:
    draws = (
        sample_initial_states
        if isinstance(model, InitialStateDenoiser)
        else sample_trajectories
    )
    *_, last = draws(model, scene, samples=[0, 1], seed=7)
    return last.clean


STAGES = pytest.mark.parametrize(
    ("kind", "make", "config_type", "scene"),
    [
        (
            INITIAL_STATES,
            initial_states,
            InitialStateConfig,
            initial_state_scenes(4, 7),
        ),
        (TRAJECTORIES, trajectories, TrajectoryConfig, trajectory_scenes(4, 7)),
    ],
    ids=["initial states", "trajectories"],
)


@STAGES
def test_a_folder_that_names_no_later_input_is_read_without_it(
    kind, make, config_type, scene, tmp_path: Path
):
    model = make(**added(config_type))
    stage = TrainedStage(kind=kind, config=model.config, model=model)
    save_model(tmp_path, {kind.name: stage})
    path = tmp_path / "config.json"
    content = json.loads(path.read_text())
    for name in added(config_type):
        del content["stages"][kind.name]["config"][name]
    path.write_text(json.dumps(content))
    read = load_model(tmp_path, STAGE_KINDS).stage(kind.name)
    assert read.config == model.config
    expected = sample(model, scene)
    assert torch.equal(sample(read.model, scene), expected)
    # What the later inputs hold makes no difference.
    other = replace(
        scene,
        boundary_pose=scene.boundary_pose + 1.0,
        boundary_shape=-scene.boundary_shape,
        agent_activity=(scene.agent_activity + 1) % 4,
    )
    assert torch.equal(sample(read.model, other), expected)
    assert not torch.equal(sample(make(), scene), expected)
