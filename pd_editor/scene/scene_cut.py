"""Cuts a scene to the part of its map and of its time that are asked for."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.base.errors import InputError
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.base_reference import MapWindow, SceneCut, part_name
from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.geometry.paved_area import paved_rings, valid_area
from pd_editor.scene.road_map import Crosswalk, Lane, RoadMap, areas_of
from pd_editor.scene.roles.focal_agent import with_focal_agent
from pd_editor.scene.scenario import Provenance, Scenario
from pd_editor.scene.signals import signals_of_lanes
from pd_editor.scene.time_axis import TimeAxis

FUTURE_S: Final = TimeAxis().future_s
"""Future that the shipped models sample, and that methods are compared on."""
COMPARED: Final = SceneCut(until_s=FUTURE_S)
"""What methods are compared on: of the scene as it is, what models sample."""
_MORE: Final = 1e-6
"""Steps by which times may be off by rounding."""


def is_long(scenario: Scenario) -> bool:
    """Whether the future is longer than ``FUTURE_S`` by more than rounding."""
    axis = scenario.time_axis
    return axis.future_s > FUTURE_S + 0.05


def cut_scenario(scenario: Scenario, cut: SceneCut) -> Scenario:
    """Keep a part of the map; make another step current, leave out what is later.

    Agents that are only there later are left out.

    Raises:
        InputError: the recording is shorter, a number is not positive, or the part of
            the map is empty.
    """
    if cut.window is not None:
        scenario = within_window(scenario, cut.window)
        # The part of the map alone, unless times are cut below.
        scenario = scenario.with_origin(cut=SceneCut(window=cut.window))
    axis = scenario.time_axis
    now, last = steps_of_cut(axis, cut)
    if (now, last) == (axis.current_step, axis.num_steps - 1):
        return scenario
    steps = slice(last + 1)
    agents = scenario.agents.cut_to(steps)
    is_valid = agents.is_valid
    agents = replace(agents, observed=is_valid & (np.arange(last + 1) <= now)).taken(
        is_valid.any(axis=1)
    )
    span = axis.end_timestamp_ns - axis.start_timestamp_ns
    share = last / max(axis.num_steps - 1, 1)
    end = axis.start_timestamp_ns + type(span)(span * share)
    return replace(
        scenario,
        agents=agents,
        signals=tuple(
            replace(one, states=one.states[steps]) for one in scenario.signals
        ),
        time_axis=replace(
            axis, num_steps=last + 1, current_step=now, end_timestamp_ns=end
        ),
        provenance=origin_of_cut(scenario.provenance, cut, now, last),
    )


def steps_of_cut(axis: TimeAxis, cut: SceneCut) -> tuple[int, int]:
    """Current and last step that a cut leaves of a recording.

    Raises:
        InputError: the recording is shorter, or a number is not positive.
    """
    for name, value in (("current", cut.current_s), ("until", cut.until_s)):
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"--{name} is {value:g}; expected seconds above 0.")
    now, last = axis.current_step, axis.num_steps - 1
    if cut.current_s is not None:
        now = max(math.ceil(cut.current_s / axis.step_s - _MORE), 1) - 1
    if cut.until_s is not None:
        last = now + math.floor(cut.until_s / axis.step_s + _MORE)
    if now > axis.num_steps - 1 or (cut.until_s is not None and now >= last):
        raise InputError(
            f"The recording has {axis.num_steps} steps of {axis.step_s:g} s; expected"
            " a current step (--current) and a later one (--until) among them."
        )
    return now, min(last, axis.num_steps - 1)


def origin_of_cut(origin: Provenance, cut: SceneCut, *numbers: float) -> Provenance:
    """Where a part of a recording is from; the numbers tell it from other parts."""
    # Edits of the cut recording do not fit the whole one.
    text = " ".join(map(str, (origin.content_sha256, *numbers)))
    digest = hashlib.sha256(text.encode()).hexdigest()
    return replace(origin, cut=cut, content_sha256=digest)


DEFAULT_RADIUS_M: Final = 150.0
MOST_RADIUS_M: Final = 5_000.0
_CELLS: Final = 4
"""Cells of the grid, by which windows are sought, along half a window."""
_MOST_CELLS: Final = 2_000


def window_of(
    around: tuple[float, float] | None, radius_m: float | None
) -> MapWindow | None:
    """The square about a point of the file; None without one.

    Raises:
        InputError: a number is not finite, or the radius is not above 0.
    """
    if around is None:
        if radius_m is not None:
            raise InputError("A radius needs a place: give --around X Y, too.")
        return None
    radius = DEFAULT_RADIUS_M if radius_m is None else radius_m
    if not 0 < radius <= MOST_RADIUS_M or not np.isfinite(around).all():
        raise InputError(
            f"The window around {around[0]:g}, {around[1]:g} with radius {radius:g} is "
            f"none; expected metres of the file, and a radius up to {MOST_RADIUS_M:g}."
        )
    return MapWindow(x_m=around[0], y_m=around[1], radius_m=radius)


def _meets(
    lines_m: Sequence[Float[np.ndarray, "_ 2"]], window: MapWindow
) -> Bool[np.ndarray, "L"]:
    """Which lines have a part in the square."""
    lines = [shapely.LineString(one) for one in lines_m]
    return np.asarray(shapely.intersects(shapely.box(*window.bounds_m), lines), bool)


def within_window(scenario: Scenario, window: MapWindow) -> Scenario:
    """A scene of the lanes that meet a square, whole, and of what is on them or in it.

    Links to other lanes are open ends. Its id names the place, for there may be several.

    Raises:
        InputError: there is no lane.
    """
    x, y = np.array([window.x_m, window.y_m]) - scenario.origin_city_m
    here = replace(window, x_m=float(x), y_m=float(y))
    road = scenario.road_map
    lanes = lanes_within(road.lanes, here)
    if not lanes:
        low, high = (end + scenario.origin_city_m for end in road.bounds_m)
        raise InputError(
            f"{scenario.scenario_id} has no lane within {window.radius_m:g} m of "
            f"{window.x_m:g}, {window.y_m:g}; its map spans x {low[0]:.0f} to "
            f"{high[0]:.0f}, y {low[1]:.0f} to {high[1]:.0f}."
        )
    square = shapely.box(*here.bounds_m)
    ground = shapely.union_all(
        [square, *(valid_area(one.outline_m()) for one in lanes)]
    )
    areas = [valid_area(one.boundary[:, :2]) for one in road.drivable_areas]
    paved = [shapely.intersection(one, ground) for one in areas]
    cut = RoadMap(
        lanes=lanes,
        crosswalks=crosswalks_within(road.crosswalks, here),
        drivable_areas=areas_of(
            paved_rings(paved), 1 + max(one.lane_id for one in road.lanes)
        ),
        source_fields=road.source_fields,
    )
    agents = _tracks_within(scenario.agents, ground)
    origin = scenario.provenance
    digest = hashlib.sha256(f"{origin.content_sha256} {window}".encode())
    found = replace(
        scenario,
        scenario_id=part_name(scenario.scenario_id, window),
        road_map=cut,
        signals=signals_of_lanes(scenario.signals, cut.lane_of),
        agents=agents,
        focal_id=scenario.focal_id if scenario.focal_id in agents.row_of else "",
        provenance=replace(origin, content_sha256=digest.hexdigest()),
    )
    return with_focal_agent(found, np.array([here.x_m, here.y_m]))


def lanes_within(lanes: tuple[Lane, ...], window: MapWindow) -> tuple[Lane, ...]:
    """Lanes whose centre lines meet a square, linked among themselves alone."""
    stay = _meets([one.centerline_m for one in lanes], window)
    kept = [one for one, stays in zip(lanes, stay, strict=True) if stays]
    ids = {one.lane_id for one in kept}
    return tuple(
        replace(
            one,
            successors=tuple(filter(ids.__contains__, one.successors)),
            predecessors=tuple(filter(ids.__contains__, one.predecessors)),
            left_neighbor=one.left_neighbor if one.left_neighbor in ids else None,
            right_neighbor=one.right_neighbor if one.right_neighbor in ids else None,
        )
        for one in kept
    )


def crosswalks_within(
    crosswalks: tuple[Crosswalk, ...], window: MapWindow
) -> tuple[Crosswalk, ...]:
    """Crosswalks of which an edge meets a square."""
    stay = _meets([one.edge1[:, :2] for one in crosswalks], window)
    return tuple(one for one, stays in zip(crosswalks, stay, strict=True) if stays)


def densest_windows(
    lanes: tuple[Lane, ...], count: int, radius_m: float = DEFAULT_RADIUS_M
) -> tuple[MapWindow, ...]:
    """Squares that hold the greatest length of lanes, without overlap, the fullest first.

    There are fewer than ``count`` where no lane is left.
    """
    lines = Lines.of([one.centerline for one in lanes])
    low = lines.points_m[:, :2].min(axis=0)
    span = float(np.ptp(lines.points_m[:, :2], axis=0).max())
    cell = max(radius_m / _CELLS, span / _MOST_CELLS)
    reach = max(round(radius_m / cell), 1)
    dense = lines.densified(cell / 2)
    points = dense.points_m[:, :2]
    length = np.linalg.norm(np.diff(points, axis=0), axis=1) * (
        np.diff(dense.line) == 0
    )
    # One window of empty cells lies around the map.
    rows = np.floor((points[1:] - low) / cell).astype(int) + 2 * reach
    inside = np.zeros(rows.max(axis=0) + 2 * reach + 1)
    np.add.at(inside, tuple(rows.T), length)
    total = np.pad(inside.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    wide = 2 * reach
    # Of the square whose first cell is i, j.
    full = total[wide:, wide:] - total[:-wide, wide:] - total[wide:, :-wide]
    full += total[:-wide, :-wide]
    found: list[MapWindow] = []
    while len(found) < count and full.max() > cell / 100:
        i, j = np.unravel_index(np.argmax(full), full.shape)
        x, y = low + (np.array([i, j]) - reach) * cell
        found.append(
            MapWindow(x_m=round(float(x)), y_m=round(float(y)), radius_m=radius_m)
        )
        near = (
            slice(max(i - wide + 1, 0), i + wide),
            slice(max(j - wide + 1, 0), j + wide),
        )
        full[near] = 0.0
    return tuple(found)


def _tracks_within(agents: AgentTracks, ground: shapely.Geometry) -> AgentTracks:
    """Tracks between the first and the last step at which they are on the ground."""
    shapely.prepare(ground)
    on_ground = shapely.contains_xy(ground, *np.moveaxis(agents.position_m, -1, 0))
    inside = agents.is_valid & on_ground
    since = np.logical_or.accumulate(inside, axis=1)
    until = np.logical_or.accumulate(inside[:, ::-1], axis=1)[:, ::-1]
    is_valid = agents.is_valid & since & until
    there = is_valid[..., None]
    cut = replace(
        agents,
        is_valid=is_valid,
        observed=agents.observed & is_valid,
        position_m=np.where(there, agents.position_m, 0.0),
        velocity_mps=np.where(there, agents.velocity_mps, 0.0),
        heading_rad=np.where(is_valid, agents.heading_rad, 0.0),
    )
    return cut.taken(np.flatnonzero(is_valid.any(axis=1)))
