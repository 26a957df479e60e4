from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import (
    ExportError,
    InputError,
    MapFileError,
    ScenarioFileError,
)
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.read import read_scenario, read_scenario_bytes
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.formats.dataset import DatasetIndex
from tests.builders import empty_tracks, scenario_with
from tests.scene.av2_io.small_files import (
    MAP,
    SCENARIO,
    TRACKS,
    changed_map,
    with_column,
)

ID = SCENARIO.scenario_id
TRACKS_NAME, MAP_NAME = f"scenario_{ID}.parquet", f"log_map_archive_{ID}.json"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, data in scenario_files(SCENARIO).items():
        (tmp_path / name).write_bytes(data)
    return tmp_path


def test_a_folder_reads_as_what_was_written(folder: Path) -> None:
    found = read_scenario(folder)
    assert (found.scenario_id, found.city) == (ID, "nowhere")
    assert found.focal_id == "100"
    np.testing.assert_array_equal(found.origin_city_m, SCENARIO.origin_city_m)
    np.testing.assert_allclose(
        found.agents.position_m, SCENARIO.agents.position_m, atol=1e-9
    )
    assert found.provenance.source == str(folder.resolve())
    assert found.provenance.content_sha256 == sha256(TRACKS + MAP).hexdigest()
    assert Path(found.provenance.source).is_absolute()


def test_other_files_in_the_folder_do_no_harm(folder: Path) -> None:
    (folder / "recipe.json").write_text("{}")
    (folder / "notes.parquet").mkdir()
    assert read_scenario(folder).scenario_id == ID


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gone: there is no such folder"):
        read_scenario(tmp_path / "gone")


def test_a_file_is_no_folder(folder: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_scenario(folder / TRACKS_NAME)


@pytest.mark.parametrize(
    "name", ["nul\0", "line\nbreak", "half\ud800", "x" * 256, "x/" * 2500]
)
def test_names_that_no_folder_can_have(name: str) -> None:
    """Neither NUL nor long names reach the operating system (fault 5)."""
    for open_it in (read_scenario, DatasetIndex, open_scenario):
        with pytest.raises(InputError, match=r"no usable path|path is too long"):
            open_it(Path(name))


def test_missing_tracks(folder: Path) -> None:
    (folder / TRACKS_NAME).unlink()
    with pytest.raises(ScenarioFileError, match="found no track files; expected one"):
        read_scenario(folder)


def test_two_track_files(folder: Path) -> None:
    (folder / "scenario_b.parquet").write_bytes(TRACKS)
    with pytest.raises(ScenarioFileError, match="found 2 track files"):
        read_scenario(folder)


def test_missing_map(folder: Path) -> None:
    (folder / MAP_NAME).unlink()
    with pytest.raises(MapFileError, match=f"the map {MAP_NAME} is missing"):
        read_scenario(folder)


def test_map_of_another_scenario(folder: Path) -> None:
    (folder / MAP_NAME).rename(folder / "log_map_archive_other.json")
    with pytest.raises(MapFileError, match=f"another scenario; expected {MAP_NAME}"):
        read_scenario(folder)


def test_a_map_far_from_the_tracks() -> None:
    def change(archive: dict) -> None:
        for entry in archive["lane_segments"].values():
            for name in ("centerline", "left_lane_boundary", "right_lane_boundary"):
                for point in entry[name]:
                    point["x"] += 3000
        archive["drivable_areas"] = {}

    with pytest.raises(MapFileError, match=r"lies 2\.\d km from the tracks"):
        read_scenario_bytes(TRACKS, changed_map(change), name=ID)


@pytest.mark.parametrize("bad_id", ["../../etc/x", "a/b", "", ".hidden", "CÖ"])
def test_ids_that_are_no_file_names_are_refused(bad_id: str) -> None:
    count = SCENARIO.agents.is_valid.sum()
    data = with_column("scenario_id", [bad_id] * count)
    with pytest.raises(ScenarioFileError, match="scenario_id is"):
        read_scenario_bytes(data, MAP, name="x")
    with pytest.raises(ExportError, match="cannot be part of a file's name"):
        scenario_files(replace(SCENARIO, scenario_id=bad_id))


def test_a_map_field_nested_too_deeply_cannot_be_written() -> None:
    nested: list = []
    for _ in range(100_000):
        nested = [nested]
    road_map = replace(SCENARIO.road_map, source_fields={"x": nested})
    with pytest.raises(ExportError, match="nested too deeply"):
        scenario_files(replace(SCENARIO, road_map=road_map))


def test_a_scenario_without_agents_cannot_be_written() -> None:
    with pytest.raises(ExportError, match="without agents cannot be written"):
        scenario_files(scenario_with(empty_tracks(110)))


def test_a_scenario_without_its_focal_agent_can_be_read_again() -> None:
    files = scenario_files(
        replace(SCENARIO, agents=SCENARIO.agents.taken([1]), focal_id="100")
    )
    found = read_scenario_bytes(*files.values(), name=ID)
    assert found.focal_id == "100"
    assert found.agents.ids == ("101",)
