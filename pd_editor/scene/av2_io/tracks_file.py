"""Reader of Argoverse 2 motion forecasting tracks (parquet).

One row per track and valid step; ``write`` lists our additional columns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.base.plain_text import listed
from pd_editor.scene.agent_kind import (
    Activity,
    AgentCategory,
    AgentKind,
    default_sizes_m,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.track_table import TrackTable, is_readable, open_track_table
from pd_editor.scene.geometry.angles import heading_of, wrap_angle, wrap_outside
from pd_editor.scene.scene_limits import (
    MAX_AGENTS,
    MAX_LENGTH_M,
    MAX_POSITION_M,
    MAX_SPEED_MPS,
    MAX_STATES,
    MAX_STEPS,
    is_apart,
)
from pd_editor.scene.thresholds import FASTEST_MPS
from pd_editor.scene.time_axis import TimeAxis

PAST_S: Final = TimeAxis().current_step * TimeAxis().step_s
"""Past of a file that does not tell observed steps from predicted ones."""
MAX_HEADING_RAD: Final = 1_000.0
NOMINAL_STEP_S: Final = 0.1

_SCENARIO_COLUMNS: Final = (
    "scenario_id",
    "start_timestamp",
    "end_timestamp",
    "num_timestamps",
    "focal_track_id",
    "city",
)
_OWN_COLUMNS: Final = (
    "length_m",
    "width_m",
    "has_known_size",
    "activity",
    "is_made_up",
    "current_step",
)
ACTIVITY_NAMES: Final = {one: one.name.lower() for one in Activity}
"""Activities as files say them."""
_ROW_COLUMNS: Final = (
    "observed",
    "track_id",
    "object_type",
    "object_category",
    "timestep",
    "position_x",
    "position_y",
    "heading",
    "velocity_x",
    "velocity_y",
)
_WINDOW_S: Final = 0.5
_MOVING_MPS: Final = 2.0
"""Positions that move faster than this for a while show where an agent drives."""
_AGREES_RAD: Final = 0.3
_MANY: Final = 0.5
_FEW: Final = 10
"""Fewer moving states prove nothing."""
_MAX_RATIO: Final = 2.0
"""Velocities that differ from the motion by more than this factor get a note."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TracksFile:
    """Contents of a track file."""

    scenario_id: str
    city: str
    focal_id: str
    origin_city_m: Float[np.ndarray, "2"]
    agents: AgentTracks
    """In the scene frame."""
    time_axis: TimeAxis
    source_fields: Mapping[str, Any]
    """Unknown columns that hold the same value in every row."""
    notes: tuple[str, ...]


def read_tracks(data: bytes, file_name: str) -> TracksFile:
    """Read the tracks from a parquet file's bytes.

    Agents come in the order of their first rows. The scene's origin is the focal
    agent's position at the current step in whole metres, so that the change of frame
    loses nothing.

    Raises:
        ScenarioFileError: the file is damaged or not an Argoverse 2 scenario.
    """
    table = open_track_table(data, file_name)
    track, ids = table.texts("track_id")
    time_axis, step = _time_axis(table)
    _check_numbers(table, track, step, len(ids), time_axis.num_steps)
    focal_id = table.one_text("focal_track_id")
    position = np.stack(
        [table.bounded_numbers("position_x"), table.bounded_numbers("position_y")],
        axis=-1,
    )
    _check_places(table, position)
    is_focal = track == (ids.index(focal_id) if focal_id in ids else -1)
    origin = _origin(position, step, is_focal, time_axis.current_step)
    agents, told = _agents(table, track, ids, step, position - origin, time_axis)
    source_fields, notes = _other_columns(table)
    return TracksFile(
        scenario_id=table.one_text("scenario_id"),
        city=table.one_text("city"),
        focal_id=focal_id,
        origin_city_m=origin,
        agents=agents,
        time_axis=time_axis,
        source_fields=source_fields,
        notes=(
            *notes,
            *told,
            *notes_on_velocities(agents, time_axis.step_s),
            *_notes_on_speed(agents, time_axis),
        ),
    )


def _time_axis(table: TrackTable) -> tuple[TimeAxis, Int[np.ndarray, "R"]]:
    """Time axis, and the step of each row."""
    num_steps = table.one_number("num_timestamps")
    if not (1 <= num_steps <= MAX_STEPS and num_steps == int(num_steps)):
        raise table.error(
            f"column 'num_timestamps' says {num_steps:g}; "
            f"expected a whole number from 1 to {MAX_STEPS}."
        )
    step = table.integers("timestep")
    is_bad = (step < 0) | (step >= num_steps)
    if is_bad.any():
        expected = f"a step from 0 to {num_steps - 1:g}"
        raise table.row_error("timestep", is_bad, expected)
    axis = TimeAxis(
        num_steps=int(num_steps),
        current_step=current_step_of(table, step, int(num_steps)),
        step_s=_step_s(table, int(num_steps)),
        start_timestamp_ns=table.one_number("start_timestamp"),
        end_timestamp_ns=table.one_number("end_timestamp"),
    )
    return axis, step


def _step_s(table: TrackTable, num_steps: int) -> float:
    """Time between two steps; what is nearly 0.1 s is 0.1 s."""
    if num_steps == 1:
        return NOMINAL_STEP_S
    end, start = table.one_number("end_timestamp"), table.one_number("start_timestamp")
    step_s = (end - start) / (num_steps - 1) * 1e-9
    if not 1e-3 <= step_s <= 10:
        raise table.error(
            f"its timestamps are {step_s:g} s apart; expected 0.1 s between steps."
        )
    is_nominal = abs(step_s - NOMINAL_STEP_S) < 0.02 * NOMINAL_STEP_S
    return NOMINAL_STEP_S if is_nominal else step_s


def current_step_of(
    table: TrackTable, step: Int[np.ndarray, "R"], num_steps: int
) -> int:
    """Current step of a table: its own column says it, or the last observed step.

    Raises:
        ScenarioFileError: the column says a step that is not there.
    """
    if "current_step" not in table.table.column_names:
        return default_current_step(
            step, table.flags("observed"), _step_s(table, num_steps)
        )
    current = table.one_number("current_step")
    if not (0 <= current < num_steps and current == int(current)):
        raise table.error(
            f"column 'current_step' says {current:g}; "
            f"expected a step from 0 to {num_steps - 1}."
        )
    return int(current)


def default_current_step(
    step: Int[np.ndarray, "R"], observed: Bool[np.ndarray, "R"], step_s: float
) -> int:
    """Current step of a file that does not store one: the last observed step.

    A file that tells observed steps from predicted ones nowhere has the past of
    Argoverse 2, in seconds, if it is longer.
    """
    if 0 < observed.sum() < len(observed):
        return int(step[observed].max())
    return min(int(step.max()), round(PAST_S / step_s))


def _check_numbers(
    table: TrackTable,
    track: Int[np.ndarray, "R"],
    step: Int[np.ndarray, "R"],
    num_agents: int,
    num_steps: int,
) -> None:
    """Raise if a track has two rows at one step, or the table is too large."""
    if num_agents > MAX_AGENTS:
        raise table.error(
            f"it has {num_agents} tracks; at most {MAX_AGENTS} are opened."
        )
    if num_agents * num_steps > MAX_STATES:
        raise table.error(
            f"it has {num_agents} tracks over {num_steps} steps; at most {MAX_STATES} "
            "states are opened."
        )
    cell = track * num_steps + step
    order = np.argsort(cell, kind="stable")
    is_repeat = np.zeros(len(cell), bool)
    is_repeat[order[1:]] = np.diff(cell[order]) == 0
    if is_repeat.any():
        expected = "each step of a track once"
        raise table.row_error("timestep", is_repeat, expected)


def _check_places(table: TrackTable, position: Float[np.ndarray, "R 2"]) -> None:
    """Raise if tracks are too far apart for one scene."""
    is_bad_xy = is_apart(position)
    for is_bad, name in zip(is_bad_xy.T, ("position_x", "position_y"), strict=True):
        if is_bad.any():
            expected = f"a place within {MAX_POSITION_M / 1000:g} km of the other ones"
            raise table.row_error(name, is_bad, expected)


def _notes_on_speed(agents: AgentTracks, axis: TimeAxis) -> tuple[str, ...]:
    """Note agents with implausible speeds; they are kept as recorded."""
    both = agents.is_valid[:, 1:] & agents.is_valid[:, :-1]
    moved = np.diff(agents.position_m, axis=1)
    jumps = both & (
        np.hypot(moved[..., 0], moved[..., 1]) > FASTEST_MPS * axis.step_s + 2.0
    )
    is_fast = agents.is_valid & (agents.speed_mps() > FASTEST_MPS)
    notes = []
    if is_fast.any():
        notes.append(
            f"Recorded faster than {FASTEST_MPS:g} m/s: "
            f"{agents_named(agents.ids, is_fast)}."
        )
    if jumps.any():
        notes.append(
            f"Recorded with leaps between steps: {agents_named(agents.ids, jumps)}."
        )
    return tuple(notes)


def agents_named(ids: Sequence[str], chosen: Bool[np.ndarray, "A T"]) -> str:
    """Name the first agents that are chosen at any step, and the number of others."""
    names = [ids[row] for row in np.flatnonzero(chosen.any(axis=1)).tolist()]
    return f"agent {listed(names, 1)}"


def _origin(
    position: Float[np.ndarray, "R 2"],
    step: Int[np.ndarray, "R"],
    is_focal: Bool[np.ndarray, "R"],
    current_step: int,
) -> Float[np.ndarray, "2"]:
    """Position of the focal agent nearest to the current step, in whole metres."""
    if not is_focal.any():
        return np.rint(np.median(position, axis=0))
    rows = np.flatnonzero(is_focal)
    return np.rint(position[rows[np.argmin(np.abs(step[rows] - current_step))]])


def _agents(
    table: TrackTable,
    track: Int[np.ndarray, "R"],
    ids: tuple[str, ...],
    step: Int[np.ndarray, "R"],
    position_m: Float[np.ndarray, "R 2"],
    axis: TimeAxis,
) -> tuple[AgentTracks, tuple[str, ...]]:
    """The agents, and notes on the units of their headings."""
    kinds, categories = _kinds(table, track), _categories(table, track)
    heading = table.bounded_numbers("heading", MAX_HEADING_RAD)
    velocity = np.stack(
        [
            table.bounded_numbers("velocity_x", MAX_SPEED_MPS),
            table.bounded_numbers("velocity_y", MAX_SPEED_MPS),
        ],
        axis=-1,
    )
    size, has_known_size = _sizes(table, track, kinds)

    def unfolded(values: np.ndarray) -> np.ndarray:
        shape = (len(ids), axis.num_steps, *values.shape[1:])
        full = np.zeros(shape, values.dtype)
        full[track, step] = values
        return full

    position, is_valid = unfolded(position_m), unfolded(np.ones(len(table), bool))
    heading, notes = headings_in_radians(
        unfolded(heading), position, is_valid, axis.step_s
    )
    agents = AgentTracks(
        ids=ids,
        kinds=kinds,
        categories=categories,
        size_m=size,
        has_known_size=has_known_size,
        position_m=position,
        heading_rad=np.where(is_valid, wrap_outside(heading), 0.0),
        velocity_mps=unfolded(velocity),
        is_valid=is_valid,
        observed=unfolded(table.flags("observed")),
        activity=_activities(table, track, len(ids)),
        has_made_up_past=_have_made_up_past(table, track, len(ids)),
    )
    return agents, notes


def _have_made_up_past(
    table: TrackTable, track: Int[np.ndarray, "R"], num_agents: int
) -> Bool[np.ndarray, "A"]:
    if "is_made_up" not in table.table.column_names:
        return np.zeros(num_agents, bool)
    return np.bincount(track[table.flags("is_made_up")], minlength=num_agents) > 0


def _per_track(
    table: TrackTable,
    column: str,
    track: Int[np.ndarray, "R"],
    values: Float[np.ndarray, "R"] | Int[np.ndarray, "R"] | Bool[np.ndarray, "R"],
) -> np.ndarray:
    """Value of each track; all rows of a track must share it."""
    _, first_row = np.unique(track, return_index=True)
    per_track = values[first_row]
    is_bad = values != per_track[track]
    if is_bad.any():
        expected = "the same value in all rows of the track"
        raise table.row_error(column, is_bad, expected)
    return per_track


def _kinds(table: TrackTable, track: Int[np.ndarray, "R"]) -> tuple[AgentKind, ...]:
    codes, names = table.texts("object_type")
    known = {kind.value: kind for kind in AgentKind}
    is_bad = ~np.array([name in known for name in names])[codes]
    if is_bad.any():
        expected = f"one of {', '.join(known)}"
        raise table.row_error("object_type", is_bad, expected)
    per_track = _per_track(table, "object_type", track, codes)
    return tuple(known[names[code]] for code in per_track)


def _categories(
    table: TrackTable, track: Int[np.ndarray, "R"]
) -> tuple[AgentCategory, ...]:
    values = table.integers("object_category")
    is_bad = ~np.isin(values, list(AgentCategory))
    if is_bad.any():
        raise table.row_error("object_category", is_bad, "one of 0, 1, 2, 3")
    per_track = _per_track(table, "object_category", track, values)
    return tuple(AgentCategory(int(value)) for value in per_track)


def _sizes(
    table: TrackTable, track: Int[np.ndarray, "R"], kinds: tuple[AgentKind, ...]
) -> tuple[Float[np.ndarray, "A 2"], Bool[np.ndarray, "A"]]:
    columns = table.table.column_names
    if "length_m" not in columns and "width_m" not in columns:
        return default_sizes_m(kinds), np.zeros(len(kinds), bool)
    sizes = []
    for name in ("length_m", "width_m"):
        values = table.numbers(name)
        is_bad = (values <= 0) | (values > MAX_LENGTH_M)
        if is_bad.any():
            expected = f"a size above 0 and up to {MAX_LENGTH_M:g} m"
            raise table.row_error(name, is_bad, expected)
        sizes.append(_per_track(table, name, track, values))
    has_known_size = np.ones(len(kinds), bool)
    if "has_known_size" in columns:
        flags = table.flags("has_known_size")
        has_known_size = _per_track(table, "has_known_size", track, flags)
    return np.stack(sizes, axis=-1), has_known_size


def _activities(
    table: TrackTable, track: Int[np.ndarray, "R"], num_agents: int
) -> Int[np.ndarray, "A"]:
    """Known in our own files only."""
    if "activity" not in table.table.column_names:
        return np.zeros(num_agents, np.int8)
    codes, names = table.texts("activity")
    known = {name: activity for activity, name in ACTIVITY_NAMES.items()}
    is_bad = ~np.array([name in known for name in names])[codes]
    if is_bad.any():
        raise table.row_error("activity", is_bad, f"one of {', '.join(known)}")
    per_track = _per_track(table, "activity", track, codes)
    return np.array([known[names[code]] for code in per_track], np.int8)


def _other_columns(table: TrackTable) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Unknown scenario-wide columns, and a note for each column that is not kept."""
    known = {*_ROW_COLUMNS, *_SCENARIO_COLUMNS, *_OWN_COLUMNS}
    fields: dict[str, Any] = {}
    notes = []
    for name in table.table.column_names:
        if name in known or name.startswith("__index_level_"):
            continue
        column = table.table[name].combine_chunks()
        if is_readable(column.type) and len(column.unique()) == 1:
            fields[name] = column[0].as_py()
        else:
            notes.append(f"Column {name[:60]!r} of the track file is not kept.")
    return fields, tuple(notes)


def headings_in_radians(
    heading: Float[np.ndarray, "A T"],
    position_m: Float[np.ndarray, "A T 2"],
    is_valid: Bool[np.ndarray, "A T"],
    step_s: float,
) -> tuple[Float[np.ndarray, "A T"], tuple[str, ...]]:
    """Headings in radians, counter-clockwise from +x, with a note if they were not.

    Degrees, and degrees clockwise from north, are known by the motion of the agents.
    Without moving agents, values beyond two turns count as degrees.
    """
    moves, motion = _motion(position_m, is_valid, step_s)
    most = float(np.abs(heading[is_valid]).max(initial=0.0))
    readings = {
        "radians": heading,
        "degrees": np.radians(heading),
        "degrees clockwise from north": np.radians(90.0 - heading),
    }
    if moves.sum() < _FEW:
        unit = "degrees" if most > 4 * np.pi else "radians"
    else:
        course = heading_of(motion[moves])
        fits = {
            one: float((np.abs(wrap_angle(rows[moves] - course)) < _AGREES_RAD).mean())
            for one, values in readings.items()
            for rows in (values[:, : moves.shape[1]],)
        }
        # Each reading is likelier than the next: they agree along a diagonal road.
        unit = max(fits, key=lambda one: fits[one] - 0.02 * list(fits).index(one))
        is_odd = fits["radians"] < _MANY
        # Within half a turn are radians, as exports write them, however agents slide.
        if fits[unit] < _MANY or most <= np.pi or not (is_odd or most > 2.1 * np.pi):
            unit = "radians"
        if is_odd and unit == "radians":
            return heading, ("Headings disagree with the motion of most agents.",)
    told = f"Headings were read as {unit}; expected radians."
    return readings[unit], () if unit == "radians" else (told,)


def notes_on_velocities(agents: AgentTracks, step_s: float) -> tuple[str, ...]:
    """Note velocities that do not fit the motion of positions; they are kept."""
    moves, motion = _motion(agents.position_m, agents.is_valid, step_s)
    driven_mps = float(np.hypot(*motion[moves].T).sum())
    said_mps = float(agents.speed_mps()[:, : moves.shape[1]][moves].sum())
    if moves.sum() < _FEW or 1 / _MAX_RATIO < said_mps / driven_mps < _MAX_RATIO:
        return ()
    return (
        f"Velocities do not fit the positions: together they are"
        f" {said_mps / driven_mps:.2g} times as large as the motion.",
    )


def _motion(
    position_m: Float[np.ndarray, "A T 2"],
    is_valid: Bool[np.ndarray, "A T"],
    step_s: float,
) -> tuple[Bool[np.ndarray, "A S"], Float[np.ndarray, "A S 2"]]:
    """Which states move on, and their velocity to a later place."""
    count = max(1, round(_WINDOW_S / step_s))
    motion = (position_m[:, count:] - position_m[:, :-count]) / (count * step_s)
    is_fast = np.hypot(motion[..., 0], motion[..., 1]) > _MOVING_MPS
    there = is_valid[:, count:] & is_valid[:, :-count]
    # Others jitter: boxes of standing agents jump now and then.
    drives = (there & is_fast).sum(axis=1) > _MANY * there.sum(axis=1)
    return there & is_fast & drives[:, None], motion
