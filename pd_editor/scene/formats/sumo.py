"""SUMO networks (.net.xml), and floating-car data (.fcd.xml) beside them."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.plain_text import one_line
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import (
    NO_HEADINGS,
    FileScene,
    FileTrack,
    headings_on_the_way,
    usual_now_s,
)
from pd_editor.scene.formats.file_signal import FileSignal, cyclic_signal
from pd_editor.scene.formats.missing_links import with_missing_links
from pd_editor.scene.formats.packed_file import (
    head_of,
    named_by,
    stem_of,
    unpacked_name,
)
from pd_editor.scene.formats.recorded_map import crosswalks_of
from pd_editor.scene.formats.scene_format import SceneFormat, has_root
from pd_editor.scene.formats.sumo_net import (
    CROSSWALK,
    PAVED,
    SumoNet,
    center_of_front,
    heading_of_sumo,
    points_of,
    sumo_net,
)
from pd_editor.scene.formats.sumo_writer import write
from pd_editor.scene.formats.xml_file import Place, parse_xml
from pd_editor.scene.geometry.angles import left_of, unit_vector
from pd_editor.scene.geometry.map_projection import projected
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import at_height_zero, without_repeats
from pd_editor.scene.geometry.wide_line import borders_m, wide_lines, with_end_normals
from pd_editor.scene.road_map import Lane, LaneMark
from pd_editor.scene.scenario import Scenario

ENDING: Final = ".net.xml"
CONFIGS: Final = (".sumocfg", ".sumo.cfg")
"""Endings of configurations, which are opened themselves; in folders networks are."""
_FILES: Final = {
    "net": "net-file",
    "fcd": "fcd-output",
    "rou": "route-files",
    "add": "additional-files",
}
"""Elements of configurations that name files."""
_CLASSES: Final = {
    "pedestrian": (AgentKind.PEDESTRIAN, 0.215),
    "bicycle": (AgentKind.CYCLIST, 1.6),
    "bike": (AgentKind.CYCLIST, 1.6),
    "moped": (AgentKind.MOTORCYCLIST, 2.1),
    "motorcycle": (AgentKind.MOTORCYCLIST, 2.2),
    "bus": (AgentKind.BUS, 12.0),
    "coach": (AgentKind.BUS, 14.0),
    "tram": (AgentKind.BUS, 22.0),
    "trailer": (AgentKind.VEHICLE, 16.5),
    "truck": (AgentKind.VEHICLE, 7.1),
    "delivery": (AgentKind.VEHICLE, 6.5),
    "emergency": (AgentKind.VEHICLE, 6.5),
    "passenger": (AgentKind.VEHICLE, 5.0),
}
"""Kind and SUMO's length of vehicle classes; others are as ``passenger``. Types have such names."""
_USUAL: Final = "passenger"
_PERSON: Final = "pedestrian"
_STATE: Final = {
    "x": None,
    "y": None,
    "angle": np.nan,
    "speed": np.nan,
    "speedLat": 0.0,
}
"""Attributes of a state, and what stands for those that are not there."""
_SAME_POINT_M: Final = 0.01
_NEAR_DEG: Final = 0.01


def read(path: Path) -> Scenario:
    """Read a network, and the vehicles and persons in the floating-car data beside it.

    ``NAME.fcd.xml`` has the states, ``NAME.rou.xml`` and ``NAME.add.xml`` the sizes of
    ``NAME.net.xml``'s vehicles; each may be gzipped. A ``.sumocfg`` names them. Signals have the states of their
    static programmes.

    Raises:
        FormatError: a file is damaged, or has no edges.
    """
    net_file, beside = _files(path)
    root, data = parse_xml(net_file, "net")
    net = sumo_net(root)
    # Of these, SUMO does not heed the name of the root.
    types = [parse_xml(one, None)[0] for one in (*beside["rou"], *beside["add"])]
    tracks: tuple[FileTrack, ...] = ()
    times: list[float] = []
    notes: list[str] = []
    if any(map(_reacts, root.children("tlLogic"))):
        notes.append("Signals that react to traffic have unknown states.")
    for file in beside["fcd"][:1]:
        motion, more = parse_xml(file, "fcd-export")
        known = {
            one.get("id"): one for part in types for one in part.children(".//vType")
        }
        tracks, times = _tracks(motion, known, root.children("location")[:1])
        if any(not one.get("angle") for one in motion.element.iterfind("timestep/*")):
            notes.append(NO_HEADINGS)
        data += more
    lanes, number = _lanes(net)
    lanes, linked = with_missing_links(lanes)
    polygons = _polygons(types)
    walks = crosswalks_of(enumerate(polygons[CROSSWALK], 10**6))
    return FileScene(
        path=path,
        name=stem_of(path).removesuffix(".net"),
        lanes=lanes,
        crosswalks=(*net.crosswalks(1), *walks),
        more_paved=[*net.paved_beside_lanes(), *map(valid_area, polygons[PAVED])],
        tracks=tracks,
        signals=tuple(_signals(root, net, number)),
        current_s=usual_now_s(times[0], times[-1]) if times else None,
        notes=(*notes, *linked),
    ).scenario(data)


def _files(path: Path) -> tuple[Path, dict[str, list[Path]]]:
    """A network, and files of motion, of types and of more, which are named or beside it."""
    named: dict[str, list[Path]] = {}
    if _is_config(path):
        config = parse_xml(path, None)[0]
        for part, tag in _FILES.items():
            places = [
                named_by(path, name)
                for one in config.children(f".//{tag}")
                for name in one.get("value").split(",")
            ]
            found = (next(filter(Path.is_file, one), None) for one in places)
            named[part] = [one for one in found if one is not None]
        if not named["net"]:
            raise config.error("names no net-file that is there; expected a network.")
        (path,) = named["net"][:1]
    name = stem_of(path).removesuffix(".net")
    beside = {
        part: [
            found
            for ending in (".xml", ".xml.gz")
            if (found := path.with_name(f"{name}.{part}{ending}")).is_file()
        ]
        for part in ("fcd", "rou", "add")
    }
    return path, {part: named.get(part) or files[:1] for part, files in beside.items()}


def _polygons(roots: Sequence[Place]) -> dict[str, list[Float[np.ndarray, "_ 2"]]]:
    """Rings of crosswalks and of drivable areas."""
    found: dict[str, list[Float[np.ndarray, "_ 2"]]] = {CROSSWALK: [], PAVED: []}
    for place in (one for root in roots for one in root.children("poly")):
        kind = place.get("type")
        if kind in found and len(ring := points_of(place)) > 2:
            found[kind].append(ring)
    return found


def _lanes(net: SumoNet) -> tuple[tuple[Lane, ...], dict[str, int]]:
    """All lanes for traffic, those through junctions among them, and their numbers."""
    shapes = {
        name: points
        for name, lane in net.lanes.items()
        if lane.kind is not None
        and len(points := without_repeats(lane.shape_m, _SAME_POINT_M)) > 1
    }
    widths = [
        np.full(len(one), net.lanes[name].width_m) for name, one in shapes.items()
    ]
    lines = dict(zip(shapes, wide_lines([*shapes.values()], widths), strict=True))
    number = {name: row for row, name in enumerate(lines, start=1)}
    after: dict[str, list[str]] = {name: [] for name in net.lanes}
    before: dict[str, list[str]] = {name: [] for name in net.lanes}
    for start, end in net.links:
        after[start].append(end)
        before[end].append(start)
    ways = {
        name: [
            tuple(dict.fromkeys(_next(name, links, net, number)))
            for links in (after, before)
        ]
        for name in lines
    }
    joined = dict(lines)
    for name, (ahead, behind) in ways.items():
        if net.lanes[name].is_internal and ahead and behind:
            ends = lines[behind[0]].normal[-1], lines[ahead[0]].normal[0]
            joined[name] = with_end_normals(lines[name], *ends)
    lanes = []
    borders = borders_m([*joined.values()])
    for (name, line), (on_left, on_right) in zip(joined.items(), borders, strict=True):
        lane = net.lanes[name]
        kerb, inner = (
            number.get(f"{lane.edge}_{lane.index + step}")
            if not lane.is_internal or lane.edge in net.junction_edges
            else None
            for step in (-1, 1)
        )
        left, right = (kerb, inner) if net.drives_left else (inner, kerb)
        assert lane.kind is not None, "it is driven on"
        lanes.append(
            Lane(
                lane_id=number[name],
                kind=lane.kind,
                is_intersection=lane.edge in net.junction_edges
                or (lane.is_internal and lane.junction in net.crossed_junctions),
                centerline=at_height_zero(line.points_m),
                left=at_height_zero(on_left),
                right=at_height_zero(on_right),
                left_mark=_mark(left),
                right_mark=_mark(right),
                successors=tuple(number[one] for one in ways[name][0]),
                predecessors=tuple(number[one] for one in ways[name][1]),
                left_neighbor=left,
                right_neighbor=right,
            )
        )
    return tuple(lanes), number


def _signals(
    root: Place, net: SumoNet, number: Mapping[str, int]
) -> Iterator[FileSignal]:
    """Signals of connections; those that always have the same state are one signal."""
    # Of several programmes of a signal, SUMO runs the last one.
    phases = {one.attribute("id"): _phases(one) for one in root.children("tlLogic")}
    stops: dict[tuple[str, str], dict[int, Float[np.ndarray, "2"] | None]] = {}
    # Lanes through junctions that the file lacks were made.
    ends = {one: end for one, end in net.links if net.lanes[one].is_internal}
    through = {
        (one, ends.get(via)): via
        for one, via in net.links
        if net.lanes[via].is_internal and not net.lanes[one].is_internal
    }
    for one in root.children("connection"):
        name = one.element.get("tl")
        start, end = (
            f"{one.attribute(edge)}_{one.attribute(lane)}"
            for edge, lane in (("from", "fromLane"), ("to", "toLane"))
        )
        if name not in phases or start not in number:
            continue
        via = one.element.get("via") or through.get((start, end))
        within = via or end
        begins = within in number and (
            via is not None or net.lanes[end].edge in net.junction_edges
        )
        lane, row = (within, 0) if begins else (start, -1)
        index, states = one.integer("linkIndex"), phases[name][2]
        if not all(0 <= index < len(state) for state in states):
            raise one.error(f"has link {index}, which a phase of {name!r} has not.")
        key = (name, "".join(state[index] for state in states) or str(index))
        stops.setdefault(key, {})[number[lane]] = net.lanes[lane].shape_m[row]
    for row, ((name, letters), stop_m) in enumerate(stops.items()):
        offset, seconds, _ = phases[name]
        cycle = list(zip(seconds, letters, strict=False))
        yield cyclic_signal(f"{name}:{row}", stop_m, cycle, offset)


def _phases(logic: Place) -> tuple[float, list[float], list[str]]:
    """Offset, durations and states; none if they react to traffic."""
    found = logic.children("phase") if not _reacts(logic) else []
    seconds = [one.number("duration") for one in found]
    if not all(one > 0 for one in seconds):
        raise logic.error("has a phase that does not last; expected more than 0 s.")
    # A green that gives way is green.
    states = [one.attribute("state").replace("g", "G") for one in found]
    return logic.number("offset", 0.0), seconds, states


def _reacts(logic: Place) -> bool:
    return logic.get("type", "static") != "static"


def _mark(neighbor: int | None) -> LaneMark:
    """Nets have no markings, but neighbours between which vehicles change lanes."""
    return LaneMark.UNKNOWN if neighbor is None else LaneMark.DASHED_WHITE


def _next(
    name: str, links: Mapping[str, list[str]], net: SumoNet, known: Mapping[str, int]
) -> Iterator[str]:
    """Known lanes that are linked to one, directly or by lanes of one point."""
    seen, rest = {name}, list(links[name])
    while rest:
        one = rest.pop(0)
        if one in known:
            yield one
        elif net.lanes[one].kind is not None and one not in seen:
            seen.add(one)
            rest = [*links[one], *rest]


def _tracks(
    root: Place, types: Mapping[str, Place], location: Sequence[Place]
) -> tuple[tuple[FileTrack, ...], list[float]]:
    """Tracks of vehicles and persons in the order in which they appear; all times."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    first: dict[str, Place] = {}
    times = []
    for step in root.children("timestep"):
        times.append(_time_s(step))
        for tag in ("vehicle", "person"):
            for place in step.children(tag):
                name = place.attribute("id")
                first.setdefault(name, place)
                told = place.element.keys()
                numbers = [
                    place.number(key) if default is None or key in told else default
                    for key, default in _STATE.items()
                ]
                rows.setdefault(name, []).append((times[-1], *numbers))
    steps = np.diff(times)
    step_s = float(np.median(steps)) if len(steps) else 0.0
    tables = {name: np.array(one) for name, one in rows.items()}
    if tables and location:
        points = np.concatenate([one[:, 1:3] for one in tables.values()])
        if _is_in_degrees(points, location[0]):
            for one in tables.values():
                one[:, 1:3] = _in_metres(one[:, 1:3], location[0], root)
    return tuple(
        _track(first[name], types, one, step_s) for name, one in tables.items()
    ), times


def _time_s(step: Place) -> float:
    """Seconds, which may be told as HH:MM:SS, after days if there are any."""
    told = re.fullmatch(
        r"(?:(\d+):)?(\d+):(\d\d):(\d\d(?:\.\d*)?)", step.attribute("time")
    )
    if told is None:
        return step.number("time")
    days, hours, minutes, seconds = (float(one or 0) for one in told.groups())
    return ((24 * days + hours) * 60 + minutes) * 60 + seconds


def _numbers(location: Place, name: str, count: int) -> Float[np.ndarray, "_"]:
    try:
        found = np.array(location.get(name).split(","), float)
    except ValueError:
        found = np.zeros(0)
    return found if len(found) == count else np.full(count, np.nan)


def _is_in_degrees(points: Float[np.ndarray, "N 2"], location: Place) -> bool:
    """Whether places are those of ``--fcd-output.geo``: all near the net, in degrees."""
    bounds = _numbers(location, "origBoundary", 4)
    is_near = (bounds[:2] - _NEAR_DEG < points) & (points < bounds[2:] + _NEAR_DEG)
    is_projected = location.get("projParameter", "!") != "!"
    return is_projected and bool(is_near.all() and (np.abs(bounds) <= 180.0).all())


def _in_metres(
    degrees: Float[np.ndarray, "N 2"], location: Place, root: Place
) -> Float[np.ndarray, "N 2"]:
    """Longitudes and latitudes in the net's metres."""
    lon, lat = degrees.T
    found = projected(location.attribute("projParameter"), lat, lon)
    if found is None:
        raise root.error(
            "is in degrees, of a projection other than transverse Mercator; expected metres."
        )
    return found + _numbers(location, "netOffset", 2)


def _track(
    place: Place,
    types: Mapping[str, Place],
    table: Float[np.ndarray, "N 6"],
    step_s: float,
) -> FileTrack:
    is_person = place.element.tag == "person"
    type_id = place.get("type")
    found = types.get(type_id)
    told = None if found is None else found.get("vClass", _USUAL)
    guess = next((one for one in _CLASSES if one in type_id.lower()), _USUAL)
    kind, length = _CLASSES.get(
        _PERSON if is_person else told or guess, _CLASSES[_USUAL]
    )
    kind = next((one for one in AgentKind if type_id.startswith(one.value)), kind)
    size = None
    if found is not None and found.get("length") and found.get("width"):
        size = length, _ = found.number("length"), found.number("width")
    time_s, x, y, angle, speed, aside = table.T
    place_m = np.stack([x, y], axis=-1)
    heading = headings_on_the_way(time_s, place_m, heading_of_sumo(angle))
    ahead = unit_vector(heading)
    # The position of a person is the middle, as it is of nobody else.
    back = np.full(len(table), 0.0 if is_person else length)
    return FileTrack(
        track_id=one_line(place.attribute("id")),
        kind=kind,
        size_m=size,
        time_s=time_s,
        position_m=center_of_front(place_m, heading, back),
        heading_rad=heading,
        velocity_mps=None
        if np.isnan(speed).any()
        else speed[:, None] * ahead + aside[:, None] * left_of(ahead),
        longest_gap_s=1.5 * step_s,
    )


_is_network: Final = has_root("net", ENDING)


def _is_config(path: Path) -> bool:
    return unpacked_name(path.name).lower().endswith(CONFIGS)


def _recognises(path: Path) -> bool:
    return _is_network(path) or (_is_config(path) and b"<net-file" in head_of(path))


SUMO: Final = SceneFormat(
    name="sumo",
    title="SUMO",
    endings=(ENDING,),
    recognises=_recognises,
    read=read,
    write=write,
)
