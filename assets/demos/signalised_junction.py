"""A four-way junction in a town, as the lights change from the main to the side road."""

from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from assets.demos.road_drawing import (
    LaneDrawing,
    Street,
    band,
    crosswalk,
    lane_along,
    linked,
    paved,
    road_map,
    side_by_side,
    turn_between,
)
from assets.demos.traffic_drawing import RoadUser, Stop, along_lanes, drawn_tracks
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.road_map import LaneKind, LaneMark, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.time_axis import TimeAxis

YELLOW, DASHED = LaneMark.DOUBLE_SOLID_YELLOW, LaneMark.DASHED_WHITE
SOLID, NO_MARK = LaneMark.SOLID_WHITE, LaneMark.NONE

ARM_M: Final = 130.0
MAIN_STOP_M: Final = 15.0
SIDE_STOP_M: Final = 17.0
MAIN_HALF_M: Final = 8.5
SIDE_HALF_M: Final = 5.3
PARKING_HALF_M: Final = 7.5
MAIN_YELLOW_S, SIDE_GREEN_S = 1.3, 4.8
MAIN_SPEED, SIDE_SPEED = 12.5, 10.5
FOCAL_ID: Final = "12"

MAIN = Street(heading=lambda s: 0.08 + 0.0017 * s)
SIDE = Street(heading=lambda s: 1.63 + 0.13 * np.sin(s / 55.0))


def _main_arm(start: float, end: float, name: str) -> list[LaneDrawing]:
    """Both ways of the main road, for one direction of travel past the junction."""
    side = np.sign(end - start)
    near, far = side * MAIN_STOP_M, side * 50.0
    pieces = (
        ("in", start, -far, DASHED),
        ("wait", -far, -near, SOLID),
        ("out", near, end, DASHED),
    )
    lanes = []
    for part, begin, finish, middle in pieces:
        label = f"{name}-{part}"
        inner = lane_along(
            MAIN, f"{label}-inner", begin, finish, 1.7, 3.3, (YELLOW, middle)
        )
        outer = lane_along(
            MAIN, f"{label}-outer", begin, finish, 5.0, 3.3, (middle, SOLID)
        )
        bike = lane_along(
            MAIN,
            f"{label}-bike",
            begin,
            finish,
            7.45,
            1.6,
            (SOLID, NO_MARK),
            kind=LaneKind.BIKE,
        )
        lanes += side_by_side(inner, outer, bike)
    return linked(
        lanes,
        {f"{name}-in-{k}": (f"{name}-wait-{k}",) for k in ("inner", "outer", "bike")},
    )


def _side_arm(start: float, end: float, name: str) -> list[LaneDrawing]:
    """One direction of the side road: lane, left-turn pocket, lane beyond."""
    side = np.sign(end - start)
    near, far = side * SIDE_STOP_M, side * 62.0
    approach = lane_along(SIDE, f"{name}-in", start, -far, 3.25, 3.5, (YELLOW, SOLID))
    straight = lane_along(SIDE, f"{name}-wait", -far, -near, 3.25, 3.5, (SOLID, SOLID))
    pocket = lane_along(
        SIDE, f"{name}-left", -far, -near, 0.0, 3.0, (YELLOW, SOLID), shift_from=3.25
    )
    beyond = lane_along(SIDE, f"{name}-out", near, end, 3.25, 3.5, (YELLOW, SOLID))
    lanes = [approach, *side_by_side(pocket, straight), beyond]
    return linked(lanes, {f"{name}-in": (f"{name}-left", f"{name}-wait")})


def junction_lanes() -> list[LaneDrawing]:
    """All lanes, those inside the junction last."""
    arms = (
        *_main_arm(-ARM_M, ARM_M, "east"),
        *_main_arm(ARM_M, -ARM_M, "west"),
        *_side_arm(-ARM_M, ARM_M, "north"),
        *_side_arm(ARM_M, -ARM_M, "south"),
    )
    of = {lane.name: lane for lane in arms}
    turns: list[tuple[str, str]] = []
    for here, left, right in (("east", "north", "south"), ("west", "south", "north")):
        turns += [
            (f"{here}-wait-{lane}", f"{here}-out-{lane}")
            for lane in ("inner", "outer", "bike")
        ]
        turns.append((f"{here}-wait-inner", f"{left}-out"))
        turns.append((f"{here}-wait-outer", f"{right}-out"))
    for here, left, right in (("north", "west", "east"), ("south", "east", "west")):
        turns.append((f"{here}-wait", f"{here}-out"))
        turns.append((f"{here}-wait", f"{right}-out-outer"))
        turns.append((f"{here}-left", f"{left}-out-inner"))
    inside = [turn_between(of[first], of[second]) for first, second in turns]
    links: dict[str, tuple[str, ...]] = {}
    for first, second in turns:
        links[first] = (*links.get(first, ()), f"{first}>{second}")
    return [*linked(arms, links), *inside]


def junction_map() -> RoadMap:
    """Lanes, four crossings, and the paved ground with its parking strips."""
    parking = [
        band(SIDE, start, end, PARKING_HALF_M)
        for start, end in ((-112.0, -34.0), (34.0, 112.0))
    ]
    area = paved(
        [
            band(MAIN, -ARM_M, ARM_M, MAIN_HALF_M),
            band(SIDE, -ARM_M, ARM_M, SIDE_HALF_M),
        ],
        parking,
        corner_radius=6.5,
    )
    crossings = (
        crosswalk(MAIN, -11.5, MAIN_HALF_M, 1),
        crosswalk(MAIN, 11.5, MAIN_HALF_M, 2),
        crosswalk(SIDE, -13.3, SIDE_HALF_M, 3),
        crosswalk(SIDE, 13.3, SIDE_HALF_M, 4),
    )
    return road_map(junction_lanes(), crossings, area)


MAIN_LIGHTS = tuple(
    Stop(lane=f"{way}-wait-{lane}", closed_from_s=MAIN_YELLOW_S, closed_until_s=99.0)
    for way in ("east", "west")
    for lane in ("inner", "outer", "bike")
)
SIDE_LIGHTS = (
    *(
        Stop(lane=f"{way}-wait", closed_from_s=-99.0, closed_until_s=SIDE_GREEN_S)
        for way in ("north", "south")
    ),
    *(
        Stop(lane=f"{way}-left", closed_from_s=-99.0, closed_until_s=99.0)
        for way in ("north", "south")
    ),
)


def _route(way: str, lane: str, out: str | None = None) -> list[str]:
    """Names of the lanes from one arm of the junction to another."""
    if way in ("east", "west"):
        out = out or f"{way}-out-{lane}"
        wait = f"{way}-wait-{lane}"
        return [f"{way}-in-{lane}", wait, f"{wait}>{out}", out]
    out = out or f"{way}-out"
    return [f"{way}-in", f"{way}-{lane}", f"{way}-{lane}>{out}", out]


CAR, VAN, SMALL_CAR = (4.5, 1.8), (5.4, 2.0), (4.3, 1.8)
BUS, MOTORCYCLE, BICYCLE = (12.0, 2.9), (2.1, 0.8), (1.8, 0.7)
KIND_OF_SIZE: Final = {
    BUS: AgentKind.BUS,
    MOTORCYCLE: AgentKind.MOTORCYCLIST,
    BICYCLE: AgentKind.CYCLIST,
}


class Start(NamedTuple):
    """Where and how somebody on a lane begins."""

    agent_id: str
    route: tuple[str, ...]
    to_junction_m: float
    speed: float
    size_m: tuple[float, float]
    moves_off_at_s: float | None = None


UNDER_WAY: Final = (
    Start("11", ("east", "outer"), 23.0, MAIN_SPEED, CAR),
    Start(FOCAL_ID, ("east", "inner", "north-out"), 50.0, MAIN_SPEED, (4.7, 1.9)),
    Start("13", ("east", "outer"), 43.0, MAIN_SPEED, MOTORCYCLE),
    Start(EGO_ID, ("east", "outer"), 66.0, MAIN_SPEED, (4.9, 2.0)),
    Start("14", ("east", "inner"), 74.0, MAIN_SPEED, VAN),
    Start("15", ("east", "outer"), 89.0, 11.5, BUS),
    Start("21", ("west", "outer"), 25.0, MAIN_SPEED, CAR),
    Start("22", ("west", "inner"), 18.0, MAIN_SPEED, SMALL_CAR),
    Start("23", ("west", "inner"), 62.0, MAIN_SPEED, VAN),
    Start("24", ("west", "outer"), 70.0, MAIN_SPEED, CAR),
    Start("25", ("west", "inner"), 84.0, MAIN_SPEED, (4.6, 1.85)),
    Start("51", ("east", "bike"), 17.0, 5.6, BICYCLE),
    Start("52", ("east", "bike"), 44.0, 5.0, BICYCLE),
    Start("53", ("west", "bike"), 8.0, 6.0, BICYCLE),
)
QUEUES: Final = (
    Start("31", ("south", "wait"), 19.9, SIDE_SPEED, CAR, 5.1),
    Start("32", ("south", "wait"), 26.9, SIDE_SPEED, (4.8, 1.9), 5.9),
    Start("33", ("south", "wait"), 34.3, SIDE_SPEED, VAN, 6.7),
    Start("34", ("south", "left", "east-out-inner"), 19.8, SIDE_SPEED, CAR, 99.0),
    Start("41", ("north", "wait", "east-out-outer"), 20.0, SIDE_SPEED, (4.4, 1.8), 5.3),
    Start("42", ("north", "wait"), 26.8, SIDE_SPEED, CAR, 6.0),
    Start("43", ("north", "wait"), 33.6, SIDE_SPEED, (4.6, 1.9), 6.8),
    Start(
        "44", ("north", "left", "west-out-inner"), 19.9, SIDE_SPEED, (4.2, 1.75), 99.0
    ),
)
SCORED_IDS: Final = frozenset({"11", "13", "14", "21", "23", "31", "41", "42", "51"})


def _drivers() -> list[RoadUser]:
    """Everybody on a lane."""
    lines = {lane.name: lane.center for lane in junction_lanes()}
    users = []
    for agent_id, route, to_junction, speed, size, starts_at_s in UNDER_WAY + QUEUES:
        # The focal car is in the junction before its light is red.
        lights = () if agent_id == FOCAL_ID else (*MAIN_LIGHTS, *SIDE_LIGHTS)
        line, stops = along_lanes(lines, _route(*route), lights)
        category = AgentCategory.UNSCORED
        if agent_id == FOCAL_ID:
            category = AgentCategory.FOCAL
        elif agent_id in SCORED_IDS:
            category = AgentCategory.SCORED
        users.append(
            RoadUser(
                agent_id=agent_id,
                line=line,
                start_m=ARM_M - to_junction,
                speed=speed,
                kind=KIND_OF_SIZE.get(size, AgentKind.VEHICLE),
                size_m=size,
                category=category,
                stops=stops,
                starts_at_s=starts_at_s,
            )
        )
    return users


def _pedestrian(
    agent_id: str,
    line: Float[np.ndarray, "N 2"],
    at: float,
    speed: float,
    starts_at_s: float | None = None,
) -> RoadUser:
    return RoadUser(
        agent_id=agent_id,
        line=line,
        start_m=at,
        speed=speed,
        kind=AgentKind.PEDESTRIAN,
        size_m=(0.6, 0.6),
        starts_at_s=starts_at_s,
    )


def _pedestrians() -> list[RoadUser]:
    """Some finish crossing the side road, others wait to cross the main road."""
    across = np.linspace(-22, 22, 60)

    def over_side(along: float) -> Float[np.ndarray, "N 2"]:
        return SIDE.at(np.full(60, along), across)

    def over_main(along: float) -> Float[np.ndarray, "N 2"]:
        return MAIN.at(np.full(60, along), across)

    pavement = MAIN.at(np.linspace(24, 90, 60), 10.2)
    return [
        _pedestrian("61", over_side(-13.0), 20.4, 1.4),
        _pedestrian("62", over_side(-12.2), 19.2, 1.45),
        _pedestrian("63", over_main(-11.2), 12.2, 1.4, starts_at_s=6.0),
        _pedestrian("64", over_main(-12.1), 11.7, 1.25, starts_at_s=6.6),
        _pedestrian("65", over_main(-10.6)[::-1], 12.0, 1.3, starts_at_s=99.0),
        _pedestrian("66", pavement, 20.0, 1.35),
    ]


def _parked() -> list[RoadUser]:
    """Cars at the kerbs of the side road."""
    places = (
        (42.0, 1),
        (48.7, 1),
        (62.4, 1),
        (76.0, 1),
        (47.0, -1),
        (54.1, -1),
        (81.5, -1),
    )
    places += tuple((-place - 3.2, side) for place, side in places[1:4])
    users = []
    for k, (along, side) in enumerate(places):
        reach = np.array([along - 3.0, along + 3.0])
        line = SIDE.at(reach if side > 0 else reach[::-1], side * 6.4)
        size = ((4.5, 1.8), (4.2, 1.75), (4.8, 1.9))[k % 3]
        users.append(
            RoadUser(
                agent_id=str(71 + k),
                line=line,
                start_m=3.0,
                speed=0.0,
                size_m=size,
                starts_at_s=99.0,
            )
        )
    return users


def signalised_junction() -> Scenario:
    """The scenario; the current step is when the side road's queue moves off."""
    time_axis = TimeAxis()
    agents = drawn_tracks([*_drivers(), *_pedestrians(), *_parked()], time_axis)
    return Scenario(
        scenario_id="signalised-junction",
        city="drawn",
        origin_city_m=np.array([0.0, 0.0]),
        road_map=junction_map(),
        agents=agents,
        time_axis=time_axis,
        focal_id=FOCAL_ID,
    )
