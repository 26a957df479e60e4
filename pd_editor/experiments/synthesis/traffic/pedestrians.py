"""Samples pedestrians on footways, and on crosswalks without approaching vehicles.

They are sampled after the simulation, whose vehicles do not react to them.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.road_network.footways import Crossing, Footways
from pd_editor.experiments.synthesis.traffic.demand_config import (
    DemandOptions,
    WalkingOptions,
    sample_pedestrian_type,
)
from pd_editor.experiments.synthesis.traffic.tracks import overlapping_pairs
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector
from pd_editor.scene.geometry.polyline import (
    arc_length,
    point_at,
    resample,
    smoothed,
    without_repeats,
)

SPOT_SPACING_M: Final = 0.5
LINE_SPACING_M: Final = 0.25
CORNER_M: Final = 0.8
"""Standard deviation of the filter that smooths corners."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Passage:
    """Use of a crossing by a pedestrian."""

    crossing: Crossing
    is_backwards: bool
    begin_m: float
    """Arc length along the walk at which the crossing begins."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Walk:
    """A pedestrian's path over footways and crossings."""

    line_m: Float[np.ndarray, "N 2"]
    passages: tuple[_Passage, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Traffic:
    """Vehicle tracks, the steps at which they occupy crossings, and how people walk."""

    tracks: TrafficTracks
    num_steps: int
    step_s: float
    options: WalkingOptions
    known: dict[int, Bool[np.ndarray, "K T"]] = field(default_factory=dict)

    def busy_on(self, crossing: Crossing) -> Bool[np.ndarray, "K T"]:
        """Whether each spot of a crossing is blocked by vehicles at each step."""
        key = id(crossing)
        if key not in self.known:
            self.known[key] = self._busy(_spots(crossing))
        return self.known[key]

    def _busy(self, spot_m: Float[np.ndarray, "K 2"]) -> Bool[np.ndarray, "K T"]:
        tracks = self.tracks
        busy = np.zeros((len(spot_m), self.num_steps), bool)
        far = np.hypot(*np.ptp(spot_m, axis=0)) + 15.0
        away = np.linalg.norm(tracks.position_m - spot_m.mean(axis=0), axis=1)
        rows = np.flatnonzero(away < far)
        ahead = unit_vector(tracks.heading_rad[rows])
        gap = spot_m[:, None] - tracks.position_m[rows]
        half = tracks.size_m[tracks.agent[rows]] / 2 + self.options.clearance_m
        covers = np.abs(np.sum(gap * ahead, axis=-1)) < half[:, 0]
        covers &= np.abs(np.sum(gap * left_of(ahead), axis=-1)) < half[:, 1]
        spot, row = np.nonzero(covers)
        step = tracks.step[rows[row]]
        before, after = (
            round(self.options.before_s / self.step_s),
            round(self.options.after_s / self.step_s),
        )
        # A pedestrian on a spot leaves it before a vehicle arrives, and vice versa.
        for shift in range(-after, before + 1):
            busy[spot, np.clip(step + shift, 0, self.num_steps - 1)] = True
        return busy


def sample_pedestrians(
    footways: Footways,
    traffic: TrafficTracks,
    options: DemandOptions,
    num_steps: int,
    step_s: float,
    random: np.random.Generator,
) -> TrafficTracks:
    """Sample tracks of pedestrians that touch neither vehicles nor each other."""
    beside = _Traffic(
        tracks=traffic, num_steps=num_steps, step_s=step_s, options=options.walking
    )
    spread = options.pedestrian_spread
    density = random.lognormal(-0.5 * spread**2, spread)
    present = density * options.pedestrians_per_km * footways.length_m / 1000
    walking = options.walking
    stands_s = walking.standing_share * np.mean(walking.standing_s)
    stay_s = float(np.mean(walking.walk_s) + stands_s)
    # Pedestrians present at the start began their walks earlier.
    count = random.poisson(present * (num_steps * step_s / stay_s + 1.0))
    tracks = traffic.taken(np.zeros(len(traffic.ids), bool))
    for number in range(count):
        first_step = round(random.uniform(-stay_s / step_s, num_steps))
        person = _person(number, first_step, footways, beside, random)
        tracks = tracks if person is None else tracks.joined(person)
    return tracks.taken(_apart(tracks, traffic))


def _apart(pedestrians: TrafficTracks, traffic: TrafficTracks) -> Bool[np.ndarray, "A"]:
    """Which pedestrians to keep so that no boxes touch."""
    num_before = len(traffic.ids)
    stays = np.ones(num_before + len(pedestrians.ids), bool)
    both = traffic.joined(pedestrians)
    for one, other in overlapping_pairs(both, with_pedestrians=True).tolist():
        if other >= num_before and stays[one]:
            stays[other] = False
    return stays[num_before:]


def _person(
    number: int,
    first_step: int,
    footways: Footways,
    traffic: _Traffic,
    random: np.random.Generator,
) -> TrafficTracks | None:
    """Sample one pedestrian's track within the recording; None if it is too short."""
    name, options = f"pedestrian-{number:04d}", traffic.options
    size = sample_pedestrian_type(name, random).size_m
    pace = float(np.clip(random.normal(*options.pace_mps), 0.7, 2.0))
    walk = _sample_walk(
        footways, pace * random.uniform(*options.walk_s), options, random
    )
    aside = float(
        np.clip(
            random.normal(0.0, options.aside_m),
            -options.max_aside_m,
            options.max_aside_m,
        )
    )
    along = _progress(walk, pace, first_step, traffic, random)
    along = along[max(-first_step, 0) : traffic.num_steps - first_step]
    if len(along) * traffic.step_s < options.min_s:
        return None
    line = _rounded(walk.line_m, aside)
    share = along / arc_length(walk.line_m)[-1]
    length = arc_length(line)[-1]
    position = point_at(line, share * length)
    reach = point_at(line, share * length + 0.5)
    return TrafficTracks(
        ids=(name,),
        kinds=(AgentKind.PEDESTRIAN,),
        size_m=np.array([size]),
        first_step=np.array([max(first_step, 0)]),
        first_row=np.array([0, len(along)]),
        position_m=position,
        heading_rad=heading_of(reach - point_at(line, share * length - 0.5)),
        velocity_mps=np.gradient(position, traffic.step_s, axis=0),
    )


def _sample_walk(
    footways: Footways,
    length_m: float,
    options: WalkingOptions,
    random: np.random.Generator,
) -> _Walk:
    """Sample a walk from a random point, over some of the crossings that it passes."""
    lengths = np.array([arc_length(line)[-1] for line in footways.lines_m])
    way = int(random.choice(len(lengths), p=lengths / lengths.sum()))
    at = float(random.uniform(0.0, lengths[way]))
    parts: list[np.ndarray] = []
    taken: list[_Passage] = []
    gone = 0.0
    while True:
        sign = 1 if random.random() < 0.5 else -1
        rest = max(length_m - gone, options.min_way_m)
        end = float(np.clip(at + sign * rest, 0.0, lengths[way]))
        done = [passage.crossing for passage in taken]
        found = [
            (crossing, side)
            for crossing in footways.crossings
            for side in (0, 1)
            if crossing.footway[side] == way
            and min(at, end) <= crossing.along_m[side] <= max(at, end)
            and crossing not in done
            and random.random() < options.crossing_share
        ]
        if not found:
            parts.append(_between(footways.lines_m[way], at, end))
            break
        crossing, side = min(found, key=lambda c: abs(c[0].along_m[c[1]] - at))
        stop = crossing.along_m[side]
        parts.append(_between(footways.lines_m[way], at, stop))
        gone += abs(stop - at)
        taken.append(_Passage(crossing=crossing, is_backwards=side == 1, begin_m=gone))
        parts.append(crossing.line_m[::-1] if side else crossing.line_m)
        gone += float(arc_length(crossing.line_m)[-1])
        way, at = crossing.footway[1 - side], crossing.along_m[1 - side]
    line = without_repeats(np.concatenate(parts), 1e-6)
    return _Walk(line_m=line, passages=tuple(taken))


def _between(
    line: Float[np.ndarray, "N 2"], start_m: float, end_m: float
) -> Float[np.ndarray, "M 2"]:
    """Part of a line between two arc lengths, reversed if the end is before the start."""
    along = arc_length(line)
    low, high = min(start_m, end_m), max(start_m, end_m)
    inside = along[(along > low) & (along < high)]
    part = point_at(line, np.array([low, *inside, high]))
    return part if start_m <= end_m else part[::-1]


def _progress(
    walk: _Walk,
    pace_mps: float,
    first_step: int,
    traffic: _Traffic,
    random: np.random.Generator,
) -> Float[np.ndarray, "T"]:
    """Distance walked at each step from the first one on."""
    length, options = float(arc_length(walk.line_m)[-1]), traffic.options
    stops: list[tuple[float, float | _Passage]] = [
        (passage.begin_m, passage) for passage in walk.passages
    ]
    if random.random() < options.standing_share:
        at = float(random.uniform(0.0, length))
        on_crossing = [
            p.begin_m
            for p in walk.passages
            if 0 <= at - p.begin_m <= arc_length(p.crossing.line_m)[-1]
        ]
        stops.append(
            (min([at, *on_crossing]), float(random.uniform(*options.standing_s)))
        )
    time, place = 0.0, 0.0
    times, places = [time], [place]
    # A stop before a crossing comes first, then the wait for traffic.
    for at, stop in sorted(stops, key=lambda s: (s[0], isinstance(s[1], _Passage))):
        time += (at - place) / pace_mps
        place = at
        times.append(time)
        places.append(place)
        if isinstance(stop, _Passage):
            arrival = first_step + round(time / traffic.step_s)
            wait = _wait_steps(stop, pace_mps, arrival, traffic)
            time += wait * traffic.step_s
        else:
            time += stop
        times.append(time)
        places.append(place)
    times.append(time + (length - place) / pace_mps)
    places.append(length)
    steps = np.arange(int(times[-1] / traffic.step_s) + 1)
    along = np.interp(steps * traffic.step_s, times, places)
    return smoothed(along[:, None], options.pace_change_s / traffic.step_s)[:, 0]


def _wait_steps(
    passage: _Passage, pace_mps: float, arrival: int, traffic: _Traffic
) -> int:
    """Steps to wait until a crossing is free of vehicles for the whole passage."""
    busy = traffic.busy_on(passage.crossing)
    busy = busy[::-1] if passage.is_backwards else busy
    later = np.arange(len(busy)) * SPOT_SPACING_M / pace_mps / traffic.step_s
    starts = np.arange(arrival, max(traffic.num_steps, arrival) + 1)
    step = starts[:, None] + np.rint(later).astype(int)
    is_known = (step >= 0) & (step < traffic.num_steps)
    row = np.broadcast_to(np.arange(len(busy)), step.shape)
    step = np.clip(step, 0, traffic.num_steps - 1)
    is_free = ~(busy[row, step] & is_known).any(axis=1)
    return int(np.argmax(is_free))


def _spots(crossing: Crossing) -> Float[np.ndarray, "K 2"]:
    length = arc_length(crossing.line_m)[-1]
    return point_at(crossing.line_m, np.arange(0.0, length, SPOT_SPACING_M))


def _rounded(
    line: Float[np.ndarray, "N 2"], aside_m: float
) -> Float[np.ndarray, "M 2"]:
    """Smooth the corners of a line and offset it to its left."""
    num_points = int(arc_length(line)[-1] / LINE_SPACING_M) + 2
    spread = CORNER_M / LINE_SPACING_M
    smooth = smoothed(resample(line, num_points), spread)
    ahead = smoothed(np.gradient(smooth, axis=0), spread)
    return smooth + aside_m * left_of(unit_vector(heading_of(ahead)))
