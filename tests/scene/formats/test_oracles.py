"""Written scenes as the formats' own loaders read them."""

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats.registry import writer
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import EGO_ID, Scenario
from tests.oracles.environment import Oracle
from tests.scene.formats.agreement import agreement

pytestmark = [pytest.mark.slow, pytest.mark.oracle]
CENTER_M = 0.05

ANCHOR = RigidMotion(x_m=-20.0, y_m=0.0, rotation_rad=0.4)
BEND = WarpTerm(kind="double-turn", power=4.0, length_m=50.0)


def scenes(folders: list[Path]) -> Iterator[Scenario]:
    """Demos and real scenes, plain and warped."""
    for name in ("roundabout", "crosswalk"):
        yield open_scenario(name)
    for folder in folders:
        scenario = open_scenario(folder)
        yield scenario
        yield warp_scenario(scenario, RoadWarp(anchor=ANCHOR, terms=(BEND,)))


def written(scenario: Scenario, name: str, folder: Path) -> dict[str, bytes]:
    """Files of a scene in a folder of its own."""
    write = writer(name).write
    assert write is not None
    folder.mkdir(exist_ok=True)
    files = dict(write(scenario).files)
    for file, data in files.items():
        (folder / file).write_bytes(data)
    return files


def check_commonroad(told: list[Scenario], folder: Path, asked: Oracle) -> None:
    """What commonroad-io reads is in the scenes."""
    paths, ids = [], []
    for number, scenario in enumerate(told):
        files = written(scenario, "commonroad", folder / f"commonroad-{number}")
        (path,) = (folder / f"commonroad-{number}").glob("*.xml")
        table = csv.DictReader(io.StringIO(files["ids.csv"].decode()))
        ids.append({row["obstacle"]: row["agent"] for row in table})
        paths.append(str(path))
    answers = asked.ask("commonroad_scenario.py", paths)
    for scenario, read, agent_of in zip(told, answers, ids, strict=True):
        lane_of = {str(one): one for one in scenario.road_map.lane_of}
        found = agreement(scenario, read, agent_of, lane_of)
        assert found.lanes_agree
        assert found.position_m < 1e-3
        assert found.heading_deg < 0.1
        assert found.speed_mps < 0.05
        assert found.size_m < 1e-3
        assert found.aside_m < CENTER_M
        assert len(read["problems"]) == 1


def check_metadrive(told: list[Scenario], folder: Path, asked: Oracle) -> None:
    """The ego that MetaDrive replays is that of the scenes."""
    folders = [folder / f"scenarionet-{number}" for number in range(len(told))]
    for scenario, own in zip(told, folders, strict=True):
        written(scenario, "scenarionet", own)
    answers = asked.ask("metadrive_replay.py", [str(one) for one in folders])
    for scenario, read in zip(told, answers, strict=True):
        assert read["arrives"]
        agents = scenario.agents
        row = agents.row_of[EGO_ID if EGO_ID in agents.row_of else scenario.focal_id]
        # MetaDrive counts from the ego's first place, in single precision.
        first = int(agents.is_valid[row].argmax())
        place = agents.position_m[row, first:] - agents.position_m[row, first]
        ego = np.array(read["ego_m"])
        # MetaDrive counts the way along its own route, and ends a replay before its end.
        way_m = np.linalg.norm(np.diff(place, axis=0), axis=1).sum()
        assert np.hypot(*(ego[-1] - place[-1])) < 5.0 + 0.5 * way_m
        np.testing.assert_allclose(ego, place[1 : len(ego) + 1], atol=1e-3)


@pytest.mark.real_data
def test_commonroad_io_reads_what_is_in_the_scene(
    av2_scenario_folders: list[Path], oracle: Callable[[str], Oracle], tmp_path: Path
):
    told = list(scenes(av2_scenario_folders[::20]))
    check_commonroad(told, tmp_path, oracle("commonroad"))


@pytest.mark.real_data
def test_metadrive_replays_what_is_in_the_scene(
    av2_scenario_folders: list[Path], oracle: Callable[[str], Oracle], tmp_path: Path
):
    told = list(scenes(av2_scenario_folders[::40]))
    check_metadrive(told, tmp_path, oracle("metadrive"))


@pytest.mark.real_data
def test_commonroad_io_reads_the_same_in_real_files(
    format_files: Path, oracle: Callable[[str], Oracle]
):
    paths = sorted((format_files / "commonroad").glob("*.xml"))
    answers = oracle("commonroad").ask(
        "commonroad_scenario.py", [str(one) for one in paths]
    )
    num_compared = 0
    for path, read in zip(paths, answers, strict=True):
        scene = open_scenario(path)
        lane_of = {str(one): one for one in scene.road_map.lane_of}
        assert read["lanes"].keys() == lane_of.keys(), path.name
        if not read["tracks"]:
            continue
        # Ours begin before the file's first state, where it has little of a past.
        first = round(-scene.time_axis.start_timestamp_ns / 1e8)
        tracks = {
            name: track | {"states": [[s[0] + first, *s[1:]] for s in track["states"]]}
            for name, track in read["tracks"].items()
        }
        agent_of = {name: name for name in tracks}
        found = agreement(scene, read | {"tracks": tracks}, agent_of, lane_of)
        assert found.lanes_agree, path.name
        assert found.center_m < 0.05, path.name
        assert found.position_m < 1e-3, path.name
        assert found.heading_deg < 0.1, path.name
        assert found.speed_mps < 0.05, path.name
        assert found.size_m < 1e-3, path.name
        num_compared += found.num_states
    assert num_compared > 10_000
