"""Taking over what a generator drew."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.speed import SpeedLimit
from pd_editor.base.errors import EditError, GenerationError
from pd_editor.editor.commands import (
    DeleteAgents,
    DuplicateAgents,
    PlaceAgent,
    RemoveAllAgents,
    ReplaceTraffic,
    RequestSummary,
    SetAgentActivity,
    SetAgentSpeed,
    new_agent_id,
    new_agent_ids,
    traffic_command,
)
from pd_editor.editor.commands.edit_limits import MAX_POSITION_M
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.session import EditorSession
from pd_editor.scene.agent_kind import Activity, AgentCategory, AgentKind
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids, road_user_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import MadeUpPast
from tests.editor.command_strategies import ABSENT_ID, busy_scenario
from tests.editor.fake_generators import DriftGenerator, PlacingGenerator

BASE = busy_scenario()
NOW = BASE.current_step
REQUEST = GenerationRequest(scenario=BASE, agent_ids=("104", "100"), seed=3)


def traffic() -> GeneratedTraffic:
    return run_to_end(DriftGenerator().generate(REQUEST))


def test_futures_are_replaced_and_all_else_stays():
    drawn = traffic()
    result = traffic_command(REQUEST, drawn).apply(BASE)
    rows = BASE.agents.rows(REQUEST.agent_ids)
    sample = drawn.samples[0]
    for name in ("position_m", "heading_rad", "velocity_mps"):
        after, before = getattr(result.agents, name), getattr(BASE.agents, name)
        assert (after[:, : NOW + 1] == before[:, : NOW + 1]).all()
        assert np.allclose(
            after[rows, NOW + 1 :], getattr(sample, name)[:, 1:], atol=1e-4
        )
    assert result.agents.is_valid[rows, NOW:].all()
    assert result.agents.ids == BASE.agents.ids
    assert result.provenance.notes == (
        "Motion of 2 agents was sampled by drift, seed 3.",
    )


def test_new_agents_have_no_past_and_no_score():
    drawn = traffic().samples[0]
    sample = replace(
        drawn, ids=("104", "new"), kinds=(AgentKind.VEHICLE, AgentKind.BUS)
    )
    command = ReplaceTraffic(
        sample=sample,
        generator="test",
        request=RequestSummary(agent_ids=("104",), num_new_agents={AgentKind.BUS: 1}),
    )
    agents = command.apply(BASE).agents
    row = agents.row_of["new"]
    assert agents.kinds[row] is AgentKind.BUS
    assert agents.categories[row] is AgentCategory.UNSCORED
    assert agents.has_known_size[row]
    assert not agents.is_valid[row, :NOW].any()
    assert agents.is_valid[row, NOW:].all()
    assert np.allclose(agents.position_m[row, NOW:], sample.position_m[1], atol=1e-3)


def test_a_redrawn_state_drops_the_past():
    drawn = traffic().samples[0]
    moved = replace(drawn, position_m=drawn.position_m + np.array([0.0, 2.0]))
    command = replace(traffic_command(REQUEST, traffic()), sample=moved)
    agents = command.apply(BASE).agents
    rows = agents.rows(REQUEST.agent_ids)
    assert not agents.is_valid[rows, :NOW].any()
    assert (agents.observed[rows] == (np.arange(110) == NOW)).all()
    assert np.allclose(agents.position_m[rows, NOW:], moved.position_m, atol=1e-3)


def test_an_agent_that_was_absent_comes_into_being():
    sample = replace(traffic().samples[0], ids=("104", ABSENT_ID))
    request = RequestSummary(agent_ids=("104", ABSENT_ID))
    command = ReplaceTraffic(sample=sample, generator="test", request=request)
    agents = command.apply(BASE).agents
    row = agents.row_of[ABSENT_ID]
    assert (agents.is_valid[row] == (np.arange(110) >= NOW)).all()


def test_new_agents_take_the_place_of_all_and_one_becomes_focal():
    drawn = traffic().samples[0]
    sample = replace(drawn, ids=("new-1", "new-2"))
    summary = RequestSummary(
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 2},
        removed_ids=BASE.agents.ids,
    )
    assert not len(summary.request(BASE, 0).scenario.agents)
    command = ReplaceTraffic(sample=sample, generator="test", request=summary)
    assert command.label.startswith("Resample 2 agents")
    result = command.apply(BASE)
    assert result.agents.ids == ("new-1", "new-2")
    focal = BASE.agents.position_m[BASE.agents.row_of[BASE.focal_id], NOW]
    gap = np.linalg.norm(sample.position_m[:, 0] - focal, axis=-1)
    assert result.focal_id == sample.ids[int(np.argmin(gap))]
    row = result.agents.row_of[result.focal_id]
    assert result.agents.categories[row] is AgentCategory.FOCAL
    assert sum(one is AgentCategory.FOCAL for one in result.agents.categories) == 1


def resampled(scenario, generator=None, **asked):
    """The scenario with all road users replaced by a row of new vehicles."""
    removed = road_user_ids(scenario)
    request = GenerationRequest(
        scenario=scenario.without_agents(removed),
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: 3},
        **asked,
    )
    traffic = run_to_end((generator or PlacingGenerator()).generate(request))
    return traffic_command(request, traffic, removed_ids=removed).apply(scenario)


def test_a_second_resample_reuses_no_id_and_finds_a_focal_agent_of_its_own():
    """(D2): the focal agent's name was given to another car, which stayed unscored."""
    once = resampled(BASE)
    twice = resampled(once)
    assert once.agents.ids == ("new-1", "new-2", "new-3")
    assert twice.agents.ids == ("new-4", "new-5", "new-6")
    for result in (once, twice):
        row = result.agents.row_of[result.focal_id]
        focal = [one is AgentCategory.FOCAL for one in result.agents.categories]
        assert focal.count(True) == 1
        assert focal[row]
    assert twice.provenance.notes[-1].endswith("is the focal agent now.")


def test_an_id_is_never_given_twice_in_a_history():
    """(D2): neither to placed agents, nor to copies, nor after a deletion."""
    session = EditorSession(BASE)
    had: set[str] = set()
    for _ in range(3):
        name = new_agent_id(session.scenario)
        copies = new_agent_ids(session.scenario, 1, "copy")
        assert not had & {name, *copies}
        had |= {name, *copies}
        session.apply(DuplicateAgents(agent_ids=("101",), new_ids=copies))
        session.apply(
            PlaceAgent(
                agent_id=name,
                kind=AgentKind.VEHICLE,
                x_m=5.0,
                y_m=0.0,
                heading_rad=0.0,
                speed_mps=5.0,
            )
        )
        session.apply(DeleteAgents(agent_ids=(name, *copies)))
    assert replay(session.recipe(), BASE).retired_ids == had


def test_a_result_takes_no_id_of_an_agent_that_was_removed_meanwhile():
    """A run that ended after other edits gave the id of a deleted agent to another."""
    request = GenerationRequest(
        scenario=BASE, agent_ids=(), num_new_agents={AgentKind.VEHICLE: 2}
    )
    result = run_to_end(PlacingGenerator().generate(request))
    early = traffic_command(request, result)
    once = early.apply(BASE)
    left = DeleteAgents(agent_ids=("new-1", "new-2")).apply(once)
    with pytest.raises(EditError, match="'new-1' was the id of an agent"):
        early.apply(left)
    late = traffic_command(request, result, edited=left)
    assert late.sample.ids == ("new-3", "new-4")
    assert late.apply(left).agents.ids == (*left.agents.ids, "new-3", "new-4")


def test_recipes_that_use_an_id_again_still_open_and_their_focal_agent_is_one():
    """(D2): such as were written before ids were unique."""
    sample = replace(traffic().samples[0], ids=("new-1", "new-2"))

    def command(removed: tuple[str, ...]) -> ReplaceTraffic:
        summary = RequestSummary(agent_ids=(), removed_ids=removed)
        return ReplaceTraffic(sample=sample, generator="test", request=summary)

    once = command(BASE.agents.ids).apply(BASE)
    twice = command(once.agents.ids).apply(once)
    row = twice.agents.row_of[twice.focal_id]
    assert twice.agents.categories[row] is AgentCategory.FOCAL


def test_traffic_that_would_take_a_kept_agents_id_is_refused():
    sample = replace(traffic().samples[0], ids=("101", "new-2"))
    summary = RequestSummary(agent_ids=(), num_new_agents={AgentKind.VEHICLE: 2})
    command = ReplaceTraffic(sample=sample, generator="test", request=summary)
    with pytest.raises(EditError, match="already an agent '101'"):
        command.apply(BASE)


def test_an_ego_that_is_removed_is_noted():
    """(D6): the ego was gone after a resample, and nothing said so."""
    agents = replace(BASE.agents, ids=("AV", *BASE.agents.ids[1:]))
    base = replace(BASE, agents=agents, focal_id="101")
    note = "The ego vehicle (AV) was removed."
    assert note in resampled(base).provenance.notes
    deleted = DeleteAgents(agent_ids=("AV",)).apply(base)
    assert deleted.provenance.notes == (note,)


def test_the_first_agent_on_a_bare_road_is_the_focal_one():
    """(D2): an export needs one."""
    bare = RemoveAllAgents().apply(BASE)
    place = PlaceAgent(
        agent_id=new_agent_id(bare),
        kind=AgentKind.VEHICLE,
        x_m=5.0,
        y_m=0.0,
        heading_rad=0.0,
        speed_mps=5.0,
    )
    placed = place.apply(bare)
    assert placed.focal_id == place.agent_id
    assert placed.agents.categories == (AgentCategory.FOCAL,)


def test_a_bare_road_gets_traffic_and_a_focal_agent():
    bare = RemoveAllAgents().apply(BASE)
    assert not len(bare.agents)
    assert bare.road_map is BASE.road_map
    sample = replace(traffic().samples[0], ids=("new-1", "new-2"))
    summary = RequestSummary(agent_ids=(), num_new_agents={AgentKind.VEHICLE: 2})
    command = ReplaceTraffic(sample=sample, generator="test", request=summary)
    assert command.apply(bare).focal_id in sample.ids


def test_a_scenario_that_moved_on_is_told():
    command = traffic_command(REQUEST, traffic())
    gone = BASE.with_agents(BASE.agents.taken([0, 1, 2, 3]))
    with pytest.raises(EditError, match="Agent 104 is not in the scenario any more"):
        command.apply(gone)


def other_sample(**changes: np.ndarray | tuple) -> GeneratedTraffic:
    return replace(traffic(), samples=(replace(traffic().samples[0], **changes),))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda: replace(traffic(), samples=()), "Sample 0 was asked for, but drift"),
        (
            lambda: other_sample(
                position_m=np.zeros((2, 60, 2)),
                heading_rad=np.zeros((2, 60)),
                velocity_mps=np.zeros((2, 60, 2)),
            ),
            r"position_m has the shape \(2, 60, 2\); expected \(2, 61, 2\)",
        ),
        (
            lambda: other_sample(ids=("104", "101")),
            "generated agent 101, which was to be",
        ),
        (lambda: other_sample(ids=("104", "104")), "one kind and one id each"),
        (lambda: other_sample(kinds=(AgentKind.BUS,)), "one kind and one id each"),
        (
            lambda: other_sample(ids=("a", "b", "c"), kinds=(AgentKind.BUS,) * 3),
            r"size_m has the shape \(2, 2\); expected \(3, 2\)",
        ),
    ],
)
def test_nonsense_is_refused(answer, message):
    with pytest.raises(GenerationError, match=message):
        traffic_command(REQUEST, answer())


def test_agents_far_outside_are_refused():
    far = np.full((2, 61, 2), 2 * MAX_POSITION_M)
    with pytest.raises(EditError, match="more than 5000 m"):
        traffic_command(REQUEST, other_sample(position_m=far))


def test_the_summary_makes_the_same_request_again():
    request = replace(
        REQUEST, num_samples=2, num_denoising_steps=7, num_new_agents={AgentKind.BUS: 2}
    )
    twice = replace(traffic(), samples=traffic().samples * 2)
    command = traffic_command(request, twice, sample_index=1)
    assert command.request.request(BASE, command.seed) == request
    assert command.request.sample_index == 1


def test_an_empty_sample_changes_nothing():
    no_agent = TrafficSample(
        ids=(),
        kinds=(),
        size_m=np.zeros((0, 2)),
        position_m=np.zeros((0, 61, 2)),
        heading_rad=np.zeros((0, 61)),
        velocity_mps=np.zeros((0, 61, 2)),
    )
    summary = RequestSummary(agent_ids=())
    command = ReplaceTraffic(sample=no_agent, generator="test", request=summary)
    assert command.apply(BASE) is BASE


def test_activities_that_were_sampled_are_kept_through_recipe_and_undo():
    drawn = traffic().samples[0]
    sample = replace(
        drawn,
        ids=("104", "new"),
        activity=(Activity.UNKNOWN, Activity.PARKED),
        velocity_mps=np.zeros_like(drawn.velocity_mps),
    )
    session = EditorSession(BASE)
    session.apply(SetAgentSpeed(agent_ids=("104",), speed_mps=0.0))
    session.apply(SetAgentActivity(agent_ids=("104",), activity=Activity.WAITING))
    known = session.scenario.agents.activity
    session.apply(
        ReplaceTraffic(
            sample=sample,
            generator="test",
            request=RequestSummary(agent_ids=("104",), num_new_agents={}),
        )
    )
    # The state of 104 stays, and with it what was known of it.
    agents = session.scenario.agents
    assert agents.activity[agents.row_of["104"]] == Activity.WAITING
    assert agents.activity[agents.row_of["new"]] == Activity.PARKED
    again = replay(Recipe.from_text(session.recipe().to_text()), BASE)
    assert np.array_equal(again.agents.activity, agents.activity)
    session.undo()
    assert np.array_equal(session.scenario.agents.activity, known)


def test_states_that_are_sampled_without_an_activity_have_none():
    standing = SetAgentSpeed(agent_ids=("104",), speed_mps=0.0).apply(BASE)
    parked = SetAgentActivity(agent_ids=("104",), activity=Activity.PARKED)
    moved = traffic().samples[0]
    moved = replace(moved, position_m=moved.position_m + 5.0)
    result = ReplaceTraffic(
        sample=moved,
        generator="test",
        request=RequestSummary(agent_ids=REQUEST.agent_ids),
    ).apply(parked.apply(standing))
    assert not result.agents.activity.any()


def test_a_sample_with_too_few_activities_is_refused():
    sample = replace(traffic().samples[0], activity=(Activity.PARKED,))
    with pytest.raises(GenerationError, match="activity is of 1 agents, not 2"):
        ReplaceTraffic(
            sample=sample,
            generator="test",
            request=RequestSummary(agent_ids=REQUEST.agent_ids),
        )


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        ((2, 2), ()),
        ((2, 1), ("1 of 2 agents appears after the scene's start",)),
        ((0, 1), ("2 of 2 agents appear after the scene's start",)),
    ],
)
def test_agents_that_enter_late_are_told(steps, told):
    past = MadeUpPast(
        ids=("104", "100"),
        num_steps=steps,
        position_m=np.zeros((2, 2, 2), np.float32),
        heading_rad=np.zeros((2, 2), np.float32),
        velocity_mps=np.zeros((2, 2, 2), np.float32),
    )
    command = replace(traffic_command(REQUEST, traffic()), past=past)
    assert command.notes == tuple(
        f"{one}: others are in the way before." for one in told
    )


def appearing(position_m: tuple[float, float], after: int = 10) -> Scenario:
    """The scenario whose absent agent appears some steps after the current one."""
    agents = BASE.agents
    row = agents.row_of[ABSENT_ID]
    later = np.arange(agents.num_steps) >= NOW + after
    track = np.broadcast_to(position_m, (agents.num_steps, 2))
    agents = agents.with_rows(
        np.array([row]),
        position_m=track[None].copy(),
        is_valid=later[None],
        observed=agents.observed[[row]] & later,
    )
    return replace(BASE, agents=agents)


def placed_anew(scenario: Scenario, **changes: object) -> ReplaceTraffic:
    """Agent 104 placed at the origin, where it stays."""
    asked = {"agent_ids": ("104",), "resampled_state_ids": ("104",), **changes}
    request = GenerationRequest(scenario=scenario, **asked)
    return traffic_command(request, run_to_end(PlacingGenerator().generate(request)))


def test_agents_that_appear_later_in_sampled_ones_are_left_out_and_told():
    scenario = appearing((1.0, 0.5))
    command = placed_anew(scenario, back_casts=True)
    assert command.left_out_ids == (ABSENT_ID,)
    assert command.notes[-1] == (
        "1 agent that appears later is left out: generated ones are in the way."
    )
    after = command.apply(scenario)
    assert ABSENT_ID not in after.agents.row_of
    assert after.provenance.notes[-1].endswith(f"later: agent {ABSENT_ID}.")
    assert set(after.agents.ids) == set(scenario.agents.ids) - {ABSENT_ID}
    session = EditorSession(scenario)
    session.apply(command)
    again = replay(Recipe.from_text(session.recipe().to_text()), scenario)
    assert again.agents.ids == after.agents.ids
    session.undo()
    assert ABSENT_ID in session.scenario.agents.row_of


def test_agents_that_appear_elsewhere_or_beside_recorded_traffic_stay():
    assert not placed_anew(appearing((1.0, 30.0))).left_out_ids
    # There now, though on the same place.
    here = appearing((1.0, 0.5), after=0)
    assert not placed_anew(here).left_out_ids
    # Most of the recorded traffic stays; then all of it is driven anew.
    hit = appearing((1.0, 0.5))
    assert not placed_anew(hit, resampled_state_ids=()).left_out_ids
    everyone = {"agent_ids": drivable_agent_ids(hit), "resampled_state_ids": ()}
    on_another = appearing((30.0, 3.5))
    assert placed_anew(on_another, **everyone).left_out_ids == (ABSENT_ID,)
    live = placed_anew(on_another, **everyone, before_edit=on_another)
    assert not live.left_out_ids
    term = SpeedLimit(speed_mps=5.0, agent_ids=(ABSENT_ID,))
    guided = replace(on_another, guidance=(term,))
    assert not placed_anew(guided, **everyone).left_out_ids
    locked = replace(hit, locks={ABSENT_ID: TRAJECTORY_LOCK})
    command = placed_anew(locked)
    assert not command.left_out_ids
    # It is locked only after the run.
    command = placed_anew(hit)
    assert ABSENT_ID in command.apply(locked).agents.row_of
