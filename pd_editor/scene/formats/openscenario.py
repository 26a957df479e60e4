"""ASAM OpenSCENARIO 1.x on OpenDRIVE roads: entities that stand or follow trajectories.

Written, it is 1.2, in which each agent follows its trajectory: the reference point of an
entity is the centre of its box; agents that come later are added at their first step, and
all are deleted after their last one.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import FormatError
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, DEFAULT_SIZE_M, AgentKind
from pd_editor.scene.formats.commonroad_writer import unbroken_parts
from pd_editor.scene.formats.file_scene import FileTrack, headings_on_the_way
from pd_editor.scene.formats.lane_drive import NEAR_M, Driver, RoadLanes
from pd_editor.scene.formats.packed_file import named_by
from pd_editor.scene.formats.parameters import insert_catalogs, set_parameters
from pd_editor.scene.formats.recorded_map import USUAL_WIDTH_M
from pd_editor.scene.formats.reference_line import Clothoid
from pd_editor.scene.formats.xml_file import EDITOR, Place, added, as_file, parse_xml
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.scene_limits import MAX_LINES_M, MAX_STEPS
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis

ENDING: Final = ".xosc"
EGO_NAME: Final = "Ego"
VEHICLES: Final = {
    AgentKind.VEHICLE: "car",
    AgentKind.BUS: "bus",
    AgentKind.MOTORCYCLIST: "motorbike",
    AgentKind.CYCLIST: "bicycle",
}
"""Categories of vehicles; all others but pedestrians are obstacles."""
_DATE: Final = "1970-01-01T00:00:00"
_WHEEL_M: Final = 0.7
_MOST: Final = 100.0
"""Speed, acceleration and braking that no trajectory exceeds."""
_VERTEX: Final = (
    '<Vertex time="%.10g"><Position><WorldPosition x="%.10g" y="%.10g" h="%.10g"/>'
    "</Position></Vertex>"
)
_EGO: Final = re.compile("(?i)ego(?![a-z])|ego_?(vehicle|car)|hero$")
"""Names of the car that is tested."""
_ONCE: Final = {"priority": "override", "maximumExecutionCount": "1"}
_KINDS: Final = {
    **{word: kind for kind, word in VEHICLES.items()},
    **dict.fromkeys(("train", "tram"), AgentKind.BUS),
}
"""Kinds by categories of vehicles; others are as ``car``."""
_OTHER_KINDS: Final = {"Pedestrian": AgentKind.PEDESTRIAN, "Misc": AgentKind.STATIC}
"""Kinds by elements of entities, or names of their catalogs."""
_LAMPS: Final = {
    "on;off;off": "red",
    "on;on;off": "redYellow",
    "off;on;off": "yellow",
    "off;off;on": "green",
    "off;off;off": "unknown",
}
_PLACES: Final = (
    "WorldPosition", "GeoPosition", "LanePosition", "RoadPosition", "RelativeWorldPosition",
    "RelativeObjectPosition", "RelativeRoadPosition", "RelativeLanePosition",
    "RoutePosition",
)  # fmt: skip
_WITHIN: Final = re.compile("(Private|Global|Routing|Longitudinal|Lateral|)Action")
"""Elements around actions."""
_MOVES: Final = (
    "SpeedAction", "SpeedProfileAction", "LaneChangeAction", "LaneOffsetAction",
    "AssignRouteAction", "AcquirePositionAction", "SynchronizeAction",
    "LongitudinalDistanceAction",
)  # fmt: skip
_RULES: Final = {
    "greaterThan": np.greater, "lessThan": np.less, "notEqualTo": np.not_equal,
    "greaterOrEqual": np.greater_equal, "lessOrEqual": np.less_equal,
}  # fmt: skip
_USUAL_LIMITS: Final = {"Acceleration": 3.0, "Deceleration": 5.0, "Speed": 70.0}
"""Limits of who keeps a distance, where the file has none."""
_LATERAL_MPS2: Final = 1.0
"""Acceleration of changes of the offset from the lane."""
_STEP_S: Final = TimeAxis().step_s
_DIGITS: Final = 6
"""Digits of seconds in which two states of an entity differ."""
Pose = tuple[float, float, float]
"""x, y, and heading, which is NaN if it is not told."""
Phases = dict[str, tuple[str, tuple[tuple[float, str], ...]]]
Project = Callable[[float, float], Float[np.ndarray, "2"] | None]
"""Tells x and y of a latitude and a longitude, if that is known."""
Locate = Callable[[Place, str, int | None, float, float], tuple[Pose, float]]
"""Tells the pose of a place on a road, and how far it is beside the road's line.

It is given by an element for errors, the road, the lane, s, and the offset from the middle of
the lane: without a lane, from the line.
"""
_FINE_M: Final = 0.2
"""Step in which curves are followed."""
_MOST_POINTS: Final = 10_000
_MOST_RELATIVE: Final = 50
"""Entities in a row of which each is placed relative to the next."""


@dataclass(frozen=True)
class _Spot:
    """A pose, and its road, lane, s and distance beside the road's line, if these are known."""

    pose: Pose
    road: tuple[str, int | None, float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What a file tells of traffic, in the frame of its road network."""

    tracks: tuple[FileTrack, ...] = ()
    ego_id: str = ""
    current_s: float | None = None
    phases: Phases = field(default_factory=dict)
    """Of lights, by id: their controller, and seconds and words of its phases."""
    notes: tuple[str, ...] = ()
    data: bytes = b""
    """Bytes of the file."""


def scenario_root(path: Path) -> tuple[Place, bytes]:
    """Root of a file with values of parameters and entries of catalogs; its bytes.

    Raises:
        FormatError: the file is damaged, or of another version than 1.
    """
    root, data = parse_xml(path, "OpenSCENARIO")
    header = root.child("FileHeader")
    if (major := header.integer("revMajor")) != 1:
        raise header.error(f"is of version {major}; expected 1.")
    set_parameters(root.element)
    data += insert_catalogs(root)
    return root, data


def road_network_of(root: Place) -> Path:
    """The file of the road network: where the scenario says, or beside it.

    Raises:
        FormatError: it is not there.
    """
    file = root.child("RoadNetwork").child("LogicFile")
    told = file.attribute("filepath")
    places = named_by(root.path, told)
    town = [one.with_name(f"{one.name}.xodr") for one in places[-1:]]
    for one in (*places, *town):
        if one.is_file():
            return one
    raise file.error(f"names {told[:80]!r}, which is neither there nor beside it.")


def motion_of(
    root: Place, data: bytes, locate: Locate, project: Project, graph: RoadLanes
) -> Motion:
    """Entities on a road network; what is not read is told in notes.

    Raises:
        FormatError: an element is damaged, or names a place that is not there.
    """
    story = _Story(root, locate, project, graph)
    tracks, notes = story.tracks()
    described = root.child("FileHeader").get("description")
    current = re.search(r"current at (\d+(?:\.\d*)?) s$", described)
    # How those go on that have no trajectory may be up to a controller.
    is_open = story.is_driven or any(len(one.time_s) == 1 for one in tracks)
    egos = sorted((one.track_id for one in tracks if _EGO.match(one.track_id)), key=len)
    return Motion(
        tracks=tracks,
        ego_id=egos[0] if egos else "",
        current_s=float(current[1]) if current else (0.0 if is_open else None),
        phases=_phases(root),
        notes=notes,
        data=data,
    )


class _Story:
    """States of entities, as the actions of a file lead to them."""

    def __init__(
        self, root: Place, locate: Locate, project: Project, graph: RoadLanes
    ) -> None:
        self._root, self._locate, self._project = root, locate, project
        self._graph = graph
        self._lasting: dict[str, tuple[float, float]] = {}
        """When events begin and end, by their names and those of their actions."""
        self._states: defaultdict[str, dict[float, Pose]] = defaultdict(dict)
        self._ends_s: dict[str, float] = {}
        self._speeds: dict[str, float] = {}
        self._acting: set[str] = set()
        self._unread: set[str] = set()
        self._spots: dict[tuple[str, float], _Spot | None] = {}
        self._depth = 0
        self._is_timed, self.is_driven = True, False
        self._drivers: dict[str, Driver] = {}
        self._courses: dict[str, tuple[Float[np.ndarray, "T 2"], Any] | None] = {}
        self._follows_s: dict[str, float] = {}
        """When the first trajectories of entities begin."""
        board = root.child("Storyboard")
        self._begins = {
            private.get("entityRef"): position
            for private in board.children("Init/Actions/Private")
            for position in private.children("PrivateAction/TeleportAction/Position")
        }
        self._times_s = _times_s(board)
        privates = board.children("Init/Actions/Private")
        # Places and speeds first, which trajectories without times are followed from.
        for tag in ("TeleportAction", "SpeedAction", ""):
            for private in privates:
                for part in private.children(f".//{tag}") if tag else [private]:
                    self._act(part, (private.attribute("entityRef"),), 0.0)
        pending = [
            (act, event, tuple(one.attribute("entityRef") for one in actors))
            for act in board.children("Story/Act")
            for group in act.children("ManeuverGroup")
            for actors in [group.children("Actors/EntityRef")]
            for event in group.children("Maneuver/Event")
        ]
        for _, event, names in pending:
            if event.element.find("Action/PrivateAction") is not None:
                self._acting.update(names)
        # What happens first decides on what else does.
        rest = [
            (self._event_s(*one), _depends(one[0]) or _depends(one[1]), one)
            for one in pending
        ]
        while rest:
            first = min(rest, key=lambda row: row[0])
            rest.remove(first)
            start_s, _, (_, event, names) = first
            end_s = self._act(event, names, start_s)
            self._courses.clear()
            for one in (event, *event.children("Action")):
                self._lasting[one.get("name")] = start_s, end_s
            if np.isfinite(start_s):
                rest = [
                    (self._event_s(*one), True, one) if is_open else (time, False, one)
                    for time, is_open, one in rest
                ]

    def _event_s(self, act: Place, event: Place, names: tuple[str, ...]) -> float:
        act_s = self._start_s(act, 0.0, names)
        self._lasting[act.get("name")] = act_s, np.inf
        return max(act_s, self._start_s(event, act_s, names))

    def _start_s(self, place: Place, after_s: float, names: tuple[str, ...]) -> float:
        """When an act or an event starts: 0 without a trigger, infinity if that is unknown."""
        groups = place.children("StartTrigger/ConditionGroup")
        met = [
            [self._met_s(n, after_s, names) for n in one.children("Condition")]
            for one in groups
        ]
        return min((max(one, default=0.0) for one in met), default=0.0)

    def _met_s(self, condition: Place, after_s: float, names: tuple[str, ...]) -> float:
        delay_s = condition.number("delay", 0.0)
        for one in condition.children("ByValueCondition/SimulationTimeCondition"):
            return one.number("value") + delay_s
        for one in condition.children("*/StoryboardElementStateCondition"):
            begin_s, end_s = self._lasting.get(
                one.get("storyboardElementRef"), (np.inf, np.inf)
            )
            is_begin = one.get("state") in ("startTransition", "runningState")
            return (begin_s if is_begin else end_s) + delay_s
        for one in condition.children("ByEntityCondition"):
            told = one.children("TriggeringEntities/EntityRef")
            actors = [n.attribute("entityRef") for n in told] or names
            for rule in one.children("EntityCondition/*"):
                holds = [self._holds(rule, name) for name in actors]
                known = np.array([n for n in holds if n is not None], bool)
                if len(known):
                    is_all = one.children(
                        "TriggeringEntities[@triggeringEntitiesRule='all']"
                    )
                    met = known.all(axis=0) if is_all else known.any(axis=0)
                    rows = np.flatnonzero(met & (self._times_s >= after_s))
                    return (
                        float(self._times_s[rows[0]]) + delay_s if len(rows) else np.inf
                    )
        return np.inf

    def _course(self, name: str) -> tuple[Float[np.ndarray, "T 2"], Any] | None:
        """Places and speeds of an entity; None if they are unknown."""
        if name not in self._courses:
            self._courses[name] = self._new_course(name)
        return self._courses[name]

    def _new_course(self, name: str) -> tuple[Float[np.ndarray, "T 2"], Any] | None:
        driver, own = self._drivers.get(name), self._states[name]
        if len(own) > 1:
            times = np.array(sorted(own))
            table = np.array([own[time][:2] for time in times.tolist()])
            place = np.stack([np.interp(self._times_s, times, n) for n in table.T], -1)
            return place, np.hypot(*np.gradient(place, self._times_s, axis=0).T)
        if driver is None:
            return None
        late = len(self._times_s) - len(driver.times_s)
        place = np.pad(driver.states()[0], ((late, 0), (0, 0)), constant_values=np.nan)
        return place, np.pad(driver.speed_mps, (late, 0), constant_values=np.nan)

    def _holds(self, rule: Place, name: str) -> Bool[np.ndarray, "T"] | None:
        """When a condition on an entity holds; None if that is not read."""
        own, tag = self._course(name), rule.element.tag
        other = self._course(rule.get("entityRef")) if rule.get("entityRef") else None
        if other is None:
            for position in rule.children("Position"):
                if (spot := self._spot_if_any(position)) is not None:
                    other = np.array([spot.pose[:2]]), np.zeros(1)
        if own is None or _unread_value(rule, tag):
            return None
        place, speed = own
        if tag == "TraveledDistanceCondition":
            moved = np.hypot(*np.diff(place, axis=0).T)
            return np.append(0.0, np.cumsum(moved)) >= rule.number("value")
        if tag == "SpeedCondition":
            return _compared(speed, rule)
        if tag == "StandStillCondition":
            step = np.arange(len(speed))
            moved = np.maximum.accumulate(np.where(speed < STANDING_MPS, -1, step))
            return step - moved > round(rule.number("duration", 0.0) / _STEP_S)
        if tag == "AccelerationCondition":
            return _compared(np.gradient(speed, _STEP_S), rule)
        if other is None:
            return None
        gap_m = np.hypot(*(place - other[0]).T)
        if tag == "ReachPositionCondition":
            return gap_m <= rule.number("tolerance")
        if tag in ("DistanceCondition", "RelativeDistanceCondition"):
            return _compared(gap_m, rule)
        if tag == "RelativeSpeedCondition":
            return _compared(speed - other[1], rule)
        if tag == "TimeHeadwayCondition":
            return _compared(gap_m / np.maximum(speed, 1e-6), rule)
        if tag == "TimeToCollisionCondition":
            closing = -np.gradient(gap_m, _STEP_S)
            return (closing > 0) & _compared(gap_m / np.maximum(closing, 1e-6), rule)
        return None

    def _act(self, part: Place, names: tuple[str, ...], start_s: float) -> float:
        """Take what a part tells, which starts at infinity if a condition decides; its end."""
        ends = [start_s]
        for one in part.element.iter():
            place, tag = Place(part.path, one), one.tag
            if tag == "EntityAction":
                names = (place.attribute("entityRef"),)
            elif tag == "FollowTrajectoryAction":
                self._follow(place, names, start_s)
                ends += [max(self._states[n], default=np.inf) for n in names]
            elif tag == "DeleteEntityAction":
                self._ends_s |= dict.fromkeys(names, start_s)
            elif tag in ("TeleportAction", "AddEntityAction"):
                if np.isinf(start_s):
                    self._unread.add(f"{tag} on a condition other than a time")
                elif spot := self._spot(place.child("Position"), start_s):
                    for name in names:
                        self._put(name, spot.pose, start_s)
            elif tag in _MOVES:
                ends += [self._move(place, name, start_s) for name in names]
            elif tag.endswith("Action") and not _WITHIN.fullmatch(tag):
                self._unread.add(tag)
                ends.append(np.inf)
        return max(ends)

    def _put(self, name: str, pose: Pose, time_s: float) -> None:
        """Place an entity, which goes on from there."""
        if (time := round(time_s, _DIGITS)) in self._states[name]:
            return
        self._states[name][time] = pose
        if name in self._drivers:
            driver = self._drivers[name]
            driver.place(driver.step(time_s), pose)
        elif len(times := self._times_s[self._times_s >= time_s - 1e-6]) > 1:
            self._drivers[name] = Driver(self._graph, pose, 0.0, times)

    def _move(self, action: Place, name: str, start_s: float) -> float:
        """Take an action on speed, lane or way; its end, infinity if it is not read."""
        driver, tag = self._drivers.get(name), action.element.tag
        if start_s == 0 and tag == "SpeedAction":
            for target in action.children("SpeedActionTarget/AbsoluteTargetSpeed"):
                if not _unread_value(target, "AbsoluteTargetSpeed"):
                    self._speeds[name] = target.number("value")
        end_s = None
        if driver is not None and start_s <= driver.times_s[-1]:
            step = driver.step(start_s)
            if tag == "SpeedAction":
                end_s = self._change_speed(action, driver, step)
            elif tag == "SpeedProfileAction":
                end_s = _profile(action, driver, step)
            elif tag in ("LaneChangeAction", "LaneOffsetAction"):
                end_s = self._change_lane(action, driver, step)
            elif tag == "SynchronizeAction":
                end_s = self._meet(action, driver, step)
            elif tag == "LongitudinalDistanceAction":
                end_s = self._keep_distance(action, name, driver, step)
            else:
                end_s = self._go_to(action, driver, step)
        if end_s is None:
            when = " on a condition" if np.isinf(start_s) else ""
            self._unread.add(f"{tag}{when}")
        return np.inf if end_s is None else end_s

    def _change_speed(self, action: Place, driver: Driver, step: int) -> float | None:
        first = float(driver.speed_mps[step])
        for target in action.children("SpeedActionTarget/*"):
            if _unread_value(target, "AbsoluteTargetSpeed", "RelativeTargetSpeed"):
                return None
            value = target.number("value")
            if target.element.tag == "RelativeTargetSpeed":
                other = self._drivers.get(target.get("entityRef"))
                if other is None:
                    return None
                theirs = float(other.speed_mps[other.step(float(driver.times_s[step]))])
                is_factor = target.get("speedTargetValueType") == "factor"
                value = theirs * value if is_factor else theirs + value
            mean = max((abs(first) + abs(value)) / 2, STANDING_MPS)
            seconds, shape = _dynamics(
                action, "SpeedActionDynamics", abs(value - first),
                lambda way, mean=mean: way / mean,
            )  # fmt: skip
            return driver.change_speed(step, value, seconds, shape)
        return None

    def _change_lane(self, action: Place, driver: Driver, step: int) -> float | None:
        """Onto another lane, or beside its middle."""
        for target in action.children("*/AbsoluteTargetLaneOffset"):
            if _unread_value(target, "AbsoluteTargetLaneOffset"):
                return None
            offset = target.number("value")
            seconds = np.sqrt(6 * abs(offset - driver.offset_m) / _LATERAL_MPS2)
            return driver.change_offset(step, offset, float(seconds))
        lane = driver.lane_at(step)
        for target in action.children("LaneChangeTarget/*") if lane else ():
            if _unread_value(target, "AbsoluteTargetLane", "RelativeTargetLane"):
                return None
            value = target.integer("value")
            if target.element.tag == "RelativeTargetLane":
                other = self._drivers.get(target.get("entityRef"))
                theirs = (
                    None
                    if other is None
                    else other.lane_at(other.step(float(driver.times_s[step])))
                )
                if theirs is None:
                    return None
                lane_id, left = self._graph.id_of(theirs)
                found = lane_id + left * value
                # No lane has the number 0.
                value = found + int(np.sign(found - lane_id)) * (lane_id * found <= 0)
            seconds, shape = _dynamics(
                action, "LaneChangeActionDynamics", USUAL_WIDTH_M,
                lambda way: driver.seconds_of(step, way),
            )  # fmt: skip
            offset = action.number("targetLaneOffset", 0.0)
            return driver.change_lane(step, value, seconds, shape, offset)
        return None

    def _go_to(self, action: Place, driver: Driver, step: int) -> float | None:
        """Along a route, or to a place."""
        places = action.children(".//Waypoint/Position") or action.children("Position")
        spots = [self._spot_if_any(one) for one in places]
        lanes = [self._graph.lane_of(*one.pose) for one in spots if one is not None]
        goals = [one[0] for one in lanes if one is not None]
        if not goals or not driver.go_to(step, goals[-1:]):
            return None
        return float(driver.times_s[step])

    def _meet(self, action: Place, driver: Driver, step: int) -> float | None:
        """At a place when another entity is nearest to one of its own."""
        master = self._course(action.get("masterEntityRef"))
        its, own = (
            self._spot_if_any(action.child(f"TargetPosition{whose}"))
            for whose in ("Master", "")
        )
        if master is None or its is None or own is None:
            return None
        begin_s = float(driver.times_s[step])
        gap = np.hypot(*(master[0] - its.pose[:2]).T)
        gap[(self._times_s < begin_s) | np.isnan(gap)] = np.inf
        row, final = int(gap.argmin()), None
        for one in action.children("FinalSpeed/*"):
            if _unread_value(one, "AbsoluteSpeed", "RelativeSpeedToMaster"):
                return None
            is_relative = one.element.tag == "RelativeSpeedToMaster"
            final = one.number("value") + is_relative * float(master[1][row])
        time_s = float(self._times_s[row])
        is_met = gap[row] <= NEAR_M
        if is_met and driver.arrive(step, np.array(own.pose[:2]), time_s, final):
            return time_s
        return None

    def _keep_distance(
        self, action: Place, name: str, driver: Driver, step: int
    ) -> float | None:
        """Behind another entity, or before it, at a distance or a time."""
        other = action.get("entityRef")
        course = self._course(other)
        if course is None or _unread_value(action, "LongitudinalDistanceAction"):
            return None
        bodies = 0.0
        if action.get("freespace") == "true":
            bodies = (self._length_m(name) + self._length_m(other)) / 2
        sign = -1.0 if action.get("displacement") == "leadingReferencedEntity" else 1.0
        distance, seconds = (
            action.number("distance", 0.0),
            action.number("timeGap", 0.0),
        )
        limits = [
            one.number(f"max{what}", _USUAL_LIMITS[what])
            for one in action.children("DynamicConstraints") or [action]
            for what in _USUAL_LIMITS
        ]
        return driver.keep_distance(
            step,
            course[0][-len(driver.times_s) :],
            lambda speed: sign * (distance + bodies + seconds * speed),
            (limits[0], limits[1], limits[2]),
            action.get("continuous") == "true",
        )

    def _length_m(self, name: str) -> float:
        places = self._root.children("Entities/ScenarioObject")
        size = next((_body(one)[1] for one in places if one.get("name") == name), None)
        return DEFAULT_SIZE_M[AgentKind.VEHICLE][0] if size is None else size[0]

    def _follow(self, action: Place, names: tuple[str, ...], start_s: float) -> None:
        """Add the states on a trajectory, at most a step apart.

        Without times it is followed at the first speed of each entity.
        """
        shapes = action.children("Trajectory/Shape/*")
        shapes += action.children("TrajectoryRef/Trajectory/Shape/*")
        line = self._line(shapes[0], start_s) if shapes else None
        timing = next(iter(action.children("TimeReference/Timing")), None)
        begin_s = start_s
        if timing is not None:
            is_absolute = timing.attribute("domainAbsoluteRelative") != "relative"
            begin_s = timing.number("offset") + (0.0 if is_absolute else start_s)
        for name in names:
            if line is None or np.isinf(begin_s):
                self._unread.add("trajectories of other shapes, or on conditions")
            elif timing is not None and np.isfinite(line[:, 0]).all():
                times = begin_s + timing.number("scale") * line[:, 0]
                self._go(name, np.column_stack([times, line[:, 1:]]))
            elif (speed := self._speeds.get(name, 0.0)) > 0:
                self._is_timed = False
                times = begin_s + arc_length(line[:, 1:3]) / speed
                bare = np.full(len(line), np.nan)
                self._go(name, np.column_stack([times, line[:, 1:3], bare]))
            else:
                self._unread.add("trajectories without times or speed")

    def _go(self, name: str, table: Float[np.ndarray, "N 4"]) -> None:
        """Add states of an entity: times, x, y and headings, which may be far apart."""
        table = table[np.argsort(table[:, 0], kind="stable")]
        times, step_s = table[:, 0], TimeAxis().step_s
        before_s = self._follows_s.get(name, np.inf)
        self._follows_s[name] = min(before_s, float(times[0]))
        if max(np.diff(times), default=0.0) > 1.5 * step_s:
            last_s = min(times[-1], times[0] + MAX_STEPS * step_s)
            times = np.union1d(times, np.arange(times[0], last_s, step_s))
            table[:, 3] = np.unwrap(table[:, 3])
        found = [np.interp(times, table[:, 0], one) for one in table[:, 1:].T]
        for time, x, y, heading in zip(times, *found, strict=True):
            self._states[name][round(float(time), _DIGITS)] = (x, y, heading)

    def _line(self, shape: Place, start_s: float) -> Float[np.ndarray, "N 4"] | None:
        """Times, which may be unknown, x, y and headings along a trajectory, if it is known."""
        tag = shape.element.tag
        corners = shape.children({"Nurbs": "ControlPoint"}.get(tag, "Vertex"))
        if tag.startswith("Clothoid"):
            return self._clothoids(shape, start_s)
        spots = [self._spot(one.child("Position"), start_s) for one in corners]
        poses = np.array([one.pose for one in spots if one]).reshape(-1, 3)
        if not len(poses) or len(poses) < len(spots):
            return None
        if tag == "Polyline":
            times = [one.number("time", np.nan) for one in corners]
            return np.column_stack([times, poses])
        if tag == "Nurbs":
            knots = np.array([one.number("value") for one in shape.children("Knot")])
            weights = np.array([one.number("weight", 1.0) for one in corners])
            order = shape.integer("order")
            if not (1 < order <= len(poses) and len(knots) == len(poses) + order):
                raise shape.error(
                    "needs as many knots as control points and its order."
                )
            points = _nurbs(order, knots, weights, poses[:, :2])
            unknown = np.full(len(points), np.nan)
            return np.column_stack([unknown, points, unknown])
        return None

    def _clothoids(
        self, shape: Place, start_s: float
    ) -> Float[np.ndarray, "N 4"] | None:
        """Times, x, y and headings along a clothoid, or a spline of them."""
        parts = shape.children("ClothoidSplineSegment")
        begins = [one.number("timeStart", np.nan) for one in parts]
        ends = [*begins[1:], shape.number("timeEnd", np.nan)]
        if not parts:
            parts, begins = [shape], [shape.number("startTime", np.nan)]
            ends = [shape.number("stopTime", np.nan)]
        pose, rows = None, []
        for part, begin_s, end_s in zip(parts, begins, ends, strict=True):
            for one in (*part.children("PositionStart"), *part.children("Position")):
                spot = self._spot(one, start_s)
                pose = None if spot is None else spot.pose
            if pose is None:
                return None
            length = part.number("length")
            if not 0 < length <= MAX_LINES_M:
                raise part.error(f"is {length:g} m long; expected more than 0.")
            growth = part.number("curvaturePrime", part.number("curvatureDot", 0.0))
            first = part.number("curvature", part.number("curvatureStart", 0.0))
            last = part.number("curvatureEnd", first + length * growth)
            x, y, heading = pose
            line = Clothoid(
                0.0, length, x, y, heading + part.number("hOffset", 0.0), first, last
            )
            s = np.linspace(0.0, length, int(np.ceil(length / _FINE_M)) + 1)
            times = begin_s + s / length * (end_s - begin_s)
            rows.append(np.column_stack([times, line.at(s)]))
            pose = tuple(rows[-1][-1, 1:].tolist())
        return np.concatenate([one[bool(n) :] for n, one in enumerate(rows)])

    def _spot(self, position: Place, start_s: float) -> _Spot | None:
        """A place by the road or by where entities begin; None, which is noted, for others."""
        (one,) = position.children("*")[:1] or [position]
        tag = one.element.tag
        relative = tag.startswith("Relative")
        near = self._at(one.get("entityRef"), start_s) if relative else None
        if unread := _unread_value(one, *_PLACES):
            self._unread.add(unread)
        elif tag == "GeoPosition" and self._on_earth(one) is None:
            self._unread.add("GeoPosition in an unknown projection")
        elif relative and (
            near is None
            or ("World" not in tag and "Object" not in tag and near.road is None)
        ):
            self._unread.add(f"{tag} to an entity whose place then is unknown")
        elif tag == "RoutePosition" and self._on_route(one) is None:
            self._unread.add("RoutePosition off routes along lanes")
        else:
            try:
                found = self._placed(one, tag, near)
            except FormatError:
                if not relative:
                    raise
                self._unread.add(f"{tag} beyond a road")
                return None
            x, y, heading = found.pose
            for turn in one.children("Orientation[@h]"):
                is_relative = turn.get("type") == "relative"
                heading = (heading if is_relative else 0.0) + turn.number("h")
            return replace(found, pose=(x, y, heading))
        return None

    def _spot_if_any(self, position: Place) -> _Spot | None:
        """A place that conditions and routes name, which may be beyond the roads."""
        try:
            return self._spot(position, 0.0)
        except FormatError:
            return None

    def _on_earth(self, one: Place) -> Float[np.ndarray, "2"] | None:
        """A place of a latitude and a longitude, before version 1.2 in radians."""
        lat, lon = (
            one.number(f"{name}Deg")
            if one.get(f"{name}Deg")
            else float(np.rad2deg(one.number(name)))
            for name in ("latitude", "longitude")
        )
        return self._project(lat, lon)

    def _placed(self, one: Place, tag: str, near: _Spot | None) -> _Spot:
        """A place without its orientation."""
        if tag == "WorldPosition":
            return _Spot((one.number("x"), one.number("y"), one.number("h", np.nan)))
        if tag == "RoutePosition" and (pose := self._on_route(one)) is not None:
            return _Spot(pose)
        if tag == "GeoPosition" and (place := self._on_earth(one)) is not None:
            x, y = place.tolist()
            return _Spot((x, y, np.nan))
        if near is not None and tag in (
            "RelativeWorldPosition",
            "RelativeObjectPosition",
        ):
            x, y, heading = near.pose
            dx, dy = one.number("dx"), one.number("dy")
            if tag == "RelativeObjectPosition":
                ahead = unit_vector(np.array(heading))
                dx, dy = (dx * ahead + dy * left_of(ahead)).tolist()
            return _Spot((x + dx, y + dy, heading))
        if near is None or near.road is None:
            lane = one.integer("laneId") if tag == "LanePosition" else None
            road, s = one.attribute("roadId"), one.number("s")
            beside = one.number(
                "t" if lane is None else "offset", 0.0 if lane else None
            )
        elif tag == "RelativeRoadPosition":
            road, lane, s, beside = near.road
            lane, s, beside = None, s + one.number("ds"), beside + one.number("dt")
        else:
            road, lane, s, _ = near.road
            step = one.integer("dLane")
            before, lane = lane or 0, (lane or 0) + step
            # No lane has the number 0.
            lane += (1 if step > 0 else -1) if before * lane <= 0 and step else 0
            s += one.number("ds", one.number("dsLane", 0.0))
            beside = one.number("offset", 0.0)
        pose, aside = self._locate(one, road, lane, s, beside)
        return _Spot(pose, (road, lane, s, aside))

    def _on_route(self, one: Place) -> Pose | None:
        """A place along a route from its first point; None if that does not follow lanes."""
        stops = one.children(".//Waypoint/Position")
        spots = [self._spot_if_any(position) for position in stops]
        lanes = [self._graph.lane_of(*n.pose) for n in spots if n is not None]
        goals = [lane[0] for lane in lanes if lane is not None]
        for place in one.children("InRoutePosition/*[@pathS]"):
            first = lanes[0] if lanes and None not in spots else None
            start = None if first is None else self._graph.onto(first, goals[-1:])
            if start is None or spots[0] is None:
                return None
            way = self._graph.way(start, MAX_LINES_M, goals[-1:])
            s = way.place_of(np.array(spots[0].pose[:2])) + place.number("pathS")
            here = way.lane_at(s)
            if place.get("laneId") and here is not None:
                beside = self._graph.beside(here, place.integer("laneId"))
                if beside is None:
                    return None
                point = way.at(np.array([s]))[0][0]
                way = self._graph.way(beside, MAX_LINES_M)
                s = way.place_of(point)
            (point,), (heading,) = way.at(np.array([s]))
            aside = place.number("laneOffset", place.number("t", 0.0))
            x, y = (point + aside * left_of(unit_vector(heading))).tolist()
            return x, y, float(heading)
        return None

    def _at(self, name: str, time_s: float) -> _Spot | None:
        """Where an entity is, unless that depends on itself or on conditions."""
        key = name, round(time_s, _DIGITS)
        if key not in self._spots and self._depth < _MOST_RELATIVE:
            self._spots[key] = None
            self._depth += 1
            self._spots[key] = self._reached(*key)
            self._depth -= 1
        return self._spots.get(key)

    def _reached(self, name: str, time_s: float) -> _Spot | None:
        """Where an entity begins, or is after it kept its lane and speed."""
        if not time_s:
            found = self._begins.get(name)
            return None if found is None else self._spot(found, 0.0)
        begin = self._at(name, 0.0)
        if begin is None or len(self._states[name]) > 1:
            return None
        try:
            return self._ahead(begin, self._speeds.get(name, 0.0) * time_s)
        except FormatError:
            return None

    def _ahead(self, spot: _Spot, way_m: float) -> _Spot:
        """The place further on along a road.

        Raises:
            FormatError: it is not on a road, or the road or lane ends before.
        """
        if not way_m:
            return spot
        if spot.road is None:
            raise self._root.error("has an entity without a road.")
        road, lane, s, aside = spot.road
        along = self._locate(self._root, road, None, s, 0.0)[0][2]
        (_, _, heading), middle = self._locate(self._root, road, lane, s, 0.0)
        turn = spot.pose[2] - heading
        s += way_m if np.cos(spot.pose[2] - along) >= 0 else -way_m
        (x, y, heading), beside = self._locate(
            self._root, road, lane, s, aside - middle
        )
        return _Spot((x, y, heading + turn), (road, lane, s, beside))

    def tracks(self) -> tuple[tuple[FileTrack, ...], tuple[str, ...]]:
        """Of all entities that have a place; sentences on what is not read."""
        for name, driver in self._drivers.items():
            if driver.moves or self._follows_s.get(name, 0.0) > 0:
                self._drive(name, driver)
        last_s = max((max(one) for one in self._states.values() if one), default=0.0)
        last_s = min(last_s, MAX_STEPS * TimeAxis().step_s)
        places = self._root.child("Entities").children("ScenarioObject")
        known = [one for one in places if self._states.get(one.attribute("name"))]
        tracks = tuple(self._track(one, last_s) for one in known)
        lost = [one.attribute("name") for one in places if one not in known]
        sizeless = sum(one.size_m is None for one in tracks)
        some = ", ".join(sorted(self._unread)[:6])
        told = (
            (sizeless, f"{sizeless} entities without a box have the usual sizes."),
            (lost, f"Entities without a place are left out: {', '.join(lost[:6])}."),
            (
                self.is_driven,
                "Without trajectories entities keep lane and speed but for actions on them.",
            ),
            (
                not self._is_timed,
                "Trajectories without times are followed at the entity's first speed.",
            ),
            (some, f"Not read of {self._root.path.name}: {some}."),
        )
        return tracks, tuple(text for holds, text in told if holds)

    def _drive(self, name: str, driver: Driver) -> None:
        """Add the states of who drives, until its trajectory begins or its road ends."""
        ends = self._follows_s.get(name, np.inf), self._ends_s.get(name, np.inf)
        until_s = min(ends) - _STEP_S / 2
        states = self._states[name]
        self.is_driven |= driver.moves
        for time, place, heading, there in zip(
            driver.times_s, *driver.states(), strict=True
        ):
            if time >= until_s or not there:
                break
            states[round(float(time), _DIGITS)] = (*place.tolist(), float(heading))

    def _track(self, place: Place, last_s: float) -> FileTrack:
        name, step_s = place.attribute("name"), TimeAxis().step_s
        states, speed = self._states[name], self._speeds.get(name, 0.0)
        if len(states) == 1 and not speed and name not in self._acting:
            ((first_s, pose),) = states.items()
            until_s = min(self._ends_s.get(name, np.inf) - step_s, last_s)
            times = np.arange(first_s, until_s + step_s / 2, step_s)
            states = dict.fromkeys(times.tolist(), pose) or states
        table = np.array([(time, *states[time]) for time in sorted(states)])
        heading = headings_on_the_way(table[:, 0], table[:, 1:3], table[:, 3])
        kind, size, center = _body(place)
        ahead = unit_vector(heading)
        return FileTrack(
            track_id=name,
            kind=kind,
            size_m=size,
            time_s=table[:, 0],
            position_m=table[:, 1:3] + center[0] * ahead + center[1] * left_of(ahead),
            heading_rad=heading,
            velocity_mps=speed * ahead if len(table) == 1 else None,
        )


def _unread_value(place: Place, *known: str) -> str | None:
    """What is not read of an element: its name if it is not known, or an expression."""
    tag = place.element.tag
    if any("$" in text for text in place.element.attrib.values()):
        return f"{tag} of expressions"
    return None if tag in known else tag


def _depends(place: Place) -> bool:
    """Whether what else happens decides when an act or an event starts."""
    told = ("ByEntityCondition", "StoryboardElementStateCondition")
    return any(place.element.find(f"StartTrigger//{tag}") is not None for tag in told)


def _times_s(board: Place) -> Float[np.ndarray, "T"]:
    """Steps up to when the file stops, else until some seconds after its last event."""
    usual = TimeAxis()
    stops, others = (
        [
            one.number("value")
            for one in board.children(f"{part}//SimulationTimeCondition")
            if not _unread_value(one, "SimulationTimeCondition")
        ]
        for part in ("StopTrigger", "Story")
    )
    last_s = min(stops, default=max(others, default=0.0) + usual.future_s)
    most_s = (MAX_STEPS - usual.num_steps) * _STEP_S
    return np.arange(0.0, min(max(last_s, 1.0), most_s) + _STEP_S / 2, _STEP_S)


def _dynamics(
    action: Place, tag: str, change: float, seconds_of: Callable[[float], float]
) -> tuple[float, str]:
    """Seconds and shape of a change, of which a distance takes ``seconds_of``."""
    for one in action.children(tag):
        shape, by = one.get("dynamicsShape", "linear"), one.get("dynamicsDimension")
        if shape != "step" and not _unread_value(one, tag):
            value = abs(one.number("value", 0.0))
            if by == "rate":
                value = change / max(value, 1e-3)
            return seconds_of(value) if by == "distance" else value, shape
    return 0.0, "step"


def _profile(action: Place, driver: Driver, step: int) -> float:
    """Take the speeds of a profile; its end."""
    time_s = float(driver.times_s[step])
    for one in action.children("SpeedProfileEntry"):
        seconds = one.number("time", 0.0)
        step = driver.step(time_s)
        time_s = driver.change_speed(step, one.number("speed"), seconds, "linear")
    return time_s


def _compared(values: Float[np.ndarray, "T"], rule: Place) -> Bool[np.ndarray, "T"]:
    return _RULES.get(rule.get("rule"), np.isclose)(values, rule.number("value"))


def _nurbs(
    order: int,
    knots: Float[np.ndarray, "K"],
    weights: Float[np.ndarray, "N"],
    points: Float[np.ndarray, "N 2"],
) -> Float[np.ndarray, "M 2"]:
    """Points along a rational spline, by the recursion of Cox and de Boor."""
    count = int(min(arc_length(points)[-1] / _FINE_M, _MOST_POINTS)) + 2
    place = np.linspace(knots[order - 1], knots[-order], count)[:, None]
    last = np.nextafter(knots[-order], -np.inf)
    place = np.minimum(place, last)
    share = ((knots[:-1] <= place) & (place < knots[1:])).astype(float)
    for span in range(1, order):
        wide = knots[span:] - knots[:-span]
        slope = np.divide(1.0, wide, where=wide > 0, out=np.zeros_like(wide))
        rise = (place - knots[: -span - 1]) * slope[:-1]
        fall = (knots[span + 1 :] - place) * slope[1:]
        share = rise * share[:, :-1] + fall * share[:, 1:]
    share = share * weights
    return share @ points / share.sum(axis=1, keepdims=True)


def _body(
    place: Place,
) -> tuple[AgentKind, tuple[float, float] | None, tuple[float, float]]:
    """Kind, size, and where the box's centre is from an entity's point of reference."""
    (body,) = place.children("*")[:1] or [place]
    kind = _KINDS.get(body.get("vehicleCategory"), AgentKind.VEHICLE)
    told = body.get("catalogName", body.element.tag)
    for word, other in _OTHER_KINDS.items():
        kind = other if word in told else kind
    for box in body.children("BoundingBox"):
        size, center = box.child("Dimensions"), box.child("Center")
        return (
            kind,
            (size.number("length"), size.number("width")),
            (center.number("x"), center.number("y")),
        )
    return kind, None, (0.0, 0.0)


def _phases(root: Place) -> Phases:
    found: Phases = {}
    for control in root.children("RoadNetwork/TrafficSignals/TrafficSignalController"):
        for phase in control.children("Phase"):
            seconds = phase.number("duration")
            if seconds <= 0:
                raise phase.error("does not last; expected more than 0 s.")
            for one in phase.children("TrafficSignalState"):
                light, word = one.attribute("trafficSignalId"), one.attribute("state")
                name, before = found.get(light, (control.attribute("name"), ()))
                found[light] = name, (*before, (seconds, _LAMPS.get(word, word)))
    return found


def entity_names(agent_ids: Sequence[str]) -> dict[str, str]:
    """Names of entities by agent id: the ego is ``Ego``, others are as their ids."""
    names: dict[str, str] = {}
    for number, one in enumerate(agent_ids):
        name = EGO_NAME if one == EGO_ID else one
        is_usable = re.fullmatch(r"[A-Za-z0-9_.-]+", name) is not None
        if not is_usable or (name == EGO_NAME) != (one == EGO_ID):
            name = f"agent_{number}"
        while name in names.values():
            name += "_"
        names[one] = name
    return names


def light_ids(scenario: Scenario) -> dict[tuple[str, int], int]:
    """Ids in a road network of a signal's lights, one for each of its lanes."""
    keys = [(one.signal_id, lane) for one in scenario.signals for lane in one.lane_ids]
    return dict(zip(keys, count(1 + max(scenario.road_map.lane_of)), strict=False))


def openscenario_file(
    scenario: Scenario, road_file: str, names: Mapping[str, str]
) -> bytes:
    """Trajectories of a scenario's agents on a road network, named as given."""
    agents, step_s = scenario.agents, scenario.time_axis.step_s
    root = etree.Element("OpenSCENARIO")
    told = f"{scenario.scenario_id}, current at {scenario.current_step * step_s:g} s"
    about = {"author": EDITOR, "date": _DATE, "description": told}
    added(root, "FileHeader", revMajor=1, revMinor=2, **about)
    added(root, "CatalogLocations")
    network = added(root, "RoadNetwork")
    added(network, "LogicFile", filepath=road_file)
    _write_signals(network, scenario)
    entities = added(root, "Entities")
    story_board = added(root, "Storyboard")
    init = added(added(story_board, "Init"), "Actions")
    act = added(added(story_board, "Story", name="Story"), "Act", name="Act")
    for row, one in enumerate(agents.ids):
        name = names[one]
        kind, size = agents.kinds[row], agents.size_m[row].tolist()
        _entity(added(entities, "ScenarioObject", name=name), name, kind, size)
        states = np.column_stack([agents.position_m[row], agents.heading_rad[row]])
        maneuver = etree.Element("Maneuver", name=f"Maneuver {name}")
        for number, steps in enumerate(unbroken_parts(agents.is_valid[row])):
            track = np.column_stack([steps * step_s, states[steps]]).tolist()
            if steps[0] == 0:
                start = added(added(init, "Private", entityRef=name), "PrivateAction")
                _place(added(start, "TeleportAction"), track[0])
            _write_track(maneuver, f"{name} {number}", name, track)
            if steps[-1] < agents.num_steps - 1:
                event = added(maneuver, "Event", name=f"Leave {name} {number}", **_ONCE)
                _entity_action(event, "DeleteEntityAction", name)
                _at(added(event, "StartTrigger"), track[-1][0] + step_s)
        title = {"name": f"Group {name}", "maximumExecutionCount": 1}
        group = added(act, "ManeuverGroup", **title)
        actors = added(group, "Actors", selectTriggeringEntities="false")
        added(actors, "EntityRef", entityRef=name)
        if len(maneuver):
            group.append(maneuver)
    _at(added(act, "StartTrigger"), 0.0)
    _at(added(story_board, "StopTrigger"), scenario.time_axis.duration_s, "greaterThan")
    return as_file(root)


def _write_signals(network: etree._Element, scenario: Scenario) -> None:
    """Add the states of signals over time."""
    lights = light_ids(scenario)
    controllers = added(network, "TrafficSignals") if lights else network
    for one in scenario.signals:
        controller = added(controllers, "TrafficSignalController", name=one.signal_id)
        for n, (state, seconds) in enumerate(one.phases(scenario.time_axis.step_s)):
            # Red, yellow and green.
            lamps = ";".join("on" if state == lamp else "off" for lamp in (1, 2, 3))
            phase = added(controller, "Phase", name=n, duration=seconds)
            for lane in one.lane_ids:
                light = {"trafficSignalId": lights[one.signal_id, lane]}
                added(phase, "TrafficSignalState", **light, state=lamps)


def _entity(
    place: etree._Element, name: str, kind: AgentKind, size_m: Sequence[float]
) -> None:
    """Add what an entity is, with its box around its reference point."""
    length, width = size_m
    height = DEFAULT_HEIGHT_M[kind]
    if kind in VEHICLES:
        found = added(place, "Vehicle", name=name, vehicleCategory=VEHICLES[kind])
    elif kind == AgentKind.PEDESTRIAN:
        about = {"mass": 80, "pedestrianCategory": "pedestrian"}
        found = added(place, "Pedestrian", name=name, **about)
    else:
        about = {"mass": 100, "miscObjectCategory": "obstacle"}
        found = added(place, "MiscObject", name=name, **about)
    box = added(found, "BoundingBox")
    added(box, "Center", x=0, y=0, z=height / 2)
    added(box, "Dimensions", width=width, length=length, height=height)
    if kind in VEHICLES:
        most = ("maxSpeed", "maxAcceleration", "maxDeceleration")
        added(found, "Performance", **dict.fromkeys(most, _MOST))
        axles = added(found, "Axles")
        wheels = {"wheelDiameter": _WHEEL_M, "trackWidth": width}
        for tag, steering, share in (("FrontAxle", 0.5, 0.3), ("RearAxle", 0.0, -0.3)):
            place = {"positionX": share * length, "positionZ": _WHEEL_M / 2}
            added(axles, tag, maxSteering=steering, **wheels, **place)
    added(found, "Properties")


def _write_track(
    maneuver: etree._Element, title: str, name: str, track: Sequence[Sequence[float]]
) -> None:
    """Add an event in which an entity appears, if it comes later, and follows a track.

    A track has rows of time, x, y, heading.
    """
    event = etree.Element("Event", name=f"Event {title}", **_ONCE)
    if track[0][0] > 0:
        _place(_entity_action(event, "AddEntityAction", name), track[0])
    if len(track) > 1:
        action = added(event, "Action", name=f"Follow {title}")
        routing = added(added(action, "PrivateAction"), "RoutingAction")
        follow = added(routing, "FollowTrajectoryAction")
        path = added(follow, "Trajectory", name=f"Trajectory {title}", closed="false")
        # Most elements are these: to parse them takes half as long as to add them.
        states = (np.array(track) + 0.0).tolist()
        vertices = "".join(map(_VERTEX.__mod__, map(tuple, states)))
        added(path, "Shape").append(
            etree.fromstring(f"<Polyline>{vertices}</Polyline>")
        )
        timing = {"domainAbsoluteRelative": "absolute", "scale": 1, "offset": 0}
        added(added(follow, "TimeReference"), "Timing", **timing)
        added(follow, "TrajectoryFollowingMode", followingMode="position")
    if len(event):
        _at(added(event, "StartTrigger"), track[0][0])
        maneuver.append(event)


def _entity_action(event: etree._Element, tag: str, name: str) -> etree._Element:
    """Add an action on an entity's existence; the element in it."""
    action = added(event, "Action", name=f"{tag} {name}")
    found = added(added(action, "GlobalAction"), "EntityAction", entityRef=name)
    return added(found, tag)


def _place(parent: etree._Element, state: Sequence[float]) -> None:
    _, x, y, heading = state
    added(added(parent, "Position"), "WorldPosition", x=x, y=y, h=heading)


def _at(trigger: etree._Element, time_s: float, rule: str = "greaterOrEqual") -> None:
    """Let a trigger fire at a time of the simulation."""
    about = {"name": "time", "delay": 0, "conditionEdge": "none"}
    condition = added(added(trigger, "ConditionGroup"), "Condition", **about)
    time = added(condition, "ByValueCondition")
    added(time, "SimulationTimeCondition", value=time_s, rule=rule)
