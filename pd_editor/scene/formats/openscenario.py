"""ASAM OpenSCENARIO 1.x on OpenDRIVE roads: entities that stand or follow trajectories."""

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import FileTrack, headings_on_the_way
from pd_editor.scene.formats.openscenario_writer import VEHICLES
from pd_editor.scene.formats.xml_file import Place, parse_xml
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.scene_limits import MAX_STEPS
from pd_editor.scene.time_axis import TimeAxis

ENDING: Final = ".xosc"
_KINDS: Final = {word: kind for kind, word in VEHICLES.items()}
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
_WITHIN: Final = re.compile("(Private|Global|Routing|Longitudinal|Lateral|)Action")
"""Elements around actions."""
_DIGITS: Final = 6
"""Digits of seconds in which two states of an entity differ."""
Pose = tuple[float, float, float]
"""x, y, and heading, which is NaN if it is not told."""
Phases = dict[str, tuple[str, tuple[tuple[float, str], ...]]]
Locate = Callable[[Place], Pose]
"""Tells the pose of a LanePosition without its orientation."""


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
    """Root of a file, in which parameters have their declared values; its bytes.

    Raises:
        FormatError: the file is damaged, or of another version than 1.
    """
    root, data = parse_xml(path, "OpenSCENARIO")
    header = root.child("FileHeader")
    if (major := header.integer("revMajor")) != 1:
        raise header.error(f"is of version {major}; expected 1.")
    declared = {
        f"${one.get('name')}": one.get("value") or ""
        for one in root.element.iter("ParameterDeclaration")
    }
    for one in root.element.iter("*") if declared else ():
        for name, text in one.items():
            one.set(name, declared.get(text, text))
    return root, data


def road_network_of(root: Place) -> Path:
    """The file of the road network: where the scenario says, or beside it.

    Raises:
        FormatError: it is not there.
    """
    file = root.child("RoadNetwork").child("LogicFile")
    told = PurePosixPath(file.attribute("filepath").replace("\\", "/"))
    places = [root.path.parent / one for one in (told, told.name) if told.name]
    for one in places[told.is_absolute() :]:
        if one.is_file():
            return one
    raise file.error(f"names {str(told)[:80]!r}, which is neither there nor beside it.")


def motion_of(root: Place, data: bytes, locate: Locate) -> Motion:
    """Entities on a road network; what is not read is told in notes.

    Raises:
        FormatError: an element is damaged, or names a place that is not there.
    """
    tracks, notes = _Story(root, locate).tracks()
    described = root.child("FileHeader").get("description")
    current = re.search(r"current at (\d+(?:\.\d*)?) s$", described)
    # How those go on that have a first state alone is up to a controller.
    is_open = any(len(one.time_s) == 1 for one in tracks)
    egos = [one.track_id for one in tracks if one.track_id.lower() in ("ego", "hero")]
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

    def __init__(self, root: Place, locate: Locate) -> None:
        self._root, self._locate = root, locate
        self._states: defaultdict[str, dict[float, Pose]] = defaultdict(dict)
        self._ends_s: dict[str, float] = {}
        self._speeds: dict[str, float] = {}
        self._acting: set[str] = set()
        self._unread: set[str] = set()
        board = root.child("Storyboard")
        for private in board.children("Init/Actions/Private"):
            name = private.attribute("entityRef")
            self._act(private, (name,), 0.0)
        for act in board.children("Story/Act"):
            for group in act.children("ManeuverGroup"):
                actors = group.children("Actors/EntityRef")
                names = tuple(one.attribute("entityRef") for one in actors)
                for event in group.children("Maneuver/Event"):
                    if event.element.find("Action/PrivateAction") is not None:
                        self._acting.update(names)
                    self._act(event, names, max(_start_s(act), _start_s(event)))

    def _act(self, part: Place, names: tuple[str, ...], start_s: float) -> None:
        """Take what a part tells, which starts at infinity if a condition decides."""
        for one in part.element.iter():
            place, tag = Place(part.path, one), one.tag
            if tag == "EntityAction":
                names = (place.attribute("entityRef"),)
            elif tag == "FollowTrajectoryAction":
                self._follow(place, names, start_s)
            elif tag == "DeleteEntityAction":
                self._ends_s |= dict.fromkeys(names, start_s)
            elif tag in ("TeleportAction", "AddEntityAction"):
                if np.isinf(start_s):
                    self._unread.add(f"{tag} on a condition other than a time")
                elif (pose := self._pose(place.child("Position"))) is not None:
                    for name in names:
                        self._states[name].setdefault(round(start_s, _DIGITS), pose)
            elif tag == "SpeedAction" and not start_s:
                for target in place.children("SpeedActionTarget/AbsoluteTargetSpeed"):
                    self._speeds |= dict.fromkeys(names, target.number("value"))
            elif tag.endswith("Action") and not _WITHIN.fullmatch(tag):
                self._unread.add(tag)

    def _follow(self, action: Place, names: tuple[str, ...], start_s: float) -> None:
        """Add the states of a trajectory whose times are told, at most a step apart."""
        lines = action.children("Trajectory/Shape/Polyline")
        lines += action.children("TrajectoryRef/Trajectory/Shape/Polyline")
        timings = action.children("TimeReference/Timing")
        begin_s = np.inf
        for one in timings[:1]:
            is_relative = one.attribute("domainAbsoluteRelative") == "relative"
            begin_s = one.number("offset") + (start_s if is_relative else 0.0)
        if not lines or np.isinf(begin_s):
            self._unread.add("trajectories without a polyline, or without times")
            return
        scale, rows = timings[0].number("scale"), []
        for vertex in lines[0].children("Vertex"):
            pose = self._pose(vertex.child("Position"))
            if pose is not None:
                rows.append((begin_s + scale * vertex.number("time"), *pose))
        table = np.array(sorted(rows)).reshape(-1, 4)
        times, step_s = table[:, 0], TimeAxis().step_s
        if max(np.diff(times), default=0.0) > 1.5 * step_s:
            last_s = min(times[-1], times[0] + MAX_STEPS * step_s)
            times = np.union1d(times, np.arange(times[0], last_s, step_s))
            table[:, 3] = np.unwrap(table[:, 3])
        found = [np.interp(times, table[:, 0], one) for one in table[:, 1:].T]
        for name in names:
            for time, x, y, heading in zip(times, *found, strict=True):
                self._states[name][round(float(time), _DIGITS)] = (x, y, heading)

    def _pose(self, position: Place) -> Pose | None:
        """A pose that depends on the road alone; None, which is noted, for others."""
        (one,) = position.children("*")[:1] or [position]
        tag, told = one.element.tag, one.element.attrib
        if any("$" in text for text in told.values()):
            self._unread.add(f"{tag} of expressions")
        elif tag == "WorldPosition":
            return one.number("x"), one.number("y"), one.number("h", np.nan)
        elif tag == "LanePosition":
            x, y, heading = self._locate(one)
            for turn in one.children("Orientation[@h]"):
                is_absolute = turn.get("type") == "absolute"
                heading = (0 if is_absolute else heading) + turn.number("h")
            return x, y, heading
        else:
            self._unread.add(tag)
        return None

    def tracks(self) -> tuple[tuple[FileTrack, ...], tuple[str, ...]]:
        """Of all entities that have a place; sentences on what is not read."""
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
            (some, f"Not read of {self._root.path.name}: {some}."),
        )
        return tracks, tuple(text for holds, text in told if holds)

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


def _start_s(place: Place) -> float:
    """When an act or an event starts: 0 without a trigger, infinity if it is no time alone."""
    conditions = place.children("StartTrigger/ConditionGroup/Condition")
    times = place.children("StartTrigger//SimulationTimeCondition")
    if len(conditions) != len(times) or len(times) > 1:
        return np.inf
    delays = sum(one.number("delay", 0.0) for one in conditions)
    return delays + sum(one.number("value") for one in times)


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
