"""Placed agents keep clear of the trajectories of kept ones."""

import numpy as np
import pytest
import shapely

from pd_editor.editor.commands import traffic_command
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.placement_rules import (
    ConflictResampling,
    ConflictSearch,
    KeptPaths,
)
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import GenerationRequest, Region, run_to_end
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers

SEARCH = ConflictSearch.of(ConflictResampling(), InitialStateGuidance())


def blocked(state: tuple[float, float, float, float], *, is_kept: bool = True) -> bool:
    """Whether an agent is in the way of one that drives along the x axis at 10 m/s."""
    agents = straight_drivers([(0, 0, 0, 10), state])
    scenario = scenario_with(agents)
    names = agents.ids[1:] if is_kept else agents.ids
    kept = KeptPaths.of(scenario, names)
    random = np.random.default_rng(0)
    only_pair = SEARCH.conflicts(agents, scenario, KeptPaths.of(scenario, agents.ids))
    chosen = SEARCH.conflicting(scenario, agents.ids[1:], random, kept)
    return bool(chosen) and not only_pair[0, 1]


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        pytest.param((45, 0, np.pi / 2, 0), True, id="stands across, 4.5 s ahead"),
        pytest.param((45, 2.2, 0, 0), True, id="stands at 0.2 m"),
        pytest.param((45, 4, 0, 0), False, id="stands in the next lane"),
        pytest.param((90, 0, 0, 0), False, id="further than it drives"),
        pytest.param((30, 0, 0, 9), False, id="drives on ahead"),
        pytest.param((60, -45, np.pi / 2, 7.5), False, id="meets it in 6 s"),
    ],
)
def test_whoever_is_where_a_kept_agent_will_be_is_in_conflict(
    state: tuple[float, float, float, float], expected: bool
) -> None:
    assert blocked(state) == expected


def test_paths_that_are_generated_anew_are_free() -> None:
    assert not blocked((45, 0, np.pi / 2, 0), is_kept=False)


def box(scenario: Scenario, row: int, step: int) -> shapely.Polygon:
    agents = scenario.agents
    x, y = agents.position_m[row, step]
    length, width = agents.size_m[row] / 2
    flat = shapely.box(x - length, y - width, x + length, y + width)
    turned = agents.heading_rad[row, step]
    return shapely.affinity.rotate(flat, turned, origin=(x, y), use_radians=True)


@pytest.mark.parametrize("seed", range(3))
def test_no_new_agent_is_hit_by_a_kept_one(diffuser: PathDiffuser, seed: int) -> None:
    """A bus was placed in the path of a kept ego, which drove through it after 4 s."""
    states = [(-60.0 - 12 * number, 0.0, 0.0, 15.0) for number in range(6)]
    scenario = scenario_with(straight_drivers(states))
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 6, AgentKind.BUS: 2},
        region=Region(center_m=(0.0, 0.0), half_side_m=40.0),
        seed=seed,
    )
    traffic = run_to_end(diffuser.generate(request))
    result = traffic_command(request, traffic).apply(scenario)
    agents = result.agents
    new = agents.rows(traffic.samples[0].ids)
    kept = np.setdiff1d(np.arange(len(agents)), new)
    for step in range(result.current_step, agents.num_steps):
        ours = shapely.union_all([box(result, int(row), step) for row in kept])
        for row in new:
            assert ours.intersection(box(result, int(row), step)).area <= 0.05
    if len(new) < 8:
        assert any("new agents were placed" in note for note in traffic.notes)
