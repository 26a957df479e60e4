"""A model with random weights, and a scenario for it."""

from pathlib import Path

import numpy as np
import pytest

from pd_editor.generation.checkpoints.model_folder import TrainedStage, save_model
from pd_editor.generation.initial_state.network.agent_count_prior import AgentCounts
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.stages import INITIAL_STATES, TRAJECTORIES
from pd_editor.scene.scenario import Scenario
from tests.builders import two_agents_that_pass
from tests.generation.trajectory.scenes import small_model


@pytest.fixture(scope="module")
def model_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    driver = small_model(sees_signals=False)
    counts = AgentCounts(
        half_side_m=np.full(3, 62.0),
        lane_m=np.full(3, 200.0),
        counts=np.einsum("i,jk->ijk", [4, 0, 0, 1, 2], [[0, 0], [0, 1]])[None].repeat(
            3, axis=0
        ),
    )
    config = InitialStateConfig(
        width=32, num_heads=2, num_layers=1, num_near_pieces=4, relation_width=16
    )
    placer = InitialStateDenoiser(config)
    placer.set_agent_counts(counts)
    save_model(
        folder,
        {
            "traj": TrainedStage(kind=TRAJECTORIES, config=driver.config, model=driver),
            "init": TrainedStage(
                kind=INITIAL_STATES,
                config=config,
                model=placer,
                sampling={"sampler": InitialStateSamplerConfig(fit_density=1.0)},
            ),
        },
    )
    return folder


@pytest.fixture
def diffuser(model_folder: Path) -> PathDiffuser:
    return PathDiffuser(model_folder)


@pytest.fixture
def scenario() -> Scenario:
    return two_agents_that_pass()
