"""Reader of SUMO net files for the conversion to maps."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.sax import SAXException

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.road_map import LaneKind

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge
    from sumolib.net.lane import Lane

_KIND_OF: Final = {
    "passenger": LaneKind.VEHICLE,
    "bus": LaneKind.BUS,
    "bicycle": LaneKind.BIKE,
}
"""Kind of a lane by the first of these that may use it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoLane:
    """A lane of a SUMO net."""

    sumo_id: str
    edge: str
    index: int
    """Index counted from the kerb."""
    shape_m: Float[np.ndarray, "N 2"]
    width_m: float
    kind: LaneKind | None
    """Kind of the lane; None for sidewalks and parking strips."""
    is_parking: bool

    @property
    def is_internal(self) -> bool:
        """Whether it is within a junction."""
        return self.edge.startswith(":")


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """Contents of a net that a road map needs."""

    lanes: Mapping[str, SumoLane]
    """Lanes by SUMO id, in the order of the file."""
    links: tuple[tuple[str, str], ...]
    """Pairs of consecutive lanes, including internal lanes of junctions."""
    junction_of: Mapping[str, tuple[str, str]]
    """Junctions at the start and end of each normal edge."""
    num_legs: Mapping[str, int]
    """Number of roads at each junction; a road with two directions counts once."""
    junction_areas_m: Mapping[str, Float[np.ndarray, "_ 2"]]
    walking_areas_m: tuple[Float[np.ndarray, "_ 2"], ...]
    crossings: tuple[tuple[Float[np.ndarray, "_ 2"], float], ...]
    """Centre line and width of each pedestrian crossing."""
    has_signals: bool

    @cached_property
    def lanes_of_edge(self) -> dict[str, list[SumoLane]]:
        """Lanes of each edge, from the kerb to the left."""
        result: dict[str, list[SumoLane]] = {}
        for lane in self.lanes.values():
            result.setdefault(lane.edge, []).append(lane)
        return result


def parsed_net(net_file: Path) -> "Net":
    """The net in a file, junctions' own lanes and footways included, as sumolib has it.

    Raises:
        SynthesisError: the file is missing or no SUMO net, or sumolib is not installed.
    """
    try:
        from sumolib.net import readNet
    except ImportError as error:
        raise SynthesisError(
            "sumolib is not installed; expected it from pip install 'pd-editor[synth]'."
        ) from error
    try:
        net_file.stat()
        net = readNet(
            str(net_file),
            withInternal=True,
            withPedestrianConnections=True,
            withPrograms=True,
            lxml=False,
        )
    except (OSError, SAXException, KeyError, ValueError, TypeError) as error:
        raise SynthesisError(f"{net_file}: expected a SUMO net ({error}).") from error
    if not net.getEdges():
        raise SynthesisError(f"{net_file}: expected a SUMO net with edges.")
    return net


def read_sumo_net(net_file: Path) -> SumoNet:
    """What a road map needs of the net in a file.

    Raises:
        SynthesisError: the file is missing or no SUMO net.
    """
    net = parsed_net(net_file)
    by_function: dict[str, list[Any]] = {}
    for edge in net.getEdges():
        by_function.setdefault(edge.getFunction(), []).append(edge)
    afoot = [*by_function.get("crossing", ()), *by_function.get("walkingarea", ())]
    lanes = {
        lane.getID(): _lane(lane, edge.getID())
        for edge in net.getEdges()
        if edge not in afoot
        for lane in edge.getLanes()
    }
    ends = {
        edge.getID(): (edge.getFromNode().getID(), edge.getToNode().getID())
        for edge in by_function.get("", ())
    }
    return SumoNet(
        lanes=lanes,
        links=tuple(
            link
            for edge in (*by_function.get("", ()), *by_function.get("internal", ()))
            for link in _links(edge)
            if link[1] in lanes
        ),
        junction_of=ends,
        num_legs=_num_legs(ends),
        junction_areas_m={
            node.getID(): np.array(node.getShape())
            for node in net.getNodes()
            if node.getShape()
        },
        walking_areas_m=tuple(
            lane_shape_m(edge.getLane(0)) for edge in by_function.get("walkingarea", ())
        ),
        crossings=tuple(
            (lane_shape_m(edge.getLane(0)), edge.getLane(0).getWidth())
            for edge in by_function.get("crossing", ())
        ),
        has_signals=bool(net.getTrafficLights()),
    )


def lane_shape_m(lane: "Lane") -> Float[np.ndarray, "N 2"]:
    """Middle line of a lane; outline of a walking area."""
    return np.array(lane.getShape())


def _lane(lane: "Lane", edge: str) -> SumoLane:
    kinds = [kind for name, kind in _KIND_OF.items() if lane.allows(name)]
    return SumoLane(
        sumo_id=lane.getID(),
        edge=edge,
        index=lane.getIndex(),
        shape_m=lane_shape_m(lane),
        width_m=lane.getWidth(),
        kind=kinds[0] if kinds else None,
        is_parking=not (kinds or lane.allows("pedestrian") or edge.startswith(":")),
    )


def _links(edge: "Edge") -> Iterator[tuple[str, str]]:
    for lane in edge.getLanes():
        for link in lane.getOutgoing():
            yield lane.getID(), link.getViaLaneID() or link.getToLane().getID()


def _num_legs(ends: Mapping[str, tuple[str, str]]) -> dict[str, int]:
    others: dict[str, set[str]] = {}
    for start, end in ends.values():
        others.setdefault(start, set()).add(end)
        others.setdefault(end, set()).add(start)
    return {junction: len(there) for junction, there in others.items()}
