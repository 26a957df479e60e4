"""More agents than fit: as many as fit are placed, and the notes say how many."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.analysis.metrics.box_overlaps import overlapping_pairs
from pd_editor.analysis.repair.current_states import counted
from pd_editor.editor.commands import traffic_command
from pd_editor.generation.initial_state.placement_rules import ConflictSearch
from pd_editor.generation.initial_state.squares import (
    colliding_with_kept,
    without_overlapping,
)
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    Region,
    TrafficSample,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.scenario import Scenario
from tests.analysis.repair.scenes import Crowd, crowds
from tests.builders import scenario_with, straight_drivers


def overlaps_of(scenario: Scenario, names: tuple[str, ...]) -> int:
    agents = scenario.agents
    pairs = overlapping_pairs(agents, scenario.current_step)
    pairs = pairs[counted(agents, pairs)]
    return int(np.isin(pairs, agents.rows(names)).any(axis=1).sum())


@settings(max_examples=60, deadline=None)
@given(crowd=crowds())
def test_new_agents_that_stay_overlap_no_other(crowd: Crowd):
    states, kinds = crowd
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    new = scenario.agents.ids[1::2]
    kept, stays = without_overlapping(scenario, new)
    assert overlaps_of(kept, stays) == 0
    assert set(kept.agents.ids) == {*scenario.agents.ids[::2], *stays}
    if not overlaps_of(scenario, new):
        assert kept is scenario
    assert not kept.retired_ids


def test_who_is_not_admitted_or_breaks_a_rule_is_left_out(
    diffuser: PathDiffuser, monkeypatch: pytest.MonkeyPatch
):
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0)]))
    asked = {}

    def admits(placed: Scenario, new_ids: Sequence[str]) -> list[str]:
        asked.update(placed=placed, new_ids=new_ids)
        return list(new_ids)[1:]

    searched = []
    search = ConflictSearch.conflicting
    monkeypatch.setattr(
        ConflictSearch,
        "conflicting",
        lambda self, placed, ids, *more: (
            searched.append(ids) or ids[:1] or search(self, placed, ids, *more)
        ),
    )
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 4},
        region=Region(center_m=(0.0, 0.0), half_side_m=30.0),
        admits=admits,
    )
    sample = run_to_end(diffuser.generate(request)).samples[0]
    _, second, *others = asked["new_ids"]
    assert [list(ids) for ids in searched] == [[second, *others]]
    assert set(sample.ids) <= set(others)
    assert asked["placed"].agents.is_valid[:, scenario.current_step].all()


def test_what_fits_is_placed_and_the_number_is_said(diffuser: PathDiffuser):
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0)]))
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 30},
        region=Region(center_m=(0.0, 0.0), half_side_m=6.0),
    )
    traffic = run_to_end(diffuser.generate(request))
    count = len(traffic.samples[0].ids)
    assert 0 < count < 30
    assert (
        f"{count} of 30 new agents were placed; no free place was found for "
        in " ".join(traffic.notes)
    )
    after = traffic_command(request, traffic).apply(scenario)
    assert overlaps_of(after, traffic.samples[0].ids) == 0


def test_it_is_said_how_many_found_no_room(diffuser: PathDiffuser):
    scenario = scenario_with(straight_drivers([(8.0 * n, 0, 0, 0) for n in range(30)]))
    ids = scenario.agents.ids
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        resampled_state_ids=ids,
        region=Region(center_m=(0.0, 0.0), half_side_m=6.0),
    )
    traffic = run_to_end(diffuser.generate(request))
    agents = traffic_command(request, traffic).apply(scenario).agents
    pairs = overlapping_pairs(agents, scenario.current_step)
    count = len(np.unique(pairs[counted(agents, pairs)]))
    assert count > 0
    assert f"There is no room for {count} placed agents" in " ".join(traffic.notes)


def test_no_more_are_placed_than_a_scene_may_have(diffuser: PathDiffuser):
    states = [(12.0 * (n % 20), 200.0 + 5 * (n // 20), 0.0, 0.0) for n in range(498)]
    scenario = scenario_with(straight_drivers(states))
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=(),
        num_new_agents={AgentKind.PEDESTRIAN: 5},
        region=Region(center_m=(0.0, 0.0), half_side_m=60.0),
    )
    traffic = run_to_end(diffuser.generate(request))
    assert len(traffic.samples[0].ids) <= 2
    assert any("of 5 new agents were placed" in note for note in traffic.notes)
    traffic_command(request, traffic).apply(scenario)


def straight_on(scenario: Scenario, *names: str) -> TrafficSample:
    """The recorded trajectories of some agents, as if they were sampled."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(names)
    return TrafficSample(
        ids=names,
        kinds=tuple(agents.kinds[row] for row in rows),
        size_m=agents.size_m[rows],
        position_m=agents.position_m[rows, now:],
        heading_rad=agents.heading_rad[rows, now:],
        velocity_mps=agents.velocity_mps[rows, now:],
    )


def test_placed_agents_in_the_way_of_kept_ones_are_found():
    # The first one drives into the second, which stands; the third is beside the road.
    scenario = scenario_with(
        straight_drivers([(0, 0, 0, 10), (30, 0, 0, 0), (30, 20, 0, 0)])
    )
    placed = scenario.agents.ids[1:]
    some = straight_on(scenario, *placed)
    assert colliding_with_kept(scenario, some, placed) == (placed[0],)
    assert colliding_with_kept(scenario, some, placed[1:]) == ()
    every = straight_on(scenario, *scenario.agents.ids)
    assert colliding_with_kept(scenario, every, placed) == (placed[0],)
    assert colliding_with_kept(scenario, every, scenario.agents.ids) == ()


def test_agents_in_the_way_are_placed_again(diffuser: PathDiffuser):
    # A convoy that passes most of the region within six seconds.
    states = [(-60.0 - 12 * number, 0.0, 0.0, 15.0) for number in range(6)]
    scenario = scenario_with(straight_drivers(states))
    asked = GenerationRequest(
        scenario=scenario,
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 4},
        region=Region(center_m=(0.0, 0.0), half_side_m=40.0),
    )
    again = run_to_end(diffuser.generate(asked)).samples[0]
    raw = replace(asked, guidance=guidance_settings(None, 0))
    once = run_to_end(diffuser.generate(raw)).samples[0]

    def hits(sample: TrafficSample) -> int:
        placed = traffic_command(asked, traffic_with(sample)).apply(scenario)
        return len(colliding_with_kept(placed, sample, sample.ids))

    # Whoever still is in the way after some tries is left out.
    assert hits(again) == 0 <= hits(once)


def traffic_with(sample: TrafficSample) -> GeneratedTraffic:
    return GeneratedTraffic(samples=(sample,), generator="test")
