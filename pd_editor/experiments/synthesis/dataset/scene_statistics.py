"""Quantities of a scene by which synthetic and real scenes are compared."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.box_overlaps import local_density, nearest_distance
from pd_editor.analysis.metrics.distribution_distance import Histogram, histogram_of
from pd_editor.analysis.metrics.lanes import nearest_edge
from pd_editor.analysis.metrics.motion import Kinematics, kinematics, motion_values
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import MaskedValues
from pd_editor.scene.agent_kind import AgentGroup, AgentKind
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.paths.lanes.nearest_lane import LaneMatch, nearest_lanes
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

TURNING_DEG: Final = 30.0
"""Change of heading in the window beyond which an agent turns."""
TURNING_PATH_M: Final = 5.0
"""Least length of paths whose turns are measured."""
START_M: Final = 2.0
"""Least displacement of a start; tracks of parked vehicles drift by up to this."""
_COMPARED_STEPS: Final = slice(10, 46, 5)
"""Steps whose accelerations are compared. Fits are one-sided at the first steps, and
tracks of Argoverse 2 decelerate to rest in their last second."""
_KINDS: Final = tuple(AgentKind)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredScene:
    """A scene with cached intermediate values of several quantities."""

    scenario: Scenario

    @cached_property
    def everyone(self) -> TrafficView:
        """View of all road users at the current step."""
        return recorded_traffic(self.scenario)

    @cached_property
    def motor_vehicles(self) -> TrafficView:
        """View of the motor vehicles, with the other road users as context."""
        view = self.everyone
        rows = np.flatnonzero(view.agents.is_in("movers"))
        names = [view.agents.ids[row] for row in rows]
        return recorded_traffic(self.scenario, names)

    @cached_property
    def moves(self) -> Bool[np.ndarray, "A"]:
        """Which motor vehicles move at the current step."""
        velocity = self.motor_vehicles.agents.velocity_mps[:, 0]
        return np.hypot(velocity[:, 0], velocity[:, 1]) > MOVING_MPS

    @cached_property
    def motion(self) -> Kinematics:
        """Derivatives of the motor vehicles' paths."""
        return kinematics(self.motor_vehicles)

    @cached_property
    def lanes(self) -> LaneMatch:
        """Lane nearest to each motor vehicle at the current step."""
        agents = self.motor_vehicles.agents
        return nearest_lanes(
            self.scenario.road_map,
            agents.position_m[:, 0],
            heading_rad=agents.heading_rad[:, 0],
        )


_Measure = Callable[[MeasuredScene], MaskedValues]


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """Something measured, and the bins of its histogram."""

    name: str
    unit: str
    """Unit; "share" for quantities that are 0 or 1."""
    bins: Histogram
    measure: _Measure

    def distance(
        self, one: Float[np.ndarray, "N"], other: Float[np.ndarray, "M"]
    ) -> float:
        """Jensen-Shannon distance of two non-empty sets."""
        return self.bins.distance(one, other).root


def _quantities() -> tuple[Quantity, ...]:
    quantities: list[Quantity] = []

    def add(
        name: str, unit: str, low: float, high: float, num: int, measure: _Measure
    ) -> None:
        bins = Histogram(metric=name, source="ours", low=low, high=high, num_bins=num)
        quantities.append(Quantity(name=name, unit=unit, bins=bins, measure=measure))

    def as_in_tables(name: str, metric: str, measure: _Measure) -> None:
        bins, unit = histogram_of(metric, "ours"), _UNITS[metric]
        quantities.append(Quantity(name=name, unit=unit, bins=bins, measure=measure))

    as_in_tables("speed", "speed", lambda s: _motion(s, "speed"))
    as_in_tables("speed of the moving", "speed", _speed_of_moving)
    add("standing", "share", 0, 1, 2, lambda s: _motion(s, "standing"))
    add("standing that start", "share", 0, 1, 2, _starts)
    as_in_tables("nearest agent", "nearest_distance", _nearest)
    as_in_tables("local density", "local_density", _density)
    as_in_tables("lateral deviation", "nearest_edge", lambda s: _edge(s, 0))
    as_in_tables("angular deviation", "nearest_edge_angle", lambda s: _edge(s, 1))
    add("offset from lane, moving", "m", 0, 4, 20, lambda s: _offset(s, moving=True))
    add(
        "offset from lane, standing", "m", 0, 12, 24, lambda s: _offset(s, moving=False)
    )
    add("angle to lane, moving", "deg", 0, 30, 30, lambda s: _angle(s, moving=True))
    add("angle to lane, standing", "deg", 0, 90, 30, lambda s: _angle(s, moving=False))
    as_in_tables("path in 6 s", "path_length", lambda s: _motion(s, "path_length"))
    as_in_tables(
        "longitudinal acceleration",
        "longitudinal_acceleration",
        lambda s: _while_moving(s, s.motion.longitudinal_mps2),
    )
    as_in_tables(
        "lateral acceleration",
        "lateral_acceleration",
        lambda s: _while_moving(s, s.motion.lateral_mps2),
    )
    add("heading change in 6 s", "deg", -120, 120, 40, _heading_change)
    add("turning", "share", 0, 1, 2, _turning)
    add("agents in a scene", "", 0, 120, 24, lambda s: _count(s, None))
    add("movers in a scene", "", 0, 80, 20, lambda s: _count(s, "movers"))
    add("pedestrians in a scene", "", 0, 40, 20, lambda s: _count(s, "pedestrians"))
    add("kind", "", 0, len(_KINDS), len(_KINDS), _kind)
    add("lanes in a scene", "", 0, 160, 20, _lane_count)
    add("length of lanes", "m", 0, 120, 30, _lane_length)
    add("curvature of lanes", "1/m", 0, 0.2, 40, _lane_curvature)
    add("lanes in junctions", "share", 0, 1, 2, _lane_in_junction)
    return tuple(quantities)


_UNITS: Final = {
    "speed": "m/s",
    "nearest_distance": "m",
    "local_density": "m",
    "nearest_edge": "m",
    "nearest_edge_angle": "deg",
    "path_length": "m",
    "longitudinal_acceleration": "m/s^2",
    "lateral_acceleration": "m/s^2",
}


def _rows(value: np.ndarray, is_valid: np.ndarray | None = None) -> MaskedValues:
    valid = np.ones(value.shape, bool) if is_valid is None else is_valid
    return MaskedValues(value=np.asarray(value, float), is_valid=valid)


def _motion(scene: MeasuredScene, name: str) -> MaskedValues:
    found = motion_values(scene.motor_vehicles)[name]
    return _rows(found.value, found.is_valid)


def _speed_of_moving(scene: MeasuredScene) -> MaskedValues:
    return _rows(_motion(scene, "speed").value, scene.moves)


def _starts(scene: MeasuredScene) -> MaskedValues:
    """Whether agents that stand at the current step have started by the last step."""
    agents, stands = scene.motor_vehicles.agents, _motion(scene, "standing").value > 0
    away = np.linalg.norm(agents.position_m[:, -1] - agents.position_m[:, 0], axis=-1)
    return _rows(away > START_M, stands & agents.is_valid.all(axis=1))


def _nearest(scene: MeasuredScene) -> MaskedValues:
    found = nearest_distance(scene.motor_vehicles)
    return _rows(found.value, found.is_valid)


def _density(scene: MeasuredScene) -> MaskedValues:
    found = local_density(scene.motor_vehicles)
    return _rows(found.value, found.is_valid)


def _edge(scene: MeasuredScene, which: int) -> MaskedValues:
    found = nearest_edge(scene.motor_vehicles)[which]
    return _rows(found.value, found.is_valid)


def _offset(scene: MeasuredScene, *, moving: bool) -> MaskedValues:
    return _rows(scene.lanes.distance_m, scene.lanes.is_valid & (scene.moves == moving))


def _angle(scene: MeasuredScene, *, moving: bool) -> MaskedValues:
    heading = scene.motor_vehicles.agents.heading_rad[:, 0]
    angle = np.abs(np.degrees(wrap_angle(heading - scene.lanes.heading_rad)))
    return _rows(angle, scene.lanes.is_valid & (scene.moves == moving))


def _while_moving(scene: MeasuredScene, value: np.ndarray) -> MaskedValues:
    motion = scene.motion
    valid = motion.is_valid & (motion.speed_mps > MOVING_MPS)
    return _rows(value[:, _COMPARED_STEPS], valid[:, _COMPARED_STEPS])


def _heading_change(scene: MeasuredScene) -> MaskedValues:
    """Accumulated change of heading of agents with a long enough path, in degrees."""
    agents = scene.motor_vehicles.agents
    both = agents.is_valid[:, 1:] & agents.is_valid[:, :-1]
    turn = wrap_angle(np.diff(agents.heading_rad, axis=1))
    total = np.degrees(np.where(both, turn, 0.0).sum(axis=1))
    far = _motion(scene, "path_length").value > TURNING_PATH_M
    return _rows(total, far & agents.is_valid.all(axis=1))


def _turning(scene: MeasuredScene) -> MaskedValues:
    change = _heading_change(scene)
    return _rows(np.abs(change.value) > TURNING_DEG, change.is_valid)


def _count(scene: MeasuredScene, group: AgentGroup | None) -> MaskedValues:
    agents = scene.everyone.agents
    if group is None:
        return _rows(np.array([len(agents)]))
    return _rows(np.array([agents.is_in(group).sum()]))


def _kind(scene: MeasuredScene) -> MaskedValues:
    kinds = scene.everyone.agents.kinds
    return _rows(np.array([_KINDS.index(kind) + 0.5 for kind in kinds], float))


def _lane_count(scene: MeasuredScene) -> MaskedValues:
    return _rows(np.array([len(scene.scenario.road_map.lanes)]))


def _lane_length(scene: MeasuredScene) -> MaskedValues:
    lanes = scene.scenario.road_map.lanes
    return _rows(np.array([arc_length(lane.centerline_m)[-1] for lane in lanes], float))


def _lane_curvature(scene: MeasuredScene) -> MaskedValues:
    """Change of direction from a lane's start to its end, divided by its length."""
    found = []
    for lane in scene.scenario.road_map.lanes:
        steps = np.diff(lane.centerline_m, axis=0)
        turn = wrap_angle(np.diff(heading_of(steps))).sum()
        found.append(abs(turn) / max(arc_length(lane.centerline_m)[-1], 1.0))
    return _rows(np.array(found, float))


def _lane_in_junction(scene: MeasuredScene) -> MaskedValues:
    lanes = scene.scenario.road_map.lanes
    return _rows(np.array([lane.is_intersection for lane in lanes], float))


QUANTITIES: Final[tuple[Quantity, ...]] = _quantities()
"""All compared quantities; of motor vehicles unless their names say otherwise."""
