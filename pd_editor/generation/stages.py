"""The two stages of the model, by their names on disk and in the shell."""

from collections.abc import Mapping
from typing import Final

from pd_editor.generation.checkpoints.model_folder import StageKind
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.placement_rules import ConflictResampling
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    TrajectoryGuidance,
)
from pd_editor.generation.trajectory.guidance.term_guidance import TermGuidance
from pd_editor.generation.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.generation.trajectory.sampler import TrajectorySamplerConfig

INITIAL_STATES: Final = StageKind(
    name="init",
    file_name="initial_states.safetensors",
    config_type=InitialStateConfig,
    earlier={"sees_signals": False},
    make_model=InitialStateDenoiser,
    sampling_types={
        "sampler": InitialStateSamplerConfig,
        "guidance": InitialStateGuidance,
        "conflicts": ConflictResampling,
    },
    statistics=frozenset({"counted", "state_moments", "clean_variance"}),
)
TRAJECTORIES: Final = StageKind(
    name="traj",
    file_name="trajectories.safetensors",
    config_type=TrajectoryConfig,
    earlier={"sees_signals": False},
    make_model=TrajectoryDenoiser,
    make_for=TrajectoryDenoiser.for_weights,
    sampling_types={
        "sampler": TrajectorySamplerConfig,
        "guidance": TrajectoryGuidance,
        "terms": TermGuidance,
    },
)
STAGE_KINDS: Final[Mapping[str, StageKind]] = {
    kind.name: kind for kind in (INITIAL_STATES, TRAJECTORIES)
}
