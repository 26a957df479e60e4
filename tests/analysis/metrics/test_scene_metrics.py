"""Laws that all metrics obey, on real and on hand-made scenes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pd_editor.analysis.metrics.scene_metrics import agent_values, sample_values
from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    generated_traffic,
    recorded_traffic,
)
from pd_editor.experiments.evaluation.evaluation_task import (
    paper_init_agents,
    paper_trajectory_agents,
)
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.scenario import Scenario
from tests.analysis.metrics.traffic_builders import recorded, sample_of
from tests.builders import scenario_with, straight_drivers


@pytest.fixture(scope="module")
def real_scenarios(av2_scenario_folders: list[Path]) -> list[Scenario]:
    full = [f for f in av2_scenario_folders if f.parent.name != "test50"]
    return [read_scenario(folder) for folder in full[::6]]


def same_values(first: TrafficView, second: TrafficView, rows: np.ndarray, atol: float):
    """Agents of the first are those at ``rows`` of the second."""
    one, two = agent_values(first), agent_values(second)
    for name, values in one.items():
        other = two[name].taken(rows)
        np.testing.assert_array_equal(values.is_valid, other.is_valid, err_msg=name)
        gap = np.abs(values.value - other.value)
        if name == "nearest_edge_angle":
            gap = np.minimum(gap, 360 - gap)
        assert gap.max(initial=0.0) <= atol, name


def test_the_order_of_agents_does_not_matter(real_scenarios):
    for scenario in real_scenarios:
        order = np.random.default_rng(0).permutation(len(scenario.agents))
        shuffled = scenario.with_agents(scenario.agents.taken(order))
        view = recorded_traffic(shuffled)
        row_of = {agent: row for row, agent in enumerate(view.agents.ids)}
        straight = recorded_traffic(scenario)
        rows = np.array([row_of[agent] for agent in straight.agents.ids], int)
        same_values(straight, view, rows, 1e-9)


def moved(scenario: Scenario, motion: RigidMotion) -> Scenario:
    agents = scenario.agents
    return replace(
        scenario,
        road_map=scenario.road_map.moved(motion.apply),
        agents=replace(
            agents,
            position_m=np.where(
                agents.is_valid[..., None], motion.apply(agents.position_m), 0.0
            ),
            heading_rad=agents.heading_rad + motion.rotation_rad,
            velocity_mps=motion.turn(agents.velocity_mps),
        ),
    )


def test_metrics_move_with_the_scene(real_scenarios):
    motion = RigidMotion(x_m=120.0, y_m=-45.0, rotation_rad=0.7)
    for scenario in real_scenarios:
        view = recorded_traffic(scenario)
        same_values(
            view, recorded_traffic(moved(scenario, motion)), np.arange(len(view)), 1e-3
        )


def test_generating_the_recording_scores_as_the_recording(real_scenarios):
    for scenario in real_scenarios:
        whole = scenario.agents.is_valid[:, scenario.current_step :].all(axis=1)
        present = recorded_traffic(scenario)
        ids = tuple(
            agent
            for agent in present.agents.ids
            if whole[scenario.agents.row_of[agent]]
        )
        truth = recorded_traffic(scenario, ids)
        states = truth.agents
        sample = replace(
            sample_of(ids, states.position_m, states.kinds),
            size_m=states.size_m,
            heading_rad=states.heading_rad,
            velocity_mps=states.velocity_mps,
        )
        same_values(
            truth, generated_traffic(scenario, sample), np.arange(len(ids)), 0.0
        )


def test_who_is_judged_does_not_change_what_they_score(real_scenarios):
    for scenario in real_scenarios:
        everybody = recorded_traffic(scenario)
        some = recorded_traffic(scenario, everybody.agents.ids[::3])
        same_values(some, everybody, np.arange(len(everybody))[::3], 1e-9)


def test_numbers_where_a_track_is_missing_do_not_matter(real_scenarios):
    scenario = real_scenarios[0]
    view = recorded_traffic(scenario)
    gone = ~view.agents.is_valid
    spoiled = replace(
        view.agents,
        position_m=np.where(gone[..., None], 3.0, view.agents.position_m),
        heading_rad=np.where(gone, 1.0, view.agents.heading_rad),
        velocity_mps=np.where(gone[..., None], 9.0, view.agents.velocity_mps),
    )
    assert gone.any()
    other = replace(view, agents=spoiled, logged=spoiled)
    same_values(view, other, np.arange(len(view)), 1e-9)


def test_scenes_are_judged_alone():
    """The same agents far apart in two scenes never meet, whatever their frames."""
    one, two = recorded([(0, 0, 0, 10)]), recorded([(0.5, 0, 0, 10)])
    for view in (one, two):
        values = agent_values(view)
        assert values["init_collision_2m"].value.tolist() == [0]
        assert values["init_overlap"].value.tolist() == [0]
        assert not values["minimum_gap"].is_valid.any()


def test_samples_must_be_of_the_same_agents():
    with pytest.raises(AssertionError):
        sample_values([recorded([(0, 0, 0, 1)]), recorded([(0, 0, 0, 1)] * 2)])


def test_the_papers_agents():
    kinds = (AgentKind.VEHICLE,) * 3 + (AgentKind.BUS, AgentKind.CYCLIST)
    states = [(0.0, 0, 0, 1), (9.0, 30, 0, 1), (9.0, 7.0, 0, 1), (20.0, 0, 0, 1)]
    agents = straight_drivers([*states, (30.0, 0, 0, 1)], kinds=kinds)
    is_valid = agents.is_valid.copy()
    is_valid[2, -1] = False
    unscored = (*agents.categories[:3], AgentCategory.UNSCORED, agents.categories[4])
    agents = replace(agents, is_valid=is_valid)
    view = recorded_traffic(scenario_with(agents))
    # Vehicles only; the second is off the road, the third leaves before the end.
    assert paper_init_agents(view).tolist() == [True, False, False, False, False]
    # Scored movers wherever they are.
    kept = [True, True, False, True, False]
    assert paper_trajectory_agents(view).tolist() == kept
    other = recorded_traffic(scenario_with(replace(agents, categories=unscored)))
    assert paper_trajectory_agents(other).tolist() == [True, True, *[False] * 3]
