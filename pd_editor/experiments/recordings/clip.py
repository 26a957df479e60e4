"""Extracts clips of a recording as scenarios in Argoverse 2's form.

Clips follow statistics of 35 scenarios of Argoverse 2's train split:

- focal, scored and unscored tracks, and the ego ``AV``, have all 110 steps; every other
  track is a fragment of at least 10 steps without a gap;
- the map has the lanes within 35 m (31..37 m) of the paths of focal, scored and ego;
- half of the tracks are within 40 m of the ego, nine of ten within 86 m.
"""

import uuid
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.experiments.recordings.recording import Recording, Window
from pd_editor.scene.agent_kind import (
    ROAD_USER_KINDS,
    AgentCategory,
    AgentKind,
    true_activity,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import turned, wrap_angle
from pd_editor.scene.road_map import DrivableArea, RoadMap
from pd_editor.scene.scenario import EGO_ID, Provenance, Scenario
from pd_editor.scene.signals import signals_of_lanes
from pd_editor.scene.time_axis import TimeAxis


@dataclass(frozen=True, kw_only=True)
class TrackingNoise:
    """Parameters of a tracker's errors; zero or infinity disables each.

    Noise is stationary and smooth: white noise under a Gaussian kernel, so that its
    correlation over a time d is exp(-d^2 / (4 c^2)), with the kernel's width c. Its strength
    differs between agents (log-normal factor), which gives the heavy tails of real tracks.
    Noise of velocities is independent of that of positions, as after a tracker's filter.

    The defaults follow 35 scenarios of Argoverse 2's train split: heading against motion
    0.7 deg at the median and 3.6 deg at the 90th percentile; given speed against motion
    0.3 and 1.1 m/s; positions of standing vehicles scatter by 0.07 m (90 %: 0.24 m); over
    1 s tracks leave a parabola by 1.5 cm along and 0.3 cm across only, so drift is slow.
    Occlusions are set so that a scene has as many tracks as there (55, of which 28 at the
    current step and 8 throughout, medians) and as short ones (27 steps).
    """

    along_m: float = 0.25
    """Standard deviation of a driving agent's position along its heading."""
    across_m: float = 0.12
    standing_m: float = 0.06
    """Standard deviation of a stationary agent's position, in both directions."""
    heading_rad: float = 0.018
    velocity_along_mps: float = 0.35
    velocity_across_mps: float = 0.2
    agent_spread: float = 0.7
    """Standard deviation of the logarithm of each agent's factor."""
    heading_spread: float = 1.0
    """The same for headings, whose errors have heavier tails."""
    position_width_s: float = 1.0
    """Kernel width of positions and headings."""
    velocity_width_s: float = 0.4
    range_m: float = 65.0
    """Median distance from the ego up to which an agent is observed."""
    range_spread: float = 0.5
    """Standard deviation of the logarithm of that distance."""
    occlusions_per_s: float = 0.12
    """Median rate of occlusions over agents."""
    occlusion_spread: float = 0.8
    """Standard deviation of the logarithm of each agent's rate."""
    occlusion_s: float = 1.2
    """Mean duration, exponentially distributed."""


def smooth_noise(
    random: np.random.Generator, count: int, num_steps: int, width_steps: float
) -> Float[np.ndarray, "N T"]:
    """``count`` series with mean 0, variance 1 and a Gaussian correlation."""
    if width_steps <= 0:
        return random.standard_normal((count, num_steps))
    # Where the kernel is cut off, in units of its width.
    reach = int(np.ceil(3.0 * width_steps))
    gap = np.arange(num_steps + 2 * reach)[:, None] - np.arange(num_steps) - reach
    kernel = np.exp(-0.5 * (gap / width_steps) ** 2) * (np.abs(gap) <= reach)
    kernel /= np.sqrt((kernel**2).sum(axis=0))
    return random.standard_normal((count, num_steps + 2 * reach)) @ kernel


def noisy(
    tracks: AgentTracks,
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> AgentTracks:
    """Add noise to positions, headings and velocities of tracks."""
    count, num_steps = tracks.is_valid.shape

    def blur(width_s: float) -> Float[np.ndarray, "A T"]:
        return smooth_noise(random, count, num_steps, width_s / step_s)

    spread = np.array([noise.agent_spread] * 3 + [noise.heading_spread])
    factor = np.exp(spread[:, None, None] * random.standard_normal((4, count, 1)))
    # A filter suppresses the noise of stationary agents; it returns as they start.
    drives = np.clip(tracks.speed_mps() / 3.0, 0.0, 1.0)
    along = noise.standing_m + (noise.along_m - noise.standing_m) * drives
    across = noise.standing_m + (noise.across_m - noise.standing_m) * drives
    position = np.stack(
        [
            along * factor[0] * blur(noise.position_width_s),
            across * factor[1] * blur(noise.position_width_s),
        ],
        axis=-1,
    )
    turn = noise.heading_rad * (0.3 + 0.7 * drives)
    turn = turn * factor[3] * blur(noise.position_width_s)
    change = 0.005 + 0.995 * drives
    strength_mps = (noise.velocity_along_mps, noise.velocity_across_mps)
    velocity = np.stack(
        [
            one * change * factor[2] * blur(noise.velocity_width_s)
            for one in strength_mps
        ],
        axis=-1,
    )
    is_valid, heading = tracks.is_valid, tracks.heading_rad
    position, velocity = turned(position, heading), turned(velocity, heading)
    return replace(
        tracks,
        position_m=tracks.position_m + np.where(is_valid[..., None], position, 0.0),
        heading_rad=wrap_angle(heading + np.where(is_valid, turn, 0.0)),
        velocity_mps=tracks.velocity_mps + np.where(is_valid[..., None], velocity, 0.0),
    )


def seen(
    tracks: AgentTracks,
    ego: int,
    always: Int[np.ndarray, "M"],
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> Bool[np.ndarray, "A T"]:
    """Steps at which each agent is within range of the ego and not occluded.

    ``always`` are rows whose tracks do not break off; the ego exists at all steps.
    """
    count, num_steps = tracks.is_valid.shape
    reach = noise.range_m * np.exp(noise.range_spread * random.standard_normal(count))
    gap = np.linalg.norm(tracks.position_m - tracks.position_m[ego], axis=-1)
    hidden = _hidden(count, num_steps, noise, random, step_s)
    is_seen = tracks.is_valid & (gap <= reach[:, None]) & ~hidden
    is_seen[always] = tracks.is_valid[always]
    return is_seen


def _hidden(
    count: int,
    num_steps: int,
    noise: TrackingNoise,
    random: np.random.Generator,
    step_s: float,
) -> Bool[np.ndarray, "A T"]:
    """Steps at which agents are occluded: random starts, exponential durations."""
    rate = noise.occlusions_per_s * np.exp(
        noise.occlusion_spread * random.standard_normal((count, 1))
    )
    begins = random.random((count, num_steps)) < rate * step_s
    lasts = random.exponential(noise.occlusion_s / step_s, (count, num_steps))
    ends = np.where(begins, np.arange(num_steps) + 1 + lasts, 0.0)
    return np.arange(num_steps) < np.maximum.accumulate(ends, axis=1)


SIDE_M: Final = 200.0
"""Side of the square around the window's centre whose agents are in a scenario."""
PAST_STEPS: Final = TimeAxis().current_step
FUTURE_STEPS: Final = TimeAxis().num_future_steps
MIN_TRACK_STEPS: Final = 10
MEAN_NUM_SCORED: Final = 2.6
_NEAR_M: Final = 14.0
"""Distance from the focal agent over which the chance to be ego or scored falls by e."""
_PATH_STRIDE: Final = 5
_ID_SPACE: Final = uuid.UUID("6f1c1a52-31f3-5c0e-9f2d-3a0c54f1b7d6")
_EPOCH_NS: Final = 315_964_800_000_000_000
"""Typical start timestamp of Argoverse 2's recordings."""
_NOTE: Final = "Synthetic traffic, simulated with SUMO."
MAP_MARGIN_M: Final = 35.0
"""Lanes within this distance of a path are in the map."""
_MIN_AREA_M2: Final = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Roles:
    """Rows of the agents of a window with a role; -1 if there is none."""

    focal: int
    ego: int
    scored: Int[np.ndarray, "S"]

    @property
    def main(self) -> Int[np.ndarray, "M"]:
        """Rows of focal, ego and scored agents."""
        rows = np.array([self.focal, self.ego, *self.scored], int)
        return rows[rows >= 0]

    @property
    def observer(self) -> int:
        """Row of the agent whose tracker observes the others."""
        return self.ego if self.ego >= 0 else self.focal


def cut_scenario(
    recording: Recording,
    window: Window,
    *,
    side_m: float = SIDE_M,
    noise: TrackingNoise | None = None,
) -> Scenario:
    """Extract the scenario of a window, in the recording's frame.

    Agents in the square of side ``side_m`` at the current step have complete tracks;
    others exist only while they are in the square. With ``noise``, tracks also begin
    and end as a tracker's do, and states are noisy. Equal arguments give equal
    scenarios.
    """
    num_steps = PAST_STEPS + 1 + FUTURE_STEPS
    first = window.current_step - PAST_STEPS
    assert first >= 0
    assert first + num_steps <= recording.num_steps
    rows, tracks = _gathered(recording, window, first, num_steps, side_m)
    random = np.random.default_rng(window.seed)
    roles = _roles(recording, window, rows, tracks, PAST_STEPS, random)
    paths = tracks.position_m[roles.main][:, ::_PATH_STRIDE]
    road_map = cropped_map(recording.road_map, paths)
    is_valid = tracks.is_valid
    if noise is not None:
        is_valid = seen(
            tracks, roles.observer, roles.main, noise, random, recording.step_s
        )
    tracks = _finished(tracks, roles, is_valid, PAST_STEPS)
    if noise is not None:
        tracks = noisy(tracks, noise, random, recording.step_s)
    name = f"{recording.name}/{window.current_step}/{window.focal_id}/{window.seed}"
    return Scenario(
        scenario_id=str(uuid.uuid5(_ID_SPACE, name)),
        city=recording.city,
        origin_city_m=recording.origin_city_m,
        road_map=road_map,
        agents=tracks,
        time_axis=_time_axis(recording, first, num_steps),
        focal_id=window.focal_id,
        provenance=Provenance(notes=(_NOTE,)),
        signals=tuple(
            replace(one, states=one.states[first : first + num_steps])
            for one in signals_of_lanes(recording.signals, road_map.lane_of)
        ),
    )


def has_focal_agent(recording: Recording, window: Window) -> bool:
    """Whether the window's focal agent is in the square and exists at all steps."""
    if window.focal_id not in recording.ids:
        return False
    agent, step = recording.ids.index(window.focal_id), window.current_step
    begin, end = recording.first_step[agent], recording.end_step[agent]
    if step - PAST_STEPS < begin or step + FUTURE_STEPS >= end:
        return False
    (row,) = recording.row_at(np.array([agent]), step)
    away = np.abs(recording.position_m[row] - np.array(window.center_m))
    return bool(away.max() <= SIDE_M / 2)


def _time_axis(recording: Recording, first: int, num_steps: int) -> TimeAxis:
    step_ns = recording.step_s * 1e9
    start = _EPOCH_NS + round(first * step_ns)
    return TimeAxis(
        num_steps=num_steps,
        current_step=PAST_STEPS,
        step_s=recording.step_s,
        start_timestamp_ns=float(start),
        end_timestamp_ns=float(start + round((num_steps - 1) * step_ns)),
    )


def _gathered(
    recording: Recording, window: Window, first: int, num_steps: int, side_m: float
) -> tuple[Int[np.ndarray, "A"], AgentTracks]:
    """Rows in the recording, and tracks, of the agents that enter the square."""
    counts = np.diff(recording.first_row)
    common = np.minimum(recording.end_step, first + num_steps) - np.maximum(
        recording.first_step, first
    )
    low, high = np.array(window.center_m) + side_m / 2 * np.array([[-1], [1]])
    least, greatest = recording.extent_m
    comes = ((least <= high) & (greatest >= low)).all(axis=1)
    there = np.flatnonzero(comes & (common >= MIN_TRACK_STEPS))
    steps = first + np.arange(num_steps) - recording.first_step[there, None]
    is_valid = (steps >= 0) & (steps < counts[there, None])
    row = recording.first_row[there, None] + np.clip(steps, 0, counts[there, None] - 1)
    position = recording.position_m[row]
    is_in_square = (position >= low) & (position <= high)
    is_inside = is_valid & is_in_square[..., 0] & is_in_square[..., 1]
    current = window.current_step - first
    is_valid &= is_inside[:, current, None] | is_inside
    stays = np.flatnonzero(is_valid.sum(axis=1) >= MIN_TRACK_STEPS)
    row, is_valid, there = row[stays], is_valid[stays], there[stays]
    position = position[stays]
    speed = np.hypot(*recording.velocity_mps[row[:, current]].T)
    ids = tuple(recording.ids[one] for one in there)
    kinds = tuple(recording.kinds[one] for one in there)
    return there, AgentTracks(
        ids=ids,
        kinds=kinds,
        categories=(AgentCategory.FRAGMENT,) * len(there),
        size_m=recording.size_m[there],
        has_known_size=np.ones(len(there), bool),
        position_m=np.where(is_valid[..., None], position, 0.0),
        heading_rad=np.where(is_valid, recording.heading_rad[row], 0.0),
        velocity_mps=np.where(is_valid[..., None], recording.velocity_mps[row], 0.0),
        is_valid=is_valid,
        observed=is_valid & (np.arange(num_steps) <= current),
        activity=true_activity(recording.is_parked[there], speed).astype(np.int8),
    )


def runs_of(
    is_valid: Bool[np.ndarray, "A T"],
) -> tuple[Int[np.ndarray, "R"], Bool[np.ndarray, "R T"]]:
    """Row and steps of each run of true values of at least ``MIN_TRACK_STEPS``."""
    padded = np.pad(is_valid, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    rows, begins = np.nonzero(change == 1)
    ends = np.nonzero(change == -1)[1]
    is_long = ends - begins >= MIN_TRACK_STEPS
    rows, begins, ends = rows[is_long], begins[is_long], ends[is_long]
    steps = np.arange(is_valid.shape[1])
    return rows, (steps >= begins[:, None]) & (steps < ends[:, None])


def _roles(
    recording: Recording,
    window: Window,
    rows: Int[np.ndarray, "A"],
    tracks: AgentTracks,
    current: int,
    random: np.random.Generator,
) -> _Roles:
    """Choose the focal agent, an ego near it, and a few scored agents."""
    focal = tracks.row_of[window.focal_id]
    assert tracks.is_valid[focal].all(), "the focal agent must be there all the time"
    is_free = tracks.is_valid.all(axis=1) & ~recording.is_parked[rows]
    is_free[focal] = False
    gap = np.linalg.norm(
        tracks.position_m[:, current] - tracks.position_m[focal, current], axis=-1
    )
    # Weighted sampling without replacement: one random key per agent, smallest first.
    wait = random.exponential(size=len(tracks)) * np.exp(gap / _NEAR_M)
    cars = np.flatnonzero(is_free & tracks.kind_mask({AgentKind.VEHICLE}))
    ego = int(cars[wait[cars].argmin()]) if len(cars) else -1
    if len(cars):
        is_free[ego] = False
    others = np.flatnonzero(is_free & tracks.kind_mask(ROAD_USER_KINDS) & (gap < 100))
    num = random.geometric(1 / (1 + MEAN_NUM_SCORED)) - 1
    return _Roles(focal=focal, ego=ego, scored=others[np.argsort(wait[others])][:num])


def _finished(
    tracks: AgentTracks, roles: _Roles, is_valid: Bool[np.ndarray, "A T"], current: int
) -> AgentTracks:
    """Tracks of all runs of valid steps, with categories and the ego's id."""
    categories = np.full(len(tracks), AgentCategory.UNSCORED)
    categories[roles.scored] = AgentCategory.SCORED
    categories[roles.focal] = AgentCategory.FOCAL
    names = list(tracks.ids)
    if roles.ego >= 0:
        names[roles.ego] = EGO_ID
    rows, is_valid = runs_of(is_valid)
    is_full = is_valid.all(axis=1)
    categories = np.where(is_full, categories[rows], AgentCategory.FRAGMENT)
    # An agent that is observed again gets a new id, as from a tracker.
    again = np.arange(len(rows)) - np.searchsorted(rows, rows)
    ids = [
        f"{names[row]}-{1 + number}" if number else names[row]
        for row, number in zip(rows.tolist(), again.tolist(), strict=True)
    ]
    return AgentTracks(
        ids=tuple(ids),
        kinds=tuple(tracks.kinds[row] for row in rows),
        categories=tuple(AgentCategory(int(value)) for value in categories),
        size_m=tracks.size_m[rows],
        has_known_size=tracks.has_known_size[rows],
        position_m=np.where(is_valid[..., None], tracks.position_m[rows], 0.0),
        heading_rad=np.where(is_valid, tracks.heading_rad[rows], 0.0),
        velocity_mps=np.where(is_valid[..., None], tracks.velocity_mps[rows], 0.0),
        is_valid=is_valid,
        observed=is_valid & (np.arange(tracks.num_steps) <= current),
        activity=tracks.activity[rows],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _MapIndex:
    """Searchable geometry of a map's lanes, crosswalks and drivable areas."""

    lanes: shapely.STRtree
    crosswalks: shapely.STRtree
    areas: shapely.STRtree


@lru_cache(maxsize=16)
def _index_of(road_map: RoadMap) -> _MapIndex:
    lines = [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
    crossings = [shapely.Polygon(one.outline_m()) for one in road_map.crosswalks]
    rings = [shapely.Polygon(one.boundary) for one in road_map.drivable_areas]
    return _MapIndex(
        lanes=shapely.STRtree(lines),
        crosswalks=shapely.STRtree(shapely.make_valid(crossings)),
        areas=shapely.STRtree(shapely.make_valid(rings)),
    )


def cropped_map(road_map: RoadMap, paths_m: Float[np.ndarray, "M T 2"]) -> RoadMap:
    """Crop a map to lanes, crosswalks and areas within ``MAP_MARGIN_M`` of paths."""
    index = _index_of(road_map)
    paths = shapely.MultiLineString(list(paths_m))

    def near(tree: shapely.STRtree) -> Int[np.ndarray, "K"]:
        found = tree.query(paths, predicate="dwithin", distance=MAP_MARGIN_M)
        return np.sort(found)

    rows = near(index.lanes)
    return RoadMap(
        lanes=tuple(road_map.lanes[row] for row in rows),
        crosswalks=tuple(road_map.crosswalks[row] for row in near(index.crosswalks)),
        drivable_areas=_ground(road_map, index, rows, near(index.areas)),
        source_fields=road_map.source_fields,
    )


def _ground(
    road_map: RoadMap,
    index: _MapIndex,
    lane_rows: Int[np.ndarray, "L"],
    rows: Int[np.ndarray, "K"],
) -> tuple[DrivableArea, ...]:
    """Drivable areas, clipped where they extend far beyond the lanes."""
    if not len(lane_rows) or not len(rows):
        return ()
    bounds = shapely.total_bounds(index.lanes.geometries[lane_rows])
    # Drivable areas are clipped at this distance outside the lanes.
    frame = bounds + 15.0 * np.array([-1, -1, 1, 1])
    shapes = index.areas.geometries[rows]
    extent = shapely.bounds(shapes)
    reaches_out = (extent[:, :2] < frame[:2]).any(axis=1)
    reaches_out |= (extent[:, 2:] > frame[2:]).any(axis=1)
    kept = [road_map.drivable_areas[row] for row in rows[~reaches_out]]
    cut = shapely.intersection(shapes[reaches_out], shapely.box(*frame))
    next_id = max(area.area_id for area in road_map.drivable_areas) + 1
    for part in shapely.get_parts(cut):
        if isinstance(part, shapely.Polygon) and part.area > _MIN_AREA_M2:
            ring = shapely.get_coordinates(part.exterior, include_z=True)[:-1]
            kept.append(DrivableArea(area_id=next_id, boundary=ring))
            next_id += 1
    return tuple(kept)
