import numpy as np
import torch

from pd_editor.generation.trajectory.network.features import (
    InteractionGeometry,
    Neighbors,
)
from tests.generation.trajectory.scenes import scene_batch, small_model

STEPS = (np.linspace(0, 59, 9)[1:]).astype(int) - 1


def box_gap(
    own: np.ndarray, heading: float, size: np.ndarray, corners: np.ndarray
) -> float:
    """Gap of a box to the corners of another one along its own axes."""
    axes = np.array(
        [[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]
    )
    local = (corners - own) @ axes.T
    nearest = np.maximum(local.min(axis=0), -local.max(axis=0))
    return float((nearest - size / 2).max())


def test_gaps_are_those_of_boxes_along_the_agents_axes() -> None:
    scene, model = scene_batch(7), small_model()
    neighbors = Neighbors.of(scene, 16)
    geometry = InteractionGeometry.of(
        model.decoder, scene.agent_speed, scene.agent_size, neighbors
    )
    latent = scene.future[None]
    found = geometry.features(latent, with_gaps=True)
    assert torch.equal(found[..., :24], geometry.features(latent, with_gaps=False))
    gaps = 2 * torch.arctanh(found[0, :, 24:32].double().clamp(-1 + 1e-6, 1 - 1e-6))
    gaps = gaps.view(*neighbors.row.shape[1:], 8).numpy()
    x, y = model.decoder.points(
        scene.future, scene.agent_speed, torch.from_numpy(STEPS)
    )
    pose, size = scene.agent_pose[0].double().numpy(), scene.agent_size[0].numpy()
    local = np.stack([x[0], y[0]], axis=-1).astype(float)
    turn = np.exp(1j * pose[:, 2])[:, None]
    way = np.diff(local, axis=1, prepend=0.0)
    course = pose[:, 2:] + np.arctan2(way[..., 1], way[..., 0] + 0.2)
    place = (local[..., 0] + 1j * local[..., 1]) * turn
    place = pose[:, None, :2] + np.stack([place.real, place.imag], axis=-1)
    checked = 0
    for agent in range(7):
        for slot in range(1, neighbors.row.shape[-1]):
            if not neighbors.exists[0, agent, slot]:
                continue
            other = int(neighbors.row[0, agent, slot])
            for step in range(8):
                ahead = np.exp(1j * course[other, step])
                half = np.array([1, 1, -1, -1]) * size[other, 0] / 2
                side = np.array([1, -1, -1, 1]) * size[other, 1] / 2
                corner = (half + 1j * side) * ahead
                corners = place[other, step] + np.stack([corner.real, corner.imag], -1)
                expected = box_gap(
                    place[agent, step], course[agent, step], size[agent], corners
                )
                if abs(expected) < 5.0:
                    assert abs(gaps[agent, slot, step] - expected) < 0.02
                    checked += 1
    assert checked > 10
