"""Way-points of a path: values, what is told before a run, and what was achieved."""

import re
from typing import Any

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.base.errors import EditError
from pd_editor.editor.commands.json_values import from_json, to_json
from pd_editor.scene.guidance_terms import GuidanceTerm, terms_without
from tests.builders import scenario_with, straight_drivers

LINE = ((0.0, 0.0), (20.0, 0.0), (40.0, 0.0))
PATH = FollowPath(agent_id="100", points_m=LINE)


def asked(**values: Any) -> FollowPath:
    return FollowPath(agent_id="100", points_m=LINE, **values)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"speeds_mps": (1.0,)}, "3 points has 1 values of speed"),
        ({"speeds_mps": (None, -1.0, None)}, "speed at a way-point"),
        ({"times_s": (None, 0.0, None)}, "time at a way-point"),
        ({"times_s": (None, 3.0, 2.0)}, "must increase"),
        ({"waits_for": (None, "100", None)}, "cannot wait for itself"),
        ({"waits_for": (None, "", None)}, "id of an agent"),
    ],
)
def test_values_that_cannot_be_are_refused_in_one_sentence(values: dict, said: str):
    with pytest.raises(EditError, match=said):
        asked(**values)


def test_paths_without_asks_are_written_as_before():
    """Recipes of paths that ask for nothing replay as they were."""
    path = asked(speeds_mps=(None, 5.0, None), waits_for=(None, None, "101"))
    assert from_json(GuidanceTerm, to_json(path), "here") == path
    former = {"kind": "follow-path", "agent_id": "100", "points_m": [[0, 0], [9, 0]]}
    term = from_json(GuidanceTerm, former, "here")
    assert isinstance(term, FollowPath)
    assert not term.has_asks


def test_points_keep_what_is_asked_of_them():
    path = asked(speeds_mps=(None, 5.0, None), times_s=(None, None, 4.0))
    first, second, last = path.way_points()
    assert (second.asks, last.asks) == ("5 m/s", "at 4 s")
    less = path.with_way_points([first, last])
    assert less.points_m == (LINE[0], LINE[2])
    assert less.speeds_mps == ()
    assert less.times_s == (None, 4.0)


def test_a_wait_goes_with_the_agent_it_is_for():
    path = asked(waits_for=(None, "101", None), speeds_mps=(None, None, 3.0))
    assert path.guided_ids == ("100",)
    assert path.named_ids == ("100", "101")
    (left,) = terms_without((path,), ("101",))
    assert left == asked(speeds_mps=(None, None, 3.0))
    assert terms_without((path,), ("100",)) == ()


# Another driver crosses the road of the first one 20 m ahead of it, after some 3 s.
CROSSING = scenario_with(
    straight_drivers([(0, 0, 0, 8), (24, -27, np.pi / 2, 8), (38, 0, np.pi, 0)])
)


@pytest.mark.parametrize(
    "term",
    [
        asked(speeds_mps=(None, 5.0, 9.0)),
        asked(times_s=(None, 2.5, 5.0)),
        asked(waits_for=(None, "101", None)),
    ],
    ids=["speeds", "times", "wait"],
)
def test_what_can_be_met_has_no_problem(term: FollowPath):
    assert guidance_problems(CROSSING, (term,), ("100",)) == ()


@pytest.mark.parametrize(("place", "is_told"), [(1, True), (2, False)])
def test_agents_that_wait_for_each_other_are_told_if_neither_could_go(
    place: int, *, is_told: bool
):
    """One that waits only behind the place that it has to leave first lets both go."""
    one = FollowPath(
        agent_id="100",
        points_m=((0.0, 0.0), (14.0, 0.0), (40.0, 0.0)),
        waits_for=(None, "101", None),
    )
    other = FollowPath(
        agent_id="101",
        points_m=((24.0, -27.0), (24.0, -8.0), (24.0, 20.0)),
        waits_for=tuple("100" if at == place else None for at in range(3)),
    )
    problems = guidance_problems(CROSSING, (one, other), ("100", "101"))
    told = [problem for problem in problems if "wait for each other" in problem.message]
    assert bool(told) == is_told


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (asked(speeds_mps=(None, 30.0, None)), "way-point 2 .*has 12.* m/s there"),
        (asked(times_s=(None, 0.5, None)), "way-point 2 .*m short of it at best"),
        (asked(times_s=(None, None, 50.0)), "trajectories last"),
        (asked(waits_for=(None, "102", None)), "102 does not pass way-point 2"),
        (asked(speeds_mps=(3.0, None, None)), "way-point 1 .* is behind it"),
        (
            FollowPath(
                agent_id="100",
                points_m=((0.0, 0.0), (3.0, 0.0), (40.0, 0.0)),
                waits_for=(None, "101", None),
            ),
            "way-point 2 .*asks for 0.0 m/s, and it has 5.* m/s there at best",
        ),
    ],
    ids=["speed", "early", "late", "wait", "behind", "stop"],
)
def test_what_cannot_be_met_is_a_warning(term: FollowPath, said: str):
    (problem,) = guidance_problems(CROSSING, (term,), ("100",))
    assert problem.severity == "warning"
    assert re.search(said, problem.message, re.IGNORECASE), problem.message


def test_an_agent_that_is_gone_cannot_be_waited_for():
    term = asked(waits_for=(None, "999", None))
    assert any(
        one.severity == "error" and "999" in one.message
        for one in guidance_problems(CROSSING, (term,), ("100",))
    )


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        (GoalPoint(agent_id="100", point_m=(30.0, 0.0), at_s=2.0), ""),
        (GoalPoint(agent_id="100", point_m=(20.0, 0.5), at_s=3.0), ""),
        (GoalPoint(agent_id="101", point_m=(10.0, 0.0), at_s=4.0), ""),
        (
            GoalPoint(agent_id="100", point_m=(10.0, 0.0), at_s=4.0),
            "before way-point 2",
        ),
        (GoalPoint(agent_id="100", point_m=(10.0, 0.0)), "at the end that lies before"),
        (GoalPoint(agent_id="100", point_m=(30.0, 0.0), at_s=2.5), ""),
        (
            GoalPoint(agent_id="100", point_m=(38.0, 0.0), at_s=1.0),
            "beyond way-point 2",
        ),
        (
            GoalPoint(agent_id="100", point_m=(20.0, 9.0), at_s=3.0),
            "9 m beside the path",
        ),
        (GoalPoint(agent_id="100", point_m=(70.0, 0.0), at_s=5.5), ""),
    ],
)
def test_a_goal_that_a_path_does_not_leave_room_for_is_told(goal: GoalPoint, said: str):
    path = asked(times_s=(None, 1.9, None))
    scene = scenario_with(straight_drivers([(0, 0, 0, 10), (0, 3.5, 0, 10)]))
    for terms in ((path, goal), (goal, path)):
        problems = guidance_problems(scene, terms)
        told = [one.message for one in problems if "has a goal point" in one.message]
        assert [said in one for one in told] == [True] * bool(said)
