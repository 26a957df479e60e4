"""The two stages of the model, by the names they have on disk and in the shell."""

from collections.abc import Mapping
from typing import Final

from pd_editor.diffusion.checkpoints.model_folder import StageKind
from pd_editor.diffusion.initial_state import version_1 as initial_state_version_1
from pd_editor.diffusion.initial_state.denoiser import PoseDenoiser, PoseDenoiserConfig
from pd_editor.diffusion.initial_state.guidance import PoseGuidance
from pd_editor.diffusion.initial_state.sampler import PoseSamplerConfig
from pd_editor.diffusion.trajectory import version_1 as trajectory_version_1
from pd_editor.diffusion.trajectory.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.diffusion.trajectory.guidance import TrajectoryGuidance
from pd_editor.diffusion.trajectory.sampler import TrajectorySamplerConfig

INITIAL_STATES: Final = StageKind(
    name="init",
    file_name="initial_states.safetensors",
    config_type=PoseDenoiserConfig,
    make_model=PoseDenoiser,
    sampling_types={"sampler": PoseSamplerConfig, "guidance": PoseGuidance},
    upgraded_tensors=initial_state_version_1.upgraded_tensors,
)
TRAJECTORIES: Final = StageKind(
    name="traj",
    file_name="trajectories.safetensors",
    config_type=TrajectoryConfig,
    make_model=TrajectoryDenoiser,
    sampling_types={"sampler": TrajectorySamplerConfig, "guidance": TrajectoryGuidance},
    upgraded_tensors=trajectory_version_1.upgraded_tensors,
)
STAGE_KINDS: Final[Mapping[str, StageKind]] = {
    kind.name: kind for kind in (INITIAL_STATES, TRAJECTORIES)
}
