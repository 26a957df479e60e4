"""Top views of recorded scenes beside samples of the model, and a blind sorting of them.

Each row of the sheet is a scene: as recorded, then with the states and trajectories of all
its agents sampled. ``--blind`` also writes the recorded scene and one sample of each as
pictures in random order; ``key.json`` tells which is which. Pictures of Argoverse 2 maps
are derived from them and share their licence (CC BY-NC-SA 4.0): they are not published with
this project; ``--split demos`` takes the demos, whose picture is in ``docs/pictures``.
Needs PD_EDITOR_AV2 but for the demos, and Pillow (``.[dev]``).
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmarks.whole_scenes import generate
from pd_editor.base.installed_files import demo_folder, demo_names
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

HALF_SIDE_M = 70.0
AHEAD_STEPS = 30
"""Trajectories are drawn so far: later many recorded ones have ended."""
SHIFT_M = 20.0
"""Pictures to sort are shifted by up to this, both of a scene alike."""
FINER = 3
"""Drawn so many times larger, then reduced: smooth edges."""
GROUND, ROAD, LANE, CROSSING = "#f4f5f7", "#d5d9de", "#aab2bb", "#bcc4cc"
COLORS = {
    AgentKind.VEHICLE: "#2f6fd6",
    AgentKind.BUS: "#29348f",
    AgentKind.MOTORCYCLIST: "#8439c9",
    AgentKind.CYCLIST: "#0e7c3f",
    AgentKind.PEDESTRIAN: "#cf1f67",
}
PLACEMENT = "resampled"


def top_view(scenario: Scenario, center: np.ndarray, size_px: int) -> Image.Image:
    """Roads and road users at the current step, north up, and the way ahead of them."""
    size = size_px * FINER
    picture = Image.new("RGB", (size, size), GROUND)
    draw = ImageDraw.Draw(picture)
    scale = size / (2 * HALF_SIDE_M)

    def pixels(points_m: np.ndarray) -> list[tuple[float, float]]:
        offset = (points_m[..., :2] - center) * scale
        return [(size / 2 + x, size / 2 - y) for x, y in offset.tolist()]

    road = scenario.road_map
    for area in road.drivable_areas:
        draw.polygon(pixels(area.boundary), fill=ROAD)
    for crosswalk in road.crosswalks:
        ring = np.concatenate([crosswalk.edge1, crosswalk.edge2[::-1]])
        draw.polygon(pixels(ring), fill=CROSSING)
    for lane in road.lanes:
        for line in (lane.left_m, lane.right_m):
            draw.line(pixels(line), fill=LANE, width=FINER)
    agents, now = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS))
    corners = box_corners(
        agents.position_m[rows, now], agents.heading_rad[rows, now], agents.size_m[rows]
    )
    speed = agents.speed_mps()[rows, now]
    for row, box, mps in zip(rows.tolist(), corners, speed.tolist(), strict=True):
        color = COLORS[agents.kinds[row]]
        ahead = now + np.flatnonzero(agents.is_valid[row, now : now + AHEAD_STEPS])
        if len(ahead) > 1:
            draw.line(pixels(agents.position_m[row, ahead]), fill=color, width=FINER)
        edge = "#20262d" if mps < MOVING_MPS else color
        draw.polygon(pixels(box), fill=color, outline=edge, width=FINER)
        # A light windscreen tells the front.
        front, back = box[[0, 3]], box[[1, 2]]
        draw.polygon(
            pixels(
                np.array(
                    [
                        front[0] * 0.85 + back[0] * 0.15,
                        front[1] * 0.85 + back[1] * 0.15,
                        front[1] * 0.65 + back[1] * 0.35,
                        front[0] * 0.65 + back[0] * 0.35,
                    ]
                )
            ),
            fill="#ffffff",
        )
    return picture.resize((size_px, size_px), Image.Resampling.LANCZOS)


def titled(pictures: list[Image.Image], titles: list[str], columns: int) -> Image.Image:
    """Pictures in rows, each under its title."""
    side, gap, head = pictures[0].width, 8, 22
    rows = -(-len(pictures) // columns)
    sheet = Image.new(
        "RGB", (columns * (side + gap) + gap, rows * (side + head + gap) + gap), "white"
    )
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for index, (picture, title) in enumerate(zip(pictures, titles, strict=True)):
        x = gap + index % columns * (side + gap)
        y = gap + index // columns * (side + head + gap)
        draw.text((x, y), title, fill="#1f2933", font=font)
        sheet.paste(picture, (x, y + head))
    return sheet


def folders_of(split: str) -> list[Path]:
    """Scenario folders of a split, or of the demos."""
    if split == "demos":
        return [demo_folder(name) for name in demo_names()]
    root = Path(os.environ["PD_EDITOR_AV2"]) / split
    return sorted(path.parent for path in root.glob("*/scenario*.parquet"))


def main() -> None:
    """Sample, draw, and write the sheet; with ``--blind`` also the shuffled pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="path-diffuser")
    parser.add_argument("--split", default="val")
    parser.add_argument("--signals", action="store_true")
    parser.add_argument("--samples", type=int, default=3)
    parser.add_argument("--side", type=int, default=360, help="of a picture, pixels")
    parser.add_argument("--blind", type=int, metavar="SEED", help="shuffled pictures")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[list[Scenario]] = []
    for folder in folders_of(options.split):
        row = [read_scenario(folder)]
        for seed in range(options.samples):
            out = options.out / f"sample-{seed}"
            generate(
                folder, PLACEMENT, options.model, seed, out, signals=options.signals
            )
            row.append(read_scenario(out / folder.name))
        rows.append(row)
    centers = [scene_center(row[0]) for row in rows]
    if options.blind is not None:
        write_blind(rows, centers, options.blind, options.out / "blind")
    origin = "simulated" if options.split == "demos" else "recorded"
    pictures, titles = [], []
    for row, center in zip(rows, centers, strict=True):
        for index, scenario in enumerate(row):
            # Samples have an origin of their own.
            offset = row[0].origin_city_m - scenario.origin_city_m
            pictures.append(top_view(scenario, center + offset, options.side))
            name = row[0].scenario_id[:20]
            titles.append(f"sample {index}" if index else f"{name}, {origin}")
    titled(pictures, titles, 1 + options.samples).save(
        options.out / "contact_sheet.webp", quality=70, method=6
    )


def write_blind(
    rows: list[list[Scenario]], centers: list[np.ndarray], seed: int, out: Path
) -> None:
    """Two pictures a sheet, in random order; which is which is in ``key.json``."""
    out.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(seed)
    # Around its centre, the focal agent, only the recording has an agent exactly there.
    centers = [
        center + random.uniform(-SHIFT_M, SHIFT_M, center.shape) for center in centers
    ]
    entries = [(scene, index) for scene in range(len(rows)) for index in (0, 1)]
    order = random.permutation(len(entries))
    pictures = []
    for place in order.tolist():
        scene, index = entries[place]
        scenario = rows[scene][index]
        offset = rows[scene][0].origin_city_m - scenario.origin_city_m
        pictures.append(top_view(scenario, centers[scene] + offset, 740))
    names = [f"{number + 1:02d}" for number in range(len(pictures))]
    for first in range(0, len(pictures), 2):
        pair = slice(first, first + 2)
        titled(pictures[pair], names[pair], 2).save(out / f"{names[first]}.png")
    key = {
        name: {
            "scene": rows[entries[place][0]][0].scenario_id,
            "is_recorded": entries[place][1] == 0,
        }
        for name, place in zip(names, order.tolist(), strict=True)
    }
    (out / "key.json").write_text(json.dumps(key, indent=1))


if __name__ == "__main__":
    main()
