"""Attention scores of trained systems on recorded scenes, for Table I."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from reproduction.paper_tables import AttentionScores
from reproduction.systems import STATES, Trained, in_table_order

if TYPE_CHECKING:
    from pd_editor.generation.inputs import SceneTensors

LEVELS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
MAX_SCENES: Final = 12


def recorded_states(scenario: Scenario) -> "SceneTensors":
    """The agents of a scenario around its focal agent, with their own states.

    Raises:
        GenerationError: an agent has no finite state at the current step.
    """
    from pd_editor.generation.features.scene_features import packed, scene_features
    from pd_editor.generation.features.scene_fields import LATENT_SIZE
    from pd_editor.generation.initial_state.network.conditioning import only_agents
    from pd_editor.generation.initial_state.network.state_encoding import (
        POSITION_UNIT_M,
    )
    from pd_editor.generation.inputs import batch_of

    features = scene_features(scenario, with_candidates=False)

    def no_latents(future_m: np.ndarray, speed_mps: np.ndarray, /) -> np.ndarray:
        del speed_mps
        return np.zeros((*future_m.shape[:-2], LATENT_SIZE))

    scene = batch_of([packed(features, no_latents)])
    is_inside = scene.agent_pose[..., :2].abs().amax(dim=-1) <= POSITION_UNIT_M
    return only_agents(scene, is_inside)


def attention_scores(
    trained: Sequence[Trained], folders: Mapping[str, Path], scenes: Sequence[Path]
) -> tuple[AttentionScores, ...]:
    """Variances of attention scores of each system with an own first stage.

    ``folders`` are of models by their names as methods; of ``scenes`` the first few are
    used.
    """
    from pd_editor.generation.checkpoints.model_folder import load_model
    from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
    from pd_editor.generation.stages import STAGE_KINDS
    from reproduction.attention_probe import attention_variance

    batches = []
    for folder in scenes[:MAX_SCENES]:
        try:
            batches.append(recorded_states(read_scenario(folder)))
        except PdEditorError:
            continue
    if not batches:
        return ()
    found: dict[str, list[tuple[np.ndarray, np.ndarray, bool]]] = {}
    for one in trained:
        if STATES not in one.stages:
            continue
        model = load_model(folders[one.method], STAGE_KINDS).stage(STATES).model
        assert isinstance(model, InitialStateDenoiser)
        scores = attention_variance(model, batches, LEVELS)
        found.setdefault(one.system, []).append(
            (
                np.array([score.over_map for score in scores]),
                np.array([score.over_agents for score in scores]),
                model.config.is_differential,
            )
        )
    return tuple(
        AttentionScores(
            system=system,
            over_map=tuple(np.mean([one[0] for one in found[system]], axis=0).tolist()),
            over_agents=tuple(
                np.mean([one[1] for one in found[system]], axis=0).tolist()
            ),
            is_differential=found[system][0][2],
        )
        for system in in_table_order(found)
    )
