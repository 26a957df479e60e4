"""The data within the player's page, and the page around it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pd_editor
from pd_editor.base.installed_files import demo_names
from pd_editor.editor.commands import DeleteAgents
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats.player import player_page
from pd_editor.scene.junction_phases import sampled_signals
from pd_editor.scene.palette import DARK, LIGHT
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor, warp_scenario
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState
from tests.builders import two_agents_that_pass
from tests.scene.formats.embedded_scenes import Page, line_of, scenes_in, tracks_of

MOST_BYTES = 1_000_000


@cache
def without_anything() -> Scenario:
    scenario = open_scenario("roundabout")
    scenario = scenario.without_agents(scenario.agents.ids)
    return replace(scenario, road_map=RoadMap(lanes=()))


def check_carried(scenario: Scenario, data: dict) -> None:
    """Tracks are the scenario's within a centimetre, and nothing is there besides."""
    agents, axis = scenario.agents, scenario.time_axis
    assert [one["id"] for one in data["agents"]] == list(agents.ids)
    assert (data["current"], data["stepS"]) == (axis.current_step, axis.step_s)
    for row, one in enumerate(data["agents"]):
        values, there = tracks_of(one, axis.num_steps)
        np.testing.assert_array_equal(there, agents.is_valid[row])
        gap = values[there, :2] - agents.position_m[row, there]
        assert np.abs(gap).max(initial=0.0) <= 0.00501
        turn = values[there, 2] - agents.heading_rad[row, there]
        assert np.abs(np.angle(np.exp(1j * turn))).max(initial=0.0) <= 0.00051
        # No turn on the spot between two steps.
        assert np.abs(np.diff(values[there, 2])).max(initial=0.0) <= np.pi + 0.001
        speed = values[there, 3] - agents.speed_mps()[row, there]
        assert np.abs(speed).max(initial=0.0) <= 0.00501
        np.testing.assert_allclose(
            one["size"][:2], agents.size_m[row] * 100, atol=0.501
        )
    lines = data["road"][-1]["lines"]
    for line, lane in zip(lines, scenario.road_map.lanes, strict=True):
        gap = line_of(line) - lane.centerline_m
        assert np.abs(gap).max() <= 0.00501


@pytest.mark.parametrize("demo", demo_names())
def test_a_demo_is_carried_as_it_is(demo: str):
    scenario = open_scenario(demo)
    page = player_page([scenario])
    (data,) = scenes_in(page)
    check_carried(scenario, data)
    assert len(page) < MOST_BYTES


@pytest.mark.real_data
def test_real_scenes_are_carried_as_they_are(av2_scenario_folders: list[Path]):
    most = 0
    for folder in av2_scenario_folders[::6]:
        scenario = open_scenario(folder)
        page = player_page([scenario])
        (data,) = scenes_in(page)
        check_carried(scenario, data)
        assert data["attribution"] == "Argoverse 2 by Argo AI, CC BY-NC-SA 4.0."
        assert len(page) < MOST_BYTES
        most = max(most, len(scenario.agents))
    assert most >= 60


def test_a_gap_in_a_track_stays_a_gap():
    scenario = open_scenario("queue")
    is_valid = scenario.agents.is_valid.copy()
    is_valid[:, 20:25] = is_valid[0] = False
    scenario = scenario.with_agents(replace(scenario.agents, is_valid=is_valid))
    check_carried(scenario, scenes_in(player_page([scenario]))[0])


def test_a_warped_scene_carries_its_original():
    plain = open_scenario("signalised-junction")
    assert scenes_in(player_page([plain]))[0]["original"] is None
    warp = RoadWarp(
        anchor=pose_of_anchor(plain, plain.focal_id),
        terms=(WarpTerm(kind="smooth-turn", power=6.0, length_m=30.0),),
    )
    warped = warp_scenario(plain, warp)
    (data,) = scenes_in(player_page([warped]))
    check_carried(warped, data)
    applied = warped.applied_warp
    assert applied is not None
    carried = {one["id"]: one for one in data["original"]["agents"]}
    assert 0 < len(carried) < len(plain.agents)
    for row, name in enumerate(plain.agents.ids):
        now = warped.agents.position_m[warped.agents.row_of[name]]
        before = applied.original_agents.position_m[row]
        if name in carried:
            values, there = tracks_of(carried[name], len(before))
            assert np.abs(values[there, :2] - before[there]).max() <= 0.00501
        else:
            assert np.abs(now - before).max() <= 0.011
    lines = [line_of(one)[[0, -1]] for one in data["original"]["lines"]]
    ends = np.concatenate(lines)
    for lane, now in zip(plain.road_map.lanes, warped.road_map.lanes, strict=True):
        gap = np.linalg.norm(ends - lane.left_m[-1], axis=-1).min()
        if np.linalg.norm(now.left_m[-1] - lane.left_m[-1]) > 1:
            assert gap < 0.01
    assert len(lines) < len(plain.road_map.lanes)


def test_stop_lines_have_the_colours_of_their_signals():
    scenario = open_scenario("signalised-junction")
    first, *others = sampled_signals(scenario, seed=1)
    first = replace(first, states=np.arange(110).astype(np.int8) // 30)
    scenario = replace(scenario, signals=(first, *others))
    (data,) = scenes_in(player_page([scenario]))
    shown = iter(data["signals"])
    for signal in scenario.signals:
        for _ in signal.lane_ids:
            phases = next(shown)["phases"]
            for step, state in enumerate(signal.states):
                color = [color for first, color in phases if first <= step][-1]
                expected = [one.signals[SignalState(state)] for one in (LIGHT, DARK)]
                assert color == ["#" + bytes(one).hex() for one in expected]
    assert next(shown, None) is None
    assert data["signals"]


@given(st.text(st.characters(codec="utf-8"), max_size=20))
def test_any_name_is_text(name: str):
    """A name such as </script><b> ended the script that carried it."""
    scenario = without_anything()
    known = Page(player_page([scenario]))
    for told in (name, f"</script><b>{name}<!--<script>"):
        named = replace(
            scenario,
            scenario_id=told,
            provenance=replace(scenario.provenance, attribution=told, notes=(told,)),
        )
        page = player_page([named])
        assert Page(page).elements == known.elements
        (data,) = scenes_in(page)
        assert data["name"] == data["attribution"] == data["notes"][0] == told


def test_a_page_asks_for_nothing_outside():
    page = player_page([open_scenario("roundabout"), open_scenario("merge")])
    assert [one["name"] for one in scenes_in(page)] == ["roundabout", "merge"]
    found = Page(page)
    names = {key for _, attributes in found.elements for key in attributes}
    assert not names & {"src", "srcset", "data", "action"}
    hrefs = [one["href"] for _, one in found.elements if "href" in one]
    assert hrefs == ["data:,"]
    assert b"url(" not in page
    assert b"fetch(" not in page


def test_scenarios_and_sessions_show_themselves():
    scenario = two_agents_that_pass()
    session = pd_editor.EditorSession(scenario)
    session.apply(DeleteAgents(agent_ids=scenario.agents.ids[-1:]))
    for one, now in ((scenario, scenario), (session, session.scenario)):
        assert one.show().page == player_page([now])
