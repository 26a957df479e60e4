"""CommonRoad scenarios, versions 2017a, 2018b and 2020a (XML)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.commonroad_writer import LANE_TYPES, MARKS, TYPES, write
from pd_editor.scene.formats.file_scene import FileScene, FileTrack, headings_on_the_way
from pd_editor.scene.formats.file_signal import FileSignal, cyclic_signal
from pd_editor.scene.formats.missing_links import with_missing_links
from pd_editor.scene.formats.packed_file import stem_of
from pd_editor.scene.formats.scene_format import SceneFormat, has_root
from pd_editor.scene.formats.xml_file import Place, parse_xml, told_of
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.geometry.polyline import (
    midline,
    onward,
    turns_back,
    ways_of_bounds,
    without_repeats,
)
from pd_editor.scene.road_map import Crosswalk, Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_STEPS

VERSIONS: Final = ("2017a", "2018b", "2020a")
_VEHICLES: Final = ("truck", "taxi", "priorityVehicle", "parkedVehicle")
_STATIC: Final = ("roadBoundary", "building", "pillar", "median_strip")
_KINDS: Final = {
    **{word: kind for kind, word in TYPES.items()},
    **dict.fromkeys(_VEHICLES, AgentKind.VEHICLE),
    **dict.fromkeys(_STATIC, AgentKind.STATIC),
    "train": AgentKind.BUS,
    "constructionZone": AgentKind.CONSTRUCTION,
}
"""Kinds of obstacles; all others are of unknown kind."""
_FINEST: Final = 100
"""Steps of a file for one of a scene, at most."""
_OBSTACLES: Final = frozenset({"obstacle", "staticObstacle", "dynamicObstacle"})
_LANE_KINDS: Final = {word: kind for kind, word in LANE_TYPES.items()}
_NO_LANES: Final = frozenset({"crosswalk", "sidewalk"})
_TWO_WAY: Final = "userBidirectional[.='vehicle' or .='car' or .='bus' or .='truck']"
_SOURCES: Final = (
    "author", "affiliation", "source", "license", "licence", "copyright"
)  # fmt: skip
_MARKS: Final = {
    f"{wide}{word}": mark for mark, word in MARKS.items() for wide in ("", "broad_")
}

_Box = tuple[tuple[float, float], float, tuple[float, float]]
"""Length and width of a box, its turn and its centre."""


def read(path: Path) -> Scenario:
    """Read a scenario: lanelets, obstacles, and the planning problem's start as the ego.

    Signs are left out, since scenes have no place for them.

    Raises:
        FormatError: the file is damaged, or of another version.
    """
    root, data = parse_xml(path, "commonRoad")
    version = root.attribute("commonRoadVersion")
    if version not in VERSIONS:
        raise root.error(
            f"is of version {version[:20]!r}; expected {' or '.join(VERSIONS)}."
        )
    step_s = root.number("timeStepSize")
    if not step_s > 0:
        raise root.error(f"has steps of {step_s:g} s; expected more than 0.")
    second = _second_ways(root)
    lanes, crosswalks, mended = _roads(root, second)
    lanes, linked = _linked(lanes, second)
    tracks, notes = _obstacles(root, step_s)
    notes += [*mended, *linked]
    problems = root.children("planningProblem")
    ego_id, now_s = "", 0.0
    if problems:
        ego = _start(problems[0], step_s)
        ego_id, now_s = ego.track_id, float(ego.time_s[0])
        if ego_id in {one.track_id for one in tracks}:
            raise problems[0].error(
                "has the id of an obstacle; expected one of its own."
            )
        tracks.append(ego)
        notes.append(
            f"AV is the start of planning problem {ego_id} (of {len(problems)}), which "
            "has no trajectory."
        )
    if second:
        notes.append(f"{len(second)} lanelets are for both ways, each as two lanes.")
    if signs := len(root.children("trafficSign")):
        notes.append(f"{signs} traffic signs are left out.")
    others = len(
        root.children("environmentObstacle") + root.children("phantomObstacle")
    )
    if others:
        notes.append(f"{others} environment and phantom obstacles are left out.")
    return FileScene(
        path=path,
        name=root.get("benchmarkID", stem_of(path)),
        lanes=lanes,
        crosswalks=crosswalks,
        tracks=tuple(tracks),
        signals=tuple(_signals(root, step_s)),
        current_s=now_s,
        ego_id=ego_id,
        notes=tuple(notes),
        attribution=told_of(root.element, *_SOURCES),
    ).scenario(data)


def _second_ways(root: Place) -> dict[int, int]:
    """Numbers of the second ways of lanelets that are for both ways."""
    ids = [one.integer("id") for one in root.children("lanelet")]
    both = [Place(root.path, n) for n in root.element.xpath(f"lanelet[{_TWO_WAY}]")]
    return {one.integer("id"): max(ids) + n for n, one in enumerate(both, start=1)}


def _linked(
    lanes: tuple[Lane, ...], second: Mapping[int, int]
) -> tuple[tuple[Lane, ...], list[str]]:
    """Lanes with the links that files leave out: all, or those of second ways; a note."""
    is_told = any(one.successors or one.predecessors for one in lanes)
    ways = {*second.values()}
    return with_missing_links(
        lanes,
        lambda one, other: not is_told or bool(ways & {one.lane_id, other.lane_id}),
    )


def _roads(
    root: Place, second: Mapping[int, int]
) -> tuple[tuple[Lane, ...], tuple[Crosswalk, ...], list[str]]:
    """Lanelets for vehicles as lanes, crosswalks apart; a note on those that were mended.

    ``second`` has the numbers of the second ways of lanelets that are for both ways.
    """
    in_junction = _junction_ids(root)
    lanes: list[Lane] = []
    crosswalks: list[Crosswalk] = []
    mended: dict[str, list[int]] = {}
    seen: set[int] = set()
    for place in root.children("lanelet"):
        number = place.integer("id")
        if number in seen:
            raise place.error("comes twice; expected ids that are unique.")
        seen.add(number)
        types = {one.element.text or "" for one in place.children("laneletType")}
        left, right = _bound(place, "leftBound"), _bound(place, "rightBound")
        marks = _mark(place.child("leftBound")), _mark(place.child("rightBound"))
        beside = [_beside(place, name, second) for name in ("Left", "Right")]
        ways = ways_of_bounds(left[:, :2], right[:, :2])
        if ways == (-1, -1):
            left, right, marks, beside = right, left, marks[::-1], beside[::-1]
        elif ways != (1, 1):
            left, right = left[:: ways[0]], right[:: ways[1]]
        if ways != (1, 1) and not types & _NO_LANES:
            mended.setdefault("lay the wrong way round", []).append(number)
        num_points = len(without_repeats(left)) + len(without_repeats(right))
        left, right, center = _lines(place, left, right)
        if len(left) + len(right) < num_points and not types & _NO_LANES:
            mended.setdefault("turned back, and now go on", []).append(number)
        if "crosswalk" in types:
            crosswalks.append(Crosswalk(crosswalk_id=number, edge1=left, edge2=right))
        if types & _NO_LANES:
            continue
        kinds = (_LANE_KINDS[one] for one in types if one in _LANE_KINDS)
        lanes.append(
            Lane(
                lane_id=number,
                kind=next(kinds, LaneKind.VEHICLE),
                is_intersection="intersection" in types or number in in_junction,
                centerline=center,
                left=left,
                right=right,
                left_mark=marks[0],
                right_mark=marks[1],
                successors=_refs(place, "successor"),
                predecessors=_refs(place, "predecessor"),
                left_neighbor=beside[0][0],
                right_neighbor=beside[1][0],
            )
        )
        if number in second:
            lanes.append(_turned(lanes[-1], second, beside))
    told = [
        f"Bounds of {len(ids)} lanelets {what}: {', '.join(map(str, ids[:6]))}."
        for what, ids in mended.items()
    ]
    return tuple(lanes), tuple(crosswalks), told


def _lines(
    place: Place, left: Float[np.ndarray, "L 3"], right: Float[np.ndarray, "R 3"]
) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    """Bounds and centre line, without points at which the lanelet turns back."""
    # Midway between points of the same number, as in commonroad-io.
    center = (left + right) / 2 if len(left) == len(right) else midline(left, right)
    left, right, center = map(without_repeats, (left, right, center))
    if len(turns_back(center)):
        left, right = onward(left), onward(right)
        center = without_repeats(midline(left, right))
    if min(map(len, (left, right, center))) < 2:
        raise place.error("has a bound that leads back to where it begins.")
    return left, right, center


def _junction_ids(root: Place) -> set[int]:
    """Lanelets that lead through intersections."""
    return {
        successor
        for intersection in root.children("intersection")
        for incoming in intersection.children("incoming")
        for name in ("successorsRight", "successorsStraight", "successorsLeft")
        for successor in _refs(incoming, name)
    }


def _bound(place: Place, name: str) -> Float[np.ndarray, "N 3"]:
    bound = place.child(name)
    points = np.array([_point(one) for one in bound.children("point")], float)
    points = points.reshape(-1, 3)
    if len(without_repeats(points)) < 2:
        raise bound.error("has fewer than two different points.")
    return points


def _point(place: Place) -> tuple[float, float, float]:
    z = next((one.number() for one in place.children("z")), 0.0)
    return place.child("x").number(), place.child("y").number(), z


def _mark(bound: Place) -> LaneMark:
    return _MARKS.get(bound.text("lineMarking"), LaneMark.UNKNOWN)


def _signals(root: Place, step_s: float) -> Iterator[FileSignal]:
    """Traffic lights with the lanelets that refer to them, and with their cycles."""
    stops: dict[int, dict[int, Float[np.ndarray, "2"] | None]] = {}
    for lanelet in root.children("lanelet"):
        lines = lanelet.children("stopLine")
        lights = [n for one in (lanelet, *lines) for n in _refs(one, "trafficLightRef")]
        points = [_point(one) for line in lines for one in line.children("point")]
        if lights:
            # Without a line of its own, it is at the end of the lanelet.
            ends = [_bound(lanelet, f"{side}Bound")[-1] for side in ("left", "right")]
            stop = np.mean(points or ends, axis=0)[:2]
            for number in lights:
                stops.setdefault(number, {})[lanelet.integer("id")] = stop
    for light in root.children("trafficLight"):
        cycles = [] if light.text("active") == "false" else light.children("cycle")
        parts = [part for one in cycles for part in one.children("cycleElement")]
        steps = [part.child("duration").number() for part in parts]
        if not all(one > 0 for one in steps):
            raise light.error("has an element that does not last; expected steps.")
        colors = [part.text("color") for part in parts]
        offset = sum(n.number() for one in cycles for n in one.children("timeOffset"))
        yield cyclic_signal(
            str(light.integer("id")),
            stops.get(light.integer("id"), {}),
            [(step_s * n, color) for n, color in zip(steps, colors, strict=True)],
            step_s * offset,
        )


def _refs(place: Place, name: str) -> tuple[int, ...]:
    return tuple(one.integer("ref") for one in place.children(name))


def _beside(
    place: Place, side: str, second: Mapping[int, int]
) -> tuple[int | None, int | None]:
    """The lanes beside a lanelet that lead the same way, and the opposite one."""
    for one in place.children(f"adjacent{side}"):
        number, other = one.integer("ref"), second.get(one.integer("ref"))
        is_same = one.get("drivingDir") == "same"
        return (number, other) if is_same else (other, number)
    return None, None


def _turned(
    lane: Lane, second: Mapping[int, int], beside: Sequence[Sequence[int | None]]
) -> Lane:
    """The second way of a lanelet; ``beside`` has neighbours to its right and left."""
    return replace(
        lane,
        lane_id=second[lane.lane_id],
        centerline=lane.centerline[::-1],
        left=lane.right[::-1],
        right=lane.left[::-1],
        left_mark=lane.right_mark,
        right_mark=lane.left_mark,
        successors=tuple(second[one] for one in lane.predecessors if one in second),
        predecessors=tuple(second[one] for one in lane.successors if one in second),
        left_neighbor=beside[1][1],
        right_neighbor=beside[0][1],
    )


def _obstacles(root: Place, step_s: float) -> tuple[list[FileTrack], list[str]]:
    tracks: list[FileTrack] = []
    notes: list[str] = []
    states = [
        state
        for tag in ("obstacle", "dynamicObstacle")
        for part in ("trajectory/state", "occupancySet/occupancy")
        for state in root.children(f"{tag}/{part}")
    ]
    last_s = max((step_s * _value(one, "time") for one in states), default=step_s)
    for place in root.children("*"):
        if place.element.tag in _OBSTACLES:
            track = _obstacle(place, step_s, last_s)
            if track.track_id in {one.track_id for one in tracks}:
                raise place.error("comes twice; expected ids that are unique.")
            tracks.append(track)
    without = [one.track_id for one in tracks if len(one.time_s) == 1]
    if without:
        notes.append(
            f"{len(without)} obstacles have a first state but no trajectory: "
            f"{', '.join(without[:6])}."
        )
    return tracks, notes


def _obstacle(place: Place, step_s: float, last_s: float) -> FileTrack:
    is_static = place.element.tag == "staticObstacle" or place.text("role") == "static"
    size, turn, offset = _shape(place)
    time, x, y, told, speed = np.array(list(_states(place, step_s))).T
    position = np.stack([x, y], axis=-1)
    heading = headings_on_the_way(time, position, told)
    velocity = unit_vector(told) * speed[:, None]
    if is_static and (last_s - time[0]) / step_s > MAX_STEPS * _FINEST:
        raise place.error("would have too many states; expected fewer or longer steps.")
    if is_static:
        time = np.arange(time[0], last_s + step_s / 2, step_s)
        position, heading = (
            one[:1].repeat(len(time), 0) for one in (position, heading)
        )
        velocity = np.zeros((len(time), 2))
    if (np.diff(time) <= 0).any():
        raise place.error("has states whose times do not increase.")
    ahead = unit_vector(heading)
    position = position + offset[0] * ahead + offset[1] * left_of(ahead)
    return FileTrack(
        track_id=place.attribute("id"),
        kind=_KINDS.get(place.text("type"), AgentKind.UNKNOWN),
        size_m=size,
        time_s=time,
        position_m=position,
        heading_rad=heading + turn,
        velocity_mps=velocity,
        longest_gap_s=1.5 * step_s,
    )


def _states(place: Place, step_s: float) -> Iterator[tuple[float, ...]]:
    """Time, x, y, heading and speed of an obstacle's states, the last two maybe NaN.

    Of a prediction by occupancies these are its middles; states without a place are left out.
    """
    states = place.children("trajectory/state[position]")
    # In 2017a, a trajectory may have the first one.
    first = (
        place.children("initialState") or states[:1] or [place.child("initialState")]
    )[0]
    begin = _value(first, "time")
    for one in (first, *(n for n in states if _value(n, "time") != begin)):
        told = (_value(one, name, np.nan) for name in ("orientation", "velocity"))
        yield step_s * _value(one, "time"), *_position(one), *told
    for one in place.children("occupancySet/occupancy"):
        shapes, number = one.children("shape/*"), _value(one, "time")
        if number > begin and (boxes := _boxes(shapes)):
            is_box = len(shapes) == 1 and shapes[0].children("orientation")
            turn = boxes[0][1] if is_box else np.nan
            yield step_s * number, *_whole(boxes)[2], turn, np.nan


def _start(problem: Place, step_s: float) -> FileTrack:
    """The ego's first state."""
    state = problem.child("initialState")
    heading = np.array([_value(state, "orientation")])
    return FileTrack(
        track_id=problem.attribute("id"),
        kind=AgentKind.VEHICLE,
        size_m=None,
        time_s=np.array([step_s * _value(state, "time")]),
        position_m=np.array([_position(state)]),
        heading_rad=heading,
        velocity_mps=unit_vector(heading) * _value(state, "velocity", 0.0),
    )


def _shape(
    place: Place,
) -> tuple[tuple[float, float] | None, float, tuple[float, float]]:
    """Length and width of the box, its turn and its centre in the obstacle's frame."""
    boxes = [box for one in place.children("shape/*") if (box := _box(one))]
    return _whole(boxes) if boxes else (None, 0.0, (0.0, 0.0))


def _boxes(shapes: Sequence[Place]) -> list[_Box]:
    """Boxes of shapes that have a place of their own."""
    placed = (n for n in shapes if n.element.tag == "polygon" or n.children("center"))
    return [box for one in placed if (box := _box(one)) is not None]


def _whole(boxes: Sequence[_Box]) -> _Box:
    """The only box, or one around all."""
    if len(boxes) == 1:
        return boxes[0]
    corners = [
        box_corners(*map(np.array, (center, turn, size)))
        for size, turn, center in boxes
    ]
    return _around(np.concatenate(corners))


def _box(one: Place) -> _Box | None:
    center = next((_point(n)[:2] for n in one.children("center")), (0.0, 0.0))
    if one.element.tag == "rectangle":
        size = one.child("length").number(), one.child("width").number()
        turn = next((n.number() for n in one.children("orientation")), 0.0)
        return size, turn, center
    if one.element.tag == "circle":
        across = 2 * one.child("radius").number()
        return (across, across), 0.0, center
    if one.element.tag == "polygon" and len(points := one.children("point")):
        return _around(np.array([_point(p)[:2] for p in points]))
    return None


def _around(points: Float[np.ndarray, "N 2"]) -> _Box:
    low, high = points.min(axis=0), points.max(axis=0)
    length, width = np.maximum(high - low, 0.1).tolist()
    x, y = ((low + high) / 2).tolist()
    return (length, width), 0.0, (x, y)


def _position(state: Place) -> tuple[float, float]:
    """A point, or the middle of shapes."""
    position = state.child("position")
    for one in position.children("point"):
        return _point(one)[:2]
    if boxes := _boxes(position.children("*")):
        return _whole(boxes)[2]
    raise position.error("has no point; expected one.")


def _value(state: Place, name: str, default: float | None = None) -> float:
    """A number of a state, exact or the middle of an interval."""
    if default is not None and state.element.find(name) is None:
        return default
    place = state.child(name)
    for one in place.children("exact"):
        return one.number()
    low, high = place.child("intervalStart"), place.child("intervalEnd")
    return (low.number() + high.number()) / 2


COMMONROAD: Final = SceneFormat(
    name="commonroad",
    title="CommonRoad",
    endings=(".xml",),
    recognises=has_root("commonroad"),
    read=read,
    write=write,
)
