from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.repair.state_repairs import slow_for_gaps
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.generation import path_diffuser
from pd_editor.generation.initial_state import pipeline
from pd_editor.generation.initial_state.attributes import AttributeRequest
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    UNCONDITIONED,
    Conditioning,
)
from pd_editor.generation.initial_state.placement_rules import ConflictSearch, KeptPaths
from pd_editor.generation.initial_state.sampler import sample_initial_states
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.generation.request_options import MOST_AGENTS
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import GenerationRequest, Region, guidance_settings
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers
from tests.generation.generated_traffic import SINGLE, close, generated, same


def test_agents_are_added_and_placed_anew(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    ids = scenario.agents.ids
    traffic = generated(
        diffuser,
        scenario,
        ids[:1],
        resampled_state_ids=ids[:1],
        num_new_agents={AgentKind.PEDESTRIAN: 1, AgentKind.VEHICLE: 2},
        num_samples=2,
        region=Region(center_m=(20.0, 0.0), half_side_m=30.0),
    )
    one, two = traffic.samples
    assert one.ids == (ids[0], "new-1", "new-2", "new-3")
    assert one.kinds[1:] == (AgentKind.VEHICLE,) * 2 + (AgentKind.PEDESTRIAN,)
    assert not same(one, two)
    alone = generated(
        diffuser,
        scenario,
        ids[:1],
        resampled_state_ids=ids[:1],
        num_new_agents={AgentKind.PEDESTRIAN: 1, AgentKind.VEHICLE: 2},
        region=Region(center_m=(20.0, 0.0), half_side_m=30.0),
    )
    assert close(alone.samples[0], one)


def test_samples_of_a_batch_are_those_made_alone(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Several squares; the number of agents differs from sample to sample."""
    asked = {
        "resampled_state_ids": scenario.agents.ids[:1],
        "samples_num_agents": True,
        "region": Region(center_m=(0.0, 0.0), half_side_m=90.0),
        "num_samples": 3,
        "only_on_road": True,
        "seed": 3,
    }
    batches: list[int] = []
    place = pipeline.place_agents

    def counted(model: Any, tasks: Any, **more: Any) -> Any:
        batches.append(len(tasks))
        return place(model, tasks, **more)

    monkeypatch.setattr(pipeline, "place_agents", counted)
    together = generated(diffuser, scenario, scenario.agents.ids[:1], **asked)
    assert max(batches) > 1
    monkeypatch.setattr(path_diffuser, "_MOST_PLACED_TOGETHER", 1)
    alone = generated(diffuser, scenario, scenario.agents.ids[:1], **asked)
    for one, two in zip(alone.samples, together.samples, strict=True):
        assert close(one, two)
    assert len({sample.ids for sample in together.samples}) > 1


def test_samples_share_one_map_with_crosswalks(diffuser: PathDiffuser) -> None:
    """Distances to crosswalks depend on the agents, which differ between samples."""
    traffic = generated(
        diffuser,
        open_scenario("signalised-junction"),
        (),
        num_new_agents={AgentKind.VEHICLE: 3, AgentKind.PEDESTRIAN: 1},
        num_samples=2,
        seed=1,
        region=Region(center_m=(0.0, 0.0), half_side_m=62.0),
        guidance=guidance_settings(None, 0),
    )
    assert [len(one.ids) for one in traffic.samples] == [4, 4]


def test_a_batch_of_samples_is_cancelled_between_steps(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=scenario.agents.ids,
        resampled_state_ids=scenario.agents.ids,
        num_samples=4,
    )
    steps = diffuser.generate(request)
    shares = [next(steps).fraction for _ in range(3)]
    steps.close()
    assert shares == sorted(set(shares))
    assert shares[-1] < 0.4


def test_high_quality_samples_more_versions_of_agents_in_conflict(
    diffuser: PathDiffuser, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers: list[int] = []
    best_of = ConflictSearch.best_of

    def counted(
        self: ConflictSearch, versions: list, ids: tuple, kept: KeptPaths
    ) -> Scenario:
        numbers.append(len(versions))
        return best_of(self, versions, ids, kept)

    monkeypatch.setattr(ConflictSearch, "best_of", counted)
    crowd = [(8.0 * k, 3.5 * lane, 0.0, 9.0) for k in range(9) for lane in range(2)]
    scenario = scenario_with(straight_drivers(crowd))
    ids = scenario.agents.ids
    for quality in ("fast", "high"):
        generated(diffuser, scenario, ids, resampled_state_ids=ids, quality=quality)
    assert set(numbers) == {2, 4}


def test_whoever_is_placed_can_brake_behind_those_ahead(diffuser: PathDiffuser) -> None:
    """The weights are random: without the last repair some could not."""
    crowd = [(8.0 * k, 3.5 * lane, 0.0, 9.0) for k in range(9) for lane in range(2)]
    scenario = scenario_with(straight_drivers(crowd))
    ids = scenario.agents.ids
    traffic = generated(
        diffuser,
        scenario,
        ids,
        resampled_state_ids=ids,
        moving_share=1.0,
        num_samples=3,
    )
    now = scenario.current_step
    for sample in traffic.samples:
        agents = scenario.agents
        rows = agents.rows(sample.ids)
        arrays = {
            name: getattr(agents, name).copy()
            for name in ("position_m", "heading_rad", "velocity_mps")
        }
        for name, values in arrays.items():
            values[rows, now] = getattr(sample, name)[:, 0]
        placed = scenario.with_agents(agents.with_rows(rows, **arrays))
        assert slow_for_gaps(placed) is placed


def test_the_model_chooses_how_many_so_that_there_are_as_many_as_in_training(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    traffic = generated(
        diffuser,
        scenario,
        scenario.agents.ids,
        samples_num_agents=True,
        region=Region(center_m=(0.0, 0.0), half_side_m=62.0),
    )
    kinds = traffic.samples[0].kinds
    assert kinds.count(AgentKind.PEDESTRIAN) == 2
    assert kinds.count(AgentKind.CYCLIST) == 1
    assert kinds.count(AgentKind.VEHICLE) == 4


def test_wishes_about_those_placed_are_answered(
    diffuser: PathDiffuser, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks: list[Conditioning] = []

    def spied(*given: Any, **more: Any) -> Any:
        tasks.append(given[3])
        return sample_initial_states(*given, **more)

    monkeypatch.setattr(pipeline, "sample_initial_states", spied)
    asked = {
        "num_new_agents": {AgentKind.VEHICLE: 6, AgentKind.PEDESTRIAN: 1},
        "num_samples": 2,
        "guidance": (SINGLE,),
        "region": Region(center_m=(0.0, 0.0), half_side_m=62.0),
    }
    wishes = {"moving_share": 0.75, "only_on_road": True}
    traffic = generated(diffuser, scenario, (), **asked, **wishes)
    first, *again = tasks
    kept, drives, walks = first.moves[0, :9].split([2, 6, 1])
    assert (kept == UNCONDITIONED).all()
    assert 4 <= (drives == CONDITIONED_YES).sum() <= 5
    assert (drives == CONDITIONED_NO).sum() + (drives == CONDITIONED_YES).sum() == 6
    assert walks != UNCONDITIONED
    assert first.on_road[0, :9].tolist() == [UNCONDITIONED] * 2 + [
        CONDITIONED_YES
    ] * 6 + [UNCONDITIONED]
    assert again, "a network with random weights places agents in conflict"
    assert all(bool((task.moves != UNCONDITIONED).any()) for task in again)
    numbers = []
    for sample in traffic.samples:
        walker = sample.kinds.index(AgentKind.PEDESTRIAN)
        # Speeds are rounded, so some are at the limit: no other rounding may be used.
        speed = np.linalg.norm(sample.velocity_mps[:, 0], axis=-1)
        off = is_off_road(scenario, sample.position_m[:, 0])
        off[walker] = False
        numbers.append(((speed >= 0.5).sum(), off.sum()))
    moving, off = np.sum(numbers, axis=0)
    # One that fits nowhere is left out, and told in a note of its own.
    count = sum(len(sample.ids) for sample in traffic.samples)
    assert count >= 12
    speeds, places = (one for one in traffic.notes if "placed agents in 2" in one)
    assert speeds.startswith(
        f"{moving} of {count} placed agents in 2 samples move at t = 0 "
    )
    assert "75% were asked for" in speeds
    verb = "is" if off < 2 else "are"
    expected = f"{off or 'None'} of {count} placed agents in 2 samples {verb} off the road at t = 0."
    assert places.startswith(expected)
    without = generated(diffuser, scenario, (), **asked).notes
    assert not any("placed agents in 2" in one for one in without)


def test_only_on_the_road_leaves_no_vehicle_beside_the_drivable_area() -> None:
    """A parked one within 4 m of a centre line stayed where it was, beside the road."""
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5), (30, -3, 0, 0)]))
    now = scenario.current_step

    def is_off(traits: AttributeRequest) -> bool:
        placing = pipeline.SquarePlacement(
            resampled_ids=("101",),
            new_kinds=(),
            new_ids=(),
            region=Region(center_m=(30.0, 0.0), half_side_m=40.0),
            traits=traits,
        )
        repaired = pipeline._repaired(scenario, [placing], np.array([CONDITIONED_YES]))
        return bool(is_off_road(repaired, repaired.agents.position_m[1:2, now])[0])

    assert is_off(AttributeRequest())
    assert not is_off(AttributeRequest(only_on_road=True))


def test_no_agent_is_placed_outside_the_square_even_to_be_on_a_lane(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    beside = Region(center_m=(0.0, 50.0), half_side_m=20.0)
    traffic = generated(
        diffuser,
        scenario.without_agents(scenario.agents.ids),
        (),
        num_new_agents={AgentKind.VEHICLE: 4},
        region=beside,
    )
    place = traffic.samples[0].position_m[:, 0]
    # Who overlaps somebody at the border is slid out of it by a car's length at most.
    outside = np.abs(place - beside.center_m) - beside.half_side_m
    assert (outside <= 5.0).all()
    assert (outside.max(axis=1) <= 0).sum() >= 3


def test_a_full_road_gets_no_more_agents(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    nowhere = Region(center_m=(500.0, 500.0), half_side_m=5.0)
    traffic = generated(
        diffuser,
        scenario.without_agents(scenario.agents.ids),
        (),
        samples_num_agents=True,
        region=nowhere,
        num_samples=2,
    )
    assert [sample.ids for sample in traffic.samples] == [(), ()]
    assert any(
        "No agent was placed in 2 of 2 samples" in note for note in traffic.notes
    )


def test_agents_that_are_not_there_take_no_room(diffuser: PathDiffuser) -> None:
    agents = straight_drivers(
        [(4.0 * number, 0.0, 0.0, 1.0) for number in range(MOST_AGENTS)]
    )
    scenario = scenario_with(agents)
    valid = agents.is_valid.copy()
    valid[3:, scenario.current_step] = False
    scenario = scenario.with_agents(replace(agents, is_valid=valid))
    traffic = generated(diffuser, scenario, (), samples_num_agents=True)
    assert traffic.samples


def test_new_agents_have_drawn_sizes_and_those_that_stay_keep_theirs(
    diffuser: PathDiffuser, scenario: Scenario
) -> None:
    ids, now = scenario.agents.ids, {AgentKind.PEDESTRIAN: 1, AgentKind.VEHICLE: 4}
    asked = {
        "resampled_state_ids": ids[:1],
        "num_new_agents": now,
        "num_samples": 2,
        "seed": 5,
        "region": Region(center_m=(20.0, 0.0), half_side_m=30.0),
    }
    one, two = generated(diffuser, scenario, ids[:1], **asked).samples
    again, _ = generated(diffuser, scenario, ids[:1], **asked).samples
    assert np.array_equal(one.size_m, again.size_m)
    assert np.allclose(one.size_m[0], scenario.agents.size_m[0])
    assert len(np.unique(one.size_m[1:5, 0])) == 4
    assert not np.array_equal(one.size_m[1:], two.size_m[1:])
    assert (one.size_m[1:5] > 1.7).all()
