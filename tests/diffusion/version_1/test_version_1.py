"""Weights in format version 1 compute the same when they are converted.

The reference outputs were written by the networks of that version.
"""

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from pd_editor.diffusion.checkpoints.model_folder import load_model
from pd_editor.diffusion.checkpoints.tensor_file import (
    config_from_json,
    load_into,
    write_tensors,
)
from pd_editor.diffusion.initial_state.network.conditioning import sampling_conditioning
from pd_editor.diffusion.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.diffusion.stages import STAGE_KINDS
from pd_editor.diffusion.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.diffusion.version_1 import initial_state as initial_state_version_1
from pd_editor.diffusion.version_1 import trajectory as trajectory_version_1
from pd_editor.errors import ModelError
from tests.diffusion.initial_state.scenes import scene_batch as initial_state_scenes
from tests.diffusion.trajectory.scenes import FORMER
from tests.diffusion.trajectory.scenes import scene_batch as trajectory_scenes

DATA = Path(__file__).parents[2] / "data"
TRAJECTORY = TrajectoryConfig(
    width=16, num_heads=2, num_blocks=2, edge_width=8, **FORMER
)
INITIAL_STATES = config_from_json(
    InitialStateConfig,
    {
        "width": 16,
        "num_heads": 2,
        "num_layers": 2,
        "num_near_pieces": 5,
        "relation_width": 8,
        "is_differential": True,
        "is_ordered": True,
        "lowest_noise_m": 0.1,
        "highest_noise_m": 80.0,
        "lowest_direction_noise": 0.04,
        "highest_direction_noise": 3.0,
    },
    "test",
)
"""As a folder of that time has it."""


def stored(name: str) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    """Old weights, and what the old network made of some noisy input."""
    tensors = load_file(DATA / name)
    weights = {
        key.removeprefix("weights."): one
        for key, one in tensors.items()
        if key.startswith("weights.")
    }
    return weights, tensors


def test_converted_initial_state_weights_compute_the_same():
    weights, reference = stored("version_1_initial_states.safetensors")
    model = InitialStateDenoiser(INITIAL_STATES).eval()
    weights["counted"] = torch.zeros_like(model.get_buffer("counted"))
    tensors = initial_state_version_1.upgraded_tensors(weights, INITIAL_STATES)
    load_into(model, tensors, "test", STAGE_KINDS["init"].statistics)
    scene = initial_state_scenes(3, 6)
    is_given = torch.zeros_like(scene.has_agent)
    is_given[:, 1] = True
    with torch.no_grad():
        context = model.encode_context(scene, sampling_conditioning(scene, is_given))
        level = model.encode_level(reference["level"], context)
        found = model.denoise(reference["noisy"], level, context)
    torch.testing.assert_close(found, reference["clean"], rtol=1e-4, atol=1e-4)


def test_converted_trajectory_weights_compute_the_same():
    weights, reference = stored("version_1_trajectories.safetensors")
    model = TrajectoryDenoiser(TRAJECTORY).eval()
    load_into(model, trajectory_version_1.upgraded_tensors(weights, TRAJECTORY), "test")
    with torch.no_grad():
        context = model.encode_context(trajectory_scenes(4, 7))
        level = model.encode_level(reference["level"])
        found = model.denoise(reference["noisy"], level, context)
    torch.testing.assert_close(found, reference["clean"], rtol=1e-4, atol=1e-4)


def version_1_folder(folder: Path, weights: dict[str, torch.Tensor]) -> Path:
    sha256 = write_tensors(folder / "trajectories.safetensors", "traj", weights, {})
    config = {
        "width": 16,
        "num_heads": 2,
        "num_blocks": 2,
        "edge_width": 8,
        "sees_way_points": True,
        "schedule": "cosine",
        "prediction": "velocity",
    }
    stage = {"sha256": sha256, "config": config, "training": {}}
    content = {"format": "pd-editor-model", "version": 1, "stages": {"traj": stage}}
    (folder / "config.json").write_text(json.dumps(content))
    return folder


def test_a_folder_in_version_1_is_converted_when_it_is_read(tmp_path: Path):
    weights, _ = stored("version_1_trajectories.safetensors")
    stage = load_model(version_1_folder(tmp_path, weights), STAGE_KINDS).stage("traj")
    assert stage.config == TRAJECTORY
    assert stage.sampling == stage.kind.default_sampling()


@pytest.mark.parametrize("name", ["blocks.1.edge_out.weight", "noisy_in.weight"])
def test_a_damaged_folder_in_version_1_is_refused(tmp_path: Path, name: str):
    weights, _ = stored("version_1_trajectories.safetensors")
    missing = {key: one for key, one in weights.items() if key != name}
    cut = weights | {name: weights[name][:, :3]}
    for tensors in (missing, cut):
        folder = version_1_folder(tmp_path, tensors)
        with pytest.raises(
            ModelError, match=r"trajectories\.safetensors: .*(does not fit|expected)"
        ):
            load_model(folder, STAGE_KINDS)
