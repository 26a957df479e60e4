"""Threats in sampled traffic, also by a network that knows nothing (random weights)."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.analysis.threats.encounter import (
    Approach,
    Track,
    encounter,
    exertion,
    limits_of,
)
from pd_editor.analysis.threats.threat_feasibility import (
    encounter_in_words,
    meets,
    recorded_track,
)
from pd_editor.analysis.threats.threat_plans import ThreatAim
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from tests.builders import LANE_WIDTH_M, scenario_with, straight_drivers
from tests.generation.generated_traffic import SINGLE, generated, same

STATES: dict[Approach, list[tuple[float, float, float, float]]] = {
    "rear": [(0, 0, 0, 10), (-15, 0, 0, 11), (60, LANE_WIDTH_M, 0, 8)],
    "cut-in": [(0, 0, 0, 10), (6, LANE_WIDTH_M, 0, 11), (-30, 0, 0, 8)],
    "head-on": [(0, 0, 0, 6), (60, LANE_WIDTH_M, np.pi, 8), (-30, 0, 0, 8)],
    "brakes": [(0, 0, 0, 12), (22, 0, 0, 12), (-30, 0, 0, 8)],
    "pulls-out": [(0, 0, 0, 8), (25, LANE_WIDTH_M, 0, 0), (-30, 0, 0, 8)],
}


def track(sample: TrafficSample, row: int) -> Track:
    return Track(
        position_m=sample.position_m[row],
        heading_rad=sample.heading_rad[row],
        velocity_mps=sample.velocity_mps[row],
        size_m=sample.size_m[row],
    )


def sampled(
    diffuser: PathDiffuser,
    scenario: Scenario,
    *terms: GuidanceTerm,
    ids: tuple[str, ...] | None = None,
    settings: tuple[GuidanceTerm, ...] = (SINGLE,),  # type: ignore[assignment]
) -> TrafficSample:
    found = generated(
        diffuser,
        scenario,
        scenario.agents.ids if ids is None else ids,
        guidance=(*settings, *terms),
        seed=4,
        reports_cost=False,
    )
    return found.samples[0]


@pytest.mark.parametrize("severity", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("approach", list(STATES))
def test_kept_agent_is_threatened_as_asked_within_limits(
    diffuser: PathDiffuser, approach: Approach, severity: float
) -> None:
    scenario = scenario_with(straight_drivers(STATES[approach]))
    term = Threaten(
        agent_id="101", other_id="100", severity=severity, approach=approach
    )
    sample = sampled(diffuser, scenario, term, ids=("101", "102"))
    attacker, other = track(sample, 0), recorded_track(scenario, 0)
    aim = ThreatAim.of(approach, severity)
    found = encounter(attacker, other, 0.1, approach)
    assert meets(aim, found)
    now = scenario.current_step
    until = np.array([round(found.at_s / 0.1)]) if found.is_contact else None
    used = exertion(
        attacker.position_m[None],
        scenario.agents.velocity_mps[1, now],
        float(scenario.agents.heading_rad[1, now]),
        limits_of(scenario.agents.kinds[1]),
        0.1,
        until=until,
    )
    assert used.is_possible.all()
    assert meets(aim, found)
    assert abs(found.counted_gap_m - aim.gap_m) <= 0.5
    words = encounter_in_words(found, approach)
    assert ("contact" if severity == 1 else "gap") in words
    assert "relative speed" in words


@pytest.mark.parametrize("settings", [(SINGLE,), ()])
def test_threatened_agent_that_is_sampled_stays_bit_identical(
    diffuser: PathDiffuser, settings: tuple[GuidanceTerm, ...]
) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    plain = sampled(diffuser, scenario)
    threatened = sampled(diffuser, scenario, term, settings=settings)
    for name in ("position_m", "heading_rad", "velocity_mps"):
        assert np.array_equal(getattr(plain, name)[0], getattr(threatened, name)[0])
    assert not np.array_equal(plain.position_m[1], threatened.position_m[1])


def test_infeasible_threats_change_nothing(diffuser: PathDiffuser) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-80, 0, np.pi, 10)]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    assert same(sampled(diffuser, scenario, term), sampled(diffuser, scenario))


def test_a_threat_to_an_agent_that_is_gone_is_told_and_not_run(
    diffuser: PathDiffuser,
) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    term = Threaten(agent_id="101", other_id="gone")
    found = generated(diffuser, scenario, ("101", "102"), guidance=(term,), seed=4)
    (outcome,) = found.guidance[0].outcomes
    assert not outcome.is_run
    assert "agent gone is gone" in outcome.achieved


@pytest.mark.parametrize("approach", list(STATES))
def test_an_agent_whose_recording_ends_is_threatened_where_it_drives_on(
    diffuser: PathDiffuser, approach: Approach
) -> None:
    """Such threats were told to be feasible, and then dropped without a word."""
    scenario = scenario_with(straight_drivers(STATES[approach]))
    is_valid = scenario.agents.is_valid.copy()
    is_valid[0, scenario.current_step + 3 :] = False
    short = replace(scenario, agents=replace(scenario.agents, is_valid=is_valid))
    term = Threaten(agent_id="101", other_id="100", approach=approach)
    assert not guidance_problems(short, (term,), ("101", "102"))
    found = generated(diffuser, short, ("101", "102"), guidance=(SINGLE, term), seed=4)
    (outcome,) = found.guidance[0].outcomes
    assert outcome.is_run
    assert outcome.is_feasible
    assert outcome.is_obeyed
    # It would have kept its velocity.
    whole = encounter(track(found.samples[0], 0), recorded_track(scenario, 0), 0.1)
    assert whole.is_contact


def test_threats_that_are_off_change_nothing(diffuser: PathDiffuser) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    plain = sampled(diffuser, scenario)
    assert same(sampled(diffuser, scenario, replace(term, is_on=False)), plain)
    assert same(sampled(diffuser, scenario, replace(term, weight=0.0)), plain)


def test_agents_that_threaten_each_other_are_left_alone(diffuser: PathDiffuser) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    one = Threaten(agent_id="101", other_id="100")
    two = Threaten(agent_id="100", other_id="101")
    assert same(sampled(diffuser, scenario, one, two), sampled(diffuser, scenario))


def test_threats_and_other_terms_are_in_force_together(diffuser: PathDiffuser) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    threat = Threaten(agent_id="101", other_id="100", approach="rear")
    goal = GoalPoint(agent_id="102", point_m=(110.0, LANE_WIDTH_M))
    mine = GoalPoint(agent_id="100", point_m=(50.0, 0.0))
    sample = sampled(diffuser, scenario, threat, goal, mine)
    assert np.linalg.norm(sample.position_m[2, -1] - goal.point_m) < 0.5
    assert np.linalg.norm(sample.position_m[0, -1] - mine.point_m) < 0.5
    assert encounter(track(sample, 1), track(sample, 0), 0.1).is_contact


def test_several_samples_each_threaten_their_own_trajectory(
    diffuser: PathDiffuser,
) -> None:
    scenario = scenario_with(straight_drivers(STATES["rear"]))
    term = Threaten(agent_id="101", other_id="100", approach="rear")
    found = generated(
        diffuser,
        scenario,
        scenario.agents.ids,
        guidance=(SINGLE, term),
        num_samples=3,
        seed=4,
        reports_cost=False,
    )
    paths = [sample.position_m[0] for sample in found.samples]
    assert not np.array_equal(paths[0], paths[1])
    contacts = [
        encounter(track(one, 1), track(one, 0), 0.1).is_contact for one in found.samples
    ]
    assert sum(contacts) >= 2
