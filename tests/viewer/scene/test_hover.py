"""What the tooltip says, and what it does with a page's garbage."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pd_editor.editor.commands import SetAgentSpeed, TransformAgents
from pd_editor.scene.road_map import LaneMark
from pd_editor.viewer.meshes.agent_shapes import poses_at
from pd_editor.viewer.scene.picking import Hover, agent_lines, lane_lines, lane_under
from pd_editor.viewer.tab.tab_model import TabModel
from tests.builders import two_agents_that_pass
from tests.viewer.fake_page import FakePage


def test_an_agent_is_told_with_speed_lane_and_marks():
    base = two_agents_that_pass()
    focal = base.agents.row_of[base.focal_id]
    lines = agent_lines(base, base, focal, 49.0)
    assert lines[0] == f"vehicle {base.focal_id}"
    assert lines[1] == "10.0 m/s (36 km/h)"
    assert lines[2].startswith("lane ")
    assert lines[3] == "focal agent"


@pytest.mark.parametrize("row", [0, 1])
def test_edited_agents_are_told_as_edited_and_no_others(row):
    base = two_agents_that_pass()
    agent_id = base.agents.ids[row]
    moved = TransformAgents(agent_ids=(agent_id,), dx_m=2.0).apply(base)
    said = [", ".join(agent_lines(moved, base, r, 49.0)) for r in (0, 1)]
    assert "edited" in said[row]
    assert "edited" not in said[1 - row]
    slower = SetAgentSpeed(agent_ids=(agent_id,), speed_mps=4.0).apply(base)
    assert "edited" in agent_lines(slower, base, row, 49.0)[-1]


def test_a_lane_is_told_with_its_paint():
    road_map = two_agents_that_pass().road_map
    lane = lane_under(road_map, np.array([0.0, 0.0]))
    assert lane is not None
    first, second = lane_lines(lane)
    assert first == f"vehicle lane {lane.lane_id}"
    assert second == "dashed white line at the left, solid white line at the right"
    left = replace(lane, right_mark=LaneMark.NONE)
    assert lane_lines(left)[1] == "dashed white line at the left"
    bare = replace(left, left_mark=LaneMark.NONE)
    assert lane_lines(bare)[1] == "no lines marked"


class FakeDesk:
    """A session and a playhead that stands."""

    class session:
        scenario = original = two_agents_that_pass()

    class workspace:
        class playback:
            is_playing, step = False, 49.0


def test_answers_name_the_question_and_garbage_gets_none(monkeypatch):
    desk: Any = FakeDesk
    page = desk.overlay = FakePage()
    desk.model = TabModel(desk.workspace)
    desk.model.poses = poses_at(desk.session.scenario.agents, 49.0)
    Hover(desk)
    asked = {"at": [3, 4], "ray": [[0, 0, 50], [0, 0, 0]], "ask": 7}
    page.send("tooltip", asked)
    assert page.shown["tooltip"]["asked"] == 7
    assert page.shown["tooltip"]["at"] == [3, 4]
    for ask in (math.nan, "7", None, 10**400, []):
        page.send("tooltip", {**asked, "ask": ask})
    page.send("tooltip", {"ask": 7})
    monkeypatch.setattr(FakeDesk.workspace.playback, "is_playing", True)
    page.send("tooltip", asked)
    assert page.num_sent == 1
