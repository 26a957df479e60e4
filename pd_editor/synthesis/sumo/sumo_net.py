"""A SUMO net file, read into plain values."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from pd_editor.errors import SynthesisError
from pd_editor.scene.road_map import LaneKind


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoLane:
    """A lane of the net."""

    sumo_id: str
    edge: str
    index: int
    """Counted from the kerb."""
    shape_m: Float[np.ndarray, "N 2"]
    width_m: float
    kind: LaneKind | None
    """Nothing where only pedestrians, or only parked vehicles, may be."""
    is_parking: bool

    @property
    def is_internal(self) -> bool:
        """Whether it lies within a junction."""
        return self.edge.startswith(":")


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """What a road map needs of a net."""

    lanes: Mapping[str, SumoLane]
    """By SUMO id, in the order of the file."""
    links: tuple[tuple[str, str], ...]
    """A lane and the one driven on next, the junction's own lanes between."""
    junction_of: Mapping[str, tuple[str, str]]
    """Junctions where each normal edge begins and ends."""
    num_legs: Mapping[str, int]
    """Roads that meet at each junction; one with two directions counts once."""
    junction_areas_m: Mapping[str, Float[np.ndarray, "_ 2"]]
    walking_areas_m: tuple[Float[np.ndarray, "_ 2"], ...]
    crossings: tuple[tuple[Float[np.ndarray, "_ 2"], float], ...]
    """Middle line and width of each pedestrian crossing."""
    has_signals: bool

    @cached_property
    def lanes_of_edge(self) -> dict[str, list[SumoLane]]:
        """Lanes of each edge, from the kerb to the left."""
        result: dict[str, list[SumoLane]] = {}
        for lane in self.lanes.values():
            result.setdefault(lane.edge, []).append(lane)
        return result


def read_sumo_net(net_file: Path) -> SumoNet:
    """The net in a file.

    Raises:
        SynthesisError: the file is missing or no SUMO net.
    """
    try:
        root = ElementTree.parse(net_file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise SynthesisError(f"{net_file}: expected a SUMO net ({error}).") from error
    lanes: dict[str, SumoLane] = {}
    crossings, walking = [], []
    ends: dict[str, tuple[str, str]] = {}
    for edge in root.iterfind("edge"):
        function = edge.get("function", "normal")
        if function == "normal":
            ends[edge.attrib["id"]] = (edge.attrib["from"], edge.attrib["to"])
        for lane in edge.iterfind("lane"):
            if function == "crossing":
                crossings.append((_points(lane), float(lane.attrib["width"])))
            elif function == "walkingarea":
                walking.append(_points(lane))
            else:
                lanes[lane.attrib["id"]] = _lane(lane, edge.attrib["id"])
    junctions = [j for j in root.iterfind("junction") if j.get("type") != "internal"]
    return SumoNet(
        lanes=lanes,
        links=tuple(_links(root, lanes)),
        junction_of=ends,
        num_legs=_num_legs(ends),
        junction_areas_m={
            j.attrib["id"]: _points(j) for j in junctions if j.get("shape")
        },
        walking_areas_m=tuple(walking),
        crossings=tuple(crossings),
        has_signals=root.find("tlLogic") is not None,
    )


def _points(element: ElementTree.Element) -> Float[np.ndarray, "N 2"]:
    pairs = element.attrib["shape"].split()
    return np.array([[float(v) for v in pair.split(",")[:2]] for pair in pairs])


def _lane(lane: ElementTree.Element, edge: str) -> SumoLane:
    allowed, refused = lane.get("allow"), lane.get("disallow")

    def admits(who: str) -> bool:
        if allowed is not None:
            return allowed == "all" or who in allowed.split()
        return refused is None or (refused != "all" and who not in refused.split())

    kind = None
    if admits("passenger"):
        kind = LaneKind.VEHICLE
    elif admits("bus"):
        kind = LaneKind.BUS
    elif admits("bicycle"):
        kind = LaneKind.BIKE
    return SumoLane(
        sumo_id=lane.attrib["id"],
        edge=edge,
        index=int(lane.attrib["index"]),
        shape_m=_points(lane),
        width_m=float(lane.get("width", "3.2")),
        kind=kind,
        is_parking=not admits("pedestrian")
        and kind is None
        and not edge.startswith(":"),
    )


def _links(
    root: ElementTree.Element, lanes: Mapping[str, SumoLane]
) -> list[tuple[str, str]]:
    links = []
    for connection in root.iterfind("connection"):
        start = f"{connection.attrib['from']}_{connection.attrib['fromLane']}"
        end = f"{connection.attrib['to']}_{connection.attrib['toLane']}"
        end = connection.get("via", end)
        if start in lanes and end in lanes:
            links.append((start, end))
    return links


def _num_legs(ends: Mapping[str, tuple[str, str]]) -> dict[str, int]:
    others: dict[str, set[str]] = {}
    for start, end in ends.values():
        others.setdefault(start, set()).add(end)
        others.setdefault(end, set()).add(start)
    return {junction: len(there) for junction, there in others.items()}
