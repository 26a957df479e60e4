"""Worker for one network of a dataset: network, simulation, clips, files."""

import dataclasses
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.recordings.clip import cut_scenario
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, shard_bytes
from pd_editor.experiments.recordings.tracking_noise import TrackingNoise
from pd_editor.experiments.synthesis.av2_to_sumo.network_conversion import (
    network_of_map,
)
from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.traffic.city_traffic import simulate_city
from pd_editor.experiments.synthesis.traffic.demand_config import MAP_DEMAND
from pd_editor.experiments.synthesis.traffic.simulation import simulate
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files

WINDOW_SPACING_S: Final = 2.0
"""Duration by which each window lengthens a recording."""
MIN_DURATION_S: Final = 30.0
MAX_DURATION_S: Final = 160.0


@dataclass(frozen=True, kw_only=True)
class NetworkRecord:
    """Record of one finished network."""

    num_windows: int
    num_agents: int
    """Number of agents in all windows at their current steps."""


@dataclass(frozen=True, kw_only=True)
class NetworkFiles:
    """Windows of one network as files, which the worker makes and the caller writes."""

    record: NetworkRecord
    shards: Mapping[str, bytes]
    folders: Mapping[str, Mapping[str, bytes]]
    """Files of scenario folders, by the folder's name and their own."""


@dataclass(frozen=True, kw_only=True)
class NetworkItem:
    """Work item: one network of a dataset."""

    key: str
    """Name of the network and its files."""
    family: str
    """Family of procedural roads; empty if a folder is used."""
    map_folder: Path | None
    """Folder of a real scenario whose map is used."""
    city_folder: Path | None
    """Folder of a SUMO scenario, whose network and demand are used."""
    seed: int
    num_windows: int
    as_shard: bool
    with_noise: bool


def make_network(item: NetworkItem) -> NetworkFiles:
    """Make the windows of one network; equal items give equal bytes.

    Raises:
        SynthesisError: SUMO refused the roads or the traffic, or no agent moves.
        InputError: the map cannot be read.
    """
    recording = _recording(item)
    windows = choose_windows(recording, item.seed, num_windows=item.num_windows)
    if not windows:
        raise SynthesisError(f"{item.key}: no agent drives there for long enough.")
    shards: dict[str, bytes] = {}
    folders: dict[str, dict[str, bytes]] = {}
    if item.as_shard:
        shards[f"{item.key}{SHARD_SUFFIX}"] = shard_bytes([(recording, windows)])
    else:
        noise = TrackingNoise() if item.with_noise else None
        for window in windows:
            scenario = cut_scenario(recording, window, noise=noise)
            folders[scenario.scenario_id] = scenario_files(scenario)
    return NetworkFiles(
        record=NetworkRecord(num_windows=len(windows), num_agents=len(recording.ids)),
        shards=shards,
        folders=folders,
    )


def _recording(item: NetworkItem) -> Recording:
    wanted_s = MIN_DURATION_S + WINDOW_SPACING_S * item.num_windows
    duration_s = min(wanted_s, MAX_DURATION_S)
    if item.city_folder is not None:
        return simulate_city(item.city_folder, item.seed, duration_s=duration_s)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if item.map_folder is None:
            network = generate_network(item.family, item.seed, folder)
            return simulate(network, item.seed, duration_s=duration_s)
        real = read_scenario(item.map_folder)
        network = network_of_map(real.road_map, f"av2-{real.scenario_id}", folder)
        recording = simulate(
            network, item.seed, duration_s=duration_s, demand=MAP_DEMAND
        )
        return dataclasses.replace(
            recording, city=real.city, origin_city_m=real.origin_city_m
        )
