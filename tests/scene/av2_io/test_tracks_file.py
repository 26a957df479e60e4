import io
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import ScenarioFileError
from pd_editor.scene.agent_kind import AgentCategory, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.tracks_file import (
    TracksFile,
    default_current_step,
    read_tracks,
)
from pd_editor.scene.av2_io.write import tracks_bytes
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import cut_scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.scene.av2_io.small_files import (
    OFFICIAL_COLUMNS,
    SCENARIO,
    TRACKS,
    parquet,
    rows,
    table,
    with_cell,
    with_column,
    without_column,
)

FILE = "scenario_x.parquet"


def read(data: bytes) -> TracksFile:
    return read_tracks(data, FILE)


def reread(scenario: Scenario) -> TracksFile:
    return read(tracks_bytes(scenario))


def assert_same_agents(found: TracksFile, scenario: Scenario) -> None:
    expected, agents = scenario.agents, found.agents
    assert agents.ids == expected.ids
    assert agents.kinds == expected.kinds
    assert agents.categories == expected.categories
    np.testing.assert_array_equal(agents.is_valid, expected.is_valid)
    valid = expected.is_valid
    np.testing.assert_array_equal(agents.observed[valid], expected.observed[valid])
    np.testing.assert_array_equal(agents.size_m, expected.size_m)
    np.testing.assert_array_equal(agents.has_known_size, expected.has_known_size)
    np.testing.assert_array_equal(
        agents.heading_rad[valid], expected.heading_rad[valid]
    )
    np.testing.assert_array_equal(
        agents.velocity_mps[valid], expected.velocity_mps[valid]
    )
    np.testing.assert_allclose(
        agents.position_m[valid] + found.origin_city_m,
        expected.position_m[valid] + scenario.origin_city_m,
        rtol=0,
        atol=1e-9,
    )


def scenario_of(seed: int, num_agents: int, num_steps: int) -> Scenario:
    """Agents of random kinds that come and go at random steps."""
    rng = np.random.default_rng(seed)
    shape = (num_agents, num_steps)
    valid = rng.random(shape) < 0.7
    valid[:, rng.integers(num_steps)] = True
    hide = valid.astype(float)
    kinds, categories = list(AgentKind), list(AgentCategory)
    ids = tuple(f"agent {row}" for row in range(num_agents))
    agents = AgentTracks(
        ids=ids,
        kinds=tuple(kinds[rng.integers(len(kinds))] for _ in ids),
        categories=tuple(categories[rng.integers(len(categories))] for _ in ids),
        size_m=rng.uniform(0.3, 15, (num_agents, 2)),
        has_known_size=rng.random(num_agents) < 0.5,
        position_m=rng.uniform(-500, 500, (*shape, 2)) * hide[..., None],
        heading_rad=rng.uniform(-3.1415, 3.1415, shape) * hide,
        velocity_mps=rng.uniform(-30, 30, (*shape, 2)) * hide[..., None],
        is_valid=valid,
        observed=(rng.random(shape) < 0.5) & valid,
    )
    return replace(
        SCENARIO,
        agents=agents,
        time_axis=TimeAxis(
            num_steps=num_steps,
            current_step=int(rng.integers(num_steps)),
            end_timestamp_ns=1e8 * (num_steps - 1),
        ),
        focal_id=(*ids, "elsewhere")[rng.integers(num_agents + 1)],
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 5), st.integers(1, 60))
def test_written_tracks_read_back_equal(
    seed: int, num_agents: int, num_steps: int
) -> None:
    scenario = scenario_of(seed, num_agents, num_steps)
    found = reread(scenario)
    assert_same_agents(found, scenario)
    assert found.time_axis == scenario.time_axis
    assert found.focal_id == scenario.focal_id
    assert (found.scenario_id, found.city) == (scenario.scenario_id, scenario.city)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, len(TRACKS) - 1))
def test_a_cut_off_file_is_refused(length: int) -> None:
    with pytest.raises(ScenarioFileError, match=FILE):
        read(TRACKS[:length])


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(TRACKS) - 1), st.integers(0, 255))))
def test_damaged_bytes_are_refused_or_readable(
    changes: list[tuple[int, int]],
) -> None:
    """What is taken is sound: it can be written, and reads back equal."""
    damaged = bytearray(TRACKS)
    for position, value in changes:
        damaged[position] = value
    try:
        found = read(bytes(damaged))
    except ScenarioFileError:
        return
    assert np.isfinite(found.agents.position_m).all()
    assert np.isfinite(found.agents.velocity_mps).all()
    scenario = replace(
        SCENARIO,
        agents=found.agents,
        time_axis=found.time_axis,
        focal_id=found.focal_id,
        origin_city_m=found.origin_city_m,
    )
    assert_same_agents(reread(scenario), scenario)


def test_columns_and_types_are_the_official_ones() -> None:
    schema = table().schema
    assert tuple(schema.names[:16]) == OFFICIAL_COLUMNS
    types = [str(schema.field(name).type) for name in OFFICIAL_COLUMNS]
    assert types == (
        ["bool", "string", "string", "int64", "int64"]
        + ["double"] * 5
        + ["string", "double", "double", "int64", "string", "string"]
    )
    assert schema.names[16:] == ["length_m", "width_m", "has_known_size"]


def test_origin_is_the_focal_agents_place_in_whole_metres() -> None:
    found = read(TRACKS)
    np.testing.assert_array_equal(found.origin_city_m, [1000.0, -2000.0])
    np.testing.assert_allclose(found.agents.position_m[0, 49], 0, atol=1e-9)


def test_observed_rows_only_make_the_last_observed_step_current() -> None:
    step = np.array(table()["timestep"])
    found = read(rows(np.flatnonzero(step < 50)))
    assert found.time_axis.current_step == 49
    assert found.time_axis.num_steps == 110


@pytest.mark.parametrize(
    ("num_steps", "num_observed", "step_s", "expected"),
    [
        (110, 50, 0.1, 49),
        (110, 80, 0.1, 79),
        (50, 50, 0.1, 49),
        (110, 110, 0.1, 49),
        (110, 0, 0.1, 49),
        (22, 22, 0.5, 10),
        (22, 11, 0.5, 10),
        (5, 5, 0.5, 4),
    ],
)
def test_the_last_observed_step_is_current_or_the_usual_past_is_taken(
    num_steps: int, num_observed: int, step_s: float, expected: int
) -> None:
    step = np.arange(num_steps)
    assert default_current_step(step, step < num_observed, step_s) == expected


def test_agents_come_in_the_order_of_their_first_rows() -> None:
    step = np.array(table()["timestep"])
    found = read(rows(np.argsort(-step, kind="stable")))
    assert found.agents.ids == ("100", "101")
    found = read(rows(np.arange(len(step))[::-1]))
    assert found.agents.ids == ("101", "100")


def test_whole_numbers_and_flags_may_be_stored_as_floats() -> None:
    data = with_column("timestep", np.array(table()["timestep"], float))
    data = with_column("observed", np.array(table()["observed"], float), data)
    assert_same_agents(read(data), SCENARIO)


def test_files_without_sizes_get_the_defaults() -> None:
    data = parquet(table().select(list(OFFICIAL_COLUMNS)))
    assert_same_agents(read(data), SCENARIO)


def test_sizes_without_a_flag_are_known() -> None:
    found = read(without_column("has_known_size"))
    assert found.agents.has_known_size.all()


def test_unknown_scenario_wide_columns_are_kept() -> None:
    count = table().num_rows
    data = with_column("map_id", pa.repeat(pa.scalar(2**63 + 1, pa.uint64()), count))
    data = with_column("slice_id", ["abc"] * count, data)
    data = with_column("row_number", np.arange(count), data)
    found = read(data)
    assert found.source_fields == {"map_id": 2**63 + 1, "slice_id": "abc"}
    assert found.notes == ("Column 'row_number' of the track file is not kept.",)
    again = reread(replace(SCENARIO, source_fields=found.source_fields))
    assert again.source_fields == found.source_fields


def test_headings_are_wrapped_only_where_needed() -> None:
    found = read(with_cell("heading", 0, 7.0))
    assert found.agents.heading_rad[0, 0] == pytest.approx(7.0 - 2 * np.pi)


def test_whole_numbers_of_nanoseconds_are_written_as_they_were() -> None:
    """They became floats: ...789 ended in ...768 (public case 18)."""
    count, start = table().num_rows, 1_700_000_000_123_456_789
    end = start + 100_000_000 * (SCENARIO.time_axis.num_steps - 1) + 1
    data = with_column("start_timestamp", np.full(count, start))
    data = with_column("end_timestamp", np.full(count, end), data)
    axis = read(data).time_axis
    assert (axis.start_timestamp_ns, axis.end_timestamp_ns) == (start, end)
    assert axis.step_s == 0.1
    scenario = replace(SCENARIO, time_axis=axis)
    assert reread(scenario).time_axis == axis
    cut = cut_scenario(scenario, SceneCut(until_s=0.1)).time_axis
    assert isinstance(cut.end_timestamp_ns, int)


LAST = table().num_rows - 1
BAD_FILES = {
    "no parquet": (b"not parquet", "not a readable parquet file"),
    "nothing": (b"", "not a readable parquet file"),
    "no rows": (rows([]), "no rows"),
    "NaN position": (
        with_cell("position_x", 3, float("nan")),
        r"'position_x', row 3 \(track '100'\): .* finite, found nan",
    ),
    "infinite speed": (with_cell("velocity_y", 0, float("inf")), "'velocity_y', row 0"),
    "far away": (with_cell("position_y", 5, 1e9), "'position_y', row 5 .* 1e\\+08"),
    "null": (with_cell("heading", 4, None), "'heading', row 4 .* found None"),
    "text as number": (with_column("heading", ["x"] * (LAST + 1)), "'heading' .* type"),
    "number as text": (
        with_column("city", [1.5] * (LAST + 1)),
        "'city', row 0 .* whole",
    ),
    "kind": (
        with_cell("object_type", 2, "horse"),
        "'object_type', row 2 .* one of vehicle, .* 'horse'",
    ),
    "kind changes": (
        with_cell("object_type", 2, "bus"),
        "'object_type', row 2 .* the same value in all rows",
    ),
    "category": (with_cell("object_category", 0, 9), "one of 0, 1, 2, 3, found 9"),
    "category changes": (
        with_cell("object_category", LAST, 0),
        rf"'object_category', row {LAST} \(track '101'\)",
    ),
    "fractional step": (
        with_column("timestep", np.array(table()["timestep"]) + 0.5),
        "'timestep', row 0 .* a whole number, found 0.5",
    ),
    "late step": (with_cell("timestep", 9, 110), "step from 0 to 109, found 110"),
    "negative step": (with_cell("timestep", 9, -1), "step from 0 to 109, found -1"),
    "repeated row": (rows([0, 1, 2, 1]), "'timestep', row 3 .* each step .* once"),
    "two scenarios": (
        with_cell("scenario_id", 7, "other"),
        "'two-lane-road' and 'other'; expected one scenario per file",
    ),
    "two cities": (with_cell("city", 7, "other"), "'city' holds both"),
    "step count": (
        with_column("num_timestamps", [10**9] * (LAST + 1)),
        "'num_timestamps' says 1e\\+09; expected a whole number from 1",
    ),
    "step count changes": (with_cell("num_timestamps", 1, 50), "'num_timestamps', row"),
    "time runs backwards": (
        with_column("end_timestamp", [-1e9] * (LAST + 1)),
        "expected 0.1 s between steps",
    ),
    "size": (with_column("length_m", [-1.0] * (LAST + 1)), "'length_m', row 0"),
    "size changes": (with_cell("width_m", 1, 2.5), "'width_m', row 1 .* all rows"),
    "current step": (
        with_column("current_step", [110] * (LAST + 1)),
        "'current_step' says 110; expected a step from 0 to 109",
    ),
    "flag": (with_column("observed", [2] * (LAST + 1)), "expected true or false"),
    "two columns of a name": (
        parquet(
            table().rename_columns(
                [name.replace("city", "heading") for name in table().column_names]
            )
        ),
        "two columns have the same name",
    ),
}


@pytest.mark.parametrize(("data", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_bad_files_are_refused_in_one_sentence(data: bytes, message: str) -> None:
    with pytest.raises(ScenarioFileError, match=message) as refusal:
        read(data)
    text = str(refusal.value)
    assert text.startswith(f"{FILE}: ")
    assert text.endswith(".")
    assert "\n" not in text


@pytest.mark.parametrize("column", OFFICIAL_COLUMNS)
def test_each_official_column_must_be_there(column: str) -> None:
    with pytest.raises(ScenarioFileError, match=f"column '{column}' is missing"):
        read(without_column(column))


def test_too_many_cells_are_refused_before_they_are_allocated() -> None:
    count = 300
    data = parquet(
        pa.table(
            {
                "track_id": [str(row) for row in range(count)],
                "timestep": [0] * count,
                "observed": [True] * count,
                "num_timestamps": [1_000] * count,
                "start_timestamp": [0.0] * count,
                "end_timestamp": [1e11] * count,
            }
        )
    )
    with pytest.raises(
        ScenarioFileError, match=r"300 tracks over 1000 steps; at most 200000"
    ):
        read(data)


def agents_of(count: int, steps: int = 1) -> pa.Table:
    """Tracks that exist at the first steps, 3 m apart."""
    first = table().slice(0, 1)
    rows = first.take(pa.array([0] * count * steps, pa.int64()))
    ids = pa.array([str(row) for row in range(count) for _ in range(steps)])
    step = pa.array([row % steps for row in range(count * steps)], pa.int64())
    for name, values in (("track_id", ids), ("timestep", step)):
        rows = rows.set_column(rows.column_names.index(name), name, values)
    return rows


def test_too_many_tracks_are_refused_with_the_limit() -> None:
    """A scene of 501 agents is told, one of 500 opens (fault 1)."""
    found = read_tracks(parquet(agents_of(500)), "x.parquet")
    assert len(found.agents) == 500
    with pytest.raises(ScenarioFileError, match="501 tracks; at most 500 are opened"):
        read_tracks(parquet(agents_of(501)), "x.parquet")


def test_columns_that_would_unpack_to_gigabytes_are_not_read() -> None:
    """A repeated value of a megabyte is a few bytes in a file (fault 1)."""
    count = len(table())
    large = pa.array([b"x" * 2**20], pa.binary()).take(pa.array([0] * count))
    data = with_column("photo", large)
    assert len(data) < 4 * 2**20
    before = pa.total_allocated_bytes()
    found = read_tracks(data, "x.parquet")
    assert pa.total_allocated_bytes() - before < 8 * 2**20
    assert "Column 'photo' of the track file is not kept." in found.notes
    with pytest.raises(ScenarioFileError, match="column 'city' is of type binary"):
        read_tracks(with_column("city", large), "x.parquet")


def test_too_many_columns_are_refused_with_the_limit() -> None:
    """Each column costs as many values as there are rows (fault 1)."""
    wide = table()
    for number in range(100):
        wide = wide.append_column(f"c{number}", pa.array([1.0] * len(wide)))
    with pytest.raises(ScenarioFileError, match="columns; at most 100 are read"):
        read_tracks(parquet(wide), "x.parquet")


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("velocity_x", 1e6, "between -200 and 200"),
        ("velocity_y", -201.0, "between -200 and 200"),
        ("position_x", 1e6, "within 5 km of the other ones"),
        ("position_y", -9e5, "within 5 km of the other ones"),
        ("heading", 1e300, "between -1000 and 1000"),
    ],
)
def test_absurd_states_are_refused(column: str, value: float, words: str) -> None:
    """Finite numbers that no scene holds are told with their row (fault 9)."""
    with pytest.raises(ScenarioFileError, match=rf"'{column}', row 3.*{words}"):
        read_tracks(with_cell(column, 3, value), "x.parquet")


def test_odd_states_are_kept_and_told() -> None:
    """Speeds and leaps beyond all road users stand in the notes (fault 9)."""
    found = read_tracks(with_cell("velocity_x", 3, 90.0), "x.parquet")
    assert found.notes == ("Recorded faster than 60 m/s: agent 100.",)
    place = table()["position_x"][3].as_py() + 300.0
    found = read_tracks(with_cell("position_x", 3, place), "x.parquet")
    assert found.notes == ("Recorded with leaps between steps: agent 100.",)
    assert read_tracks(TRACKS, "x.parquet").notes == ()


@pytest.mark.parametrize("text", ["a\nb", "nul\0", "x" * 256, "turn\x1b[2J"])
def test_ids_and_names_must_be_printable(text: str) -> None:
    """What goes into file names, labels and messages is checked first (fault 5)."""
    for column in ("track_id", "city", "focal_track_id"):
        with pytest.raises(ScenarioFileError, match="expected texts of one line"):
            read_tracks(with_column(column, [text] * len(table())), "x.parquet")


def test_activities_are_written_where_any_is_known() -> None:
    scenario = scenario_of(3, 4, 12)
    assert b"activity" not in tracks_bytes(scenario)
    activity = np.array([0, 1, 2, 3], np.int8)
    known = replace(scenario, agents=replace(scenario.agents, activity=activity))
    found = reread(known).agents
    order = [known.agents.row_of[name] for name in found.ids]
    assert found.activity.tolist() == activity[order].tolist()
    assert reread(scenario).agents.activity.tolist() == [0] * len(found.ids)


def test_half_a_turn_in_single_precision_is_written_as_it_is_read():
    scenario = scenario_of(seed=1, num_agents=3, num_steps=20)
    heading = np.full_like(scenario.agents.heading_rad, np.float32(np.pi))
    agents = replace(scenario.agents, heading_rad=heading)
    written = tracks_bytes(replace(scenario, agents=agents))
    found = pq.read_table(io.BytesIO(written))["heading"].to_numpy()
    again = read(written).agents
    np.testing.assert_array_equal(again.heading_rad[again.is_valid], found)


def test_a_damaged_footer_is_refused_or_readable() -> None:
    """What pyarrow says of a part of a column ended the process, without an exception."""
    start = len(TRACKS) - 8 - int.from_bytes(TRACKS[-8:-4], "little")
    random, num_taken = np.random.default_rng(0), 0
    for _ in range(2_000):
        damaged = bytearray(TRACKS)
        for place in random.integers(start, len(TRACKS) - 8, 2):
            damaged[place] = random.integers(256)
        try:
            found = read(bytes(damaged))
        except ScenarioFileError:
            continue
        num_taken += 1
        assert np.isfinite(found.agents.position_m).all()
    assert 0 < num_taken < 1_000
