"""Measured errors of predicted clean states."""

import pytest
import torch

from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.noisy_traffic import (
    clean_variance_at,
    measured_clean_variance,
)
from tests.generation.initial_state.scenes import packed_scene, small_model


def test_it_is_the_mean_squared_error_of_known_parts(monkeypatch: pytest.MonkeyPatch):
    """With a network that adds level + 0.1 * part to the truth."""
    model = small_model()
    levels: list[torch.Tensor] = []
    encode, offset = InitialStateDenoiser.encode_level, 0.1 * torch.arange(8)

    def seen(self: InitialStateDenoiser, level: torch.Tensor, context: object):
        levels.append(level)
        return encode(self, level, context)

    def wrong(_self: object, _noisy: object, _level: object, context: object):
        return context.given + levels[-1][..., None, None] + offset

    monkeypatch.setattr(InitialStateDenoiser, "encode_level", seen)
    monkeypatch.setattr(InitialStateDenoiser, "denoise", wrong)
    found = measured_clean_variance(model, [packed_scene(5), packed_scene(9, seed=1)])
    even = torch.linspace(0, 1, len(found))[:, None]
    torch.testing.assert_close(found, (even + offset).square())


def test_agents_beyond_the_square_and_unknown_activities_do_not_count(
    monkeypatch: pytest.MonkeyPatch,
):
    scene = packed_scene(6)
    scene.agent_pose[1, 0] = 90.0
    scene.agent_activity[:] = 0
    scene.agent_activity[2] = 1
    numbers: list[int] = []

    def wrong(_self: object, _noisy: object, _level: object, context: object):
        numbers.append(context.given.shape[1])
        away = torch.zeros_like(context.given)
        # Only the agent of known activity is predicted well; it moved up by one.
        away[0, [0, 2, 3, 4], 5:] = 1.0
        return context.given + away

    monkeypatch.setattr(InitialStateDenoiser, "denoise", wrong)
    found = measured_clean_variance(small_model(), [scene])
    assert numbers == [5]
    assert found.abs().max() == 0


def test_between_levels_it_is_linear():
    model = small_model()
    table = model.get_buffer("clean_variance")
    table.copy_(torch.linspace(0, 4, len(table))[:, None].expand_as(table))
    found = clean_variance_at(model, [0.0, 0.31, 0.975, 1.0])
    wanted = torch.tensor([0.0, 1.24, 3.9, 4.0])[:, None].expand(-1, 8)
    torch.testing.assert_close(found, wanted)
