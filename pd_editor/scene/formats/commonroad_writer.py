"""Writes scenes as CommonRoad 2020a scenarios."""

from collections.abc import Collection
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float, Int
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.plain_text import csv_file
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.scene_format import IDS_NAME, WrittenScene, losses_of
from pd_editor.scene.formats.xml_file import EDITOR, as_file
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.road_map import Crosswalk, Lane, LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState

TYPES: Final = {
    AgentKind.VEHICLE: "car",
    AgentKind.BUS: "bus",
    AgentKind.MOTORCYCLIST: "motorcycle",
    AgentKind.CYCLIST: "bicycle",
    AgentKind.PEDESTRIAN: "pedestrian",
}
"""Types of obstacles; those of other kinds are unknown."""
MARKS: Final = {
    LaneMark.SOLID_WHITE: "solid",
    LaneMark.DASHED_WHITE: "dashed",
    LaneMark.NONE: "no_marking",
}
"""Markings; those of other colours, and double ones, are unknown."""
LANE_TYPES: Final = {LaneKind.BIKE: "bicycleLane", LaneKind.BUS: "busLane"}
_DECIMALS: Final = 4
_ANGLE_DECIMALS: Final = 6
_GOAL_M: Final = (5.0, 2.0)
"""Length and width of the goal region around the ego's last place."""
_GOAL_TURN: Final = 0.2
_CENTER_M: Final = 0.01
"""Centre lines that are nearer to midway between the bounds leave these where they are."""
_LEAST_STEP_M: Final = 0.01
_LOSSES: Final[tuple[str, ...]] = (
    "Bounds of bent lanes, moved up to 0.4 m: the centre line has to be midway.",
    "Colours of lane markings and double lines: CommonRoad knows solid and dashed ones.",
    "Velocities to the side: a state has one speed along its heading.",
)
_KEEPS: Final = frozenset(
    {"signals", "shared signals", "links", "neighbors", "lane kinds", "junctions"}
    | {"marks", "crosswalks"}
)


def write(scenario: Scenario) -> WrittenScene:
    """Files of a scenario: the XML, and a table of the ids in it.

    Steps are counted from the scenario's first one; the ego, or without one the focal
    agent, is the planning problem, which begins at the current step; without either there
    is none. Coordinates are those of the city.
    """
    agents, origin = scenario.agents, scenario.origin_city_m
    ego, root = _ego_row(scenario), _root(scenario)
    known = scenario.road_map.lane_of
    for lane in scenario.road_map.lanes:
        _lanelet(root, lane, origin, scenario.road_map)
    next_id = 1 + max((*known, *(c.crosswalk_id for c in scenario.road_map.crosswalks)))
    for walk in scenario.road_map.crosswalks:
        next_id = _crosswalk(root, walk, origin, known, next_id)
    next_id = _lights(root, scenario, next_id)
    rows: list[tuple[str, int]] = []
    place = agents.position_m + origin
    for row, name in enumerate(agents.ids):
        if row == ego:
            continue
        for steps in unbroken_parts(agents.is_valid[row]):
            rows.append((name, next_id))
            _obstacle(root, scenario, row, place, steps, next_id)
            next_id += 1
    renamed = {name: str(number) for name, number in reversed(rows)}
    losses: list[str] = list(_LOSSES)
    if ego is None:
        losses.append(
            "A planning problem, which the schema demands and readers do not."
        )
    else:
        name = agents.ids[ego]
        losses.append(
            f"Trajectory, size and kind of {name}: the planning problem has its start "
            "and its goal."
        )
        rows.append((name, next_id))
        _problem(root, scenario, ego, place, next_id)
        renamed[name] = EGO_ID
    split = len(rows) - len(agents)
    if scenario.signals:
        losses.append("Signals after the last step: their states begin again.")
    if split:
        losses.append(f"Gaps in tracks: {split} further obstacles go on after one.")
    return WrittenScene(
        files={
            f"{scenario.scenario_id}.xml": as_file(root),
            IDS_NAME: csv_file([("agent", "obstacle"), *rows]),
        },
        losses=losses_of(
            scenario, *losses, keeps=_KEEPS if ego is None else _KEEPS | {"now"}
        ),
        renamed=renamed,
    )


def _ego_row(scenario: Scenario) -> int | None:
    """Row of the agent whose start is the planning problem."""
    agents, now = scenario.agents, scenario.current_step
    rows = (agents.row_of.get(name) for name in (EGO_ID, scenario.focal_id))
    return next(
        (row for row in rows if row is not None and agents.is_valid[row, now]), None
    )


def _root(scenario: Scenario) -> etree._Element:
    """The root with what the format demands of a scenario as a whole."""
    root = etree.Element(
        "commonRoad",
        timeStepSize=f"{scenario.time_axis.step_s:g}",
        commonRoadVersion="2020a",
        author=EDITOR,
        affiliation="",
        source=scenario.provenance.attribution or "",
        benchmarkID=scenario.scenario_id,
        date="1970-01-01",
    )
    location = _child(root, "location")
    for name, value in (
        ("geoNameId", "-999"),
        ("gpsLatitude", "999"),
        ("gpsLongitude", "999"),
    ):
        _child(location, name, value)
    _child(_child(root, "scenarioTags"), "urban")
    return root


def _lanelet(
    root: etree._Element,
    lane: Lane,
    origin: Float[np.ndarray, "2"],
    road_map: RoadMap,
) -> None:
    known = road_map.lane_of
    found = _child(root, "lanelet", id=str(lane.lane_id))
    left, right = _bounds_around(lane)
    left, right = left + origin, right + origin
    _bound(found, "leftBound", left, MARKS.get(lane.left_mark, "unknown"))
    _bound(found, "rightBound", right, MARKS.get(lane.right_mark, "unknown"))
    for tag, ids in (
        ("predecessor", lane.predecessors),
        ("successor", lane.successors),
    ):
        for one in ids:
            if one in known:
                _child(found, tag, ref=str(one))
    for tag, one in (
        ("adjacentLeft", lane.left_neighbor),
        ("adjacentRight", lane.right_neighbor),
    ):
        if one in known:
            way = "opposite" if (lane.lane_id, one) in road_map.oncoming else "same"
            _child(found, tag, ref=str(one), drivingDir=way)
    _child(found, "laneletType", LANE_TYPES.get(lane.kind, "urban"))
    if lane.is_intersection:
        _child(found, "laneletType", "intersection")


def _crosswalk(
    root: etree._Element,
    walk: Crosswalk,
    origin: Float[np.ndarray, "2"],
    known: Collection[int],
    next_id: int,
) -> int:
    """Add a crosswalk, with another id where a lane has its own; the next free id."""
    own = walk.crosswalk_id
    if own in known:
        own, next_id = next_id, next_id + 1
    found = _child(root, "lanelet", id=str(own))
    one, two = walk.edge1[:, :2] + origin, walk.edge2[:, :2] + origin
    if np.hypot(*(one[-1] - two[-1])) > np.hypot(*(one[-1] - two[0])):
        two = two[::-1]
    left, right = _paired(one, two)
    for tag, line in (("leftBound", left), ("rightBound", right)):
        _bound(found, tag, line, "unknown")
    _child(found, "laneletType", "crosswalk")
    return next_id


def _lights(root: etree._Element, scenario: Scenario, next_id: int) -> int:
    """Add the signals, with cycles of their states, and stop lines; the next free id."""
    lanelet_of = {one.get("id"): one for one in root.iterfind("lanelet")}
    stops = iter(scenario.stop_lines_m() + scenario.origin_city_m)
    for number, signal in enumerate(scenario.signals, start=next_id):
        cycle = _child(_child(root, "trafficLight", id=str(number)), "cycle")
        for states in np.split(
            signal.states, np.flatnonzero(np.diff(signal.states)) + 1
        ):
            part = _child(cycle, "cycleElement")
            _child(part, "duration", str(len(states)))
            _child(part, "color", WORDS[SignalState(states[0])][1])
        for lane in signal.lane_ids:
            lanelet, (left, _, right) = lanelet_of[str(lane)], next(stops)
            line = etree.Element("stopLine")
            _point(line, *left)
            _point(line, *right)
            _child(line, "lineMarking", "solid")
            lanelet.find("laneletType").addprevious(line)
            _child(lanelet, "trafficLightRef", ref=str(number))
    return next_id + len(scenario.signals)


def _bounds_around(
    lane: Lane,
) -> tuple[Float[np.ndarray, "K 2"], Float[np.ndarray, "K 2"]]:
    """Bounds with paired points, moved until the centre line is midway between them.

    Midway between all points of bounds that bend is elsewhere than between few of them.
    """
    bounds, center = _paired(lane.left_m, lane.right_m), lane.centerline_m
    middle = (bounds[0] + bounds[1]) / 2
    way = arc_length(middle)
    own = shapely.LineString(middle)
    bends = np.asarray(shapely.line_locate_point(own, shapely.points(center)))
    is_new = np.abs(bends[:, None] - way).min(axis=1) > _LEAST_STEP_M
    every = np.sort(np.concatenate([way, bends[is_new]]))
    left, right = (_at_shares(bound, way, every) for bound in bounds)
    middle = (left + right) / 2
    longer = shapely.LineString(
        [2 * center[0] - center[1], *center, 2 * center[-1] - center[-2]]
    )
    at = shapely.line_locate_point(longer, shapely.points(middle))
    step = shapely.get_coordinates(shapely.line_interpolate_point(longer, at)) - middle
    far = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.maximum(far - _CENTER_M, 0.0) / np.maximum(far, _CENTER_M)
    return left + step, right + step


def _paired(
    one: Float[np.ndarray, "N 2"], two: Float[np.ndarray, "M 2"]
) -> tuple[Float[np.ndarray, "K 2"], Float[np.ndarray, "K 2"]]:
    """Both lines with points at equal shares of their lengths, with all that they had."""
    ways = [arc_length(line) for line in (one, two)]
    shares = [way / max(way[-1], 1e-9) for way in ways]
    every = np.unique(np.round(np.concatenate(shares), 9))
    return (
        _at_shares(one, shares[0], every),
        _at_shares(two, shares[1], every),
    )


def _at_shares(
    line: Float[np.ndarray, "N 2"],
    share: Float[np.ndarray, "N"],
    every: Float[np.ndarray, "K"],
) -> Float[np.ndarray, "K 2"]:
    return np.stack([np.interp(every, share, column) for column in line.T], axis=-1)


def _bound(
    lanelet: etree._Element, tag: str, line: Float[np.ndarray, "K 2"], mark: str
) -> None:
    bound = _child(lanelet, tag)
    if np.ptp(line, axis=0).max() < _LEAST_STEP_M:
        # Around which a lane turns; a bound has two points.
        line = line + _LEAST_STEP_M * np.linspace(0.0, 1.0, len(line))[:, None]
    for x, y in line:
        _point(bound, x, y)
    _child(bound, "lineMarking", mark)


def unbroken_parts(is_valid: np.ndarray) -> list[Int[np.ndarray, "N"]]:
    """Steps of each unbroken part of a track."""
    steps = np.flatnonzero(is_valid)
    return [
        part
        for part in np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1)
        if len(part)
    ]


def _obstacle(
    root: etree._Element,
    scenario: Scenario,
    row: int,
    place: Float[np.ndarray, "A T 2"],
    steps: Int[np.ndarray, "N"],
    number: int,
) -> None:
    agents = scenario.agents
    found = _child(root, "dynamicObstacle", id=str(number))
    _child(found, "type", TYPES.get(agents.kinds[row], "unknown"))
    box = _child(_child(found, "shape"), "rectangle")
    for tag, value in zip(("length", "width"), agents.size_m[row], strict=True):
        _child(box, tag, _text(value))
    first, *others = steps.tolist()
    _state(_child(found, "initialState"), scenario, row, place, first)
    if others:
        trajectory = _child(found, "trajectory")
        for step in others:
            _state(_child(trajectory, "state"), scenario, row, place, step)


def _problem(
    root: etree._Element,
    scenario: Scenario,
    row: int,
    place: Float[np.ndarray, "A T 2"],
    number: int,
) -> None:
    """The planning problem: start at the current step, goal at the last known place."""
    agents, now = scenario.agents, scenario.current_step
    found = _child(root, "planningProblem", id=str(number))
    start = _child(found, "initialState")
    _state(start, scenario, row, place, now)
    for tag in ("yawRate", "slipAngle"):
        _child(_child(start, tag), "exact", "0.0")
    last = int(np.flatnonzero(agents.is_valid[row])[-1])
    goal = _child(found, "goalState")
    _interval(_child(goal, "time"), max(last, now + 1), max(last, now + 1))
    box = _child(_child(goal, "position"), "rectangle")
    for tag, value in zip(("length", "width"), _GOAL_M, strict=True):
        _child(box, tag, _text(value))
    heading = float(agents.heading_rad[row, last])
    _child(box, "orientation", _angle(heading))
    center = _child(box, "center")
    for tag, value in zip("xy", place[row, last], strict=True):
        _child(center, tag, _text(value))
    turn = _child(goal, "orientation")
    low = max(heading - _GOAL_TURN, -np.pi)
    _child(turn, "intervalStart", _angle(low))
    _child(turn, "intervalEnd", _angle(min(heading + _GOAL_TURN, np.pi)))


def _state(
    state: etree._Element,
    scenario: Scenario,
    row: int,
    place: Float[np.ndarray, "A T 2"],
    step: int,
) -> None:
    agents = scenario.agents
    heading = agents.heading_rad[row, step]
    velocity = agents.velocity_mps[row, step]
    ahead = float(velocity @ unit_vector(heading))
    speed = float(np.hypot(*velocity)) * (-1 if ahead < 0 else 1)
    _point(_child(state, "position"), *place[row, step])
    for tag, value in (
        ("orientation", _angle(heading)),
        ("time", str(step)),
        ("velocity", _text(speed)),
    ):
        _child(_child(state, tag), "exact", value)


def _interval(parent: etree._Element, first: int, last: int) -> None:
    _child(parent, "intervalStart", str(first))
    _child(parent, "intervalEnd", str(last))


def _point(parent: etree._Element, x: float, y: float) -> None:
    point = _child(parent, "point")
    _child(point, "x", _text(x))
    _child(point, "y", _text(y))


def _child(
    parent: etree._Element, tag: str, text: str | None = None, **attributes: str
) -> etree._Element:
    found = etree.SubElement(parent, tag, **attributes)
    found.text = text
    return found


def _text(value: float) -> str:
    return f"{value + 0.0:.{_DECIMALS}f}"


def _angle(value: float) -> str:
    return f"{value + 0.0:.{_ANGLE_DECIMALS}f}"
