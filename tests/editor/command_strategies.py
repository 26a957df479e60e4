"""A busy hand-made scenario, and hypothesis strategies for every command on it."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit
from pd_editor.editor.commands import (
    AddGuidance,
    AdoptTrajectory,
    BeginAt,
    ChangeGuidance,
    Command,
    ContinueScene,
    DeleteAgents,
    DuplicateAgents,
    GiveGreen,
    PlaceAgent,
    PullSpeed,
    RegeneratedEdit,
    RemoveAllAgents,
    RemoveGuidance,
    RemoveSignals,
    ReplaceTraffic,
    RequestSummary,
    SampleSignals,
    SetAgentActivity,
    SetAgentHeading,
    SetAgentKind,
    SetAgentPosition,
    SetAgentSize,
    SetAgentSpeed,
    SetFocalAgent,
    SetLocks,
    SetRoadWarp,
    SlowToComfort,
    SlowToFrictionLimit,
    SnapToLane,
    TransformAgents,
    YieldToOthers,
    new_agent_id,
    new_agent_ids,
)
from pd_editor.editor.commands.roll_out import RolledMotion
from pd_editor.scene.agent_kind import Activity, AgentKind, default_sizes_m
from pd_editor.scene.generation import GuidanceSetting, TrafficSample
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import Lock
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import WARP_KINDS, RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS
from tests.builders import scenario_with, straight_drivers, straight_lane, two_lane_road

ABSENT_ID = "105"
"""The agent of ``busy_scenario`` that has no state at the current step."""


def busy_scenario() -> Scenario:
    """Six agents: drivers, one that stands, a pedestrian, gaps, one that has left."""
    vehicle = AgentKind.VEHICLE
    agents = straight_drivers(
        [
            (0, 0, 0, 10),
            (-20, 0, 0.05, 8),
            (30, 3.5, 0, 0),
            (10, -4, math.pi / 2, 1.2),
            (-40, 3.5, 0, 15),
            (60, 0, 0, 12),
        ],
        kinds=(vehicle, vehicle, AgentKind.BUS, AgentKind.PEDESTRIAN, vehicle, vehicle),
    )
    is_valid = agents.is_valid.copy()
    is_valid[3, :40] = False
    is_valid[4, 20:25] = is_valid[4, 80:] = False
    is_valid[5, 45:] = False
    mask = is_valid[..., None]
    rows = np.arange(len(agents))
    scenario = scenario_with(
        agents.with_rows(
            rows,
            is_valid=is_valid,
            position_m=np.where(mask, agents.position_m, 0.0),
            heading_rad=np.where(is_valid, agents.heading_rad, 0.0),
            velocity_mps=np.where(mask, agents.velocity_mps, 0.0),
            observed=agents.observed & is_valid,
        ),
        with_crossing(two_lane_road()),
    )
    return replace(scenario, guidance=(SpeedLimit(speed_mps=20.0),))


def with_crossing(road_map: RoadMap) -> RoadMap:
    """The map and, far from it, two pairs of lanes that cross."""
    ways = {
        91: ((100, -200), (120, -200)),
        92: ((110, -210), (110, -190)),
        93: ((120, -196), (100, -196)),
        94: ((106, -190), (106, -210)),
    }
    lanes = [straight_lane(n, *ends, is_intersection=True) for n, ends in ways.items()]
    return replace(road_map, lanes=(*road_map.lanes, *lanes))


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


def present_ids(scenario: Scenario) -> list[str]:
    """Agents with a state at the current step."""
    now = scenario.agents.is_valid[:, scenario.current_step]
    return [scenario.agents.ids[row] for row in np.flatnonzero(now)]


def lasting_ids(scenario: Scenario) -> list[str]:
    """Agents with a state at the current step and throughout the next three seconds."""
    now = scenario.current_step
    there = scenario.agents.is_valid[:, now : now + 31].all(axis=1)
    return [scenario.agents.ids[row] for row in np.flatnonzero(there)]


def some_of(ids: list[str]) -> st.SearchStrategy[tuple[str, ...]]:
    return st.lists(st.sampled_from(ids), min_size=1, unique=True).map(tuple)


def present(scenario: Scenario) -> st.SearchStrategy[tuple[str, ...]]:
    return some_of(present_ids(scenario))


def locks() -> st.SearchStrategy[Lock]:
    kept = st.sampled_from([None, 0.0]) | numbers(0, 7)
    return st.builds(Lock, kept_s=kept)


def warps() -> st.SearchStrategy[RoadWarp]:
    term = st.builds(
        WarpTerm,
        kind=st.sampled_from(WARP_KINDS),
        power=numbers(-10, 10),
        length_m=numbers(5, 80),
        border_m=numbers(0, 30),
        exponent=numbers(2, 4),
    )
    anchor = st.builds(
        RigidMotion,
        x_m=numbers(-50, 50),
        y_m=numbers(-5, 5),
        rotation_rad=numbers(-3, 3),
    )
    terms = st.lists(term, min_size=1, max_size=2).map(tuple)
    return st.builds(RoadWarp, anchor=anchor, terms=terms)


def trajectory_from(
    scenario: Scenario, agent_id: str, speed: float, bend: float
) -> dict[str, np.ndarray]:
    """An arc that starts where the agent is."""
    axis, agents = scenario.time_axis, scenario.agents
    row = agents.row_of[agent_id]
    time = np.arange(axis.num_future_steps + 1) * axis.step_s
    heading = agents.heading_rad[row, axis.current_step] + bend * time
    velocity = speed * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    moved = np.cumsum(velocity * axis.step_s, axis=0) - velocity[0] * axis.step_s
    return {
        "position_m": agents.position_m[row, axis.current_step] + moved,
        "heading_rad": heading,
        "velocity_mps": velocity,
    }


def on_scenario(
    make: Callable[[st.DrawFn, Scenario], Command],
) -> Callable[[Scenario], st.SearchStrategy[Command]]:
    """As ``st.composite``, without the scenario in the strategy's name."""

    def strategy(scenario: Scenario) -> st.SearchStrategy[Command]:
        return st.composite(lambda draw: make(draw, scenario))()

    return strategy


@on_scenario
def adoptions(draw: st.DrawFn, scenario: Scenario) -> AdoptTrajectory:
    agent_id = draw(st.sampled_from(present_ids(scenario)))
    arrays = trajectory_from(
        scenario, agent_id, draw(numbers(0, 20)), draw(numbers(-0.3, 0.3))
    )
    return AdoptTrajectory.of_arrays(agent_id=agent_id, **arrays)


@on_scenario
def replacements(draw: st.DrawFn, scenario: Scenario) -> ReplaceTraffic:
    asked = draw(present(scenario))
    added = new_agent_ids(scenario, draw(st.integers(0, 2)), "generated")
    speed, bend = draw(numbers(0, 20)), draw(numbers(-0.3, 0.3))
    moved = draw(st.sampled_from([0.0, 3.0]))
    starts = [
        trajectory_from(scenario, name, speed, bend)
        for name in (*asked, *(asked[0] for _ in added))
    ]
    kinds = (AgentKind.VEHICLE,) * len(starts)
    sample = TrafficSample(
        ids=(*asked, *added),
        kinds=kinds,
        size_m=default_sizes_m(kinds),
        position_m=np.stack([one["position_m"] for one in starts]) + moved,
        heading_rad=np.stack([one["heading_rad"] for one in starts]),
        velocity_mps=np.stack([one["velocity_mps"] for one in starts]),
    )
    return ReplaceTraffic(
        sample=sample,
        generator="test",
        model_sha256="abc",
        seed=draw(st.integers(0, 2**31)),
        request=RequestSummary(
            agent_ids=asked,
            num_new_agents={AgentKind.VEHICLE: len(added)},
            moving_share=draw(st.none() | st.floats(0, 1)),
            only_on_road=draw(st.booleans()),
            num_denoising_steps=draw(st.none() | st.integers(1, 50)),
            guidance=(GuidanceSetting(name="speed", parameters={"limit": 3.5}),),
        ),
    )


@on_scenario
def continuations(draw: st.DrawFn, scenario: Scenario) -> ContinueScene:
    """Some agents go on, some of them only later or not to the end; one may enter."""
    agents, now = scenario.agents, scenario.current_step
    ids = draw(present(scenario))
    count = draw(st.integers(1, agents.num_steps - now + 5))
    part = agents.cut_to(slice(now, now + count)).taken(agents.rows(ids))
    left = part.without_future(draw(st.integers(0, count - 1)), count)
    added = new_agent_ids(scenario, draw(st.integers(0, 1)), "entering")
    enters = replace(left.taken(range(len(added))), ids=added)
    return ContinueScene(
        motion=RolledMotion.of(left.joined(enters)),
        generator="test",
        seed=draw(st.integers(0, 2**31)),
        policies=dict.fromkeys(ids[:1], "idm"),
    )


@on_scenario
def activities(draw: st.DrawFn, scenario: Scenario) -> SetAgentActivity:
    ids = draw(present(scenario))
    now = scenario.current_step
    speed = scenario.agents.speed_mps()[scenario.agents.rows(ids), now]
    standing = (Activity.UNKNOWN, Activity.PARKED, Activity.WAITING)
    suits = standing if (speed < MOVING_MPS).any() else (Activity.DRIVING,)
    return SetAgentActivity(agent_ids=ids, activity=draw(st.sampled_from(suits)))


@on_scenario
def duplications(draw: st.DrawFn, scenario: Scenario) -> DuplicateAgents:
    ids = draw(present(scenario))
    return DuplicateAgents(
        agent_ids=ids,
        new_ids=new_agent_ids(scenario, len(ids), "copy"),
        dx_m=draw(numbers(-10, 10)),
        dy_m=draw(numbers(-10, 10)),
    )


def terms(scenario: Scenario) -> st.SearchStrategy[GuidanceTerm]:
    weight = numbers(0, 10)
    goal = st.builds(
        GoalPoint,
        agent_id=st.sampled_from(scenario.agents.ids),
        point_m=st.tuples(numbers(-90, 150), numbers(-10, 10)),
        at_s=st.none() | numbers(0.1, 6),
        weight=weight,
        is_on=st.booleans(),
    )
    limit = st.builds(
        SpeedLimit,
        agent_ids=some_of(list(scenario.agents.ids)),
        speed_mps=numbers(1, 30),
        weight=weight,
    )
    return goal | limit


def placements(scenario: Scenario) -> st.SearchStrategy[PlaceAgent]:
    return st.builds(
        PlaceAgent,
        agent_id=st.just(new_agent_id(scenario)),
        kind=st.sampled_from(AgentKind),
        x_m=numbers(-90, 150),
        y_m=numbers(-10, 10),
        heading_rad=numbers(-4, 4),
        speed_mps=numbers(0, 25),
        back_cast=st.booleans(),
    )


STRATEGIES: dict[type[Command], Callable[[Scenario], st.SearchStrategy[Command]]] = {
    SampleSignals: lambda _: st.builds(SampleSignals, seed=st.integers(0, 99)),
    GiveGreen: lambda _: st.builds(GiveGreen, lane_id=st.sampled_from([91, 92, 93])),
    RemoveSignals: lambda _: st.just(RemoveSignals()),
    SetRoadWarp: lambda _: st.builds(
        SetRoadWarp,
        warp=st.none() | warps(),
        friction_coefficient=st.none() | numbers(0.1, 1.2),
    ),
    TransformAgents: lambda scenario: st.builds(
        TransformAgents,
        agent_ids=present(scenario),
        dx_m=numbers(-40, 40),
        dy_m=numbers(-10, 10),
        rotation_rad=numbers(-7, 7),
    ),
    SetAgentPosition: lambda scenario: st.builds(
        SetAgentPosition,
        agent_id=st.sampled_from(present_ids(scenario)),
        x_m=numbers(-90, 150),
        y_m=numbers(-10, 10),
    ),
    SetAgentHeading: lambda scenario: st.builds(
        SetAgentHeading, agent_ids=present(scenario), heading_rad=numbers(-7, 7)
    ),
    SnapToLane: lambda scenario: st.builds(SnapToLane, agent_ids=present(scenario)),
    SetAgentSpeed: lambda scenario: st.builds(
        SetAgentSpeed, agent_ids=present(scenario), speed_mps=numbers(-10, 30)
    ),
    PullSpeed: lambda scenario: st.builds(
        PullSpeed,
        agent_id=st.sampled_from(lasting_ids(scenario)),
        time_s=numbers(0.1, 2.9),
        speed_mps=numbers(0, 30),
    ),
    SlowToFrictionLimit: lambda scenario: st.builds(
        SlowToFrictionLimit,
        agent_ids=present(scenario),
        friction_coefficient=numbers(0.1, 1.2),
    ),
    SlowToComfort: lambda scenario: st.builds(
        SlowToComfort, agent_ids=present(scenario)
    ),
    YieldToOthers: lambda scenario: st.builds(
        YieldToOthers, agent_ids=present(scenario)
    ),
    AdoptTrajectory: adoptions,
    SetAgentActivity: activities,
    SetAgentKind: lambda scenario: st.builds(
        SetAgentKind,
        agent_ids=some_of(list(scenario.agents.ids)),
        kind=st.sampled_from(AgentKind),
    ),
    SetAgentSize: lambda scenario: st.builds(
        SetAgentSize,
        agent_ids=some_of(list(scenario.agents.ids)),
        length_m=numbers(0.2, 30),
        width_m=numbers(0.2, 30),
    ),
    PlaceAgent: placements,
    RegeneratedEdit: lambda scenario: st.builds(
        RegeneratedEdit,
        edit=STRATEGIES[TransformAgents](scenario) | STRATEGIES[SetRoadWarp](scenario),
        traffic=replacements(scenario),
    ),
    DuplicateAgents: duplications,
    DeleteAgents: lambda scenario: st.builds(
        DeleteAgents, agent_ids=some_of(list(scenario.agents.ids))
    ),
    RemoveAllAgents: lambda _: st.just(RemoveAllAgents()),
    SetFocalAgent: lambda scenario: st.builds(
        SetFocalAgent, agent_id=st.sampled_from(present_ids(scenario))
    ),
    AddGuidance: lambda scenario: st.builds(AddGuidance, term=terms(scenario)),
    ChangeGuidance: lambda scenario: st.builds(
        ChangeGuidance, index=st.integers(0, 1), term=terms(scenario)
    ),
    RemoveGuidance: lambda _: st.builds(RemoveGuidance, index=st.integers(0, 1)),
    SetLocks: lambda scenario: st.builds(
        SetLocks, agent_ids=present(scenario), lock=st.none() | locks()
    ),
    ReplaceTraffic: replacements,
    ContinueScene: continuations,
    BeginAt: lambda scenario: st.builds(
        BeginAt,
        time_s=st.integers(
            -scenario.current_step, scenario.time_axis.num_future_steps
        ).map(lambda steps: steps * scenario.time_axis.step_s),
        keeps_guidance=st.booleans(),
    ),
}
"""How to draw each command on a scenario; most of them apply, some do not."""


ON_TRAFFIC = sorted(
    set(STRATEGIES) - {RemoveAllAgents, ContinueScene, BeginAt}, key=str
)
"""Commands after which there is somebody left, and time, to apply others to."""


def any_command(scenario: Scenario) -> st.SearchStrategy[Command]:
    return st.one_of([STRATEGIES[kind](scenario) for kind in ON_TRAFFIC])


ignore_random_checks = pytest.mark.filterwarnings(
    "ignore:Do not use the .random. module:"
    "hypothesis.errors.HypothesisDeprecationWarning"
)
"""The shape checker looks at random items of tuples, also within strategies."""
