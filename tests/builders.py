"""Small hand-made scenes for tests."""

import numpy as np

from pd_editor.scene.agent_kind import AgentCategory, AgentKind, default_sizes_m
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import DrivableArea, Lane, LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

LANE_WIDTH_M = 3.5


def straight_lane(
    lane_id: int,
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    successors: tuple[int, ...] = (),
    predecessors: tuple[int, ...] = (),
    left_neighbor: int | None = None,
    right_neighbor: int | None = None,
    kind: LaneKind = LaneKind.VEHICLE,
    is_intersection: bool = False,
) -> Lane:
    """A straight lane from start to end, points every 2 m or so."""
    ends = np.array([start, end], float)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    fraction = np.linspace(0, 1, max(int(length / 2), 1) + 1)[:, None]
    center = ends[0] + fraction * (ends[1] - ends[0])
    along = (ends[1] - ends[0]) / length
    left = np.array([-along[1], along[0]]) * LANE_WIDTH_M / 2

    def lifted(points: np.ndarray) -> np.ndarray:
        return np.column_stack([points, np.zeros(len(points))])

    return Lane(
        lane_id=lane_id,
        kind=kind,
        is_intersection=is_intersection,
        centerline=lifted(center),
        left=lifted(center + left),
        right=lifted(center - left),
        left_mark=LaneMark.DASHED_WHITE,
        right_mark=LaneMark.SOLID_WHITE,
        successors=successors,
        predecessors=predecessors,
        left_neighbor=left_neighbor,
        right_neighbor=right_neighbor,
    )


def two_lane_road() -> RoadMap:
    """Two lanes side by side along +x from -100 to 200 m, two segments each.

    Lanes 1 -> 2 run at y = 0, lanes 3 -> 4 at y = 3.5, all eastwards.
    """
    width = LANE_WIDTH_M
    return RoadMap(
        lanes=(
            straight_lane(1, (-100, 0), (50, 0), successors=(2,), left_neighbor=3),
            straight_lane(2, (50, 0), (200, 0), predecessors=(1,), left_neighbor=4),
            straight_lane(
                3, (-100, width), (50, width), successors=(4,), right_neighbor=1
            ),
            straight_lane(
                4, (50, width), (200, width), predecessors=(3,), right_neighbor=2
            ),
        ),
        drivable_areas=(
            DrivableArea(
                area_id=1,
                boundary=np.array(
                    [
                        [-100.0, -1.75, 0],
                        [200.0, -1.75, 0],
                        [200.0, 5.25, 0],
                        [-100.0, 5.25, 0],
                    ]
                ),
            ),
        ),
    )


def straight_drivers(
    states: list[tuple[float, float, float, float]],
    *,
    kinds: tuple[AgentKind, ...] | None = None,
    time_axis: TimeAxis | None = None,
) -> AgentTracks:
    """Agents (x, y, heading, speed at the current step) at constant velocity."""
    axis = time_axis or TimeAxis()
    table = np.array(states, float).reshape(-1, 4)
    heading = np.repeat(table[:, 2:3], axis.num_steps, axis=1)
    direction = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=-1)
    velocity = table[:, 3:4] * direction
    time = axis.times_s()
    position = table[:, None, :2] + time[None, :, None] * velocity[:, None, :]
    count = len(table)
    kinds = kinds or (AgentKind.VEHICLE,) * count
    steps = np.arange(axis.num_steps)
    return AgentTracks(
        ids=tuple(str(100 + row) for row in range(count)),
        kinds=kinds,
        categories=(AgentCategory.FOCAL,) * min(count, 1)
        + (AgentCategory.SCORED,) * max(count - 1, 0),
        size_m=default_sizes_m(kinds),
        has_known_size=np.zeros(count, bool),
        position_m=position,
        heading_rad=heading,
        velocity_mps=np.repeat(velocity[:, None], axis.num_steps, axis=1),
        is_valid=np.ones((count, axis.num_steps), bool),
        observed=np.tile(steps <= axis.current_step, (count, 1)),
    )


def scenario_with(agents: AgentTracks, road_map: RoadMap | None = None) -> Scenario:
    """A scenario on the two-lane road."""
    return Scenario(
        scenario_id="two-lane-road",
        city="nowhere",
        origin_city_m=np.array([1000.0, -2000.0]),
        road_map=road_map or two_lane_road(),
        agents=agents,
        time_axis=TimeAxis(),
        focal_id=agents.ids[0] if len(agents) else "",
    )


def two_agents_that_pass() -> Scenario:
    """Side by side on two lanes at 10 m/s; they never touch."""
    return scenario_with(straight_drivers([(0, 0, 0, 10), (0, LANE_WIDTH_M, 0, 10)]))


def two_agents_that_collide() -> Scenario:
    """The follower at 10 m/s runs into a standing car 20 m ahead."""
    return scenario_with(straight_drivers([(0, 0, 0, 10), (20, 0, 0, 0)]))


def empty_tracks(num_steps: int) -> AgentTracks:
    """Tracks without agents."""
    return AgentTracks(
        ids=(),
        kinds=(),
        categories=(),
        size_m=np.zeros((0, 2)),
        has_known_size=np.zeros(0, bool),
        position_m=np.zeros((0, num_steps, 2)),
        heading_rad=np.zeros((0, num_steps)),
        velocity_mps=np.zeros((0, num_steps, 2)),
        is_valid=np.zeros((0, num_steps), bool),
        observed=np.zeros((0, num_steps), bool),
    )
