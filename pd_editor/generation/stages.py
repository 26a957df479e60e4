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
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance
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
    former_sampling={
        "sampler": {
            "num_high_quality_steps": 16,
            "extrapolates_poses": False,
            "adds_missing_noise": True,
        },
        "guidance": {"push": 1.0, "farthest_out_m": 20.0, "num_last_pushes": 12},
        "conflicts": {
            "num_rounds": 1,
            "num_high_quality_versions": 4,
            "num_steps": 4,
            "gap_m": 0.45,
            "braking_mps2": 2.0,
            "side_gap_m": 0.7,
            "wrong_way_m": 1.2,
        },
    },
    former_switches={"sampler": {"adds_missing_noise": "eta"}},
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
    earlier_sampling={"sampler": {"waiting_mps": 0.0, "noise_mean_per_mps": 0.0}},
    former_sampling={
        "sampler": {"eta": 0.0, "standing_noise": 1.0},
        "guidance": {"standing_first_level": 0.35},
        "terms": {
            "first_level": 1.0,
            "is_last_step_guided": False,
            "num_avoiding": 4,
            "closing_spread": 0.3,
            "goal_aside_m": 4.0,
            "comfort_margin_mps2": 0.1,
            "held_path_m": 0.6,
            "road_m": 0.2,
            "road_margin_m": 0.2,
            "max_acceleration_mps2": 2.5,
            "max_braking_mps2": 5.0,
            "lateral_mps2": 3.0,
            "avoided_ahead_m": 0.6,
            "gap_m": 0.1,
            "threat_meeting_m": 0.05,
            "goal_way_m": 2.0,
            "speed_m": 0.4,
            "limit_margin_mps": 0.2,
            "stop_gap_m": 0.4,
            "acceleration_mps2": 1.5,
            "avoided_aside_m": 0.3,
            "pace_m": 1.5,
            "comfort_mps2": 0.05,
            "threat_m": 0.5,
            "stop_mps": 0.1,
            "braking_mps2": 2.0,
            "hard_braking_mps2": 3.5,
            "hardest_mps2": 7.0,
            "yield_gap_m": 1.0,
        },
    },
    former_switches={"guidance": {"is_last_step_guided": "last_step_share"}},
)
STAGE_KINDS: Final[Mapping[str, StageKind]] = {
    kind.name: kind for kind in (INITIAL_STATES, TRAJECTORIES)
}
