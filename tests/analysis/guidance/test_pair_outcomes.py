"""Outcomes of terms on pairs of agents, and their problems before a run."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch

from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions, KeepGap, gaps_ahead
from pd_editor.analysis.guidance.kinds.speed import StopAtLine
from pd_editor.analysis.guidance.report import (
    AgentRealism,
    guidance_problems,
    guidance_reports,
    infeasible_terms,
    term_outcomes,
)
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.generation.trajectory.guidance.interaction_terms import (
    gaps_ahead as gaps_ahead_of_prediction,
)
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario
from tests.builders import LANE_WIDTH_M, scenario_with, straight_drivers

State = tuple[float, float, float, float]


def recorded(scenario: Scenario) -> TrafficSample:
    """The recorded trajectories from the current step on, as a sample."""
    agents, now = scenario.agents, scenario.current_step
    return TrafficSample(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        position_m=agents.position_m[:, now:],
        heading_rad=agents.heading_rad[:, now:],
        velocity_mps=agents.velocity_mps[:, now:],
    )


CROSSES = [(0.0, 0.0, 0.0, 8.0), (24.0, -45.0, np.pi / 2, 8.0)]
"""The first one is at the crossing after 3 s, the second one after 5.6 s."""


@pytest.mark.parametrize(
    ("states", "term", "achieved", "error", "is_obeyed"),
    [
        ([(0, 0, 0, 10), (14.6, 0, 0, 10)], KeepGap(gap_m=8.0), "10.0 m", 0, True),
        ([(0, 0, 0, 10), (12.6, 0, 0, 9)], KeepGap(gap_m=8.0), "2.0 m", 6.0, False),
        ([(0, 0, 0, 10)], KeepGap(gap_m=8.0), "no agent ahead", 0, True),
        # Agents cannot reverse, and agents beside are not ahead.
        (
            [(0, 0, 0, 0), (6.6, 0, 0, 0)],
            KeepGap(gap_m=8.0),
            "2.0 m, and could not leave more",
            0,
            True,
        ),
        # A gap that is too short now opens.
        (
            [(0, 0, 0, 8), (10.6, 0, 0, 10)],
            KeepGap(gap_m=10.0),
            "6.2 m, opening from 6.0 m",
            0,
            True,
        ),
        ([(0, 0, 0, 9), (2.6, 2.1, 0.3, 9)], KeepGap(gap_m=8.0), "no agent", 0, True),
        (
            [(0, 0, 0, 10), (9, 0, 0, 5)],
            AvoidCollisions(),
            "2 agents collide",
            2,
            False,
        ),
        (
            [(0, 0, 0, 10), (30, 0, 0, 10)],
            AvoidCollisions(),
            "no collision after t = 0",
            0,
            True,
        ),
        (CROSSES, YieldTo(agent_id="101", other_id="100"), "s after it", 0, True),
        (CROSSES, YieldTo(agent_id="100", other_id="101"), "s before it", 3.4, False),
        (
            [(0, 0, 0, 10), (0, 20, 0, 10)],
            YieldTo(agent_id="100", other_id="101"),
            "stays clear",
            0,
            True,
        ),
        (
            [(0, 0, 0, 10), (-12, 0, 0, 12)],
            Threaten(agent_id="101", other_id="100"),
            "contact at the rear after 3.",
            0,
            True,
        ),
        (
            [(0, 0, 0, 10), (-6.1, 0, 0, 10)],
            Threaten(agent_id="101", other_id="100", severity=0.5),
            "gap 1.5 m at the rear",
            0,
            True,
        ),
        (
            [(0, 0, 0, 10), (-12, 0, 0, 12), (14, 1.0, 0, 0)],
            Threaten(agent_id="101", other_id="100"),
            ", but hits 102 after 1.8 s",
            0,
            False,
        ),
        (
            [(0, 0, 0, 10), (-20, 0, 0, 10)],
            Threaten(agent_id="101", other_id="100"),
            "gap 15.4 m",
            15.4,
            False,
        ),
    ],
)
def test_outcomes_say_what_was_achieved(
    states: Sequence[State],
    term: GuidanceTerm,
    achieved: str,
    error: float,
    is_obeyed: bool,
) -> None:
    scenario = scenario_with(straight_drivers(list(states)))
    (outcome,) = term_outcomes(scenario, recorded(scenario), [term])
    assert achieved in outcome.achieved
    assert outcome.error == pytest.approx(error, abs=0.11)
    assert outcome.is_obeyed == is_obeyed


def without_last(sample: TrafficSample) -> TrafficSample:
    return replace(
        sample,
        ids=sample.ids[:-1],
        kinds=sample.kinds[:-1],
        size_m=sample.size_m[:-1],
        position_m=sample.position_m[:-1],
        heading_rad=sample.heading_rad[:-1],
        velocity_mps=sample.velocity_mps[:-1],
    )


def test_kept_agents_count_as_recorded() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-12, 0, 0, 12)]))
    sample = recorded(scenario)
    attacker = replace(
        sample,
        ids=sample.ids[1:],
        kinds=sample.kinds[1:],
        size_m=sample.size_m[1:],
        position_m=sample.position_m[1:],
        heading_rad=sample.heading_rad[1:],
        velocity_mps=sample.velocity_mps[1:],
    )
    term = Threaten(agent_id="101", other_id="100")
    (outcome,) = term_outcomes(scenario, attacker, [term])
    assert outcome.is_obeyed


def test_collisions_that_were_asked_for_do_not_count() -> None:
    scenario = scenario_with(
        straight_drivers([(0, 0, 0, 10), (-12, 0, 0, 12), (40, LANE_WIDTH_M, 0, 5)])
    )
    sample = recorded(scenario)
    assert AgentRealism.of(scenario, sample).over().num_collisions == 2
    asked_for = AgentRealism.of(scenario, sample, {frozenset({"100", "101"})})
    assert asked_for.over().num_collisions == 0


def test_collisions_of_an_agent_that_threatens_count_but_for_the_one_asked_for() -> (
    None
):
    """It hit two cones on its way, and the report told of no collision and success."""
    states = [(0, 0, 0, 10), (-12, 0, 0, 12), (14, 1.0, 0, 0)]
    scenario = scenario_with(straight_drivers(states))
    kinds = (*scenario.agents.kinds[:2], AgentKind.CONSTRUCTION)
    scenario = scenario.with_agents(replace(scenario.agents, kinds=kinds))
    sample = without_last(recorded(scenario))
    term = Threaten(agent_id="101", other_id="100")
    (report,) = guidance_reports(scenario, [sample], [term], [sample])
    assert report.cost is not None
    assert report.cost.guided.num_collisions == 2
    assert ", but hits 102 after" in report.outcomes[0].achieved
    assert not report.outcomes[0].is_obeyed


def test_what_was_infeasible_is_not_obeyed_where_nothing_arose() -> None:
    """One card said that it cannot yield, and below that it did."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (0, 20, 0, 10)]))
    beside = StopAtLine(agent_id="100", line_m=((9.0, 30.0), (9.0, 34.0)))
    for term in (YieldTo(agent_id="100", other_id="101"), beside):
        for infeasible in ((), (term,)):
            (outcome,) = term_outcomes(scenario, recorded(scenario), [term], infeasible)
            assert outcome.is_obeyed == (not infeasible)


def test_gaps_are_those_of_the_guidance() -> None:
    random = np.random.default_rng(0)
    states = np.column_stack(
        [
            random.uniform(-30, 30, (12, 2)) * [1, 0.3],
            random.uniform(-0.6, 0.6, 12),
            random.uniform(0, 12, 12),
        ]
    )
    scenario = scenario_with(straight_drivers([tuple(one) for one in states]))
    sample = recorded(scenario)
    rows = np.arange(12)
    view = generated_traffic(scenario, sample)
    found, first = gaps_ahead(view.everyone, rows)

    def tensor(values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values.copy())

    motion = PredictedMotion(
        position_m=tensor(sample.position_m)[None],
        velocity_mps=tensor(sample.velocity_mps)[None],
        acceleration_mps2=tensor(0 * sample.velocity_mps)[None],
        heading_rad=tensor(sample.heading_rad)[None],
        size_m=tensor(sample.size_m),
        exists=torch.ones(12, 61, dtype=torch.bool),
        is_sampled=torch.ones(12, dtype=torch.bool),
        time_s=0.1 * torch.arange(61),
        level=0.0,
    )
    gap, now = gaps_ahead_of_prediction(motion, torch.from_numpy(rows))
    np.testing.assert_allclose(gap[0].numpy(), found, atol=1e-9)
    leads = np.isfinite(found)
    assert 0 < leads.sum() < leads.size
    np.testing.assert_allclose(now[0].numpy()[leads], first[leads], atol=1e-9)


def problems(states: Sequence[State], *terms: GuidanceTerm) -> list[str]:
    scenario = scenario_with(straight_drivers(list(states)))
    return [one.message for one in guidance_problems(scenario, terms)]


def test_threats_that_cannot_be_carried_out_are_told_with_the_approaches_that_can() -> (
    None
):
    states = [(0, 0, 0, 10), (-15, 0, 0, 11)]
    rear = Threaten(agent_id="101", other_id="100", approach="rear")
    assert problems(states, rear) == []
    (message,) = problems(states, replace(rear, approach="head-on"))
    assert "Agent 101 cannot come to contact with agent 100 (head-on)" in message
    assert message.endswith('choose the approach "from behind" (rear).')
    apart = [(0, 0, 0, 10), (-60, 0, np.pi, 10)]
    (message,) = problems(apart, replace(rear, severity=0.5))
    assert "a gap of 1.5 m" in message
    assert message.endswith("choose another agent.")
    ahead = [(0, 0, 0, 10), (15, 0, 0, 10)]
    (message,) = problems(ahead, replace(rear, approach="cut-in"))
    assert "it would have to come from beside the way of agent 100" in message
    (message,) = problems([(0, 0, 0, 10), (-150, 0, 0, 10)], rear)
    assert "would have to accelerate, brake or turn" in message
    assert "times as hard as it can" in message


def test_infeasible_threats_are_infeasible_in_the_outcome() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (-60, 0, np.pi, 10)]))
    term = Threaten(agent_id="101", other_id="100")
    found = guidance_problems(scenario, [term], ("101",))
    (outcome,) = term_outcomes(
        scenario, recorded(scenario), [term], infeasible_terms(found)
    )
    assert not outcome.is_feasible
    assert not outcome.is_obeyed


def test_yielding_needs_paths_that_meet_and_room_to_brake() -> None:
    yields = YieldTo(agent_id="100", other_id="101")
    assert problems([(0, 0, 0, 8), (40, -40, np.pi / 2, 8)], yields) == []
    (message,) = problems([(0, 0, 0, 8), (0, 90, np.pi / 2, 8)], yields)
    assert "do not meet" in message
    (message,) = problems([(0, 0, 0, 20), (20, -30, np.pi / 2, 8)], yields)
    assert "would have to brake with" in message


def test_contradictions_between_two_agents_are_told() -> None:
    states = [(0, 0, 0, 8), (40, -40, np.pi / 2, 8)]
    one = YieldTo(agent_id="100", other_id="101")
    two = YieldTo(agent_id="101", other_id="100")
    assert any("yield to each other" in one for one in problems(states, one, two))
    states = [(0, 0, 0, 10), (-15, 0, 0, 11), (-30, 0, 0, 12)]
    first = Threaten(agent_id="101", other_id="100")
    second = Threaten(agent_id="102", other_id="101")
    assert any("is threatened" in one for one in problems(states, first, second))
    both = Threaten(agent_id="101", other_id="102")
    assert any("threatens two agents" in one for one in problems(states, first, both))
    line = StopAtLine(agent_id="101", line_m=((-5.0, -4.0), (-5.0, 4.0)))
    for order in ((first, line), (line, first)):
        (found,) = [one for one in problems(states, *order) if "decides its" in one]
        assert f"its {line.name}" in found
