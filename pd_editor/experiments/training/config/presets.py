"""Presets of settings by hardware and purpose."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from pd_editor.experiments.training.config.run_config import Optimisation
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.loss import InitialStateLossConfig
from pd_editor.generation.initial_state.network.denoiser import InitialStateConfig
from pd_editor.generation.initial_state.placement_rules import ConflictResampling
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    TrajectoryGuidance,
)
from pd_editor.generation.trajectory.guidance.term_guidance import TermGuidance
from pd_editor.generation.trajectory.loss import TrajectoryLossConfig
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.generation.trajectory.sampler import TrajectorySamplerConfig

PresetName = Literal["default", "gpu", "av2", "tiny"]


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Size of a network, optimisation, and duration of training."""

    model: Mapping[str, Any]
    optimisation: Optimisation
    minutes: float
    windows: int = 1
    """Number of current steps at which each scenario of Argoverse 2 is used."""


NETWORKS: Final[Mapping[str, type[Any]]] = {
    "traj": TrajectoryConfig,
    "init": InitialStateConfig,
}
"""Configuration of each stage's network."""
LOSSES: Final[Mapping[str, type[Any]]] = {
    "traj": TrajectoryLossConfig,
    "init": InitialStateLossConfig,
}
"""Type of each stage's loss settings; all presets use the defaults."""
SAMPLING: Final[Mapping[str, Mapping[str, type[Any]]]] = {
    "traj": {
        "sampler": TrajectorySamplerConfig,
        "guidance": TrajectoryGuidance,
        "terms": TermGuidance,
    },
    "init": {
        "sampler": InitialStateSamplerConfig,
        "guidance": InitialStateGuidance,
        "conflicts": ConflictResampling,
    },
}
"""Types of each stage's settings of the sampling, stored beside the weights."""
_GO_ON: Final = Optimisation(batch_size=64, learning_rate=5e-4, ema_decay=0.9995)
_TRY_OUT: Final = Optimisation(batch_size=4, warmup_steps=10, ema_decay=0.98)
PRESETS: Final[Mapping[str, Mapping[PresetName, Preset]]] = {
    "traj": {
        "default": Preset(
            model=asdict(TrajectoryConfig()),
            optimisation=Optimisation(batch_size=16, learning_rate=1.5e-3),
            minutes=20.0,
        ),
        "gpu": Preset(
            model=asdict(TrajectoryConfig(width=192, num_blocks=4)),
            optimisation=Optimisation(batch_size=256, learning_rate=1.5e-3),
            minutes=12.0,
        ),
        "av2": Preset(
            model=asdict(TrajectoryConfig()),
            optimisation=_GO_ON,
            minutes=240.0,
            windows=5,
        ),
        "tiny": Preset(
            model=asdict(
                TrajectoryConfig(width=32, num_heads=4, num_blocks=1, edge_width=16)
            ),
            optimisation=_TRY_OUT,
            minutes=1.0,
        ),
    },
    "init": {
        "default": Preset(
            model=asdict(InitialStateConfig()),
            optimisation=Optimisation(batch_size=16, learning_rate=2e-3),
            minutes=30.0,
        ),
        "gpu": Preset(
            model=asdict(InitialStateConfig(width=192, num_layers=4)),
            optimisation=Optimisation(batch_size=192, learning_rate=1.5e-3),
            minutes=15.0,
        ),
        "av2": Preset(
            model=asdict(InitialStateConfig()),
            optimisation=_GO_ON,
            minutes=240.0,
            windows=5,
        ),
        "tiny": Preset(
            model=asdict(InitialStateConfig(width=32, num_layers=1, relation_width=16)),
            optimisation=_TRY_OUT,
            minutes=1.0,
        ),
    },
}
