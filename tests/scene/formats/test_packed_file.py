"""Gzipped files of all formats, and those in UTF-16."""

import gzip
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import (
    foreign_scenes,
    is_foreign,
    open_scenario,
    scenario_and_recipe,
)
from tests.scene.formats.test_commonroad import text as commonroad
from tests.scene.formats.test_lanelet2 import STREET
from tests.scene.formats.test_lanelet2 import text as lanelet2
from tests.scene.formats.test_opendrive import lane, road, section
from tests.scene.formats.test_recordings import as_gpudrive, description
from tests.scene.formats.test_sumo_net import NET

ROAD = f'<OpenDRIVE><header revMajor="1" revMinor="6"/>{road(section(lane(-1)))}</OpenDRIVE>'
FILES: dict[str, Callable[[], bytes]] = {
    "town.xodr": ROAD.encode,
    "road.xodrz": ROAD.encode,
    "town.xml": ROAD.encode,
    "scene.xml": lambda: commonroad().encode(),
    "map.osm": lambda: lanelet2(STREET[:1]).encode(),
    "hand.net.xml": NET.encode,
    "any.xml": NET.encode,
    "one.json": lambda: json.dumps(as_gpudrive()).encode(),
    "sd_one.pkl": lambda: pickle.dumps(description()),
}


@pytest.mark.parametrize("name", FILES)
def test_gzipped_files_open_as_the_plain_ones_do(tmp_path: Path, name: str):
    """Only SUMO's did."""
    data = FILES[name]()
    (tmp_path / name).write_bytes(data)
    packed = tmp_path / "packed" / f"{name}.GZ"
    packed.parent.mkdir()
    packed.write_bytes(gzip.compress(data))
    plain, found = open_scenario(tmp_path / name), open_scenario(packed)
    assert found.scenario_id == plain.scenario_id
    assert len(found.road_map.lanes) == len(plain.road_map.lanes)
    assert found.agents.ids == plain.agents.ids
    assert foreign_scenes(packed.parent) == [packed]
    assert is_foreign(packed.name, packed.read_bytes())
    uploaded, _ = scenario_and_recipe({packed.name: packed.read_bytes()})
    assert uploaded.scenario_id == plain.scenario_id


def test_an_upload_of_a_long_name_opens():
    """Its ending was cut off."""
    name = f"{'ä' * 100}.net.xml.gz"
    scenario, _ = scenario_and_recipe({name: gzip.compress(NET.encode())})
    assert scenario.road_map.lanes


@pytest.mark.parametrize("name", ["sd_one.pkl", "one.json", "town.xodr"])
def test_damaged_gzips_are_refused(tmp_path: Path, name: str):
    path = tmp_path / f"{name}.gz"
    path.write_bytes(gzip.compress(FILES[name]())[:-12])
    with pytest.raises(FormatError, match="is no valid gzip"):
        open_scenario(path)


def test_xml_in_utf_16_is_recognised(tmp_path: Path):
    path = tmp_path / "town.xml"
    path.write_bytes(f'<?xml version="1.0" encoding="UTF-16"?>{ROAD}'.encode("utf-16"))
    assert open_scenario(path).road_map.lanes
