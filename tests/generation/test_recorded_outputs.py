"""Both networks give the outputs that they were trained with, however they compute."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from pd_editor.generation.initial_state.network.conditioning import (
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from tests.generation.initial_state import scenes as initial_state_scenes
from tests.generation.trajectory import scenes as trajectory_scenes

RECORDED = Path(__file__).parents[1] / "data" / "network_outputs.npz"
"""Scenes of 5 and 9 agents, noisy samples, and what the networks made of them; written
by ``python -m tests.generation.test_recorded_outputs`` when the meaning of weights
changes, which makes all earlier weights useless."""
LEVELS = (0.05, 0.4, 0.9)
NUM_SAMPLES = 2


def given_two() -> torch.Tensor:
    """The second agent of the first scene and the third of the second are given."""
    is_given = torch.zeros((2, 9), dtype=torch.bool)
    is_given[0, 1] = is_given[1, 2] = True
    return is_given


def with_recorded_weights(model: nn.Module) -> nn.Module:
    """Weights from a generator whose numbers never change."""
    random = np.random.RandomState(0)
    with torch.no_grad():
        for name, parameter in sorted(model.named_parameters()):
            normal = torch.from_numpy(random.standard_normal(tuple(parameter.shape)))
            spread = parameter.shape[-1] ** -0.5 if parameter.ndim > 1 else 0.1
            is_scale = parameter.ndim == 1 and "norm" in name and "weight" in name
            parameter.copy_(normal * spread + float(is_scale))
    return model.eval()


def initial_state_outputs(
    scene: SceneTensors, noisy: torch.Tensor, **changes: object
) -> dict[str, torch.Tensor]:
    config = InitialStateConfig(
        width=32, num_heads=2, num_layers=2, num_near_pieces=6, relation_width=16
    )
    model = with_recorded_weights(InitialStateDenoiser(replace(config, **changes)))
    assert isinstance(model, InitialStateDenoiser)
    noisy = noisy[..., : model.config.num_state_parts]
    free = sampling_conditioning(scene)
    found: dict[str, torch.Tensor] = {}
    for name, task in (
        ("free", free),
        ("given", sampling_conditioning(scene, given_two())),
    ):
        found |= {
            f"{name} {level:g}": state_at(model, scene, noisy, task, level)
            for level in LEVELS
        }
    return found


def state_at(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    noisy: torch.Tensor,
    task: Conditioning,
    level: float,
) -> torch.Tensor:
    with torch.inference_mode():
        context = model.encode_context(scene, task)
        levels = model.encode_level(torch.full((1, 1), level), context)
        return model.denoise(noisy, levels, context)


def trajectory_outputs(
    scene: SceneTensors, noisy: torch.Tensor, **changes: object
) -> dict[str, torch.Tensor]:
    config = TrajectoryConfig(width=32, num_heads=2, num_blocks=2, edge_width=16)
    basis = trajectory_scenes.arc_basis()
    model = TrajectoryDenoiser(replace(config, **changes), basis)
    with_recorded_weights(model)
    found: dict[str, torch.Tensor] = {}
    with torch.inference_mode():
        context = model.encode_context(scene)
        for level in LEVELS:
            table = torch.full((1, 1, 1), level)
            found[f"free {level:g}"] = model.denoise(
                noisy, model.encode_level(table), context
            )
            table = torch.where(given_two()[None], 0.0, level)
            found[f"given {level:g}"] = model.denoise(
                noisy, model.encode_level(table), context
            )
    return found


PLAIN_STATES = dict.fromkeys(
    (
        "sees_signals",
        "sees_boundary",
        "relates_map_tokens",
        "sees_box_gaps",
        "folds_turns",
        "samples_activity",
    ),
    False,
)
NETWORKS = {
    "initial states": (initial_state_outputs, {"sees_signals": False}),
    "plain initial states": (initial_state_outputs, PLAIN_STATES),
    "trajectories": (trajectory_outputs, {"sees_signals": False}),
    "plain trajectories": (trajectory_outputs, trajectory_scenes.PLAIN),
}


def recorded_inputs(name: str) -> tuple[SceneTensors, torch.Tensor]:
    kind = name.removeprefix("plain ")
    with np.load(RECORDED) as file:
        arrays = {
            field.name: torch.from_numpy(file[f"{kind}/{field.name}"])
            for field in fields(SceneTensors)
            if field.name != "piece_signal"
        }
        arrays["piece_signal"] = torch.zeros(*arrays["piece_kind"].shape, 2)
        return SceneTensors(**arrays), torch.from_numpy(file[f"{kind}/noisy"])


@pytest.mark.parametrize("name", NETWORKS)
def test_outputs_are_those_recorded(name: str):
    outputs, changes = NETWORKS[name]
    found = outputs(*recorded_inputs(name), **changes)
    with np.load(RECORDED) as file:
        for key, values in found.items():
            torch.testing.assert_close(
                values,
                torch.from_numpy(file[f"{name}/{key}"]),
                rtol=1e-4,
                atol=1e-4,
                msg=lambda text, key=key: f"{key}: {text}",
            )


def _record() -> None:
    random = torch.Generator().manual_seed(0)
    arrays: dict[str, np.ndarray] = {}
    for kind, module, size in (
        ("initial states", initial_state_scenes, InitialStateConfig().num_state_parts),
        ("trajectories", trajectory_scenes, 10),
    ):
        scene = module.scene_batch(5, 9)
        noisy = torch.randn((NUM_SAMPLES, 2, 9, size), generator=random)
        scene = replace(
            scene,
            **{
                one.name: getattr(scene, one.name)[:, :9]
                for one in fields(SceneTensors)
                if one.name.startswith(("agent_", "has_agent", "near_"))
                or one.name in ("candidates", "has_candidate", "future", "has_future")
            },
        )
        arrays |= {
            f"{kind}/{one.name}": getattr(scene, one.name).numpy()
            for one in fields(SceneTensors)
        }
        arrays[f"{kind}/noisy"] = noisy.numpy()
    np.savez_compressed(RECORDED, **arrays)
    for name, (outputs, changes) in NETWORKS.items():
        found = outputs(*recorded_inputs(name), **changes)
        arrays |= {f"{name}/{key}": values.numpy() for key, values in found.items()}
    np.savez_compressed(RECORDED, **arrays)


if __name__ == "__main__":
    _record()
