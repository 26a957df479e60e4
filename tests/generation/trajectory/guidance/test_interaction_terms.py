"""Terms on pairs of agents: laws on constant velocities, and real scenes."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions, KeepGap
from pd_editor.analysis.guidance.kinds.speed import StopAtLine
from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.traffic_view import generated_traffic
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.trajectory.guidance.interaction_terms import gaps_ahead
from pd_editor.generation.trajectory.guidance.latent_motion import (
    LatentMotion,
    PredictedMotion,
)
from pd_editor.generation.trajectory.guidance.term_guide import (
    TermGuide,
    trajectory_terms,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from tests.builders import LANE_WIDTH_M, scenario_with, straight_drivers
from tests.generation.generated_traffic import SINGLE, generated, same
from tests.generation.trajectory.scenes import small_model


def guide_of(
    scenario: Scenario, *terms: GuidanceTerm, avoids: bool = False
) -> tuple[TermGuide, LatentMotion, torch.Tensor]:
    """A guide by terms, and latents of constant velocity."""
    model = small_model()
    rows = scenario.agents.rows(scenario.agents.ids)
    task = TrajectoryTask.of(scenario, rows, model.decoder.basis)
    motion = task.latent_motion(model.decoder)
    speed = scenario.agents.speed_mps()[:, scenario.current_step]
    time = 0.1 * np.arange(1, 60)
    straight = np.stack([speed[:, None] * time, np.zeros((len(rows), 59))], axis=-1)
    latent = model.decoder.basis.encode(straight, speed)
    context = task.term_context(TermGuidance())
    made = trajectory_terms(terms, context, avoids=avoids)
    guide = TermGuide(motion=motion, terms=made, config=TermGuidance(num_closings=8))
    return guide, motion, torch.from_numpy(latent)[None, None].float()


def moved(
    scenario: Scenario, *terms: GuidanceTerm, avoids: bool = False
) -> tuple[PredictedMotion, PredictedMotion]:
    """Motion at constant velocity, and as the terms ask."""
    guide, motion, latent = guide_of(scenario, *terms, avoids=avoids)
    after = guide.closed(latent)
    return motion.predicted(latent[:, 0], 0.0), motion.predicted(after[:, 0], 0.0)


def residual(scenario: Scenario, *terms: GuidanceTerm) -> tuple[float, float]:
    """Cost of the terms before and after."""
    guide, motion, latent = guide_of(scenario, *terms)

    def cost(latent: torch.Tensor) -> float:
        total = 0.0
        predicted = motion.predicted(latent[:, 0], 0.0)
        for term in guide.terms:
            for one in term.rows(predicted):
                place = (one.direction * predicted.position_m[:, one.agents]).sum(-1)
                total += float((one.weight * (place - one.target)).square().sum())
        return total

    return cost(latent), cost(guide.closed(latent))


def gaps(motion: PredictedMotion, one: int, two: int) -> np.ndarray:
    """Distances between two agents' boxes, if both drive along x."""
    offset = motion.position_m[0, one] - motion.position_m[0, two]
    size = (motion.size_m[one] + motion.size_m[two]) / 2
    apart = offset.abs() - size
    return apart.amax(dim=-1).numpy()


FOLLOWS = [(0.0, 0.0, 0.0, 10.0), (25.0, 0.0, 0.0, 5.0)]
"""The first one would run into the second one."""
CROSSES = [(0, 0, 0, 8), (24, -25, np.pi / 2, 8)]
"""The first one would be 3 m before the crossing when the second one is there."""


@pytest.mark.parametrize(
    "term",
    [
        AvoidCollisions(),
        KeepGap(gap_m=5.0),
        YieldTo(agent_id="100", other_id="101"),
    ],
)
def test_terms_that_are_met_have_no_rows(term: GuidanceTerm) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 12)]))
    guide, motion, latent = guide_of(scenario, term)
    assert len(guide.terms) == 1
    assert all(
        not one.weight.any()
        for one in guide.terms[0].rows(motion.predicted(latent[:, 0], 0))
    )
    assert torch.equal(guide.closed(latent), latent)


@pytest.mark.parametrize(
    ("states", "term"),
    [
        (FOLLOWS, AvoidCollisions()),
        (CROSSES, AvoidCollisions()),
        (FOLLOWS, KeepGap(gap_m=10.0)),
        (CROSSES, YieldTo(agent_id="100", other_id="101")),
        (CROSSES, YieldTo(agent_id="101", other_id="100")),
    ],
)
def test_projections_lower_the_cost(
    states: list[tuple[float, float, float, float]], term: GuidanceTerm
) -> None:
    before, after = residual(scenario_with(straight_drivers(states)), term)
    assert before > 1
    assert after < 0.2 * before


def test_the_agent_behind_slows_down() -> None:
    before, after = moved(scenario_with(straight_drivers(FOLLOWS)), AvoidCollisions())
    assert gaps(before, 0, 1).min() < 0
    assert gaps(after, 0, 1).min() > 0
    assert torch.equal(after.position_m[0, 1], before.position_m[0, 1])


def test_agents_far_to_the_side_are_not_moved() -> None:
    states = [*FOLLOWS, (0, 30, 0, 10)]
    before, after = moved(scenario_with(straight_drivers(states)), AvoidCollisions())
    assert torch.equal(after.position_m[0, 2], before.position_m[0, 2])


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_swerves_are_to_the_chosen_side(side: str, sign: int) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 0)]))
    term = AvoidCollisions(agent_ids=("100",), side=side)  # type: ignore[arg-type]
    before, after = moved(scenario, term)
    beside = (after.position_m[0, 0, :, 0] - 40).abs() < 4.6
    assert beside.any()
    assert (sign * after.position_m[0, 0, beside, 1] > 1.9).all()
    assert gaps(before, 0, 1).min() < 0
    assert gaps(after, 0, 1).min() > 0


def test_only_named_agents_avoid() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (30, 0.9, np.pi, 8)]))
    before, after = moved(scenario, AvoidCollisions(agent_ids=("101",)))
    assert torch.equal(after.position_m[0, 0], before.position_m[0, 0])
    assert not torch.equal(after.position_m[0, 1], before.position_m[0, 1])


LEADS = [
    GoalPoint(agent_id="100", point_m=(58.0, 0.0)),
    FollowPath(agent_id="100", points_m=((0.0, 0.0), (30.0, 0.0), (80.0, 0.0))),
]


@pytest.mark.parametrize("term", LEADS)
def test_agents_that_are_led_drive_around_others(term: GuidanceTerm) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (34, 1.6, 0, 0)]))
    _, through = moved(scenario, term)
    assert gaps(through, 0, 1).min() < -0.2
    before, after = moved(scenario, term, avoids=True)
    assert gaps(after, 0, 1).min() > -0.05
    assert torch.equal(after.position_m[:, 1], before.position_m[:, 1])


def test_agents_that_threaten_do_not_avoid() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (34, 0, 0, 0)]))
    threat = Threaten(agent_id="100", other_id="101", approach="rear")
    guide, _, _ = guide_of(scenario, LEADS[1], threat, avoids=True)
    assert len(guide.terms) == 1


def test_pairs_that_overlap_now_are_left_alone() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (3, 0, 0, 10)]))
    before, after = moved(scenario, AvoidCollisions())
    assert torch.equal(after.position_m, before.position_m)


@pytest.mark.parametrize(
    ("other", "way_m"),
    [
        ((-5.2, 0, 0, 0), (-1.5, 0)),
        ((0, 2.5, 0, 0), (0, 1.5)),
        ((4.59, 0, 0, 0), (1.5, 0)),
    ],
    ids=["backwards", "sideways", "forwards from a touch"],
)
def test_agents_that_stand_are_held(
    other: tuple[float, float, float, float], way_m: tuple[float, float]
) -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), other]))
    guide, motion, latent = guide_of(scenario, AvoidCollisions())
    path = np.linspace(0, 1, 60)[1:, None] ** 2 * np.array(way_m)
    encoded = small_model().decoder.basis.encode(path[None], np.zeros(1))
    latent[0, 0, 0] = torch.from_numpy(encoded[0]).float()
    before = motion.predicted(latent[:, 0], 0.0)
    after = motion.predicted(guide.closed(latent)[:, 0], 0.0)
    now = gaps(before, 0, 1)[0]
    assert gaps(before, 0, 1).min() < now - 0.5
    assert gaps(after, 0, 1).min() > min(now, 0) - 0.02


@pytest.mark.parametrize(("agent", "other"), [("100", "101"), ("101", "100")])
def test_the_agent_that_yields_passes_after_the_other(agent: str, other: str) -> None:
    # By the diagonal of places and times: its box is nowhere where the other's will be.
    scenario = scenario_with(straight_drivers(CROSSES))
    _, after = moved(scenario, YieldTo(agent_id=agent, other_id=other))
    row, others = scenario.agents.rows((agent, other)).tolist()
    mine, theirs = after.position_m[0, row].numpy(), after.position_m[0, others].numpy()
    offset = np.abs(mine[:, None] - theirs)
    recorded = scenario.agents.position_m[others, scenario.current_step :]
    # One drives along x, the other along y.
    half = (4.6 + 1.9) / 2
    place, time = np.nonzero((offset < half).all(axis=-1))
    assert len(place) == 0 or (place > time).all()
    assert np.linalg.norm(theirs - recorded, axis=-1).max() < 0.1


def test_gap_to_the_agent_ahead_is_kept_and_opens_at_its_rate() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (9, 0, 0, 10)]))
    before, after = moved(scenario, KeepGap(gap_m=8.0))
    agents = torch.tensor([0])
    assert gaps_ahead(before, agents)[0].max() < 4.5
    gap, _ = gaps_ahead(after, agents)
    asked = np.minimum(4.4 + 1.5 * after.time_s.numpy(), 8.0)
    assert (gap[0, 0].numpy() > asked - 0.5).all()
    assert torch.equal(after.position_m[0, 1], before.position_m[0, 1])


def test_agents_brake_for_a_gap_within_limits_and_not_for_agents_beside() -> None:
    """The leader stands too near to open the gap."""
    states = [(0, 0, 0, 10), (12, 0, 0, 0)]
    _, after = moved(scenario_with(straight_drivers(states)), KeepGap(gap_m=8.0))
    assert after.acceleration_mps2[0, 0, :, 0].min() > -6.0
    beside = scenario_with(straight_drivers([(0, 0, 0, 10), (2.6, 2.1, 0.3, 10)]))
    before, after = moved(beside, KeepGap(gap_m=8.0))
    assert torch.equal(after.position_m, before.position_m)


@pytest.mark.parametrize(("right_m", "stops"), [(2.2, True), (3.0, False)])
def test_a_line_is_stopped_at_a_bit_further_beside_it_than_it_counts(
    right_m: float, stops: bool
) -> None:
    line = StopAtLine(agent_id="100", line_m=((40.0, right_m), (40.0, right_m + 4)))
    _, after = moved(scenario_with(straight_drivers([(0, 0, 0, 10)])), line)
    assert bool(after.position_m[0, 0, -1, 0] < 39.0) is stops


def test_standing_agents_do_not_reverse_to_keep_a_gap() -> None:
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (6, 0, 0, 0)]))
    before, after = moved(scenario, KeepGap(gap_m=8.0))
    torch.testing.assert_close(after.position_m, before.position_m, atol=0.1, rtol=0)


def test_no_leader_no_gap() -> None:
    states = [(0, 0, 0, 10), (20, LANE_WIDTH_M, 0, 5), (30, 0, np.pi, 5)]
    before, _ = moved(scenario_with(straight_drivers(states)), KeepGap(gap_m=8.0))
    assert torch.isinf(gaps_ahead(before, torch.tensor([0]))[0]).all()


def test_terms_that_are_off_change_nothing(diffuser: PathDiffuser) -> None:
    scenario = scenario_with(straight_drivers(FOLLOWS))
    ids = scenario.agents.ids
    off = (AvoidCollisions(is_on=False), KeepGap(gap_m=9.0, weight=0.0), SINGLE)
    plain = generated(diffuser, scenario, ids, guidance=(SINGLE,)).samples[0]
    assert same(generated(diffuser, scenario, ids, guidance=off).samples[0], plain)


def test_new_collisions_of_real_scenes_are_fewer(av2_root: Path) -> None:
    diffuser = make_generator(DEFAULT_GENERATOR)
    assert isinstance(diffuser, PathDiffuser)
    counts = np.zeros(2, int)
    folders = sorted(path.parent for path in (av2_root / "train").glob("*/*.parquet"))
    for folder in folders[:8]:
        scenario = read_scenario(folder)
        ids = drivable_agent_ids(scenario)

        def collisions(sample: TrafficSample, scenario: Scenario = scenario) -> int:
            view = generated_traffic(scenario, sample)
            return int(box_overlap(view).newly().value.sum())

        for index, terms in enumerate([(SINGLE,), (SINGLE, AvoidCollisions())]):
            found = generated(
                diffuser,
                scenario,
                ids,
                guidance=terms,
                num_samples=2,
                reports_cost=False,
            )
            counts[index] += sum(collisions(one) for one in found.samples)
    assert counts[0] >= 8
    assert counts[1] <= 0.35 * counts[0]
