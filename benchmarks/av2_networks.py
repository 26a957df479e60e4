"""Links of real maps that their SUMO networks keep, and ones they add.

Run as ``python -m benchmarks.av2_networks``, with PD_EDITOR_AV2 naming a folder
of Argoverse 2 scenarios.
"""

import os
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.experiments.synthesis.road_network.map_network import (
    Av2Network,
    network_of_map,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.formats.sumo_net import read_sumo_net


def main() -> None:
    """Print a row for each map, and totals."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = sorted(path.parent for path in root.glob("*/*/scenario_*.parquet"))
    total = np.zeros(3, int)
    seconds, refused = [], 0
    print("map                                            links  kept  extra   time")
    with tempfile.TemporaryDirectory() as work:
        for folder in folders:
            road_map = read_scenario(folder).road_map
            known = road_map.lane_of
            wanted = {
                (n.lane_id, s)
                for n in road_map.lanes
                for s in n.successors
                if s in known
            }
            start = time.perf_counter()
            label = f"{folder.parent.name}/{folder.name}"
            try:
                network = network_of_map(road_map, folder.name, Path(work, folder.name))
            except PdEditorError as error:
                refused += 1
                print(f"{label:46s} {len(wanted):5d}  refused: {error}")
                continue
            seconds.append(time.perf_counter() - start)
            links = links_of(network)
            row = (len(wanted), len(links & wanted), len(links - wanted))
            total += row
            print(
                f"{label:46s} {row[0]:5d} {row[1]:5d} {row[2]:6d} {seconds[-1]:5.2f}s"
            )
    spread = np.percentile(seconds, [50, 0, 100])
    print(
        f"{len(folders)} maps, {refused} refused: {total[0]} links, {total[1]} kept, "
    )
    print(
        f"{total[2]} extra; {spread[0]:.2f} s a map ({spread[1]:.2f}-{spread[2]:.2f})"
    )


def links_of(network: Av2Network) -> set[tuple[int, int]]:
    """Pairs of consecutive lanes of the map that the SUMO network connects."""
    lanes_of = {
        name: [part.lane_id for part in parts]
        for name, parts in network.lane_intervals.items()
    }
    found = {pair for lanes in lanes_of.values() for pair in pairwise(lanes)}
    for one, other in read_sumo_net(network.net_file).links:
        found.add((lanes_of[one][-1], lanes_of[other][0]))
    return {(one, other) for one, other in found if one != other}


if __name__ == "__main__":
    main()
