"""A scene as a foreign file has it, and how it becomes a scenario."""

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float
from shapely.geometry.base import BaseGeometry

from pd_editor.base.errors import FormatError, LargeMapError, LargeSceneError
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain, one_line
from pd_editor.scene.agent_kind import AgentCategory, AgentKind, default_sizes_m
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.base_reference import MapWindow, SceneCut
from pd_editor.scene.formats.file_signal import ON_GRID_S, FileSignal, sampled_signals
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.paved_area import paved_rings, valid_area
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.road_map import Crosswalk, Lane, RoadMap, areas_of
from pd_editor.scene.roles.focal_agent import next_focal_row, with_focal_category
from pd_editor.scene.scenario import EGO_ID, Provenance, Scenario
from pd_editor.scene.scene_cut import crosswalks_within, lanes_within, steps_of_cut
from pd_editor.scene.scene_limits import (
    MAX_AGENTS,
    MAX_COORDINATE_M,
    MAX_POSITION_M,
    MAX_STATES,
    MAX_STEPS,
    agents_excess,
    odd_agent,
    road_excess,
)
from pd_editor.scene.thresholds import STANDING_MPS
from pd_editor.scene.time_axis import TimeAxis

_STEP_S: Final = TimeAxis().step_s
MOST_ID_CHARACTERS: Final = 100
"""Of a scene, so that names of its variants stay usable."""
_LONGEST_GAP_S: Final = 0.35
"""States further apart in time have nothing between them where the file has no steps."""
_LEAST_EXTENT_M: Final = 1.0
"""Roads that are smaller are in degrees, or in kilometres."""
NO_HEADINGS: Final = "Headings that the file does not tell are those of the motion."
_LEAP_M: Final = 1.0
"""Lanes that follow each other further away are told of."""
_CROSSING_SINE: Final = 0.34
"""Centre lines that cross at more than 20 degrees meet in a junction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FileTrack:
    """States of an agent at N increasing times, in the file's frame."""

    track_id: str
    kind: AgentKind
    size_m: tuple[float, float] | None
    """Length and width; None if the file does not tell."""
    time_s: Float[np.ndarray, "N"]
    position_m: Float[np.ndarray, "N 2"]
    """Centres of the box."""
    heading_rad: Float[np.ndarray, "N"]
    """NaN: that of the motion."""
    velocity_mps: Float[np.ndarray, "N 2"] | None = None
    """None, or not finite anywhere: that of the positions."""
    longest_gap_s: float = 0.0
    """1.5 of the file's steps: states further apart have nothing between them."""

    def __post_init__(self) -> None:
        if len(self.heading_rad) == len(self.time_s) == len(self.position_m):
            heading = headings_on_the_way(
                self.time_s, self.position_m, np.asarray(self.heading_rad, float)
            )
            object.__setattr__(self, "heading_rad", heading)
        if self.velocity_mps is not None and not np.isfinite(self.velocity_mps).all():
            object.__setattr__(self, "velocity_mps", None)


@dataclass(frozen=True, kw_only=True, eq=False)
class FileScene:
    """Map and tracks of a file, in its own frame in metres."""

    path: Path
    name: str
    lanes: tuple[Lane, ...]
    crosswalks: tuple[Crosswalk, ...] = ()
    more_paved: Sequence[BaseGeometry] = ()
    """What is drivable beside the lanes, such as shoulders and junctions."""
    tracks: tuple[FileTrack, ...] = ()
    signals: tuple[FileSignal, ...] = ()
    current_s: float | None = None
    """Time of the current step; None: ``usual_now_s`` of the tracks."""
    axis: TimeAxis | None = None
    """Steps to open; None: those of the tracks, and at least Argoverse 2's."""
    is_part: bool = False
    """Whether it is a part of a larger one, so that nobody need be there any more."""
    ego_id: str = ""
    """Track of the recording vehicle, which becomes ``AV``; empty: there is none."""
    focal_id: str = ""
    """Track that a benchmark predicts; empty: the file does not tell."""
    city: str = ""
    attribution: str = ""
    """Who made the file, and under which licence, as far as it tells."""
    file_format: str = ""
    """Title of the format, which the registry sets."""
    notes: tuple[str, ...] = field(default_factory=tuple)

    def scenario(self, data: bytes) -> Scenario:
        """The scene at 10 Hz around the current step; ``data`` are the file's bytes.

        Raises:
            FormatError: it has no lane.
            LargeSceneError: it is larger or longer than scenes may be.
        """
        self._check(data)
        axis = self._time_axis()
        agents = self._agents(axis)
        row = self._focal_row(agents, axis)
        origin = np.rint(self._middle(agents, axis, row))
        there = agents.is_valid[..., None]
        agents = replace(
            agents, position_m=np.where(there, agents.position_m - origin, 0.0)
        )
        road_map = self._road_map()
        times_s = self._now_s() + axis.times_s()
        signals, told = sampled_signals(self.signals, road_map.lanes, times_s)
        road_map = road_map.moved(lambda points: points - origin)
        excess = agents_excess(agents, road_map) if len(agents) else None
        too_large = road_excess(road_map)
        # What is astray is so in each part of a small map.
        is_small = np.ptp(road_map.bounds_m, axis=0).max() <= MAX_POSITION_M
        is_astray = is_small and agents.is_valid.size <= MAX_STATES and not too_large
        odd = odd_agent(agents) or (excess if is_astray else None)
        if odd is not None:
            raise FormatError(f"{self.path}: {odd[:1].lower()}{odd[1:]}")
        self._raise_for(too_large or excess, data)
        focal_id = "" if row is None else agents.ids[row]
        return Scenario(
            scenario_id=_as_id(self.name),
            city=one_line(self.city, MAX_ID_CHARACTERS),
            origin_city_m=origin,
            road_map=road_map,
            agents=with_focal_category(agents, focal_id),
            time_axis=axis,
            focal_id=focal_id,
            signals=signals,
            provenance=Provenance(
                source=os.path.realpath(self.path),
                content_sha256=hashlib.sha256(data).hexdigest(),
                notes=tuple(map(one_line, (*self.notes, *told, *self._link_notes()))),
                attribution=one_line(self.attribution) or None,
                file_format=self.file_format,
            ),
        )

    def within(self, window: MapWindow) -> "FileScene":
        """The lanes that meet a square, and the tracks that are in it at some time."""
        square = shapely.box(*window.bounds_m)
        paved = shapely.get_parts(np.array(self.more_paved, object))

        def is_inside(track: FileTrack) -> bool:
            away = np.abs(track.position_m - (window.x_m, window.y_m)).max(axis=1)
            return bool((away <= window.radius_m).any())

        lanes = lanes_within(self.lanes, window)
        ids = {one.lane_id for one in lanes}
        return replace(
            self,
            lanes=lanes,
            signals=tuple(one for one in self.signals if one.stop_m.keys() & ids),
            crosswalks=crosswalks_within(self.crosswalks, window),
            more_paved=paved[shapely.intersects(paved, square)].tolist(),
            tracks=tuple(filter(is_inside, self.tracks)),
            current_s=self._now_s(),
            is_part=True,
        )

    def during(self, cut: SceneCut) -> "FileScene":
        """The tracks from the usual past to the last step that a cut keeps.

        Raises:
            InputError: the recording is shorter, or a number is not positive.
        """
        (first_s, last_s), now_s = self._ends_s(), self._now_s()
        before, after = (
            max(int(one / _STEP_S + ON_GRID_S), 0)
            for one in (now_s - first_s, last_s - now_s)
        )
        axis = _axis(now_s, before, after)
        now, last = steps_of_cut(axis, cut)
        first = max(now - TimeAxis().current_step, 0)
        now_s += (now - before) * _STEP_S
        begin_s, end_s = (now_s + (one - now) * _STEP_S for one in (first, last))
        return replace(
            self,
            tracks=tuple(
                one
                for one in self.tracks
                if one.time_s[0] <= end_s and one.time_s[-1] >= begin_s
            ),
            current_s=now_s,
            axis=_axis(now_s, now - first, last - now),
            is_part=True,
        )

    def _link_notes(self) -> list[str]:
        """Sentences on lanes that begin apart from those before them, or are not there."""
        ends = {one.lane_id: one.centerline_m[[0, -1]] for one in self.lanes}
        after = [(one.lane_id, other) for one in self.lanes for other in one.successors]
        beside = [
            n for one in self.lanes for n in (one.left_neighbor, one.right_neighbor)
        ]
        steps = [ends[n][0] - ends[one][1] for one, n in after if n in ends]
        gap_m = np.hypot(*np.array(steps).reshape(-1, 2).T)
        apart = int((gap_m > _LEAP_M).sum())
        lacking = sum(n not in ends for _, n in after)
        lacking += sum(n is not None and n not in ends for n in beside)
        begin = "lane begins" if apart == 1 else "lanes begin"
        told = f"{apart} {begin} up to {gap_m.max(initial=0.0):.1f} m from those before them."
        name = "link names a lane" if lacking == 1 else "links name lanes"
        lacks = f"{lacking} {name} that the map lacks."
        return [told] * bool(apart) + [lacks] * bool(lacking)

    def _raise_for(self, excess: str | None, data: bytes) -> None:
        if excess is None:
            return
        low, high = RoadMap(lanes=self.lanes).bounds_m
        raise LargeMapError(
            f"{self.path}: {excess[:1].lower()}{excess[1:]} Open a part of it: --around X "
            f"Y --radius R, where its lanes span x {low[0]:.0f} to {high[0]:.0f}, y "
            f"{low[1]:.0f} to {high[1]:.0f} (metres), or --densest 1.",
            self,
            data,
        )

    def _check(self, data: bytes) -> None:
        """Raise for what no scene can be, before anything is computed of it."""

        def wrong(what: str) -> FormatError:
            return FormatError(f"{self.path}: {what}")

        if not self.lanes:
            raise wrong("has no lane for vehicles; expected a road.")
        lines = RoadMap(lanes=self.lanes, crosswalks=self.crosswalks)
        for row, points in enumerate(lines.polylines):
            if not (np.abs(points) <= MAX_COORDINATE_M).all():
                is_lane = row < 3 * len(self.lanes)
                whose = (
                    f"its lane {self.lanes[row // 3].lane_id}"
                    if is_lane
                    else "a crosswalk"
                )
                raise wrong(f"{whose} has lines without a place; expected metres.")
        extent_m = np.ptp(np.concatenate([n.centerline_m for n in self.lanes]), axis=0)
        if len(self.lanes) > 1 and extent_m.max() < _LEAST_EXTENT_M:
            raise wrong(
                f"its lanes lie within {extent_m.max():.2g} m of each other; expected "
                "metres, not degrees."
            )
        seen: set[str] = set()
        for one in self.tracks:
            name = EGO_ID if one.track_id == self.ego_id else one.track_id
            if not one.track_id or not is_plain(one.track_id) or name in seen:
                raise wrong(
                    f"its track {one.track_id[:40]!r} comes twice, or has no usable id."
                )
            seen.add(name)
            numbers = [*map(len, (one.time_s, one.position_m, one.heading_rad))]
            if len(set(numbers)) > 1 or not numbers[0]:
                times, places, headings = numbers
                raise wrong(
                    f"its track {name} has {times} times, {places} positions and "
                    f"{headings} headings; expected as many of each, at least one."
                )
            states = np.column_stack([one.time_s, one.position_m, one.heading_rad])
            if not (np.abs(states) <= MAX_COORDINATE_M).all():
                raise wrong(
                    f"its track {name} has states without a place or a time, or beyond "
                    f"{MAX_COORDINATE_M:.0e} m or s; count times from the recording's begin."
                )
            if not (np.diff(one.time_s) > 0).all():
                raise wrong(f"its track {name} has times that do not increase.")
        self._check_times(data)
        excess = road_excess(lines)
        if excess is None and len(self.tracks) > MAX_AGENTS:
            excess = (
                f"it has {len(self.tracks)} tracks; at most {MAX_AGENTS} are opened."
            )
        self._raise_for(excess, data)

    def _check_times(self, data: bytes) -> None:
        """Raise for a current step that nobody reaches, and for what lasts too long."""
        if not self.tracks:
            return
        first, last = self._ends_s()
        if not self.is_part and not self._now_s() <= last + ON_GRID_S:
            raise FormatError(
                f"{self.path}: its current step is at {self.current_s:g} s; expected a "
                f"time of its tracks, {first:g} to {last:g} s."
            )
        if self._time_axis().num_steps > MAX_STEPS:
            raise LargeSceneError(
                f"{self.path}: lasts {self.duration_s:.0f} s; at most "
                f"{MAX_STEPS * _STEP_S:g} s are opened. Open a part of it: --current S, "
                "seconds from its begin to t = 0, and --until S, seconds after that "
                "(open_scenario: current_s, until_s).",
                self,
                data,
            )

    @property
    def duration_s(self) -> float:
        """Time from the first state of the tracks to the last; there has to be one."""
        first_s, last_s = self._ends_s()
        return last_s - first_s

    @property
    def observed_s(self) -> float:
        """Time up to the current step, which it counts as well, of a scene with tracks."""
        return self._now_s() - self._ends_s()[0] + _STEP_S

    def _now_s(self) -> float:
        if self.current_s is not None or not self.tracks:
            return self.current_s or 0.0
        return usual_now_s(*self._ends_s())

    def _ends_s(self) -> tuple[float, float]:
        """First and last time of the tracks."""
        times = np.array([one.time_s[[0, -1]] for one in self.tracks])
        return float(times.min()), float(times.max())

    def _time_axis(self) -> TimeAxis:
        """Steps of 0.1 s that cover all tracks, and the usual past and future."""
        if self.axis is not None:
            return self.axis
        if not self.tracks:
            return TimeAxis()
        (first, last), now_s = self._ends_s(), self._now_s()
        # At least as many steps as Argoverse 2 has, so that what is generated and
        # exported has a past and a future.
        usual = TimeAxis()
        before = int((now_s - first) / _STEP_S + ON_GRID_S)
        before = max(before, usual.current_step)
        after = int((last - now_s) / _STEP_S + ON_GRID_S)
        after = max(after, usual.num_future_steps)
        return _axis(now_s, before, after)

    def _agents(self, axis: TimeAxis) -> AgentTracks:
        times = self._now_s() + axis.times_s()
        tables = [states_at(one, times) for one in self.tracks]
        shown = [n for n, table in enumerate(tables) if table[3].any()]
        tracks, tables = [self.tracks[n] for n in shown], [tables[n] for n in shown]
        kinds = tuple(one.kind for one in tracks)
        known = np.array([one.size_m is not None for one in tracks], bool)
        size_m = default_sizes_m(kinds)
        for row, one in enumerate(tracks):
            if one.size_m is not None:
                size_m[row] = one.size_m
        shape = (len(tracks), axis.num_steps)
        stacked = [
            np.stack(column) if tracks else np.zeros((*shape, *more))
            for column, more in zip(
                zip(*tables, strict=True) if tracks else ((),) * 4,
                ((2,), (), (2,), ()),
                strict=True,
            )
        ]
        position, heading, velocity, is_valid = stacked
        is_valid = is_valid.astype(bool)
        ids = tuple(
            EGO_ID if one.track_id == self.ego_id else one.track_id for one in tracks
        )
        return AgentTracks(
            ids=ids,
            kinds=kinds,
            categories=tuple(
                AgentCategory.SCORED if is_full else AgentCategory.UNSCORED
                for is_full in np.atleast_1d(is_valid.all(axis=1)).tolist()
            ),
            size_m=size_m,
            has_known_size=known,
            position_m=position,
            heading_rad=heading,
            velocity_mps=velocity,
            is_valid=is_valid,
            observed=is_valid & axis.is_past,
        )

    def _focal_row(self, agents: AgentTracks, axis: TimeAxis) -> int | None:
        now = axis.current_step
        there = agents.is_valid[:, now]
        lasts = agents.is_valid[:, now:].sum(axis=1) > 1
        # Benchmarks' test data have no future.
        lasts = lasts if lasts.any() else there
        for name in (self.focal_id, EGO_ID if self.ego_id else ""):
            row = agents.row_of.get(EGO_ID if name == self.ego_id else name)
            if row is not None and lasts[row]:
                return row
        if not there.any():
            return None
        rows = np.flatnonzero(there & lasts if (there & lasts).any() else there)
        middle = agents.position_m[there, now].mean(axis=0)
        row = next_focal_row(agents.taken(rows), now, middle)
        return None if row is None else int(rows[row])

    def _middle(
        self, agents: AgentTracks, axis: TimeAxis, row: int | None
    ) -> Float[np.ndarray, "2"]:
        if row is not None:
            return agents.position_m[row, axis.current_step]
        points = np.concatenate([one.centerline_m for one in self.lanes])
        return (points.min(axis=0) + points.max(axis=0)) / 2

    def _road_map(self) -> RoadMap:
        lanes = with_junctions(self.lanes)
        ground = [valid_area(one.outline_m()) for one in lanes]
        try:
            rings = paved_rings([*ground, *self.more_paved])
        except shapely.errors.GEOSException as error:
            raise FormatError(
                f"{self.path}: the outlines of its lanes cannot be joined ({error})."
            ) from error
        first = 1 + max(one.lane_id for one in lanes)
        return RoadMap(
            lanes=lanes,
            crosswalks=self.crosswalks,
            drivable_areas=areas_of(rings, first),
        )


def usual_now_s(first_s: float, last_s: float) -> float:
    """As far after the beginning as in Argoverse 2, in short recordings the middle."""
    usual, num = TimeAxis(), ((last_s - first_s) / _STEP_S + ON_GRID_S) // 1
    # Of 11 s from the first state to the last, models sample the last 6.
    past = usual.current_step + (num == usual.num_steps)
    return first_s + _STEP_S * min(past, num // 2)


def _axis(now_s: float, before: int, after: int) -> TimeAxis:
    """Some steps before and after a time."""
    return TimeAxis(
        num_steps=before + after + 1,
        current_step=before,
        start_timestamp_ns=round(1e9 * (now_s - before * _STEP_S)),
        end_timestamp_ns=round(1e9 * (now_s + after * _STEP_S)),
    )


def _as_id(name: str) -> str:
    """A name as it comes, but for characters that no file name can have."""
    kept = re.sub(r"[^A-Za-z0-9._-]+", "-", name).lstrip("._-")[:MOST_ID_CHARACTERS]
    return kept or "scene"


def states_at(
    track: FileTrack, times_s: Float[np.ndarray, "T"]
) -> tuple[
    Float[np.ndarray, "T 2"],
    Float[np.ndarray, "T"],
    Float[np.ndarray, "T 2"],
    Bool[np.ndarray, "T"],
]:
    """Positions, headings, velocities and presence at some times; 0 where absent."""
    known = track.time_s
    after = np.clip(np.searchsorted(known, times_s - ON_GRID_S), 0, len(known) - 1)
    before = np.clip(np.searchsorted(known, times_s + ON_GRID_S) - 1, 0, len(known) - 1)
    is_there = (known[before] <= times_s + ON_GRID_S) & (
        known[after] >= times_s - ON_GRID_S
    )
    is_there &= known[after] - known[before] <= (track.longest_gap_s or _LONGEST_GAP_S)
    span = np.maximum(known[after] - known[before], 1e-9)
    share = np.clip((times_s - known[before]) / span, 0.0, 1.0)
    share = np.where(after == before, 0.0, share)[:, None]

    def between(values: Float[np.ndarray, "N D"]) -> Float[np.ndarray, "T D"]:
        mixed = values[before] + share * (values[after] - values[before])
        return np.where(is_there[:, None], mixed, 0.0)

    velocity = track.velocity_mps
    if velocity is None:
        velocity = _motion(known, track.position_m)
    position = between(track.position_m)
    if track.velocity_mps is not None:
        # A cubic line that has the velocities of both ends.
        step = track.position_m[after] - track.position_m[before]
        early, late = (span[:, None] * velocity[row] - step for row in (before, after))
        bow = share * (1 - share) * ((1 - share) * early - share * late)
        position += np.where(is_there[:, None], bow, 0.0)
    heading = between(np.unwrap(track.heading_rad)[:, None])[:, 0]
    return position, wrap_angle(heading), between(velocity), is_there


def _motion(
    time_s: Float[np.ndarray, "N"], position_m: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 2"]:
    if len(time_s) < 2:
        return np.zeros_like(position_m)
    # That times increase is checked later.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.gradient(position_m, time_s, axis=0)


def headings_on_the_way(
    time_s: Float[np.ndarray, "N"],
    position_m: Float[np.ndarray, "N 2"],
    told_rad: Float[np.ndarray, "N"],
) -> Float[np.ndarray, "N"]:
    """Headings, where the file tells none (NaN) those of the motion.

    Who stands has the heading of before, else that of later; 0 if there is none.
    """
    is_told = ~np.isnan(told_rad)
    if is_told.all():
        return told_rad
    moves = _motion(time_s, position_m)
    known = is_told | (np.hypot(*moves.T) >= STANDING_MPS)
    rows = np.flatnonzero(known)
    if not len(rows):
        return np.zeros(len(told_rad))
    last = np.searchsorted(rows, np.arange(len(known)), side="right") - 1
    return np.where(is_told, told_rad, heading_of(moves))[rows[np.maximum(last, 0)]]


def with_junctions(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Lanes, of which those that cross others are in a junction, if none is known to be."""
    if any(one.is_intersection for one in lanes):
        return lanes
    lines = [shapely.LineString(one.centerline_m) for one in lanes]
    tree = shapely.STRtree(lines)
    first, second = tree.query(lines, predicate="crosses")
    crossing: set[int] = set()
    for one, two in zip(first.tolist(), second.tolist(), strict=True):
        if one < two and _cross_at_an_angle(
            lanes[one], lanes[two], lines[one], lines[two]
        ):
            crossing.update((one, two))
    return tuple(
        replace(one, is_intersection=True) if row in crossing else one
        for row, one in enumerate(lanes)
    )


def _cross_at_an_angle(
    one: Lane, two: Lane, first: shapely.LineString, second: shapely.LineString
) -> bool:
    place = first.intersection(second).centroid
    directions = []
    for lane, line in ((one, first), (two, second)):
        along = arc_length(lane.centerline_m)
        row = int(
            np.clip(np.searchsorted(along, line.project(place)), 1, len(along) - 1)
        )
        directions.append(lane.centerline_m[row] - lane.centerline_m[row - 1])
    a, b = directions
    size = np.hypot(*a) * np.hypot(*b)
    return bool(size > 0 and abs(a[0] * b[1] - a[1] * b[0]) > _CROSSING_SINE * size)
