"""What files of other formats may not do: name places, fill the memory, break the reader."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pd_editor.base.errors import FormatError, InputError, LargeMapError
from pd_editor.editor.scenario_store import open_scenario, scenario_and_recipe
from tests.scene.formats.test_commonroad import text as commonroad
from tests.scene.formats.test_opendrive import LINE, lane, road, section
from tests.scene.formats.test_opendrive import write as write_road
from tests.scene.formats.test_recordings import as_gpudrive, description


def pickled(folder: Path, value: Any) -> Path:
    path = folder / "sd_one.pkl"
    path.write_bytes(pickle.dumps(value))
    return path


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("../../elsewhere", "elsewhere"),
        ("/etc/passwd", "etc-passwd"),
        ("a b\tc", "a-b-c"),
        ("\u00fc", "scene"),
        ("x" * 500, "x" * 100),
        ("USA_Peach-4_1_T-1", "USA_Peach-4_1_T-1"),
    ],
)
def test_names_cannot_lead_out_of_a_folder(tmp_path: Path, name: str, expected: str):
    """The id names the folder of an export: it was taken as it came."""
    assert (
        open_scenario(pickled(tmp_path, description(id=name))).scenario_id == expected
    )


def changed_track(**state: Any) -> dict[str, Any]:
    found = description()
    found["tracks"]["7"]["state"].update(state)
    return found


def with_metadata(**about: Any) -> dict[str, Any]:
    found = description()
    found["metadata"].update(about)
    return found


def many_tracks() -> dict[str, Any]:
    track = description()["tracks"]["7"]
    return description(tracks={str(n): track for n in range(600)})


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (
            description(
                tracks={
                    "AV": description()["tracks"]["9"],
                    "7": description()["tracks"]["7"],
                }
            ),
            "comes twice",
        ),
        (description(tracks={"a\nb": description()["tracks"]["9"]}), "no usable id"),
        (many_tracks(), "it has 600 tracks; at most 500"),
        (with_metadata(ts=np.zeros(91)), "times that do not increase"),
        (with_metadata(ts=np.full(91, np.nan)), "without a place or a time"),
        (changed_track(heading=np.full(91, np.inf)), "without a place or a time"),
        (changed_track(velocity=np.full((91, 2), 1e6)), "would move at"),
        (with_metadata(ts=1e4 * np.arange(91)), "at most 100 s are opened"),
    ],
)
def test_impossible_tracks_are_refused(tmp_path: Path, value: Any, told: str):
    with pytest.raises(FormatError, match=told):
        open_scenario(pickled(tmp_path, value))


@pytest.mark.parametrize("flags", [1, 63])
def test_numbers_are_never_taken_for_addresses(tmp_path: Path, flags: int):
    """A pickle may say of an element type that its bytes point to objects."""
    data = pickle.dumps(description(), protocol=2)
    # The state of the element type, without the framing that numbers its parts.
    state = b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK"
    assert state in data
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(data.replace(state + b"\x00", state + bytes([flags])))
    assert len(open_scenario(path).agents) == 3


def test_values_that_occur_again_are_read_once(tmp_path: Path):
    """Ten lists in one another would be ten billion elements."""
    value: list[Any] = []
    for _ in range(40):
        value = [value] * 10
    with pytest.raises(FormatError, match="is no scenario description"):
        open_scenario(pickled(tmp_path, value))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (road(section(lane(-1)), length=1e12), "at most 200000"),
        (
            road(
                section(lane(-1)), geometry=LINE.replace('length="50"', 'length="1e12"')
            ),
            "at most 200000",
        ),
        (road(section(lane(-1), s=1e12)), "not in the order of s"),
        (
            road(section(lane(-1)), geometry=LINE.replace('x="0"', 'x="1e300"')),
            "<geometry> needs a number below 1e30 for x",
        ),
    ],
)
def test_roads_beyond_all_measure_are_refused(tmp_path: Path, content: str, told: str):
    with pytest.raises(FormatError, match=told):
        open_scenario(write_road(tmp_path, content))


def test_obstacles_that_stand_for_ever_are_refused(tmp_path: Path):
    path = tmp_path / "scene.xml"
    path.write_text(
        commonroad(step_s=0.001).replace(
            "<exact>30</exact>", "<exact>900000000</exact>"
        )
    )
    with pytest.raises(FormatError, match="too many states"):
        open_scenario(path)


def test_a_folder_is_looked_at_and_not_searched(tmp_path: Path):
    """A path typed into the editor, such as the root, was searched to its last folder."""
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    (deep / "one.json").write_text(json.dumps(as_gpudrive()))
    (tmp_path / "a" / "loop").symlink_to(tmp_path)
    with pytest.raises(Exception, match="found no track files"):
        open_scenario(tmp_path)
    assert open_scenario(deep).scenario_id == "one"


def test_degrees_are_not_taken_for_metres(tmp_path: Path):
    """A network in degrees opened as a road of a few millimetres."""
    found = description()
    for feature in found["map_features"].values():
        for name in ("polyline", "polygon"):
            if name in feature:
                feature[name] = np.asarray(feature[name], float) / 111_000
    with pytest.raises(
        FormatError, match=r"sd_one\.pkl: its lanes lie within .* degrees"
    ):
        open_scenario(pickled(tmp_path, found))


def test_a_part_of_the_map_is_no_cure_for_an_agent_of_no_size(tmp_path: Path):
    """The error told to open a part of the map, and the browser asked for one."""
    path = pickled(tmp_path, changed_track(length=np.full(91, 1e4)))
    with pytest.raises(FormatError, match="size outside") as caught:
        open_scenario(path)
    assert not isinstance(caught.value, LargeMapError)


def test_a_part_of_a_small_map_is_no_cure_for_an_agent_far_away(tmp_path: Path):
    """The browser asked for a square, and refused each one with the same card."""
    places = np.array(description()["tracks"]["7"]["state"]["position"], float)
    places[-1] += 1e5
    velocity = np.zeros((len(places), 2))
    track = changed_track(position=places, velocity=velocity)
    with pytest.raises(FormatError, match="km from the other ones") as caught:
        open_scenario(pickled(tmp_path, track))
    assert not isinstance(caught.value, LargeMapError)


@pytest.mark.parametrize("heading", ["east", "nan", "1e300"])
@pytest.mark.parametrize("of_offset", [True, False])
def test_headings_that_are_no_numbers_are_told(
    tmp_path: Path, heading: str, of_offset: bool
):
    """They ended in a traceback, or in crosswalks without a place."""
    walk = f'<objects><object id="1" type="crosswalk" s="9" t="0" hdg="{heading}" length="3" width="4"/></objects>'
    offset = f'<offset x="1" y="1" z="0" hdg="{heading}"/>'
    road_text = road(section(lane(-1)), more="" if of_offset else walk)
    header = f'<header revMajor="1" revMinor="7">{offset if of_offset else ""}</header>'
    path = tmp_path / "one.xodr"
    path.write_text(f"<OpenDRIVE>{header}\n{road_text}</OpenDRIVE>")
    with pytest.raises(
        FormatError, match=rf"line \d: .* number .*for hdg, not '{heading}'"
    ):
        open_scenario(path)


def test_a_truncated_pickle_is_unreadable_and_holds_nothing_forbidden(tmp_path: Path):
    path = pickled(tmp_path, description())
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(FormatError, match="is no readable pickle"):
        open_scenario(path)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        (
            "a.fcd.xml",
            "<fcd-export/>",
            "SUMO's floating-car data, .*town.fcd.xml beside",
        ),
        ("out.xml", "<fcd-export xmlns:x='y'>", "SUMO's floating-car data"),
        ("a.rou.xml", "<routes>", "SUMO's routes, .*town.rou.xml beside town.net.xml"),
        ("a.trips.xml", "<routes/>", "SUMO's routes"),
        ("a.trips.xml", "<trips>", "SUMO's routes"),
        ("a.nod.xml", "<nodes>", "netconvert -n A.nod.xml"),
        ("a.add.xml", "<additional>", "SUMO additional file"),
        ("a.sumocfg", "<configuration>", "SUMO configuration without its network"),
        ("dataset_summary.pkl", "x", "the summary of a ScenarioNet data set"),
        ("a.xosc", "<OpenSCENARIO>", "without a road network; expected a <LogicFile>"),
        ("a.osm.pbf", "x", "netconvert --osm-files"),
        ("a.osm", "<osm><node id='1'/></osm>", "netconvert --osm-files"),
        ("a.tfrecord", "x", "Waymo record"),
        ("a.cr.pb", "x", "commonroad-io writes XML"),
        ("tracks.csv", "x,y", "a table without roads"),
        (
            "a.xml",
            "<CommonRoadSolution/>",
            "a CommonRoad solution, .* open its scenario",
        ),
        ("a.xml", "<rooms/>", "no file of a known format"),
    ],
)
def test_files_that_need_others_say_what_they_are_and_how_to_open_them(
    tmp_path: Path, name: str, content: str, told: str
):
    """They were only files of no known format."""
    path = tmp_path / name
    path.write_text(f"<?xml version='1.0'?>\n<!-- written by sumo -->\n{content}")
    with pytest.raises(InputError, match=told) as found:
        open_scenario(path)
    assert "\n" not in str(found.value)


def test_an_upload_that_needs_other_files_says_so():
    with pytest.raises(InputError, match=r"a\.fcd\.xml: is SUMO's floating-car data"):
        scenario_and_recipe({"a.fcd.xml": b"<fcd-export/>"})
