"""The two stages of the model, by the names they have on disk and in the shell."""

from collections.abc import Mapping
from typing import Final

from pd_editor.diffusion.checkpoints.model_folder import StageKind
from pd_editor.diffusion.initial_state.denoiser import PoseDenoiser, PoseDenoiserConfig
from pd_editor.diffusion.trajectory.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)

INITIAL_STATES: Final = StageKind(
    name="init",
    file_name="initial_states.safetensors",
    config_type=PoseDenoiserConfig,
    make_model=PoseDenoiser,
)
TRAJECTORIES: Final = StageKind(
    name="traj",
    file_name="trajectories.safetensors",
    config_type=TrajectoryConfig,
    make_model=TrajectoryDenoiser,
)
STAGE_KINDS: Final[Mapping[str, StageKind]] = {
    kind.name: kind for kind in (INITIAL_STATES, TRAJECTORIES)
}
