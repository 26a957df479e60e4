"""ScenarioNet pickles and GPUDrive JSON as scenes."""

import collections
import json
import os
import pickle
import re
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats import gpudrive, scenarionet
from pd_editor.scene.formats.registry import format_of
from pd_editor.scene.scenario import Scenario

STEPS = 91


def driver(y: float, kind: str = "VEHICLE") -> dict[str, Any]:
    x = 10.0 + np.arange(STEPS)
    valid = np.ones(STEPS, bool)
    valid[:5] = False
    return {
        "type": kind,
        "metadata": {"type": "vehicle.bus.rigid" if y > 3 else ""},
        "state": {
            "position": np.stack([x, np.full(STEPS, y), np.zeros(STEPS)], axis=-1),
            "heading": np.zeros(STEPS),
            "velocity": np.tile([10.0, 0.0], (STEPS, 1)),
            "valid": valid,
            "length": np.full((STEPS, 1), 4.8),
            "width": np.full((STEPS, 1), 2.0),
        },
    }


def description(**more: Any) -> dict[str, Any]:
    line = np.stack([np.arange(0.0, 101.0), np.zeros(101), np.zeros(101)], axis=-1)
    found: dict[str, Any] = {
        "id": "one",
        "version": "1",
        "length": STEPS,
        "metadata": {
            "ts": 0.1 * np.arange(STEPS),
            "sdc_id": "7",
            "dataset": "waymo",
            "current_time_index": 10,
            "tracks_to_predict": {"9": {}},
        },
        "tracks": {
            "7": driver(0.0),
            "9": driver(4.0),
            "11": driver(-6.0, "PEDESTRIAN"),
        },
        "dynamic_map_states": {},
        "map_features": {
            "1": {
                "type": "LANE_SURFACE_STREET",
                "polyline": line,
                "width": np.full((101, 2), 1.8),
                "exit_lanes": ["2"],
                "left_neighbor": [{"feature_id": "3"}],
            },
            "2": {
                "type": "LANE_SURFACE_STREET",
                "polyline": line + np.array([100.0, 0, 0]),
                "exit_lanes": [],
            },
            "3": {
                "type": "LANE_BIKE_LANE",
                "polyline": line + np.array([0, 4.0, 0]),
                "exit_lanes": [],
            },
            "4": {
                "type": "CROSSWALK",
                "polygon": np.array([[40, -4], [44, -4], [44, 6], [40, 6]], float),
            },
        },
    }
    return found | more


def check(scene: Scenario) -> None:
    agents, now = scene.agents, scene.current_step
    assert sorted(agents.ids) == ["11", "9", "AV"]
    ego, other, walker = agents.rows(("AV", "9", "11"))
    assert agents.size_m[ego].tolist() == [4.8, 2.0]
    assert agents.kinds[walker] == AgentKind.PEDESTRIAN
    assert agents.is_valid[ego].sum() == STEPS - 5
    place = agents.position_m[ego, now] + scene.origin_city_m
    np.testing.assert_allclose(place, [20.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(agents.velocity_mps[other, now], [10.0, 0.0])
    assert scene.focal_id == "9"
    first, second = scene.road_map.lanes[:2]
    assert first.successors == (second.lane_id,)
    assert second.predecessors == (first.lane_id,)
    assert len(scene.road_map.crosswalks) == 1


def test_cars_are_longer_than_wide(tmp_path: Path):
    """ScenarioNet's ego of nuScenes lay across its lane, 4.08 m wide."""
    found = description()
    state = found["tracks"]["7"]["state"]
    state["length"], state["width"] = state["width"], state["length"]
    path = tmp_path / "one.pkl"
    path.write_bytes(pickle.dumps(found))
    agents = open_scenario(path).agents
    assert agents.size_m[agents.row_of["AV"]].tolist() == [4.8, 2.0]


def test_a_scenario_description_opens_with_sizes_lanes_and_ego(tmp_path: Path):
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(description()))
    assert format_of(path) is scenarionet.SCENARIONET
    scene = open_scenario(path)
    check(scene)
    assert scene.agents.kinds[scene.agents.row_of["9"]] == AgentKind.BUS
    lane, _, bike = scene.road_map.lanes
    assert lane.left_neighbor == bike.lane_id
    left = lane.left_m + scene.origin_city_m
    np.testing.assert_allclose(left[:, 1], 1.8, atol=1e-6)


def test_whole_recordings_have_the_current_step_where_argoverse_2_has_it(
    tmp_path: Path,
):
    found = description()
    found["metadata"]["current_time_index"] = 0
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    scene = open_scenario(path)
    place = scene.agents.position_m[scene.agents.row_of["AV"], scene.current_step]
    np.testing.assert_allclose(place + scene.origin_city_m, [10 + 45, 0], atol=1e-6)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4"])
def test_pickles_of_all_protocols_and_byte_orders(
    tmp_path: Path, protocol: int, kind: str
):
    found = description(large=2**40)
    for one in found["tracks"].values():
        own = one["state"]
        for name in ("position", "heading", "velocity"):
            own[name] = np.asfortranarray(own[name].astype(kind))
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found, protocol))
    check(open_scenario(path))


def test_descriptions_of_metadrive_are_dictionaries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """They are pickled as instances of its class, which is not looked for."""
    name = "metadrive.scenario.scenario_description"
    kind = type("ScenarioDescription", (dict,), {"__module__": name})
    path = tmp_path / "sd_one.pkl"
    with monkeypatch.context() as patch:
        for part in ("metadrive", "metadrive.scenario", name):
            module = types.ModuleType(part)
            patch.setitem(sys.modules, part, module)
        patch.setattr(sys.modules[name], kind.__name__, kind, raising=False)
        path.write_bytes(pickle.dumps(kind(description())))
    check(open_scenario(path))


def test_lanes_lead_to_their_own_of_all_that_metadrive_names(tmp_path: Path):
    """They began lanes aside, and their neighbours were two lanes away."""
    found = description()
    kind, line = "LANE_SURFACE_STREET", found["map_features"]["1"]["polyline"]
    names = [[f"('a', '{part}', {row})" for row in range(3)] for part in "bc"]
    found["map_features"] = {
        names[part][row]: {
            "type": kind,
            "polyline": line + np.array([100.0 * part, -3.5 * row, 0.0]),
            "exit_lanes": [] if part else names[1],
            "left_neighbor": names[part][:row],
            "right_neighbor": names[part][row + 1 :],
        }
        for part in (0, 1)
        for row in range(3)
    }
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    lanes = open_scenario(path).road_map.lanes
    assert [one.successors for one in lanes] == [(4,), (5,), (6,), (), (), ()]
    beside = [(one.left_neighbor, one.right_neighbor) for one in lanes[:3]]
    assert beside == [(None, 2), (1, 3), (2, None)]


def test_what_a_description_may_leave_out(tmp_path: Path):
    found = description()
    del found["metadata"]["ts"]
    for one in found["tracks"].values():
        del one["state"]["velocity"]
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    check(open_scenario(path))


def test_there_are_states_between_those_of_slow_recordings(tmp_path: Path):
    found = description()
    found["metadata"]["ts"] = 0.5 * np.arange(STEPS)
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    agents = open_scenario(path).agents
    assert agents.is_valid[agents.row_of["AV"]].sum() == 5 * (STEPS - 6) + 1


class Caller:
    """Would make a folder if its pickle were loaded as usual."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self._folder),)


@pytest.mark.parametrize("deep", [False, True])
def test_a_pickle_that_wants_to_call_something_is_refused_and_calls_nothing(
    tmp_path: Path, deep: bool
):
    made, path = tmp_path / "made", tmp_path / "sd_bad.pkl"
    value: Any = Caller(made)
    path.write_bytes(pickle.dumps(description(more=[value]) if deep else value))
    with pytest.raises(FormatError, match=r"holds posix\.mkdir; expected arrays"):
        open_scenario(path)
    assert not made.exists()


def with_state(**more: Any) -> dict[str, Any]:
    found = description()
    found["tracks"]["7"]["state"] |= more
    return found


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ([1, 2], "is no scenario description"),
        (description(dynamic_map_states=[1]), "expected dicts: dynamic_map_states."),
        (description(metadata={"ts": 5.0}), "'7' has 91 positions; expected 1, one"),
        (
            description(metadata={"tracks_to_predict": 5}),
            "metadata 'tracks_to_predict'",
        ),
        (
            description(metadata={"current_time_index": "x"}),
            "'current_time_index' holds",
        ),
        (
            {"metadata": {}, "tracks": {}, "map_features": {}},
            "its metadata 'ts' has no 'length'.",
        ),
        (collections.Counter("aab"), "holds collections.Counter"),
        (description(map_features={}), "has no lane for vehicles"),
        (
            description(tracks={"7": {"type": "VEHICLE", "state": {}}}),
            "sd_bad.pkl: its track '7' has no 'position'.",
        ),
        (
            description(
                map_features={"9": {"type": "LANE_X", "polyline": [[1, 2], 3]}}
            ),
            "its map feature '9' has no points for 'polyline'; expected two numbers of each.",
        ),
        (
            description(map_features={"9": {"polyline": [[1, 2]]}}),
            "its map feature '9' has no 'type'.",
        ),
        (
            description(map_features={"b1": 1e300}),
            "its map feature 'b1' is a float; expected a dict.",
        ),
        (
            description(tracks={"7": [1]}),
            "its track '7' is a list; expected a dict.",
        ),
        (
            with_state(heading=np.zeros(9)),
            "its track '7' has 'heading' of shape [9]; expected 91 numbers.",
        ),
        (
            with_state(velocity=[["a", "b"]] * STEPS),
            "its track '7' has no numbers for 'velocity'; expected 91 rows of 2 numbers.",
        ),
    ],
)
def test_pickles_of_something_else_are_refused(tmp_path: Path, value: Any, told: str):
    path = tmp_path / "sd_bad.pkl"
    path.write_bytes(pickle.dumps(value))
    with pytest.raises(FormatError) as caught:
        open_scenario(path)
    assert told in str(caught.value)


def test_a_damaged_pickle_is_refused(tmp_path: Path):
    path, data = tmp_path / "sd_bad.pkl", pickle.dumps(description())
    for cut in (0, 1, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:cut])
        with pytest.raises(FormatError):
            open_scenario(path)


def as_gpudrive() -> dict[str, Any]:
    def points(table: np.ndarray) -> list[dict[str, float]]:
        return [{"x": float(one[0]), "y": float(one[1]), "z": 0.0} for one in table]

    found = description()
    kinds = {"VEHICLE": "vehicle", "PEDESTRIAN": "pedestrian"}
    return {
        "name": "one.json",
        "scenario_id": "one",
        "objects": [
            {
                "id": int(name),
                "type": kinds[track["type"]],
                "length": 4.8,
                "width": 2.0,
                "position": points(track["state"]["position"]),
                "velocity": points(track["state"]["velocity"]),
                "heading": track["state"]["heading"].tolist(),
                "valid": track["state"]["valid"].tolist(),
            }
            for name, track in found["tracks"].items()
        ],
        "roads": [
            {
                "type": "crosswalk" if "polygon" in one else "lane",
                "geometry": points(one.get("polyline", one.get("polygon"))),
            }
            for one in found["map_features"].values()
        ],
        "tl_states": {},
        "metadata": {"sdc_track_index": 0, "tracks_to_predict": [{"track_index": 1}]},
    }


def test_a_gpudrive_scene_opens_with_lanes_that_lead_on_where_they_end(tmp_path: Path):
    path = tmp_path / "one.json"
    path.write_text(json.dumps(as_gpudrive()))
    assert format_of(path) is gpudrive.GPUDRIVE
    check(open_scenario(path))


@pytest.mark.parametrize(
    ("part", "row", "lost"), [("objects", 1, "valid"), ("roads", 0, "geometry")]
)
def test_faults_in_gpudrive_scenes_are_told_by_item(
    part: str, row: int, lost: str, tmp_path: Path
):
    """Neither the track nor the road was named."""
    found, path = as_gpudrive(), tmp_path / "one.json"
    del found[part][row][lost]
    path.write_text(json.dumps(found))
    named = f"missing required field `{lost}` - at `$.{part}[{row}]`."
    with pytest.raises(FormatError, match=re.escape(named)):
        open_scenario(path)


def test_headings_in_degrees_are_known_by_their_size(tmp_path: Path):
    """As in Nocturne's files and GPUDrive's first ones, with 1e-4 for what is unknown."""
    found = as_gpudrive()
    for one in found["objects"]:
        one["heading"] = [-100.0 if there else 1e-4 for there in one["valid"]]
    path = tmp_path / "one.json"
    path.write_text(json.dumps(found))
    agents = open_scenario(path).agents
    headings = agents.heading_rad[agents.is_valid]
    np.testing.assert_allclose(headings, np.deg2rad(-100.0))


def test_a_gpudrive_scene_may_hold_nan_where_nothing_is_valid(tmp_path: Path):
    found = as_gpudrive()
    found["metadata"]["sdc_track_index"] = 0
    for one in found["objects"]:
        one["position"][0] = {"x": float("nan"), "y": float("nan")}
        one["heading"][0] = float("nan")
        one["width"] = [one["width"]] * STEPS
    path = tmp_path / "one.json"
    path.write_text(json.dumps(found))
    check(open_scenario(path))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"objects": 3}, "Expected `array`, got `int` - at `$.objects`."),
        ({"objects": [None]}, "got `null` - at `$.objects[0]`."),
        ({"objects": [{"position": 3}]}, "got `int` - at `$.objects[0].position`."),
        ({"roads": {"a": 1}}, "got `object` - at `$.roads`."),
        ({"metadata": [float("nan")]}, "got `array` - at `$.metadata`."),
        ({"metadata": {"tracks_to_predict": [{}]}}, "`track_index` - at `$.metadata."),
        ({"tl_states": {"7": 1}}, "got `int` - at `$.tl_states"),
        ({"roads": []}, "has no lane for vehicles"),
        ({"roads": [{"type": "lane"}]}, "`geometry` - at `$.roads[0]`."),
    ],
)
def test_bad_gpudrive_scenes_are_refused(tmp_path: Path, change: dict, told: str):
    path = tmp_path / "one.json"
    path.write_text(json.dumps(as_gpudrive() | change))
    with pytest.raises(FormatError) as caught:
        open_scenario(path)
    assert told in str(caught.value)


def test_values_that_do_not_fit_are_told_by_field(tmp_path: Path):
    """Python's own texts on shapes were told."""
    found, path = as_gpudrive(), tmp_path / "one.json"
    found["objects"][1]["valid"].pop()
    path.write_text(json.dumps(found))
    told = (
        "its object '9' has 90 values of 'valid'; expected 91, one for each position."
    )
    with pytest.raises(FormatError, match=told):
        open_scenario(path)
    path.write_text(json.dumps(found)[:-9])
    with pytest.raises(FormatError, match=r"one\.json: is no valid JSON"):
        open_scenario(path)


def test_one_number_is_that_of_all_steps(tmp_path: Path):
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(with_state(length=4.8, width=[2.0], heading=None)))
    check(open_scenario(path))


@pytest.mark.real_data
def test_real_recordings_open(format_files: Path):
    paths = [
        *(format_files / "scenarionet").glob("*.pkl"),
        *(format_files / "gpudrive").glob("*.json"),
    ]
    known = [path for path in paths if format_of(path) is not None]
    assert len(known) >= 4
    for path in known:
        scene = open_scenario(path)
        row, now = scene.agents.row_of["AV"], scene.current_step
        assert scene.agents.is_valid[row, now]
        # Velocities are those of the positions.
        agents = scene.agents
        there = agents.is_valid[:, now] & agents.is_valid[:, now + 5]
        way = agents.position_m[there, now + 5] - agents.position_m[there, now]
        mean = agents.velocity_mps[there, now : now + 6].mean(axis=1)
        gap = np.linalg.norm(way / 0.5 - mean, axis=-1)
        assert np.median(gap) < 0.3, path
        assert any(one.successors for one in scene.road_map.lanes)


@pytest.mark.parametrize("name", ["sd_one.pkl", "one.json"])
def test_headings_and_velocities_are_those_of_the_motion_where_none_are_told(
    tmp_path: Path, name: str
):
    """The file was refused: KeyError."""
    path, found = tmp_path / name, description()
    if name == "one.json":
        other = as_gpudrive()
        for one in other["objects"]:
            del one["velocity"], one["heading"]
        path.write_text(json.dumps(other))
    else:
        for one in found["tracks"].values():
            del one["state"]["heading"], one["state"]["velocity"]
        path.write_bytes(pickle.dumps(found))
    scene = open_scenario(path)
    check(scene)
    agents = scene.agents
    np.testing.assert_allclose(agents.heading_rad[agents.is_valid], 0.0, atol=1e-6)
    assert any("Headings" in one for one in scene.provenance.notes)


def test_crosswalks_without_a_place_are_left_out(tmp_path: Path):
    found = description()
    found["map_features"]["4"]["polygon"] = np.full((4, 2), np.nan)
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    assert open_scenario(path).road_map.crosswalks == ()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_several_neighbours_on_a_side_the_longest_is_kept(
    tmp_path: Path, order: tuple[int, int]
):
    """It was the first one, however short."""
    found = description()
    beside = [
        {"feature_id": "2", "self_start_index": "0", "self_end_index": "10"},
        {"feature_id": "3", "self_start_index": "7", "self_end_index": "90"},
    ]
    found["map_features"]["1"]["left_neighbor"] = [beside[n] for n in order]
    path = tmp_path / "sd_one.pkl"
    path.write_bytes(pickle.dumps(found))
    scene = open_scenario(path)
    assert scene.road_map.lane_of[1].left_neighbor == 3
    told = "Lanes have several neighbours on 1 sides, of which the longest is kept."
    assert told in scene.provenance.notes


def changed_gpudrive(what: str) -> dict[str, Any]:
    found = as_gpudrive()
    for one in found["objects"]:
        if what == "points as lists":
            one["position"] = [[p["x"], p["y"], p["z"]] for p in one["position"]]
        elif what == "no sizes":
            del one["length"], one["width"]
        elif what == "unknown velocities":
            one["velocity"] = [{"x": float("nan"), "y": None}] * len(one["velocity"])
        else:
            one["type"] = one["type"].upper()
    for one in found["roads"]:
        if what == "points as lists":
            one["geometry"] = [[p["x"], p["y"]] for p in one["geometry"]]
        elif what == "capital letters":
            one["type"] = one["type"].upper()
    sign = {"type": "stop_sign", "geometry": {"x": 1.0, "y": 2.0}}
    found["roads"] += [sign, {"type": "speed_bump", "geometry": None}]
    return found


@pytest.mark.parametrize(
    "what", ["points as lists", "no sizes", "unknown velocities", "capital letters"]
)
def test_gpudrive_scenes_of_other_writers_open(tmp_path: Path, what: str):
    """Unknown velocities were places that are no numbers, the rest was refused."""
    path = tmp_path / "one.json"
    path.write_text(json.dumps(as_gpudrive()))
    usual = open_scenario(path)
    path.write_text(json.dumps(changed_gpudrive(what)))
    scene = open_scenario(path)
    assert len(scene.road_map.lanes) == len(usual.road_map.lanes)
    assert scene.agents.kinds == usual.agents.kinds
    there = usual.agents.is_valid[..., None]
    gap = (scene.agents.position_m - usual.agents.position_m) * there
    assert np.abs(gap).max() < 1e-6
    assert scene.agents.has_known_size.any() == (what != "no sizes")


@pytest.mark.parametrize(
    "asked", [{"9": {}}, ["9"], [{"track_index": 1, "track_id": "9"}]]
)
def test_tracks_to_predict_are_told_in_several_ways(tmp_path: Path, asked: object):
    """Of a list of dicts the ego was the focal agent."""
    found = description()
    found["metadata"]["tracks_to_predict"] = asked
    path = tmp_path / "one.pkl"
    path.write_bytes(pickle.dumps(found))
    assert open_scenario(path).focal_id == "9"
