"""Each term of a run has one line in its report, whatever becomes of its agents."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from shapely import Polygon

from pd_editor.analysis.guidance.guidance_kind import Driven
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowLane
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions, KeepGap
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, StopAtLine
from pd_editor.analysis.guidance.report import guidance_problems, term_outcomes
from pd_editor.analysis.threats.encounter import Approach, Track
from pd_editor.analysis.threats.threat_feasibility import expected_tracks
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.scenario import Scenario
from tests.builders import LANE_WIDTH_M, scenario_with, straight_drivers

IDS = tuple(str(100 + row) for row in range(6))


def scene(random: np.random.Generator) -> Scenario:
    """Six agents, some of which end early, come late, have gaps, stand or are locked."""
    kinds = (*[AgentKind.VEHICLE] * 4, AgentKind.PEDESTRIAN, AgentKind.STATIC)
    states = [
        (
            random.uniform(-60, 60),
            random.choice([0.0, LANE_WIDTH_M]),
            random.choice([0.0, np.pi]),
            random.choice([0.0, 1.2, 9.0]),
        )
        for _ in IDS
    ]
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    agents, now = scenario.agents, scenario.current_step
    is_valid = agents.is_valid.copy()
    for row in range(len(IDS)):
        steps = {
            "ends": slice(now + int(random.integers(1, 60)), None),
            "late": slice(0, now + int(random.integers(1, 60))),
            "gap": slice(now + 10, now + 30),
            "whole": slice(0, 0),
        }[random.choice(["ends", "late", "gap", "whole", "ends"])]
        is_valid[row, steps] = False
    locked = [name for name in IDS if random.random() < 0.2]
    return replace(
        scenario,
        agents=replace(agents, is_valid=is_valid),
        locks=dict.fromkeys(locked, TRAJECTORY_LOCK),
    )


def term(random: np.random.Generator) -> GuidanceTerm:
    """A term of any agents; one of them is in no scene."""
    one, other = random.choice([*IDS, "gone"], size=2, replace=False).tolist()
    approach: Approach = random.choice(get_args(Approach)).item()
    made = (
        Threaten(
            agent_id=one,
            other_id=other,
            approach=approach,
            severity=float(random.choice([0.0, 0.5, 1.0])),
        ),
        YieldTo(agent_id=one, other_id=other),
        GoalPoint(agent_id=one, point_m=(30.0, 0.0)),
        StopAtLine(agent_id=one, line_m=((30.0, -2.0), (30.0, 2.0))),
        FollowLane(agent_id=one, lane_ids=(1, 99)),
        SpeedLimit(agent_ids=(one, other), speed_mps=5.0),
        KeepGap(gap_m=8.0),
        AvoidCollisions(agent_ids=(one,)),
    )
    return made[int(random.choice(len(made), p=[0.4, 0.25, *[0.35 / 6] * 6]))]


def sample_of(scenario: Scenario, random: np.random.Generator) -> TrafficSample:
    """What a generator could give: some of the agents that are there, moved a little."""
    agents, now = scenario.agents, scenario.current_step
    wanted = random.random(len(IDS)) < 0.6
    rows = np.flatnonzero(
        wanted & agents.is_valid[:, now] & ~agents.kind_mask({AgentKind.STATIC})
    )
    rows = np.array([r for r in rows if IDS[r] not in scenario.locks], int)
    return TrafficSample(
        ids=tuple(IDS[row] for row in rows),
        kinds=tuple(agents.kinds[row] for row in rows),
        size_m=agents.size_m[rows],
        position_m=agents.position_m[rows, now:] + 0.0,
        heading_rad=agents.heading_rad[rows, now:] + 0.0,
        velocity_mps=agents.velocity_mps[rows, now:] + 0.0,
    )


@pytest.mark.parametrize("seed", range(60))
def test_each_term_has_one_outcome_in_order(seed: int) -> None:
    random = np.random.default_rng(seed)
    scenario = scene(random)
    terms = tuple(term(random) for _ in range(6))
    sample = sample_of(scenario, random)
    outcomes = term_outcomes(scenario, sample, terms)
    assert tuple(one.term for one in outcomes) == terms
    there = scenario.agents.is_valid[:, scenario.current_step]
    present = {name for name, is_there in zip(IDS, there, strict=True) if is_there}
    for one in outcomes:
        assert one.asked
        assert one.achieved
        if one.term.guided_ids and not set(one.term.guided_ids) & set(sample.ids):
            assert not one.is_run
        if not one.is_run:
            assert not one.is_obeyed
        if isinstance(one.term, Threaten | YieldTo):
            both = one.term.agent_id in sample.ids and one.term.other_id in present
            assert one.is_run == both
        if isinstance(one.term, Threaten) and one.is_run:
            assert one.is_obeyed <= met(one.term, scenario, sample)
    # What is not run was told before, unless it is of all agents and there are none.
    told = {problem.term for problem in guidance_problems(scenario, terms, sample.ids)}
    assert all(
        one.is_run or one.term in told or not one.term.guided_ids for one in outcomes
    )


@pytest.mark.parametrize("seed", range(30))
def test_before_and_after_a_run_the_other_agent_is_assumed_to_move_alike(
    seed: int,
) -> None:
    random = np.random.default_rng(1000 + seed)
    scenario = scene(random)
    sample = sample_of(scenario, random)
    now = scenario.current_step
    for row in np.flatnonzero(scenario.agents.is_valid[:, now]).tolist():
        if IDS[row] in sample.ids:
            continue
        (before,) = expected_tracks(scenario, row, is_kept=True)
        after = Driven(scenario=scenario, sample=sample).track(IDS[row])
        assert after is not None
        assert np.array_equal(before.position_m, after.position_m)
        assert len(before.position_m) == scenario.time_axis.num_future_steps + 1
        # Agents of these scenes keep their velocity: so does what is assumed of them.
        speed = np.linalg.norm(np.diff(before.position_m, axis=0), axis=-1) / 0.1
        first = np.linalg.norm(scenario.agents.velocity_mps[row, now])
        assert speed == pytest.approx(first, abs=0.3)


def met(one: Threaten, scenario: Scenario, sample: TrafficSample) -> bool:
    """By boxes of shapely, without our own encounter."""
    driven = Driven(scenario=scenario, sample=sample)
    tracks = [driven.track(name) for name in one.named_ids]
    boxes = [polygons(track) for track in tracks if track is not None]
    least = min(a.distance(b) for a, b in zip(boxes[0][1:], boxes[1][1:], strict=True))
    if one.severity == 1:
        return least == 0
    # In its path the gap may be larger than the least one.
    return least <= 3.0 * (1 - one.severity) + 0.51


def polygons(track: Track) -> list[Polygon]:
    return [Polygon(corners) for corners in track.at().corners_m()]
