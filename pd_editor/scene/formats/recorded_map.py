"""What recordings with centre lines only share (ScenarioNet, GPUDrive), read and written."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.base.errors import ExportError, FormatError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.missing_links import SAME_PLACE_M, meetings
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.geometry.polyline import (
    arc_length,
    at_height_zero,
    offset_line,
    without_repeats,
)
from pd_editor.scene.road_map import Crosswalk, Lane, LaneKind, LaneMark
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.scene_limits import MAX_COORDINATE_M
from pd_editor.scene.signals import SignalState

Result = TypeVar("Result")

TYPES: Final = {
    AgentKind.BUS: "VEHICLE",
    AgentKind.VEHICLE: "VEHICLE",
    AgentKind.MOTORCYCLIST: "CYCLIST",
    AgentKind.CYCLIST: "CYCLIST",
    AgentKind.PEDESTRIAN: "PEDESTRIAN",
    AgentKind.CONSTRUCTION: "TRAFFIC_CONE",
    AgentKind.STATIC: "TRAFFIC_BARRIER",
}
"""MetaDrive's types of agents; others are ``OTHER``."""
KINDS: Final = {word: kind for kind, word in TYPES.items()}

_FAULTS: Final = (LookupError, TypeError, ValueError, AttributeError, RecursionError)
"""What values of other kinds and shapes than expected raise."""
_NO_ITEMS: Final = (str, int, float, list, tuple, np.ndarray, type(None))
USUAL_WIDTH_M: Final = 3.5
_WIDTHS_M: Final = (2.2, 6.0)
_SAME_LINE_M: Final = 0.02


class _FieldError(FormatError):
    """An item of a file has something else in a field than expected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CenterLane:
    """A lane as such maps have it; keys name lanes of the same map."""

    key: str
    line: Float[np.ndarray, "N 2"]
    kind: LaneKind = LaneKind.VEHICLE
    half_width_m: tuple[float, float] | None = None
    """To the left and to the right; None: unknown."""
    polygon: Float[np.ndarray, "M 2"] | None = None
    successors: Sequence[str] | None = None
    """None: the map does not tell."""
    is_intersection: bool = False
    left_neighbor: str | None = None
    right_neighbor: str | None = None


def lanes_of(found: Sequence[CenterLane]) -> tuple[Lane, ...]:
    """Lanes with boundaries beside their centre lines, numbered from 1.

    Links that the map does not tell lead from the end of a lane to the beginnings there.
    Lanes that others name and that are not there have numbers as well, outside the map.

    Raises:
        FormatError: a lane has no usable key, line or width.
    """
    _check(found)
    number = lane_numbers(found)
    kept = [one for one in found if _is_line(one)]
    for one in kept:
        for key in (*(one.successors or ()), one.left_neighbor, one.right_neighbor):
            if key:
                number.setdefault(key, len(number) + 1)
    lines = [_simplified(one.line) for one in kept]
    follows = _links(kept, lines, number)
    before: dict[int, list[int]] = {}
    for first, others in follows.items():
        for other in others:
            before.setdefault(other, []).append(first)
    lanes: list[Lane] = []
    for one, line in zip(kept, lines, strict=True):
        own = number[one.key]
        left, right = _half_widths(one)
        lanes.append(
            Lane(
                lane_id=own,
                kind=one.kind,
                is_intersection=one.is_intersection,
                centerline=at_height_zero(line),
                left=at_height_zero(offset_line(line, left)),
                right=at_height_zero(offset_line(line, -right)),
                left_mark=LaneMark.UNKNOWN,
                right_mark=LaneMark.UNKNOWN,
                successors=tuple(follows.get(own, ())),
                predecessors=tuple(before.get(own, ())),
                left_neighbor=number.get(one.left_neighbor or ""),
                right_neighbor=number.get(one.right_neighbor or ""),
            )
        )
    return tuple(lanes)


def made_of(
    path: Path, what: str, make: Callable[..., Result], name: Any, *about: Any
) -> Result:
    """What ``make`` makes of an item of a file and more about it, such as a track.

    Raises:
        FormatError: the item is damaged; the message names it and the file.
    """
    try:
        return make(name, *about)
    except _FieldError as error:
        wrong = str(error)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from error
    except KeyError as error:
        wrong = f"has no {error}"
    except _FAULTS:
        wrong = "holds values of other kinds or shapes than expected"
        if about and isinstance(about[0], _NO_ITEMS):
            kind = type(about[0]).__name__.removesuffix("Type")
            wrong = f"is a {kind}; expected a dict"
    raise FormatError(f"{path}: its {what} {str(name)[:40]!r} {wrong}.")


def numbers_of(
    found: Mapping[str, Any], name: str, rows: int, columns: int = 1
) -> np.ndarray:
    """A field of some rows of numbers, or more, each of one column: flat, or of more.

    Raises:
        FormatError: it holds something else; ``made_of`` tells whose it is.
        KeyError: there is none.
    """
    values = found[name]
    each = f"{rows or ''} {'' if columns == 1 else f'rows of {columns} '}numbers"
    try:
        table = np.atleast_1d(np.array(values, float))
    except (TypeError, ValueError) as error:
        raise _FieldError(
            f"has no numbers for {name!r}; expected {each.strip()}"
        ) from error
    shape = list(table.shape)
    if columns == 1 and table.size == 1:
        table = np.full(rows or 1, table.item())
    elif columns == 1 and table.size == len(table):
        table = table.ravel()
    elif table.ndim != 1 + (columns > 1) or table.shape[-1] < columns:
        table = table[:0]
    if len(table) < max(rows, 1):
        raise _FieldError(f"has {name!r} of shape {shape}; expected {each.strip()}")
    return table[: rows or None]


@contextmanager
def read_as(path: Path, noun: str) -> Iterator[None]:
    """Tell of what fails inside that a file is none of its format.

    Raises:
        FormatError: a value has another kind or shape than expected.
    """
    try:
        yield
    except _FAULTS as error:
        raise FormatError(
            f"{path}: is no valid {noun}; a value in it has another kind or shape than "
            "expected."
        ) from error


def map_of(
    path: Path,
    lanes: Sequence[CenterLane],
    areas: Iterable[tuple[int, str, Float[np.ndarray, "_ 2"]]],
) -> dict[str, Any]:
    """Lanes, crosswalks and driveways of a scene; areas have a number, kind and ring.

    Raises:
        FormatError: a lane is damaged.
    """
    of_kind: dict[str, list[tuple[int, np.ndarray]]] = {"crosswalk": [], "driveway": []}
    for number, kind, ring in areas:
        if kind.lower() in of_kind and len(ring) > 2:
            of_kind[kind.lower()].append((number, ring))
    return {
        "lanes": made_of(path, "map", lanes_of, lanes),
        "crosswalks": crosswalks_of(of_kind["crosswalk"]),
        "more_paved": [valid_area(ring) for _, ring in of_kind["driveway"]],
    }


def crosswalks_of(
    rings: Iterable[tuple[int, Float[np.ndarray, "_ 2"]]],
) -> tuple[Crosswalk, ...]:
    """Crosswalks of numbered polygons; what is none is left out."""
    found = (crosswalk_of(number, ring) for number, ring in rings)
    return tuple(one for one in found if one is not None)


def lane_numbers(found: Sequence[CenterLane]) -> dict[str, int]:
    """Numbers that lanes get by their keys."""
    kept = filter(_is_line, found)
    return {one.key: row for row, one in enumerate(kept, start=1)}


def _check(found: Sequence[CenterLane]) -> None:
    """Raise for what no lane can be, with its name."""
    seen: set[str] = set()
    for one in found:
        if not one.key or one.key in seen:
            wrong = "comes twice, or has no usable name"
        elif np.ndim(one.line) != 2 or np.shape(one.line)[1] != 2:
            wrong = f"has a line of shape {np.shape(one.line)}; expected points of x, y"
        elif not (np.abs(one.line) <= MAX_COORDINATE_M).all():
            wrong = "has points without a place; expected metres"
        elif not np.isfinite(one.half_width_m or (0.0, 0.0)).all():
            wrong = "has no width; expected metres"
        elif min(one.half_width_m or (0.0, 0.0)) < 0:
            left, right = one.half_width_m or (0.0, 0.0)
            wrong = (
                f"is {left:g} m wide to the left and {right:g} m to the right of its line; "
                "expected metres of 0 or more"
            )
        else:
            seen.add(one.key)
            continue
        raise FormatError(f"lane {str(one.key)[:40]!r} {wrong}.")


def _is_line(lane: CenterLane) -> bool:
    return len(lane.line) > 1 and bool(np.ptp(lane.line, axis=0).any())


def crosswalk_of(number: int, ring: Float[np.ndarray, "N 2"]) -> Crosswalk | None:
    """Crosswalk between the long sides of a polygon, of which four corners turn most.

    A triangle has those of its smallest rectangle; a line is none.
    """
    around = shapely.minimum_rotated_rectangle(shapely.MultiPoint(ring))
    if not isinstance(around, shapely.Polygon) or around.is_empty:
        return None
    ring = without_repeats(ring)
    ring = ring[:-1] if np.allclose(ring[0], ring[-1]) else ring
    ring = ring if len(ring) >= 4 else np.asarray(around.exterior.coords)[:4]
    heading = heading_of(np.roll(ring, -1, axis=0) - ring)
    turn = np.abs(wrap_angle(heading - np.roll(heading, 1)))
    at = np.sort(np.argsort(turn)[-4:])
    ring, at = np.roll(ring, -at[0], axis=0), at - at[0]
    closed, ends = np.concatenate([ring, ring[:1]]), [*at[1:], len(ring)]
    sides = [closed[a : b + 1] for a, b in zip(at, ends, strict=True)]
    length = [float(arc_length(one)[-1]) for one in sides]
    first = 0 if length[0] + length[2] >= length[1] + length[3] else 1
    return Crosswalk(
        crosswalk_id=number,
        edge1=at_height_zero(sides[first]),
        edge2=at_height_zero(sides[first + 2][::-1]),
    )


def points_of(found: Mapping[str, Any], name: str) -> Float[np.ndarray, "N 2"]:
    """The first two coordinates of a field's points, without repeated and unknown ones.

    Raises:
        FormatError: these are no points; ``made_of`` tells whose they are.
        KeyError: there are none.
    """
    values = found[name]
    try:
        table = np.array([tuple(one)[:2] for one in values], float).reshape(-1, 2)
    except (TypeError, ValueError) as error:
        raise _FieldError(
            f"has no points for {name!r}; expected two numbers of each"
        ) from error
    return distinct_points(table)


def distinct_points(table: Float[np.ndarray, "M 2"]) -> Float[np.ndarray, "N 2"]:
    """Points without repeated and unknown ones."""
    table = table[np.isfinite(table).all(axis=1)]
    moves = np.append(True, np.linalg.norm(np.diff(table, axis=0), axis=1) > 1e-6)
    return table[moves[: len(table)]]


def _links(
    lanes: Sequence[CenterLane],
    lines: Sequence[Float[np.ndarray, "_ 2"]],
    number: Mapping[str, int],
) -> dict[int, list[int]]:
    """Numbers of the lanes that follow each."""
    if any(one.successors is not None for one in lanes):
        begin = {one.key: line[0] for one, line in zip(lanes, lines, strict=True)}
        return {
            number[one.key]: [number[key] for key in _following(one, line[-1], begin)]
            for one, line in zip(lanes, lines, strict=True)
        }
    found: dict[int, list[int]] = {}
    for row, other in meetings(lines):
        found.setdefault(row + 1, []).append(other + 1)
    return found


def _following(
    lane: CenterLane, end: Float[np.ndarray, "2"], begin: Mapping[str, np.ndarray]
) -> list[str]:
    """Lanes that follow one; of those of a whole road, which MetaDrive names, its own."""
    keys = [key for key in lane.successors or () if key]
    gaps = {key: np.hypot(*(begin[key] - end)) for key in keys if key in begin}
    is_met = min(gaps.values(), default=np.inf) < SAME_PLACE_M
    reach = USUAL_WIDTH_M / 2 if is_met else np.inf
    return [key for key in keys if gaps.get(key, 0.0) <= reach]


def _half_widths(lane: CenterLane) -> tuple[float, float]:
    if lane.half_width_m is not None:
        left, right = np.clip(lane.half_width_m, _WIDTHS_M[0] / 2, _WIDTHS_M[1] / 2)
        return float(left), float(right)
    width = USUAL_WIDTH_M
    if lane.polygon is not None and len(lane.polygon) > 2:
        width = valid_area(lane.polygon).area / max(arc_length(lane.line)[-1], 1.0)
    half = float(np.clip(width, *_WIDTHS_M)) / 2
    return half, half


def _simplified(line: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "M 2"]:
    return np.asarray(shapely.simplify(shapely.LineString(line), _SAME_LINE_M).coords)


def ego_of(scenario: Scenario) -> str:
    """The car that drives itself: the ego, else the focal agent; raises if neither is there."""
    agents, now = scenario.agents, scenario.current_step
    for name in (EGO_ID, scenario.focal_id):
        if name in agents.row_of and agents.is_valid[agents.row_of[name], now]:
            return name
    raise ExportError(
        f"Scenario {scenario.scenario_id} has neither ego nor focal agent at the "
        "current step; the format needs one as the car that drives itself (place agents, "
        "or fill it by pd-editor generate --num-agents fit)."
    )


def ego_losses(ego: str) -> tuple[str, ...]:
    """What a format that needs one says of a scene without an ego."""
    if ego == EGO_ID:
        return ()
    return (f"There is no ego: {ego} is the car that drives itself.",)


def lights_of(
    scenario: Scenario,
) -> Iterator[tuple[int, Float[np.ndarray, "2"], list[str]]]:
    """Id, place of the stop line and Waymo's words of each lane that obeys a signal."""
    stops = iter(scenario.stop_lines_m()[:, 1] + scenario.origin_city_m)
    for signal in scenario.signals:
        words = [WORDS[SignalState(one)][0] for one in signal.states]
        for lane in signal.lane_ids:
            yield lane, next(stops), words
