"""Values of guidance terms: bounds, motions of the plane, removal of agents."""

import math
from dataclasses import fields

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import KeepGap
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.base.errors import EditError
from pd_editor.scene.guidance_terms import GuidanceTerm, terms_without

GOAL = GoalPoint(agent_id="7", point_m=(3.0, 4.0))
PATH = FollowPath(agent_id="7", points_m=((0.0, 0.0), (5.0, 0.0)))
LINE = StopAtLine(agent_id="7", line_m=((0.0, -2.0), (0.0, 2.0)))


def test_each_kind_has_a_name_of_its_own():
    assert all(name == kind.value.kind for name, kind in KINDS.items())


def test_points_of_terms_move_with_the_road():
    for kind in KINDS.values():
        names = {one.name for one in fields(kind.value)}
        if names & {"point_m", "points_m", "line_m"}:
            assert kind.value.moved is not GuidanceTerm.moved, kind.value


def test_names_are_nouns_that_sentences_can_hold():
    """Messages told of "its yield to" and of "the gap of a keep gap"."""
    assert YieldTo(agent_id="7", other_id="8").name == "yielding"
    assert PATH.in_words == "path of agent 7"
    with pytest.raises(EditError, match="The distance of a gap is 0; expected"):
        KeepGap(gap_m=0.0)
    verbs = {"follow", "stop", "keep", "avoid", "threaten"}
    for kind in KINDS.values():
        words = (kind.value.noun or kind.value.kind.replace("-", " ")).split()
        assert verbs.isdisjoint(words) or words == ["stop", "line"]
        assert words[-1] != "to"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: GoalPoint(agent_id="7", point_m=(math.nan, 0.0)), "goal point"),
        (lambda: GoalPoint(agent_id="7", point_m=(9e3, 0.0)), "5000 m"),
        (lambda: GoalPoint(agent_id="7", point_m=(0.0, 0.0), at_s=0.0), "time"),
        (lambda: GoalPoint(agent_id="", point_m=(0.0, 0.0)), "id of an agent"),
        (lambda: GoalPoint(agent_id="7", point_m=(0.0, 0.0), weight=-1), "weight"),
        (lambda: FollowPath(agent_id="7", points_m=((0.0, 0.0),)), "2 to"),
        (lambda: FollowPath(agent_id="7", points_m=((0.0, 0.0),) * 2), "1 m"),
        (lambda: FollowLane(agent_id="7", lane_ids=()), "0 lanes"),
        (lambda: StopAtLine(agent_id="7", line_m=((0.0, 0.0),) * 2), "stop line"),
        (lambda: TargetSpeed(speed_mps=-1.0), "target speed"),
        (lambda: SpeedLimit(speed_mps=0.0), "speed limit"),
        (lambda: ComfortLimits(max_braking_mps2=0.0), "braking"),
        (lambda: KeepGap(gap_m=0.0), "gap"),
        (lambda: TargetSpeed(agent_ids=("7", "7"), speed_mps=1.0), "twice"),
        (lambda: YieldTo(agent_id="7", other_id="7"), "two agents"),
        (lambda: Threaten(agent_id="7", other_id="8", severity=2.0), "severity"),
    ],
)
def test_impossible_values_are_refused_in_one_sentence(make, said):
    with pytest.raises(EditError, match=said):
        make()


def test_points_move_with_the_plane_and_other_terms_stay():
    speed = TargetSpeed(speed_mps=3.0)

    def shift(points: np.ndarray) -> np.ndarray:
        return points + np.array([1.0, 2.0])

    goal, path, line, same = (one.moved(shift) for one in (GOAL, PATH, LINE, speed))
    assert goal == GoalPoint(agent_id="7", point_m=(4.0, 6.0))
    assert path == FollowPath(agent_id="7", points_m=((1.0, 2.0), (6.0, 2.0)))
    assert line == StopAtLine(agent_id="7", line_m=((1.0, 0.0), (1.0, 4.0)))
    assert same is speed


def test_removed_agents_leave_their_terms():
    both = TargetSpeed(agent_ids=("7", "8"), speed_mps=3.0)
    everyone = SpeedLimit(speed_mps=9.0)
    other = YieldTo(agent_id="9", other_id="7")
    left = terms_without((GOAL, both, everyone, other), ("7",))
    assert left == (TargetSpeed(agent_ids=("8",), speed_mps=3.0), everyone)
