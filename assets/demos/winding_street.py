"""A winding residential street with parked cars, a crossing and a side street."""

from typing import Final

import numpy as np

from assets.demos.road_drawing import (
    LaneDrawing,
    Street,
    band,
    crosswalk,
    lane_along,
    linked,
    paved,
    road_map,
    turn_between,
)
from assets.demos.traffic_drawing import RoadUser, Stop, along_lanes, drawn_tracks
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.road_map import LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.time_axis import TimeAxis

MIDDLE, EDGE = LaneMark.DASHED_YELLOW, LaneMark.NONE
LANE_M: Final = 3.2
HALF_M: Final = 3.4
PARKING_HALF_M: Final = 5.6
END_M: Final = 130.0
MOUTH_M: Final = 12.0
"""Half the length of the street's part that belongs to the junction."""
BRANCH_START_M: Final = 13.0
BRANCH_END_M: Final = 80.0
CROSSING_M: Final = -42.0
FOCAL_ID: Final = "11"

STREET = Street(
    heading=lambda s: 0.1 + 0.5 * (1 - np.cos(np.maximum(np.abs(s) - 22.0, 0.0) / 24.0))
)
_CORNER_RAD: Final = float(STREET.heading(np.zeros(1))[0]) - np.pi / 2
BRANCH = Street(heading=lambda s: _CORNER_RAD + 0.18 * np.sin(s / 40.0))
"""The side street, which leaves to the south."""


def _both_ways(
    street: Street, start: float, end: float, names: tuple[str, str]
) -> list[LaneDrawing]:
    """A lane each way between two places of a street."""
    marks = (MIDDLE, EDGE)
    return [
        lane_along(street, names[0], start, end, LANE_M / 2, LANE_M, marks),
        lane_along(street, names[1], end, start, LANE_M / 2, LANE_M, marks),
    ]


def street_lanes() -> list[LaneDrawing]:
    """All lanes, those of the junction last."""
    arms = [
        *_both_ways(STREET, -END_M, CROSSING_M, ("east-far", "west-end")),
        *_both_ways(STREET, CROSSING_M, -MOUTH_M, ("east-in", "west-out")),
        *_both_ways(STREET, MOUTH_M, END_M, ("east-out", "west-in")),
        *_both_ways(BRANCH, BRANCH_START_M, BRANCH_END_M, ("south-out", "north-in")),
    ]
    of = {lane.name: lane for lane in arms}
    turns = (
        ("east-in", "east-out"),
        ("east-in", "south-out"),
        ("west-in", "west-out"),
        ("west-in", "south-out"),
        ("north-in", "east-out"),
        ("north-in", "west-out"),
    )
    links: dict[str, tuple[str, ...]] = {
        "east-far": ("east-in",),
        "west-out": ("west-end",),
    }
    for first, second in turns:
        links[first] = (*links.get(first, ()), f"{first}>{second}")
    inside = [turn_between(of[first], of[second]) for first, second in turns]
    return [*linked(arms, links), *inside]


def street_map() -> RoadMap:
    """Lanes, a crossing, and the paved ground with its parking strips."""
    parking = [
        band(STREET, start, end, PARKING_HALF_M)
        for start, end in ((-118.0, -52.0), (24.0, 118.0))
    ]
    area = paved(
        [
            band(STREET, -END_M, END_M, HALF_M),
            band(BRANCH, 0.0, BRANCH_END_M, HALF_M),
        ],
        parking,
        corner_radius=9.0,
    )
    crossings = (crosswalk(STREET, CROSSING_M, HALF_M, 1),)
    return road_map(street_lanes(), crossings, area)


def _drivers() -> list[RoadUser]:
    lines = {lane.name: lane.center for lane in street_lanes()}
    yields = (
        Stop(lane="north-in", closed_from_s=-99.0, closed_until_s=99.0),
        Stop(lane="east-far", closed_from_s=1.6, closed_until_s=99.0),
    )
    branch_off = ["east-far", "east-in", "east-in>south-out", "south-out"]
    eastward = ["east-far", "east-in", "east-in>east-out", "east-out"]
    westward = ["west-in", "west-in>west-out", "west-out", "west-end"]
    out_of_branch = ["north-in", "north-in>west-out", "west-out"]

    def on(
        agent_id: str,
        route: list[str],
        start_m: float,
        speed: float,
        *,
        kind: AgentKind = AgentKind.VEHICLE,
        size: tuple[float, float] | None = None,
        category: AgentCategory = AgentCategory.SCORED,
        starts_at_s: float | None = None,
    ) -> RoadUser:
        line, stops = along_lanes(lines, route, yields)
        return RoadUser(
            agent_id=agent_id,
            line=line,
            start_m=start_m,
            speed=speed,
            kind=kind,
            size_m=size,
            category=category,
            stops=stops,
            starts_at_s=starts_at_s,
        )

    cyclist = AgentKind.CYCLIST
    return [
        on(
            FOCAL_ID,
            branch_off,
            69,
            9.0,
            size=(4.5, 1.85),
            category=AgentCategory.FOCAL,
        ),
        on(EGO_ID, eastward, 50, 9.0, size=(4.9, 2.0), category=AgentCategory.UNSCORED),
        on("12", eastward, 18, 9.5, size=(4.3, 1.8)),
        on("13", westward, 29, 9.0, size=(4.6, 1.9)),
        on("14", westward, 3, 8.5, size=(5.6, 2.05)),
        on("15", out_of_branch, 63.5, 8.0, size=(4.2, 1.8), starts_at_s=99.0),
        on("16", eastward, 150, 5.0, kind=cyclist, category=AgentCategory.UNSCORED),
        on("17", westward, 78, 4.8, kind=cyclist, category=AgentCategory.UNSCORED),
    ]


def _pedestrians() -> list[RoadUser]:
    """Two who wait at the crossing until the ego has passed, and a walker."""
    across = np.linspace(-14, 14, 50)
    over = STREET.at(np.full(50, CROSSING_M + 0.5), across)
    back = STREET.at(np.full(50, CROSSING_M - 0.4), across)[::-1]
    pavement = STREET.at(np.linspace(20, 100, 80), 6.8)
    drawn = (
        ("61", over, 9.2, 1.4, 5.6),
        ("62", back, 9.0, 1.3, 6.3),
        ("63", pavement, 12.0, 1.35, None),
    )
    return [
        RoadUser(
            agent_id=agent_id,
            line=line,
            start_m=start_m,
            speed=speed,
            kind=AgentKind.PEDESTRIAN,
            size_m=(0.6, 0.6),
            starts_at_s=starts_at_s,
        )
        for agent_id, line, start_m, speed, starts_at_s in drawn
    ]


def _parked() -> list[RoadUser]:
    """Cars in the parking strips on both sides."""
    right = (-108.0, -95.0, -88.5, -70.0, 34.0, 41.2, 60.0, 82.0, 88.7)
    left = (-100.0, -79.0, -61.5, 30.0, 52.0, 58.6, 97.0)
    places = [(along, 1.0) for along in right] + [(along, -1.0) for along in left]
    users = []
    for k, (along, side) in enumerate(places):
        reach = np.array([along - 3.0, along + 3.0])
        line = STREET.at(reach if side > 0 else reach[::-1], side * 4.5)
        users.append(
            RoadUser(
                agent_id=str(71 + k),
                line=line,
                start_m=float(np.linalg.norm(line[1] - line[0])) / 2,
                speed=0.0,
                size_m=((4.5, 1.8), (4.2, 1.75), (4.7, 1.85))[k % 3],
                starts_at_s=99.0,
            )
        )
    return users


def winding_street() -> Scenario:
    """The scenario; at the current step the focal car is about to branch off."""
    time_axis = TimeAxis()
    return Scenario(
        scenario_id="winding-street",
        city="drawn",
        origin_city_m=np.array([0.0, 0.0]),
        road_map=street_map(),
        agents=drawn_tracks([*_drivers(), *_pedestrians(), *_parked()], time_axis),
        time_axis=time_axis,
        focal_id=FOCAL_ID,
    )
