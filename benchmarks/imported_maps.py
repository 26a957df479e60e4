"""As many agents as fit, with their trajectories, on imported maps of each road format.

Files beside PD_EDITOR_AV2 (``formats`` and ``sumo_cities``): up to ten maps of a format, and
where there are fewer the densest squares of 150 m. Agents of files are left out. The maps
of ``train``, asked for the same, and their mirror images, in which traffic drives on the
left, tell what is due to the format. Raw comes first: no guidance, nothing sampled again,
no yielding. ``--out`` gets a picture of all of them, in the order of the table.
``--demos`` takes the demos instead, written in each format: their picture is free of
others' licences.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.contact_sheet import top_view
from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.lanes import ids_near_lanes
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.editor.commands import traffic_command
from pd_editor.editor.scenario_store import lanes_of_file, open_part, open_scenario
from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.formats.registry import read_scene, writer
from pd_editor.scene.generation import (
    AVOIDANCE,
    LANE_GUIDANCE,
    GenerationRequest,
    GuidanceSetting,
    run_to_end,
)
from pd_editor.scene.road_map import Lane, RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import densest_windows

MOST_MAPS = 10
DEMOS = ("signalised-junction", "roundabout", "merge", "winding-street", "crosswalk")
WRITTEN = ("opendrive", "commonroad", "sumo", "scenarionet")
PICTURE_PX = 320
FILES = {
    "opendrive": ("formats/opendrive/*.xodr",),
    "commonroad": ("formats/commonroad/*.xml",),
    "lanelet2": ("formats/lanelet2/*.osm",),
    "sumo": ("formats/sumo_net/*.net.xml", "sumo_cities/*/*.net.xml*"),
}


def roads(root: Path, patterns: tuple[str, ...]) -> Iterator[tuple[str, Scenario]]:
    """Names and bare maps; of few files, several squares each."""
    paths = sorted(one for pattern in patterns for one in root.glob(pattern))
    each = -(-MOST_MAPS // len(paths))
    number = 0
    for path in paths:
        lanes = lanes_of_file(lambda path=path: read_scene(path))
        windows = [None]
        if each > 1 or len(lanes) > 2000:
            windows = list(densest_windows(lanes, each))
        for window in windows:
            if number < MOST_MAPS:
                scenario = open_part(path, SceneCut(window=window, until_s=6.0))
                yield path.name[:24], scenario.without_agents(scenario.agents.ids)
                number += 1


def recorded_maps(folder: Path, *, is_mirrored: bool) -> Iterator[tuple[str, Scenario]]:
    """Names and bare maps of recorded scenes, or their mirror images."""
    for path in sorted(folder.iterdir()):
        scenario = open_scenario(path)
        bare = scenario.without_agents(scenario.agents.ids)
        if is_mirrored:
            bare = replace(bare, road_map=mirrored(bare.road_map))
        yield path.name[:8], bare


def mirrored(road_map: RoadMap) -> RoadMap:
    """The mirror image of a map: traffic that drove on the right drives on the left."""

    def swapped(lane: Lane) -> Lane:
        return replace(
            lane,
            left=lane.right,
            right=lane.left,
            left_mark=lane.right_mark,
            right_mark=lane.left_mark,
            left_neighbor=lane.right_neighbor,
            right_neighbor=lane.left_neighbor,
        )

    moved = road_map.moved(lambda points: points * (1.0, -1.0))
    return replace(moved, lanes=tuple(map(swapped, moved.lanes)))


def demos(name: str, folder: Path) -> Iterator[tuple[str, Scenario]]:
    """Names and bare maps of some demos, written in a format and read again."""
    for demo in DEMOS:
        target = folder / name / demo
        target.mkdir(parents=True, exist_ok=True)
        write = writer(name).write
        assert write is not None
        for file, data in write(open_scenario(demo)).files.items():
            (target / file).write_bytes(data)
        scenario = open_scenario(target, until_s=6.0)
        yield demo, scenario.without_agents(scenario.agents.ids)


def filled(
    generator: PathDiffuser, bare: Scenario, *, is_raw: bool, seed: int = 0
) -> Scenario:
    """The map with as many agents as fit."""
    off = tuple(
        GuidanceSetting(name=name, weight=0.0) for name in (LANE_GUIDANCE, AVOIDANCE)
    )
    request = GenerationRequest(
        scenario=bare,
        agent_ids=(),
        samples_num_agents=True,
        refines_states=not is_raw,
        guidance=off if is_raw else (),
        seed=seed,
    )
    traffic = run_to_end(generator.generate(request))
    return traffic_command(request, traffic).apply(bare)


def counts(scenario: Scenario) -> np.ndarray:
    """Agents, vehicles near lanes, those off the drivable area, agents that newly collide."""
    view = recorded_traffic(scenario)
    agents = view.agents
    near = np.isin(agents.ids, ids_near_lanes(scenario, agents.ids))
    vehicles = near & agents.kind_mask({AgentKind.VEHICLE})
    off = is_off_road(scenario, agents.position_m[vehicles, 0])
    collides = box_overlap(view).newly()
    hit = collides.is_valid & (collides.value > 0)
    return np.array([len(agents), vehicles.sum(), off.sum(), hit.sum()])


def row(name: str, found: np.ndarray) -> str:
    """A line of the table."""
    agents, vehicles, off, colliding = found
    shares = 100 * off / max(vehicles, 1), 100 * colliding / max(agents, 1)
    return f"{name:38}{agents:8}{shares[0]:16.1f}{shares[1]:18.1f}"


def main() -> None:
    """Print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Path, default=Path("models/path-diffuser"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--demos", type=Path, help="folder for files of demos")
    parser.add_argument("--seeds", type=int, default=3, help="of raw samples")
    parser.add_argument("--only", nargs="*", help="rows; default: all")
    options = parser.parse_args()
    av2 = Path(os.environ["PD_EDITOR_AV2"])
    print(f"{'':38}{'agents':>8}{'off road, %':>16}{'new collisions, %':>18}")
    recorded = [counts(open_scenario(one)) for one in sorted((av2 / "val").glob("*/"))]
    print(row("recorded (val)", np.sum(recorded, axis=0)))
    generator = PathDiffuser(options.model)
    lines: list[list[Image.Image]] = []
    sources = (
        {name: demos(name, options.demos) for name in WRITTEN}
        if options.demos
        else {
            "train": recorded_maps(av2 / "train", is_mirrored=False),
            "left-hand": recorded_maps(av2 / "train", is_mirrored=True),
            **{name: roads(av2.parent, patterns) for name, patterns in FILES.items()},
        }
    )
    for name, maps in sources.items():
        if options.only and name not in options.only:
            continue
        total = np.zeros((2, 4), int)
        pictures: list[Image.Image] = []
        for path, bare in maps:
            usual = filled(generator, bare, is_raw=False)
            raw = (
                filled(generator, bare, is_raw=True, seed=seed)
                for seed in range(options.seeds)
            )
            total += [sum(map(counts, raw), np.zeros(4, int)), counts(usual)]
            middle = np.median(usual.agents.position_m[:, usual.current_step], axis=0)
            pictures.append(top_view(usual, middle, PICTURE_PX))
            print(row(f"  {name}: {path}", counts(usual)), flush=True)
        print(row(f"{name}, raw", total[0]))
        print(row(f"{name}, default", total[1]), flush=True)
        lines.append(pictures)
    size = (max(map(len, lines)) * PICTURE_PX, len(lines) * PICTURE_PX)
    sheet = Image.new("RGB", size, "white")
    for y, pictures in enumerate(lines):
        for x, picture in enumerate(pictures):
            sheet.paste(picture, (x * PICTURE_PX, y * PICTURE_PX))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(options.out)


if __name__ == "__main__":
    main()
