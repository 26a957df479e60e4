"""Networks of commit 3b06ae4 in the second form in which they sampled.

``benchmarks.interleaved`` runs this with the package of that commit on the path.
"""
# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from pd_editor.diffusion.folded_denoiser import FoldedDenoiser
from pd_editor.diffusion.folded_pose_denoiser import (
    FoldedPoseDenoiser,
)
from pd_editor.diffusion.future_drawing import FutureTask
from pd_editor.diffusion.memory_reuse import (
    WHEN_DRAWING,
    keep_freed_memory,
)
from pd_editor.diffusion.model_folder import load_model
from pd_editor.diffusion.pose_sampling import sample_states
from pd_editor.diffusion.scene_tensors import batch_of
from pd_editor.windows.packed_scene import packed
from pd_editor.windows.scene_features import scene_features

import pd_editor
from pd_editor.diffusion.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.scene.scenario import Scenario


def network_works(scenario: Scenario) -> list[Callable[[], object]]:
    """Denoising step and context of trajectories; initial states."""
    keep_freed_memory(WHEN_DRAWING)
    folder = Path(pd_editor.__file__).resolve().parents[1] / "models/path-diffuser"
    stages = load_model(folder, STAGE_KINDS)
    states = FoldedPoseDenoiser(stages.stage(INITIAL_STATES.name).model)
    trajectories = FoldedDenoiser(stages.stage(TRAJECTORIES.name).model)
    basis = trajectories.model.way_points.basis
    task = FutureTask.of(scenario, np.arange(len(scenario.agents)), basis)
    features = scene_features(scenario, with_candidates=False)
    scene = batch_of([packed(features, basis.encode)])
    is_given = torch.zeros_like(task.scene.has_agent)
    with torch.inference_mode():
        context = trajectories.context(task.scene)
        drawing = trajectories.drawing(context, is_given, [0.5], 1)
        noisy = torch.randn(1, *task.scene.future.shape)

    def encode() -> object:
        with torch.inference_mode():
            return trajectories.context(task.scene)

    def step() -> object:
        with torch.inference_mode():
            return drawing.denoise(noisy, 0)

    def place() -> object:
        return list(sample_states(states, scene, samples=[0], seed=0))

    return [step, encode, place]
