"""Headings and velocities in other units than the format's are read rightly, or told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.tracks_file import TracksFile, read_tracks
from pd_editor.scene.av2_io.write import scenario_files, tracks_bytes
from pd_editor.scene.bundle import write_files
from pd_editor.scene.geometry.angles import wrap_angle
from tests.scene.av2_io.small_files import parquet as file_of
from tests.scene.av2_io.small_files import table as table_of

BASE = open_scenario("downtown")
TABLE = table_of(tracks_bytes(BASE))


def changed(**columns: np.ndarray) -> TracksFile:
    table = TABLE
    for name, values in columns.items():
        place = table.column_names.index(name)
        table = table.set_column(place, name, pa.array(values))
    return read_tracks(file_of(table), "x.parquet")


def column(name: str) -> np.ndarray:
    return TABLE[name].to_numpy()


HEADING = column("heading")


def test_headings_within_half_a_turn_are_radians_however_agents_move():
    # All agents slide to the east, which would fit small angles in degrees.
    rows = {"heading": np.clip(HEADING, -3.0, 3.0)}
    rows["position_x"] = column("position_x") + 8.0 * column("timestep")
    found = changed(**rows)
    said = found.agents.heading_rad[found.agents.is_valid]
    np.testing.assert_array_equal(np.sort(said), np.sort(rows["heading"]))


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (np.degrees(HEADING) % 360, "degrees"),
        (np.degrees(HEADING), "degrees"),
        ((90 - np.degrees(HEADING)) % 360, "degrees clockwise from north"),
        (HEADING % (2 * np.pi), ""),
        (HEADING + 6 * np.pi, ""),
    ],
)
def test_headings_in_degrees_are_read_as_what_they_are(values: np.ndarray, unit: str):
    found = changed(heading=values)
    gap = wrap_angle(found.agents.heading_rad - BASE.agents.heading_rad)
    assert np.abs(gap).max() < 1e-6
    assert found.notes == (
        (f"Headings were read as {unit}; expected radians.",) if unit else ()
    )


def test_headings_that_fit_no_motion_are_told():
    found = changed(heading=wrap_angle(HEADING + 2.0))
    assert found.notes == ("Headings disagree with the motion of most agents.",)


@pytest.mark.parametrize("factor", [0.0, 3.6])
def test_velocities_that_fit_no_motion_are_told(factor: float):
    names = ("velocity_x", "velocity_y")
    found = changed(**{name: factor * column(name) for name in names})
    (note,) = (one for one in found.notes if one.startswith("Velocities"))
    assert f"{factor:.2g} times as large" in note


def test_standing_agents_prove_degrees_only_beyond_two_turns():
    still = {"position_x": 0 * HEADING + 5.0, "position_y": 0 * HEADING}
    assert changed(**still, heading=0 * HEADING + 7.0).notes == ()
    (note,) = changed(**still, heading=0 * HEADING + 90.0).notes
    assert "as degrees" in note


def test_recorded_scenes_have_no_such_note(av2_scenario_folders: list[Path]):
    for folder in av2_scenario_folders:
        words = " ".join(read_scenario(folder).provenance.notes)
        assert "Headings" not in words
        assert "Velocities" not in words


def test_ids_may_be_whole_numbers_or_views():
    """A CSV file in between makes numbers of ids; newer writers use views of texts."""
    codes = pc.dictionary_encode(TABLE["track_id"]).combine_chunks().indices.to_numpy()
    first = pc.unique(TABLE["track_id"]).to_pylist()
    focal = np.full(len(TABLE), first.index(BASE.focal_id))
    for kind in (np.int64, np.int32, np.float64):
        found = changed(track_id=codes.astype(kind), focal_track_id=focal.astype(kind))
        assert found.agents.ids == tuple(map(str, range(len(first))))
        assert found.focal_id == str(first.index(BASE.focal_id))
    texts = ("track_id", "focal_track_id", "scenario_id", "city", "object_type")
    views = {name: TABLE[name].cast(pa.string_view()) for name in texts}
    table = TABLE
    for name, values in views.items():
        table = table.set_column(table.column_names.index(name), name, values)
    assert read_tracks(file_of(table), "x.parquet").agents.ids == BASE.agents.ids


def test_coordinates_of_map_projections_are_read(tmp_path: Path):
    """Only places within the scene matter: nuPlan and UTM lie beyond 1,000 km."""
    far = replace(BASE, origin_city_m=np.array([664_430.0, 4_692_000.0]))
    write_files(scenario_files(far), tmp_path / "far", forbidden=None)
    again = read_scenario(tmp_path / "far")
    assert np.abs(again.agents.position_m - BASE.agents.position_m).max() < 500
    shift = again.origin_city_m - far.origin_city_m
    gap = again.agents.position_m + shift - far.agents.position_m
    assert np.abs(gap[far.agents.is_valid]).max() < 1e-6
    written, first = (
        table_of(next(iter(scenario_files(one).values()))) for one in (again, far)
    )
    assert written["position_y"].to_pylist() == first["position_y"].to_pylist()
