"""Writes agents as OpenSCENARIO 1.2: each follows its trajectory.

The reference point of an entity is the centre of its box. Agents that come later are added
at their first step, and all are deleted after their last one.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Final

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, AgentKind
from pd_editor.scene.formats.commonroad_writer import unbroken_parts
from pd_editor.scene.formats.xml_file import added, as_file
from pd_editor.scene.scenario import EGO_ID, Scenario

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
_ONCE: Final = {"priority": "override", "maximumExecutionCount": "1"}


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
    about = {"author": "Path Diffuser Editor", "date": _DATE, "description": told}
    added(root, "FileHeader", revMajor=1, revMinor=2, **about)
    added(root, "CatalogLocations")
    network = added(root, "RoadNetwork")
    added(network, "LogicFile", filepath=road_file)
    _signals(network, scenario)
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
            _follow(maneuver, f"{name} {number}", name, track)
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


def _signals(network: etree._Element, scenario: Scenario) -> None:
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


def _follow(
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
