"""What could happen to an agent, against the checks of single terms."""

from dataclasses import replace
from itertools import product
from typing import get_args

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.possible_encounters import (
    SEVERITIES,
    endangered_id,
    possible_encounters,
)
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.analysis.threats.encounter import Approach
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.road_map import DrivableArea
from pd_editor.scene.scenario import Scenario
from tests.builders import (
    LANE_WIDTH_M,
    scenario_with,
    straight_drivers,
    straight_lane,
    two_lane_road,
)


def busy() -> Scenario:
    """Around agent 100: behind, ahead, aside, parked, crossing, and far away."""
    road = two_lane_road()
    corners = [[28.0, -60, 0], [32, -60, 0], [32, 60, 0], [28, 60, 0]]
    road = replace(
        road,
        lanes=(*road.lanes, straight_lane(9, (30, 60), (30, -60))),
        drivable_areas=(
            *road.drivable_areas,
            DrivableArea(area_id=2, boundary=np.array(corners)),
        ),
    )
    width = LANE_WIDTH_M
    states = [
        (0, 0, 0, 10),
        (-15, 0, 0, 11),
        (20, 0, 0, 10),
        (3, width, 0, 11),
        (35, width, 0, 0),
        (30, 30, -np.pi / 2, 9),
        (-900, 0, 0, 10),
    ]
    return scenario_with(straight_drivers(states), road)


def is_feasible(scenario: Scenario, term: Threaten | YieldTo) -> bool:
    return not guidance_problems(scenario, (term,), (term.agent_id,))


def test_the_list_is_what_the_checks_of_single_terms_allow() -> None:
    scenario = busy()
    found = possible_encounters(scenario, "100")
    terms = [one.term for one in found]
    assert len(set(terms)) == len(terms)
    assert all(is_feasible(scenario, term) for term in terms)
    listed = {(t.agent_id, t.approach) for t in terms if isinstance(t, Threaten)}
    for agent_id, approach in product(scenario.agents.ids[1:], get_args(Approach)):
        stands = agent_id == "104"
        if (stands and approach == "cut-in") or (
            not stands and approach == "pulls-out"
        ):
            continue
        allowed = [
            severity
            for severity in SEVERITIES
            if is_feasible(
                scenario,
                Threaten(
                    agent_id=agent_id,
                    other_id="100",
                    approach=approach,
                    severity=severity,
                ),
            )
        ]
        assert ((agent_id, approach) in listed) == bool(allowed), (agent_id, approach)
        for term in terms:
            if isinstance(term, Threaten) and (term.agent_id, term.approach) == (
                agent_id,
                approach,
            ):
                assert term.severity == max(allowed)
    wanted = {("101", "rear"), ("102", "brakes"), ("104", "pulls-out"), ("105", "side")}
    assert wanted <= listed
    assert YieldTo(agent_id="105", other_id="100") in terms
    assert not any("106" in term.named_ids for term in terms)


def test_words_tell_when_and_how_near() -> None:
    for one in possible_encounters(busy(), "100"):
        assert f"at about {one.at_s:.0f} s" in one.in_words
        if isinstance(one.term, YieldTo):
            assert one.gap_m is None
            continue
        assert one.gap_m is not None
        assert one.gap_m == pytest.approx(3 * (1 - one.term.severity), abs=0.51)
        assert ("contact" in one.in_words) == (one.gap_m == 0)
        assert 2 <= len(one.way_m) == round(one.at_s / 0.1) + 1


def test_agents_with_locked_trajectories_only_have_to_be_yielded_to() -> None:
    locked = replace(busy(), locks={"105": TRAJECTORY_LOCK})
    found = [one.term for one in possible_encounters(locked, "100")]
    assert all(term.agent_id != "105" for term in found)
    assert YieldTo(agent_id="100", other_id="105") in found


def test_a_search_is_stopped() -> None:
    assert possible_encounters(busy(), "100", lambda: True) == ()


def test_the_selected_agent_is_endangered_else_the_ego_or_the_focal_agent() -> None:
    scenario = busy()
    assert endangered_id(scenario, ("103",)) == "103"
    assert endangered_id(scenario) == scenario.focal_id
    assert endangered_id(scenario, ("103", "104")) == scenario.focal_id
