import numpy as np
import pytest

from pd_editor.base.errors import InputError
from pd_editor.experiments.evaluation.evaluation_task import (
    ALL_CONDITIONS,
    road_conditions,
)
from tests.builders import two_agents_that_pass


def test_all_is_plain_and_nine_bends():
    assert road_conditions(["all"]) == ALL_CONDITIONS
    assert len(ALL_CONDITIONS) == 10
    labels = [one.label for one in ALL_CONDITIONS]
    assert road_conditions(labels) == ALL_CONDITIONS
    assert labels[:2] == ["none", "smooth-turn:3"]


def test_each_road_once():
    found = road_conditions(["none", "ripple-road:6.0", "ripple-road:6", "none"])
    assert [one.label for one in found] == ["none", "ripple-road:6"]


@pytest.mark.parametrize(
    "text", ["", "bend:3", "none:3", "smooth-turn", "smooth-turn:x", "smooth-turn:0",
             "ripple-road:11", "ripple-road:nan", "ripple-road:inf",
             "smooth-turn:3+smooth-turn:2", "smooth-turn:3+", "smooth-turn:3@", "none@ego",
             "smooth-turn:3@nowhere", "+smooth-turn:3"]
)  # fmt: skip
def test_other_words_are_refused(text):
    with pytest.raises(InputError, match="smooth-turn"):
        road_conditions([text])


def test_sums_and_anchors_are_read_back_from_their_labels():
    label = "smooth-turn:3+ripple-road:-2.5@ego"
    (found,) = road_conditions([label])
    assert found.terms == (("smooth-turn", 3.0), ("ripple-road", -2.5))
    assert (found.anchor, found.label, found.kind, found.power) == (
        "ego",
        label,
        label,
        3.0,
    )


def test_a_sum_is_the_sum_of_its_warps():
    scenario = two_agents_that_pass()
    points = np.stack([np.linspace(-20, 80, 50), np.zeros(50)], axis=-1)
    both, *each = (
        one.warp_of(scenario).apply(points) - points
        for one in road_conditions(
            ["smooth-turn:3+ripple-road:-2", "smooth-turn:3", "ripple-road:-2"]
        )
    )
    assert np.allclose(both, each[0] + each[1])


def test_no_road_is_refused():
    with pytest.raises(InputError):
        road_conditions([])


def test_a_plain_road_is_the_scenario_itself():
    scenario = two_agents_that_pass()
    assert road_conditions(["none"])[0].applied_to(scenario) is scenario
    bent = road_conditions(["smooth-turn:3"])[0].applied_to(scenario)
    assert bent.applied_warp is not None
    assert bent.applied_warp.friction_coefficient == 0.7


def test_the_nearest_kind_is_told():
    with pytest.raises(
        InputError, match="'smoth-turn:3' is not known; the nearest is smoo"
    ):
        road_conditions(["smoth-turn:3"])
    with pytest.raises(
        InputError, match="'xyz:3' is not known; expected none, all, KIND"
    ):
        road_conditions(["xyz:3"])
