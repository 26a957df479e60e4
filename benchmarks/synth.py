"""Synthetic traffic: windows and scenario folders a minute, bytes and time of a window.

Needs SUMO (``pip install 'pd-editor[synth]'``). Both cores are used for the first two.
"""

import statistics
import tempfile
import time
from pathlib import Path

from pd_editor.base.errors import ExportError
from pd_editor.experiments.recordings.clip import TrackingNoise
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, ShardReader
from pd_editor.experiments.synthesis.dataset_builder import (
    DatasetFolder,
    DatasetPlan,
    build_dataset,
)
from pd_editor.experiments.synthesis.realism_report import scenario_folders
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.scene.av2_io.write import check_with_official_loaders

NUM_WINDOWS = 1000
NUM_FOLDERS = 1000
NUM_TIMED = 300


def built(folder: Path, plan: DatasetPlan) -> tuple[float, int]:
    """Windows a minute, and networks."""
    began = time.perf_counter()
    record = build_dataset(
        plan, DatasetFolder(folder, plan.settings, resume=False), LocalProcesses()
    )
    elapsed = time.perf_counter() - began
    return 60 * record.num_windows / elapsed, len(record.networks)


def num_accepted(folder: Path) -> int:
    """Scenario folders that Argoverse's own loaders take."""
    count = 0
    for path in scenario_folders((folder,)):
        try:
            check_with_official_loaders(path)
        except ExportError as error:
            print(error)
        else:
            count += 1
    return count


def window_times_ms(folder: Path, noise: TrackingNoise | None) -> list[float]:
    """Time of windows one after the other; their recording is decoded once."""
    reader = ShardReader(folder)
    times = []
    for index in range(min(NUM_TIMED, len(reader))):
        reader.recording(reader.windows[index][0])
        began = time.perf_counter()
        reader.window(index, noise=noise)
        times.append(1e3 * (time.perf_counter() - began))
    return times


def decode_times_ms(folder: Path) -> list[float]:
    """Time to read and decode a recording."""
    reader = ShardReader(folder, num_kept=1)
    times = []
    for place in range(len(reader.recordings)):
        began = time.perf_counter()
        reader.recording(place)
        times.append(1e3 * (time.perf_counter() - began))
    return times


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as name:
        shards, folders = Path(name) / "shards", Path(name) / "folders"
        plan = DatasetPlan(num=NUM_WINDOWS, seed=1, as_shards=True)
        rate, num = built(shards, plan)
        print(f"shards   {rate:7.0f} windows/minute ({NUM_WINDOWS} of {num} networks)")
        plan = DatasetPlan(num=NUM_FOLDERS, seed=1, with_noise=True)
        rate, num = built(folders, plan)
        print(f"folders  {rate:7.0f} folders/minute ({NUM_FOLDERS} of {num} networks)")
        print(f"accepted {num_accepted(folders):7d} of {NUM_FOLDERS} folders by av2")
        size = sum(path.stat().st_size for path in shards.glob(f"*{SHARD_SUFFIX}"))
        print(f"size     {size / NUM_WINDOWS:7.0f} bytes/window")
        for label, times in (
            ("window", window_times_ms(shards, None)),
            ("blurred", window_times_ms(shards, TrackingNoise())),
            ("decoding", decode_times_ms(shards)),
        ):
            low, high = statistics.quantiles(times, n=10)[::8]
            middle = statistics.median(times)
            print(f"{label:8s} {middle:7.2f} ms median, 10-90 %: {low:.2f}-{high:.2f}")


if __name__ == "__main__":
    main()
