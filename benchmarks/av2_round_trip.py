"""All real scenarios: read, written and compared; how equal, and how long it takes.

Run as ``python -m benchmarks.av2_round_trip``; needs PD_EDITOR_AV2.
"""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import check_with_official_loaders, scenario_files
from pd_editor.scene.formats.dataset import DatasetIndex
from tests.scene.av2_io.round_trip import compare, copy_scenario

REPEATS = 3

_Result = TypeVar("_Result")


def timed(work: Callable[[], _Result]) -> tuple[float, _Result]:
    """Smallest of a few times in milliseconds, and the result."""
    found = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = work()
        found.append((time.perf_counter() - start, result))
    return min(took for took, _ in found) * 1e3, found[-1][1]


def spread(values: list[float]) -> str:
    """Median, minimum and 95th percentile."""
    median, low, high = np.percentile(values, [50, 0, 95])
    return f"median {median:.1f}   min {low:.1f}   95 % {high:.1f}"


def main() -> None:
    """Print the table."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    folders = [card.folder for card in DatasetIndex(root).filter()]
    read_ms, write_ms, results = [], [], []
    num_accepted = 0
    with tempfile.TemporaryDirectory() as out:
        for folder in folders:
            elapsed, scenario = timed(lambda folder=folder: read_scenario(folder))
            read_ms.append(elapsed)
            elapsed, _ = timed(lambda scenario=scenario: scenario_files(scenario))
            write_ms.append(elapsed)
            copy = copy_scenario(folder, Path(out))
            results.append(compare(folder, copy))
            check_with_official_loaders(copy)
            num_accepted += 1
    same_tracks = sum(not result.differing_columns for result in results)
    same_maps = sum(not result.differing_map_fields for result in results)
    position_error = max(result.position_error_m for result in results)
    map_error = max(result.map_error_m for result in results)
    print(f"scenarios                        {len(folders)}")
    print(
        f"track rows / lanes               {sum(r.num_rows for r in results)} /",
        end=" ",
    )
    print(sum(result.num_lanes for result in results))
    print(f"tracks equal but for positions   {same_tracks}")
    print(f"maps equal but for coordinates   {same_maps}")
    print(f"largest position error           {position_error:.1e} m")
    print(f"largest map coordinate error     {map_error:.1e} m")
    print(f"accepted by av2's loaders        {num_accepted}")
    print(f"read a folder, ms                {spread(read_ms)}")
    print(f"make both files, ms              {spread(write_ms)}")


if __name__ == "__main__":
    main()
