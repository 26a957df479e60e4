"""ASAM OpenDRIVE road networks, versions 1.0 to 1.9 (XML), and OpenSCENARIO on them."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.formats.file_signal import FileSignal, cyclic_signal
from pd_editor.scene.formats.lane_drive import Key, RoadLanes
from pd_editor.scene.formats.missing_links import with_missing_links
from pd_editor.scene.formats.opendrive_writer import (
    INTERSECTION,
    JOINT,
    JOINT_M,
    LEFT,
    PAVING,
    RIGHT,
    ROAD_MARKS,
    write,
)
from pd_editor.scene.formats.openscenario import (
    ENDING,
    Motion,
    Pose,
    motion_of,
    road_network_of,
    scenario_root,
)
from pd_editor.scene.formats.packed_file import ending_of, head_of, stem_of
from pd_editor.scene.formats.recorded_map import crosswalks_of
from pd_editor.scene.formats.reference_line import Cubics, ReferenceLine
from pd_editor.scene.formats.scene_format import SceneFormat, has_root
from pd_editor.scene.formats.xml_file import EDITOR, Place, parse_xml, told_of
from pd_editor.scene.geometry.map_projection import projected
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import onward
from pd_editor.scene.road_map import Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_COORDINATE_M, MAX_LINES_M

MOST_MINOR: Final = 9
"""Newest minor version that is known."""
SPACING_M: Final = 1.0
_SAME_LINE_M: Final = 0.01
_HOLE_M: Final = 1.0
"""Longer parts of a reference line that are not told are told of."""
_ROUNDED_M: Final = 0.5
"""Places this far beyond a road are at its end."""
_SAME_AREA: Final = 0.9
"""Share of each other from which two crosswalks are one."""
_LEAST_WIDTH_M: Final = 0.3
"""Lanes of other writers that are nowhere wider are left out."""
_LANE_KINDS: Final = {
    "driving": LaneKind.VEHICLE, "entry": LaneKind.VEHICLE, "exit": LaneKind.VEHICLE,
    "onramp": LaneKind.VEHICLE, "offramp": LaneKind.VEHICLE,
    "connectingramp": LaneKind.VEHICLE, "sliplane": LaneKind.VEHICLE,
    "bidirectional": LaneKind.VEHICLE, "hov": LaneKind.VEHICLE, "shared": LaneKind.VEHICLE,
    "mwyentry": LaneKind.VEHICLE, "mwyexit": LaneKind.VEHICLE,
    "bus": LaneKind.BUS, "taxi": LaneKind.BUS, "biking": LaneKind.BIKE,
}  # fmt: skip
"""Types of lanes that are driven on, in lower case."""
_USERS: Final = {
    "passengercar": LaneKind.VEHICLE, "autonomoustraffic": LaneKind.VEHICLE,
    "throughtraffic": LaneKind.VEHICLE, "bus": LaneKind.BUS, "taxi": LaneKind.BUS,
    "bicycle": LaneKind.BIKE,
}  # fmt: skip
"""Kinds of lanes that only these may use, by words of access rules in lower case; cars first."""
_PAVED: Final = {
    **dict.fromkeys(("shoulder", "parking", "stop", "restricted"), np.inf), "border": 3.0
}  # fmt: skip
"""Types of lanes that are drivable, but lead nowhere, if narrower: wide borders are verges."""
_MARKS: Final = {kind: mark for mark, kind in ROAD_MARKS.items()}
_SOURCES: Final = ("vendor", "name", "license", "copyright")
_STOP_LINE: Final = "294"
_LIGHTS: Final = "10000"
"""How types of traffic lights begin; these are not for vehicles."""
_OTHER_LIGHTS: Final = frozenset({"1000002", "1000007", "1000013"})
End = Literal["start", "end"]


def read(path: Path) -> Scenario:
    """Read a road network, and the agents of the ``.xosc`` file beside it, if there is one.

    A ``.xosc`` file is read with the network that it names.
    Lanes are one for each lane of each section; elevations are kept, cross falls are not.
    Roads without length, or connecting within centimetres, only join lanes. Lights have the
    states of that file, or none; signs, and objects other than crosswalks and asphalt, are left out. City
    coordinates are those that the header's offset leads to, unless it turns the road.

    Raises:
        FormatError: a file is damaged, of an unknown version, or without lanes.
    """
    story = (
        path if ending_of(path) == ENDING else path.with_name(stem_of(path) + ENDING)
    )
    scenario = scenario_root(story) if story.exists() else None
    roads_at = road_network_of(scenario[0]) if scenario and story == path else path
    root, data = parse_xml(roads_at, "OpenDRIVE")
    # Some editors write no version, or no header at all.
    header = next(iter(root.children("header")), root)
    major, minor = header.number("revMajor", 1.0), header.number("revMinor", 0.0)
    if major != 1 or not 0 <= minor <= MOST_MINOR:
        raise header.error(
            f"is of version {major:g}.{minor:g}; expected 1.0 to 1.{MOST_MINOR}."
        )
    roads = _roads(root)
    network = _Network(root, roads)
    paved = [area for road in roads.values() for area in road.paved()]
    walks = _distinct(ring for road in roads.values() for ring in road.crosswalks())
    lanes, linked = network.lanes()
    motion, told = Motion(), [told_of(header.element, *_SOURCES)]
    if scenario is not None:
        about = scenario[0].children("FileHeader[License]")
        told += [told_of(one.element, "author", "License") for one in about]
        on_roads = partial(_pose, roads), partial(_of_earth, header)
        motion = motion_of(*scenario, *on_roads, RoadLanes(lanes, network.number))
    signals, notes = network.signals(motion)
    if bare := sum(not road.length_m for road in roads.values()):
        notes = (*notes, f"{bare} roads without length only join others.")
    if places := len(root.children("junction[@type='virtual']")):
        notes = (*notes, f"{places} virtual junctions join nothing.")
    if layers := len(root.children("road/lanes[@layer='temporary']")):
        notes = (*notes, f"Temporary lanes of {layers} roads are left out.")
    if holed := [name for name, road in roads.items() if road.line.gap_m > _HOLE_M]:
        notes = (*notes, f"Reference lines with gaps: {', '.join(holed[:6])}.")
    scene = FileScene(
        path=path,
        name=stem_of(path),
        lanes=lanes,
        crosswalks=crosswalks_of(enumerate(walks, start=10**6)),
        more_paved=paved,
        signals=signals,
        tracks=motion.tracks,
        ego_id=motion.ego_id,
        current_s=motion.current_s,
        notes=(*notes, *linked, *motion.notes),
        attribution="; ".join(filter(None, told)),
    ).scenario(data + motion.data)
    return replace(scene, origin_city_m=scene.origin_city_m + _offset(header))


def _roads(root: Place) -> "dict[str, _Road]":
    roads: dict[str, _Road] = {}
    within = {
        one.get("connectingRoad"): one.element.getparent().get("id")
        for one in root.children("junction/connection")
    }
    for place in root.children("road"):
        road = _Road(place, within, 0.0 if _is_own(root) else _LEAST_WIDTH_M)
        if road.name in roads:
            raise place.error("comes twice; expected ids that are unique.")
        roads[road.name] = road
    return roads


def _is_own(root: Place) -> bool:
    """Whether it is an export of this editor, to which nothing is to be added."""
    return bool(root.children(f"header[@vendor='{EDITOR}']"))


def _distinct(
    rings: Iterable[Float[np.ndarray, "_ 2"]],
) -> list[Float[np.ndarray, "_ 2"]]:
    """Rings without those that cover the same ground as one before."""
    kept: list[tuple[BaseGeometry, Float[np.ndarray, "_ 2"]]] = []
    for ring in rings:
        area = valid_area(ring)
        least = _SAME_AREA * area.area
        if not any(
            least < area.intersection(one).area > _SAME_AREA * one.area
            for one, _ in kept
        ):
            kept.append((area, ring))
    return [ring for _, ring in kept]


def _offset(header: Place) -> Float[np.ndarray, "2"]:
    """Way from the file's origin to that of its projection; 0 where it is turned, too."""
    for one in header.children("offset"):
        shift = np.array([one.number("x"), one.number("y")])
        if not one.number("hdg", 0.0) and np.abs(shift).max() <= MAX_COORDINATE_M:
            return shift
    return np.zeros(2)


def _of_earth(
    header: Place, lat_deg: float, lon_deg: float
) -> Float[np.ndarray, "2"] | None:
    """A place in the file's frame; None if its projection is unknown."""
    told = header.text("geoReference")
    found = projected(told, np.array([lat_deg]), np.array([lon_deg]))
    return None if found is None else found[0] - _offset(header)


def _pose(
    roads: Mapping[str, "_Road"],
    place: Place,
    name: str,
    lane: int | None,
    s: float,
    beside: float,
) -> tuple[Pose, float]:
    """Pose of a place on a road, in the driving direction of the lane, if there is one.

    With it comes how far it is beside the road's line.
    """
    road = roads.get(name)
    if road is None or not -_ROUNDED_M <= s <= road.length_m + _ROUNDED_M:
        raise place.error("names no road of the network, or no place on one.")
    s = min(max(s, 0.0), road.length_m)
    x, y, heading = road.line.at(np.array([s]))[0, :3].tolist()
    turn = 0.0
    if lane is not None:
        section = road.section_at(s, lane)
        if lane not in section.lanes:
            raise place.error("names no lane of the road there.")
        beside += float(np.interp(s, section.s_m, section.middle(lane)))
        turn = 0.0 if road.leads_on(lane, section.lanes[lane])[0] else np.pi
    pose = x - beside * np.sin(heading), y + beside * np.cos(heading), heading + turn
    return pose, beside


@dataclass(frozen=True, eq=False)
class _Section:
    """A lane section with the outer border of each lane."""

    place: Place
    index: int
    sides: Sequence[str]
    """Which are in it: left, right or both."""
    s_m: Float[np.ndarray, "K"]
    """Places along the road at which borders are known."""
    line: Float[np.ndarray, "K 4"]
    """Reference line there: x, y, heading, elevation."""
    border_m: Mapping[int, Float[np.ndarray, "K"]]
    """Lateral place of each lane's outer border; 0 is the centre."""
    lanes: Mapping[int, Place]

    def inner(self, lane: int) -> int:
        """The next lane towards the centre, which is 0; ids may be left out."""
        side = 1 if lane > 0 else -1
        return side * max(
            n * side for n in self.border_m if 0 <= n * side < lane * side
        )

    def outer(self, lane: int, side: int) -> int:
        """The next lane away from the centre on a side (1: left, -1: right), else 0."""
        return side * min(
            (n * side for n in self.lanes if n * side > lane * side), default=0
        )

    def middle(self, lane: int) -> Float[np.ndarray, "K"]:
        """Lateral place of a lane's middle."""
        return (self.border_m[lane] + self.border_m[self.inner(lane)]) / 2

    def points(self, lateral_m: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 3"]:
        """Points beside the reference line."""
        x, y, heading, height = self.line.T
        return np.stack(
            [x - lateral_m * np.sin(heading), y + lateral_m * np.cos(heading), height],
            axis=-1,
        )

    def width_m(self, lane: int) -> float:
        """Width of a lane where it is widest."""
        width = np.abs(self.border_m[lane] - self.border_m[self.inner(lane)])
        return float(width.max())


class _Road:
    """A road with its sections."""

    def __init__(
        self, place: Place, within: Mapping[str, str], least_width_m: float
    ) -> None:
        """Of an element; ``within`` has junctions by their connecting roads."""
        self.place, self.name = place, place.attribute("id")
        self._least_width_m = least_width_m
        self.length_m = place.number("length")
        if not 0 <= self.length_m <= MAX_LINES_M:
            raise place.error(
                f"is {self.length_m:g} m long; expected 0 or more, and at most "
                f"{MAX_LINES_M:g}."
            )
        self.drives_left = place.get("rule").upper() == "LHT"
        junction = place.get("junction", within.get(self.name, "-1"))
        self.junction = "" if junction == "-1" else junction

    @cached_property
    def line(self) -> ReferenceLine:
        """The reference line."""
        plan = self.place.child("planView")
        profile = self.place.element.find("elevationProfile")
        return ReferenceLine.of(plan, profile, self.length_m)

    @cached_property
    def sections(self) -> list[_Section]:
        """All sections in the order of the road."""
        layers = self.place.element.xpath("lanes[not(@layer='temporary')]")
        lanes = (
            Place(self.place.path, layers[0]) if layers else self.place.child("lanes")
        )
        places = lanes.children("laneSection")
        starts = [one.number("s") for one in places]
        if starts and (
            sorted(starts) != starts
            or not -1e-3 <= starts[0] <= starts[-1] <= MAX_LINES_M
        ):
            raise lanes.error("has sections that are not in the order of s.")
        offset = Cubics.of(lanes.children("laneOffset"), "s")
        found: list[_Section] = []
        is_sided = any(one.get("singleSide") in ("true", "1") for one in places)
        for sides in (("left",), ("right",)) if is_sided else (("left", "right"),):
            # A section for one side leaves those of the other side as they are.
            here = [
                (place, start)
                for place, start in zip(places, starts, strict=True)
                if place.get("singleSide") not in ("true", "1")
                or any(place.element.find(side) is not None for side in sides)
            ]
            ends = [*(start for _, start in here[1:]), self.length_m][: len(here)]
            for (place, start), end in zip(here, ends, strict=True):
                index = len(found)
                found.append(self._section(place, index, sides, (start, end), offset))
        if not found:
            raise lanes.error("has no laneSection.")
        return found

    def _section(
        self,
        place: Place,
        index: int,
        sides: Sequence[str],
        span: tuple[float, float],
        offset: Cubics,
    ) -> _Section:
        start, end = span
        end = max(end, start + 1e-3)
        count = max(int(np.ceil((end - start) / SPACING_M)), 1) + 1
        corners = [one.start for one in self.line.pieces]
        knots = [
            start + Place(place.path, one).number("sOffset")
            for one in place.element.iter("width", "border")
        ]
        s = np.concatenate(
            [np.linspace(start, end, count), corners, offset.start, knots]
        )
        s = np.unique(s[(start <= s) & (s <= end)])
        center = offset.at(s)
        borders, lanes = {0: center}, {}
        beside: dict[int, int] = {}
        # The sign of its id tells the side of a lane; netconvert mixes up the elements.
        own = [one for side in sides for one in place.children(f"{side}/lane")]
        for one in sorted(own, key=lambda lane: abs(lane.integer("id"))):
            number = one.integer("id")
            sign = 1 if number > 0 else -1
            if number in borders:
                raise one.error("comes twice in its section, or is in the centre.")
            inner = borders[beside.get(sign, 0)]
            beside[sign] = number
            width = one.children("width")
            if width or not one.children("border"):
                lateral = Cubics.of(width, "sOffset").at(s - start)
                outer = inner + sign * np.maximum(lateral, 0.0)
            else:
                border = Cubics.of(one.children("border"), "sOffset").at(s - start)
                outer = center + border
            borders[number], lanes[number] = outer, one
        return _Section(place, index, sides, s, self.line.at(s), borders, lanes)

    @property
    def is_joint(self) -> bool:
        """Whether it is without length, or connecting and not to be driven on."""
        if self.place.element.find(f"userData[@code='{JOINT}']") is not None:
            return True
        return self.length_m < JOINT_M if self.junction else not self.length_m

    def driven(self) -> Iterator[tuple[_Section, int, bool]]:
        """Sections, ids and directions of the lanes that are driven on."""
        for section in self.sections:
            for number, place in section.lanes.items():
                is_wide = section.width_m(number) >= self._least_width_m
                if _kind(place) is not None and is_wide:
                    for leads_on in self.leads_on(number, place):
                        yield section, number, leads_on

    def leads_on(self, lane: int, place: Place) -> tuple[bool, ...]:
        """Whether a lane is driven in the direction of the road; two-way ones are twice."""
        told = place.get("direction")
        for one in place.children("userData/vectorLane"):
            # RoadRunner's word, relative to the road; older files have no rule of it.
            told = one.get("travelDir") or told
        usual = ((lane < 0) != self.drives_left) != (told == "reversed")
        if told in ("both", "bidirectional") or _type(place) == "bidirectional":
            return usual, not usual
        return (told == "forward" or (usual and told != "backward"),)

    def paved(self) -> Iterator[BaseGeometry]:
        """Areas of asphalt, and of lanes that are drivable, but lead nowhere."""
        for section in self.sections:
            for number, place in section.lanes.items():
                if section.width_m(number) < _PAVED.get(_type(place), 0.0):
                    inner = section.points(section.border_m[section.inner(number)])
                    outer = section.points(section.border_m[number])
                    yield valid_area(np.concatenate([inner, outer[::-1]])[:, :2])
        for one in self.place.children("objects/object"):
            is_asphalt = one.children(f".//outline[@fillType='{PAVING}']")
            if _type(one) == "parkingspace" or (_type(one) == "none" and is_asphalt):
                yield from map(valid_area, self._rings(one))

    def crosswalks(self) -> Iterator[Float[np.ndarray, "_ 2"]]:
        """Corners of the objects that are crosswalks, which RoadRunner may only name so."""
        for one in self.place.children("objects/object"):
            told, name = _type(one), one.get("name").lower()
            if told == "crosswalk" or (told in ("-1", "none") and "crosswalk" in name):
                yield from self._rings(one)

    def _rings(self, place: Place) -> Iterator[Float[np.ndarray, "N 2"]]:
        """Outlines of an object: each that it has, else that of its size, if it has one."""
        outlines = place.children(".//outline")
        is_placed = place.number("length", 0.0) > 0 and place.number("width", 0.0) > 0
        for one in outlines or [place] * is_placed:
            ring = self._corners(place, one)
            if len(ring) > 2:
                yield ring

    def _corners(self, place: Place, outline: Place) -> Float[np.ndarray, "N 2"]:
        s, t = place.number("s"), place.number("t")
        x, y, heading, _ = self.line.at(np.array([s]))[0]
        center = np.array([x - t * np.sin(heading), y + t * np.cos(heading)])
        turn = heading + place.number("hdg", 0.0)
        axis = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        if corners := outline.children("cornerLocal"):
            uv = np.array([(one.number("u"), one.number("v")) for one in corners])
            return center + uv @ axis
        if corners := outline.children("cornerRoad"):
            line = self.line.at(np.array([one.number("s") for one in corners]))
            beside = np.array([one.number("t") for one in corners])
            normal = np.stack([-np.sin(line[:, 2]), np.cos(line[:, 2])], axis=-1)
            return line[:, :2] + beside[:, None] * normal
        sides = [place.number(name, 0.0) for name in ("length", "width")]
        half = np.array(sides) / 2
        return center + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half @ axis

    def obeying(self, place: Place) -> dict[Key, Float[np.ndarray, "2"]]:
        """Lanes for which a signal, or a reference to one, is valid, and places on them."""
        s, way = place.number("s"), place.get("orientation", "none")
        here, found = {self.section_at(s, side) for side in (1, -1)}, {}
        spans = [
            sorted((one.integer("fromLane"), one.integer("toLane")))
            for one in place.children("validity")
        ]
        for one, lane, leads_on in self.driven():
            if one not in here:
                continue
            fits = way in ("none", "+-"[not leads_on])
            told = [
                low * high > 0 or fits for low, high in spans if low <= lane <= high
            ]
            if any(told) if spans else fits:
                line = one.points(one.middle(lane))
                found[self.name, one.index, lane, leads_on] = np.array(
                    [np.interp(s, one.s_m, axis) for axis in line.T[:2]]
                )
        return found

    def sections_of(self, lane: int) -> list[_Section]:
        """Those of the side of a lane, in the order of the road."""
        side = "left" if lane > 0 else "right"
        return [one for one in self.sections if side in one.sides] or self.sections

    def section_at(self, s: float, lane: int) -> _Section:
        """The section of a lane's side at a place along the road."""
        sections = self.sections_of(lane)
        return sections[max(sum(one.s_m[0] <= s for one in sections) - 1, 0)]

    def row(self, end: End, lane: int) -> int:
        """Index of the section of a lane's side at an end."""
        return self.sections_of(lane)[0 if end == "start" else -1].index

    def end_m(self, end: End) -> Float[np.ndarray, "2"]:
        """Place of an end of the reference line."""
        s = 0.0 if end == "start" else self.length_m
        return self.line.at(np.array([s]))[0, :2]


class _Network:
    """All roads with the links of their lanes."""

    def __init__(self, root: Place, roads: Mapping[str, _Road]) -> None:
        self._root, self._roads = root, roads
        self._driven = [
            (road, section, lane, leads_on)
            for road in roads.values()
            for section, lane, leads_on in road.driven()
        ]
        self.number: dict[Key, int] = {
            (road.name, section.index, lane, leads_on): row
            for row, (road, section, lane, leads_on) in enumerate(self._driven, start=1)
        }
        self._named = {
            f"{road} {lane}": row for (road, _, lane, _), row in self.number.items()
        }
        self._direct = {
            one.attribute("id")
            for one in root.children("junction")
            if one.get("type") == "direct"
        }

    def lanes(self) -> tuple[tuple[Lane, ...], list[str]]:
        """All lanes that are driven on, with their links; a note on those by place."""
        after: defaultdict[int, set[int]] = defaultdict(set)
        before: defaultdict[int, set[int]] = defaultdict(set)
        for first, second in self._links():
            after[first].add(second)
            before[second].add(first)
        for number, (road, *_) in enumerate(self._driven, start=1):
            if road.is_joint:
                ends = before[number], after[number]
                for one in ends[0]:
                    after[one] = after[one] - {number} | ends[1]
                for one in ends[1]:
                    before[one] = before[one] - {number} | ends[0]
        # Where any lane is linked, the file tells what is linked there.
        told = {self._place(number, is_end=True) for number in after if after[number]}
        told |= {
            self._place(number, is_end=False) for number in before if before[number]
        }
        lanes = tuple(
            self._lane(*one, after, before)
            for one in self._driven
            if not one[0].is_joint
        )
        if _is_own(self._root):
            return lanes, []
        return with_missing_links(
            lanes,
            lambda one, other: (
                self._place(one.lane_id, is_end=True) not in told
                or self._place(other.lane_id, is_end=False) not in told
            ),
        )

    def _place(self, number: int, *, is_end: bool) -> tuple[str, int, bool]:
        """Road, section, and whether it is the end of that, at which a lane begins or ends."""
        road, section, _, leads_on = self._driven[number - 1]
        return road.name, section.index, leads_on == is_end

    def signals(self, motion: Motion) -> tuple[tuple[FileSignal, ...], tuple[str, ...]]:
        """Traffic lights at the stop lines of their lanes, and notes on what is left out.

        Of several for a lane, which are repeated heads or for turns, it obeys the first.
        Lights of one controller that always have the same state are one signal.
        """
        known = {one.get("id"): one for one in self._root.element.iter("signal")}
        kinds = Counter(map(_kind_of_sign, known.values()))
        lines: dict[int, Float[np.ndarray, "2"]] = {}
        heads: defaultdict[str, dict[int, Any]] = defaultdict(dict)
        for road in self._roads.values():
            for one in road.place.children("signals/*"):
                sign = known.get(one.get("id"))
                kind = None if sign is None else _kind_of_sign(sign)
                if kind and one.element.tag in ("signal", "signalReference"):
                    here = lines if kind == _STOP_LINE else heads[one.get("id")]
                    for key, at in road.obeying(one).items():
                        if key in self.number:
                            here[self.number[key]] = at
        # Others join all lights of a junction, which have many states.
        groups = {
            one.get("signalId"): (control.get("name"), ())
            for control in self._root.children("controller")
            for one in control.children("control")
            if _is_own(self._root)
        }
        taken: set[int] = set()
        places: defaultdict[Any, dict[int, Any]] = defaultdict(dict)
        for name, stops in heads.items():
            own = {n: lines.get(n, at) for n, at in stops.items() if n not in taken}
            taken |= own.keys()
            if own or not stops:
                places[motion.phases.get(name) or groups.get(name, (name, ()))] |= own
        found = [
            cyclic_signal(name, stops, phases, 0.0)
            for (name, phases), stops in places.items()
        ]
        stateless = sum(not one.words for one in found)
        bare = len(lines.keys() - taken)
        told = (
            (stateless, f"{stateless} traffic lights have unknown states."),
            (bare, f"Stop lines without a traffic light are left out: {bare}."),
            (kinds[None], f"{kinds[None]} signs and other signals are left out."),
        )
        return tuple(found), tuple(text for holds, text in told if holds)

    def _lane(
        self,
        road: _Road,
        section: _Section,
        lane: int,
        leads_on: bool,
        after: Mapping[int, set[int]],
        before: Mapping[int, set[int]],
    ) -> Lane:
        number = self.number[road.name, section.index, lane, leads_on]
        inner = section.inner(lane)
        sides = section.border_m[inner], section.border_m[lane]
        marks = _mark(section, inner), _mark(section, lane)
        side = 1 if lane > 0 else -1
        neighbors = tuple(
            self.number.get((road.name, section.index, one, leads_on))
            for one in (inner or section.outer(0, -side), section.outer(lane, side))
        )
        step = 1 if leads_on else -1
        order = 1 if leads_on == (lane < 0) else -1
        left, right = sides[::order]
        left_mark, right_mark = marks[::order]
        beside = neighbors[::order]
        told = {
            one.get("code"): one.get("value")
            for one in section.lanes[lane].element.findall("userData")
        }
        left_neighbor, right_neighbor = (
            self._named.get(told.get(code) or "", one)
            for code, one in zip((LEFT, RIGHT), beside, strict=True)
        )
        center = _simplified(section.points(section.middle(lane))[::step])
        if len(center) < 2:
            raise section.place.error("has no geometry along it; expected some.")
        return Lane(
            lane_id=number,
            kind=_kind(section.lanes[lane]) or LaneKind.VEHICLE,
            is_intersection=INTERSECTION in told
            or (bool(road.junction) and road.junction not in self._direct),
            centerline=center,
            left=_simplified(section.points(left)[::step]),
            right=_simplified(section.points(right)[::step]),
            left_mark=left_mark,
            right_mark=right_mark,
            successors=tuple(sorted(after.get(number, ()))),
            predecessors=tuple(sorted(before.get(number, ()))),
            left_neighbor=left_neighbor,
            right_neighbor=right_neighbor,
        )

    def _links(self) -> Iterator[tuple[int, int]]:
        """Numbers of lanes of which the second one follows the first one."""
        for road, section, lane, _ in self._driven:
            for end in ("start", "end"):
                for other, its_end in self._touching(road, section, lane, end):
                    yield from self._joined(
                        (road.name, section.index, lane), end, other, its_end
                    )
        yield from self._through_junctions()

    def _touching(
        self, road: _Road, section: _Section, lane: int, end: End
    ) -> Iterator[tuple[tuple[str, int, int], End]]:
        """Lanes at an end of a lane, with their end there, by its own links."""
        tag = "predecessor" if end == "start" else "successor"
        ids = [
            one.integer("id")
            for one in section.lanes[lane].children(f"link/{tag}[@id]")
            if one.get("layer") != "temporary"
        ]
        if section.index != road.row(end, lane):
            near = section.index + (1 if end == "end" else -1)
            for one in ids:
                yield (road.name, near, one), "start" if end == "end" else "end"
            return
        # Virtual junctions link to places along a road (elementS).
        for link in road.place.element.xpath(f"link/{tag}[not(@elementS)]"):
            other = self._roads.get(link.get("elementId") or "")
            if link.get("elementType") == "road" and other is not None:
                contact = _contact(link)
                for one in ids:
                    yield (other.name, other.row(contact, one), one), contact

    def _through_junctions(self) -> Iterator[tuple[int, int]]:
        for junction in self._root.children("junction"):
            if junction.get("type") == "virtual":
                continue
            for connection in junction.children("connection"):
                first = self._roads.get(connection.get("incomingRoad"))
                name = connection.get("connectingRoad", connection.get("linkedRoad"))
                second = self._roads.get(name)
                if first is None or second is None:
                    continue
                contact = _contact(connection.element)
                gaps = {
                    end: float(np.hypot(*(first.end_m(end) - second.end_m(contact))))
                    for end in ("start", "end")
                }
                own: End = "start" if gaps["start"] < gaps["end"] else "end"
                for link in connection.children("laneLink"):
                    one, other = link.integer("from"), link.integer("to")
                    yield from self._joined(
                        (first.name, first.row(own, one), one),
                        own,
                        (second.name, second.row(contact, other), other),
                        contact,
                    )

    def _joined(
        self,
        one: tuple[str, int, int],
        end: End,
        other: tuple[str, int, int],
        its_end: End,
    ) -> Iterator[tuple[int, int]]:
        """Links of two lanes that touch, in the directions in which they are driven."""
        for first, second in (
            ((*one, end == "end"), (*other, its_end == "start")),
            ((*other, its_end == "end"), (*one, end == "start")),
        ):
            if first in self.number and second in self.number:
                yield self.number[first], self.number[second]


def _type(place: Place) -> str:
    """Type of a lane or an object; cases are mixed up, and it may be left out."""
    return place.get("type", "none").lower()


def _kind(lane: Place) -> LaneKind | None:
    """Kind of a lane by its type, and by who may use its beginning; None if nobody drives."""
    kind = _LANE_KINDS.get(_type(lane))
    rules = lane.children("access[@rule]")
    told: dict[str, set[str]] = {"allow": set(), "deny": set()}
    for one in (n for n in rules if n.number("sOffset", 0.0) == 0):
        words = [one, *one.children("restriction")]
        told.setdefault(one.get("rule").lower(), set()).update(
            (n.get("type") or n.get("restriction")).lower() for n in words
        )
    admitted, barred = told["allow"] - {""}, told["deny"]
    if kind is not LaneKind.VEHICLE or not (admitted or barred & _USERS.keys()):
        return kind
    users = (n for n in _USERS if n not in barred and (not admitted or n in admitted))
    return next((_USERS[n] for n in users), None)


def _contact(link: Any) -> End:
    return "end" if link.get("contactPoint") == "end" else "start"


def _kind_of_sign(sign: Any) -> str | None:
    """The beginning of a light's type, or a stop line's type; None for all else."""
    # Older files have points in it.
    kind = (sign.get("type") or "").replace(".", "")
    if sign.get("dynamic") in ("yes", "true", None) and kind not in _OTHER_LIGHTS:
        return _LIGHTS if kind.startswith(_LIGHTS) else None
    return kind if kind == _STOP_LINE else None


def _mark(section: _Section, lane: int) -> LaneMark:
    """The longest marking of a lane's outer border, or of the centre."""
    center = section.place.children("center/lane")[:1]
    marks = [
        one
        for n in ([section.lanes[lane]] if lane else center)
        for one in n.children("roadMark")
    ]
    if not marks:
        return LaneMark.UNKNOWN
    marks.sort(key=lambda one: one.number("sOffset", 0.0))
    starts = [one.number("sOffset", 0.0) for one in marks]
    length_m = float(np.ptp(section.s_m))
    found = marks[int(np.diff(np.minimum([*starts, length_m], length_m)).argmax())]
    kind, color = found.get("type"), found.get("color").lower()
    if kind == "none":
        return LaneMark.NONE
    color = color if color in ("yellow", "blue") else "white"
    return _MARKS.get((kind, color), LaneMark.UNKNOWN)


def _simplified(line: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "M 3"]:
    kept = shapely.simplify(shapely.LineString(line), _SAME_LINE_M)
    found = shapely.get_coordinates(kept, include_z=True)
    # Borders turn back within curves that are narrower than their road.
    return onward(found) if len(found) > 2 else found


_is_network: Final = has_root("opendrive", ".xodr", ".xodrz")


def _recognises(path: Path) -> bool:
    # Catalogs of OpenSCENARIO name no road network.
    is_scenario = ending_of(path) == ENDING and b"<logicfile" in head_of(path)
    return is_scenario or _is_network(path)


OPENDRIVE: Final = SceneFormat(
    name="opendrive",
    title="OpenDRIVE",
    endings=(".xodr", ".xodrz", ENDING),
    recognises=_recognises,
    read=read,
    write=write,
)
