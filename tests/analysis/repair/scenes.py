"""Random scenes on the two-lane road, and independent oracles for repairs."""

import numpy as np
import shapely
from hypothesis import strategies as st

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.paths.lanes.route_choice import lane_kinds_of
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers

KINDS = (
    AgentKind.VEHICLE,
    AgentKind.VEHICLE,
    AgentKind.BUS,
    AgentKind.CYCLIST,
    AgentKind.PEDESTRIAN,
    AgentKind.RIDERLESS_BICYCLE,
    AgentKind.STATIC,
)

Crowd = tuple[list[tuple[float, float, float, float]], tuple[AgentKind, ...]]
"""States (x, y, heading, speed) and kinds; made a scene outside the strategy."""


@st.composite
def crowds(draw, max_agents: int = 7) -> Crowd:
    """A few agents close together, on and off the lanes, at all sorts of angles."""
    count = draw(st.integers(1, max_agents))
    number = st.floats(0, 1, allow_subnormal=False)
    states, kinds = [], []
    for _ in range(count):
        turned = draw(st.sampled_from([0.0, 0.0, 0.3, -0.3, 1.2, 3.1]))
        speed = draw(st.sampled_from([0.0, 0.2, 3.0, 8.0, 15.0]))
        x, y = -20 + 60 * draw(number), -7 + 16 * draw(number)
        states.append((x, y, turned, speed))
        kinds.append(draw(st.sampled_from(KINDS)))
    return states, tuple(kinds)


def crowded_road(crowd: Crowd) -> Scenario:
    """The drawn agents on the two-lane road."""
    states, kinds = crowd
    return scenario_with(straight_drivers(states, kinds=kinds))


def boxes(scenario: Scenario, step: int) -> list[shapely.Polygon | None]:
    """Each agent's box at a step; None where it does not exist."""
    agents = scenario.agents
    corners = box_corners(
        agents.position_m[:, step], agents.heading_rad[:, step], agents.size_m
    )
    return [
        shapely.Polygon(ring) if there else None
        for ring, there in zip(corners, agents.is_valid[:, step], strict=True)
    ]


def overlaps_at(scenario: Scenario, step: int) -> set[tuple[int, int]]:
    """Pairs of rows that share more than 0.05 m^2, by shapely."""
    shapes = boxes(scenario, step)
    return {
        (one, two)
        for two in range(len(shapes))
        for one in range(two)
        if shapes[one] is not None
        and shapes[two] is not None
        and shapes[one].intersection(shapes[two]).area > 0.05
    }


def overlaps_later(scenario: Scenario) -> set[tuple[int, int]]:
    """Pairs of rows that overlap at any step after the current one."""
    steps = range(scenario.current_step + 1, scenario.time_axis.num_steps)
    return set().union(*(overlaps_at(scenario, step) for step in steps))


def off_lane_m(scenario: Scenario) -> np.ndarray:
    """Distance of every agent to the nearest centre line it may follow, now."""
    points = shapely.points(scenario.agents.position_m[:, scenario.current_step])
    found = np.zeros(len(points))
    for row, kind in enumerate(scenario.agents.kinds):
        lanes = [
            shapely.LineString(lane.centerline_m)
            for lane in scenario.road_map.lanes
            if lane.kind in lane_kinds_of(kind)
        ]
        if lanes:
            found[row] = shapely.distance(shapely.MultiLineString(lanes), points[row])
    return found


def changed_ids(before: Scenario, after: Scenario) -> set[str]:
    """Agents whose tracks differ in any way."""
    one, two = before.agents, after.agents
    same = (one.position_m == two.position_m).all((1, 2))
    same &= (one.heading_rad == two.heading_rad).all(1)
    same &= (one.velocity_mps == two.velocity_mps).all((1, 2))
    return {one.ids[row] for row in np.flatnonzero(~same)}
