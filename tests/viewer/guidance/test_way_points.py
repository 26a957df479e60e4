"""Way-points of a path: clicked, chosen, moved, added, removed, and what they ask."""

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.base.errors import EditError
from tests.viewer.fake_browser import FakeTab
from tests.viewer.guidance.test_guiding import by, draw, focal


def path_of(tab: FakeTab) -> FollowPath:
    (term,) = tab.session.scenario.guidance
    assert isinstance(term, FollowPath)
    return term


@pytest.fixture
def place(tab: FakeTab) -> np.ndarray:
    """Place of the focal agent, which gets a path by four clicks on its lane."""
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    clicks = [place, *(by(place, ahead, 0.4) for ahead in (10.0, 20.0, 30.0))]
    points = [list(map(float, one)) for one in clicks]
    draw(tab, "follow-path", kind="drawn", points=points, isClicked=True)
    return place


def dots(tab: FakeTab, *, offered: bool = False) -> list[dict]:
    marks = tab.shown("guidance_marks")["marks"]
    return [m for m in marks if m["shape"] == "dot" and m["isOffer"] is offered]


def on_dot(tab: FakeTab, node: int, *points, drop=True, **event) -> None:
    tab.hear("guidance_marks", kind="grab", index=0, node=node, **event)
    for point in points:
        at = list(map(float, point))
        tab.hear("guidance_marks", kind="drag", index=0, node=node, point=at, **event)
    last = {"point": at} if points else {}
    kind = "drop" if drop else "cancel"
    tab.hear("guidance_marks", kind=kind, index=0, node=node, **last, **event)


def row(tab: FakeTab) -> dict:
    (found,) = tab.shown("guidance_panel")["rows"]
    return found


def give(tab: FakeTab, name: str, value) -> None:
    version = tab.shown("guidance_panel")["version"]
    event = {"kind": "input", "index": 0, "name": name, "value": value}
    tab.hear("guidance_panel", **event, version=version, count=1)


def test_clicked_points_are_kept_and_snap_to_the_lane(tab: FakeTab, place):
    points = np.array(path_of(tab).points_m)
    assert len(points) == 4
    assert np.ptp(points[1:, 1]) < 0.05
    # The agent is pressed where it stands, not the point under it.
    assert [dot["node"] for dot in dots(tab)] == [1, 2, 3]
    assert len(dots(tab, offered=True)) == 3


def test_a_chosen_way_point_gets_a_speed_a_time_and_a_wait(tab: FakeTab, place):
    on_dot(tab, 2)
    assert [dot["isChosen"] for dot in dots(tab)] == [False, True, False]
    named = {one["name"]: one for one in row(tab)["inputs"]}
    assert named["point"]["value"] == "3"
    give(tab, "speeds_mps", 4.0)
    give(tab, "times_s", 3.0)
    give(tab, "times_s", None)
    other = named["waits_for"]["options"][1]
    give(tab, "waits_for", other)
    term = path_of(tab)
    assert (term.speeds_mps, term.times_s) == ((None, None, 4.0, None), ())
    assert term.waits_for == (None, None, other, None)
    assert dots(tab)[1]["label"] == f"wait for {other}, 4 m/s"
    give(tab, "waits_for", "nobody")
    assert path_of(tab).waits_for == ()
    before = tab.session.scenario
    give(tab, "speeds_mps", 1e9)
    assert tab.session.scenario is before


def test_a_way_point_is_chosen_in_the_list_as_well(tab: FakeTab, place):
    give(tab, "point", "2")
    assert [dot["isChosen"] for dot in dots(tab)] == [True, False, False]
    give(tab, "point", "All")
    assert not any(dot["isChosen"] for dot in dots(tab))


def test_a_way_point_is_dragged_as_one_edit(tab: FakeTab, place):
    count = len(tab.session.entries)
    aside = by(place, 20.0, -1.6)
    on_dot(tab, 2, by(place, 21.0, 0.0), aside, isFree=True)
    assert len(tab.session.entries) == count + 1
    assert path_of(tab).points_m[2] == pytest.approx(tuple(aside), abs=0.01)
    before = tab.session.scenario
    on_dot(tab, 2, by(place, 0.0, 500.0))
    assert tab.session.scenario is before
    on_dot(tab, 2, by(place, 25.0, 0.0), drop=False)
    assert tab.session.scenario is before


def test_a_way_point_is_added_between_two_and_keeps_what_others_ask(
    tab: FakeTab, place
):
    on_dot(tab, 2)
    give(tab, "speeds_mps", 4.0)
    on_dot(tab, 1, isOffer=True)
    term = path_of(tab)
    assert len(term.points_m) == 5
    assert term.points_m[2][0] == pytest.approx(place[0] + 15.0, abs=0.5)
    assert term.speeds_mps == (None, None, None, 4.0, None)
    # It is chosen, and so is what the next press of a key removes.
    assert next(one for one in dots(tab) if one["isChosen"])["node"] == 2
    tab.run(tab.elements.delete)
    assert len(path_of(tab).points_m) == 4
    assert path_of(tab).speeds_mps == (None, None, 4.0, None)


def test_delete_removes_the_agent_once_no_way_point_is_chosen(tab: FakeTab, place):
    agent_id, _ = focal(tab)
    on_dot(tab, 2)
    tab.run(tab.elements.escape)
    assert tab.session.selection == (agent_id,)
    with pytest.raises(EditError, match=f"{agent_id} is the focal agent"):
        tab.run(tab.elements.delete)


def test_a_missed_time_is_drawn_from_where_the_agent_should_be(tab: FakeTab, place):
    on_dot(tab, 3)
    give(tab, "times_s", 2.0)
    scenario = tab.session.scenario
    step = scenario.current_step + 20
    there = scenario.agents.position_m[scenario.agents.row_of[scenario.focal_id], step]
    assert dots(tab)[-1]["achieved"] == pytest.approx(there.tolist(), abs=0.01)
