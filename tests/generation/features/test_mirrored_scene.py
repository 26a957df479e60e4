"""Traffic on the left is seen as the mirror image of traffic on the right.

Half of the scenes of a training are mirrored, so a model knows both.
"""

from dataclasses import replace

import numpy as np
import pytest

import pd_editor
from benchmarks.imported_maps import mirrored
from pd_editor.generation.features.scene_features import packed, scene_features
from pd_editor.generation.inputs import batch_of
from pd_editor.scene.scenario import Scenario
from tests.generation.trajectory.scenes import arc_basis

IN_ORDER = (
    "piece_pose",
    "piece_shape",
    "piece_kind",
    "agent_pose",
    "agent_speed",
    "agent_activity",
    "near_agents",
    "has_candidate",
    "future",
)


def left_hand(scenario: Scenario) -> Scenario:
    agents = scenario.agents
    return replace(
        scenario,
        road_map=mirrored(scenario.road_map),
        agents=replace(
            agents,
            position_m=agents.position_m * (1.0, -1.0),
            velocity_mps=agents.velocity_mps * (1.0, -1.0),
            heading_rad=-agents.heading_rad,
        ),
    )


@pytest.mark.parametrize("demo", ["signalised-junction", "merge"])
def test_left_hand_traffic_is_seen_as_the_mirror_image(demo: str):
    scenario = pd_editor.open_scenario(demo)
    basis = arc_basis()
    seen, expected = (
        batch_of([packed(scene_features(one), basis.encode)])
        for one in (left_hand(scenario), scenario)
    )
    expected = expected.mirrored()
    for name in IN_ORDER:
        one, two = (getattr(of, name).numpy() for of in (seen, expected))
        assert np.allclose(one, two, atol=1e-3), name
    # Of equally near lanes, the order of candidates may differ.
    for agent, exists in enumerate(seen.has_candidate[0].numpy()):
        one, two = (of.candidates[0, agent, exists].numpy() for of in (seen, expected))
        apart = np.abs(one[:, None] - two[None]).max(axis=-1)
        if exists.any():
            assert apart.min(axis=1).max() < 0.01
            assert apart.min(axis=0).max() < 0.01
