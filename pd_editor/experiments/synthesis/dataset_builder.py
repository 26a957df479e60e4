"""Builds a synthetic dataset of many networks, each with its windows, in a folder."""

import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import InputError, SynthesisError
from pd_editor.base.regular_file import check_path
from pd_editor.experiments.recordings.clip import TrackingNoise, cut_scenario
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, shard_bytes
from pd_editor.experiments.synthesis.realism_report import scenario_folders
from pd_editor.experiments.synthesis.road_network.generator import (
    FAMILIES,
    FAMILY_SHARES,
    generate_network,
)
from pd_editor.experiments.synthesis.road_network.map_network import (
    network_of_map,
)
from pd_editor.experiments.synthesis.sumo.sumo_scenario import (
    city_name,
    read_sumo_scenario,
)
from pd_editor.experiments.synthesis.sumo.sumo_tools import sumo_tool
from pd_editor.experiments.synthesis.traffic.city_traffic import simulate_city
from pd_editor.experiments.synthesis.traffic.demand_config import MAP_DEMAND
from pd_editor.experiments.synthesis.traffic.simulation import simulate
from pd_editor.experiments.work_engine.work_engine import (
    WorkEngine,
    WorkProgress,
    run_items,
)
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME, ResumableFolder
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import replace_folder

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
    # Least duration, and that by which each window lengthens a recording.
    wanted_s = 30.0 + 2.0 * item.num_windows
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


MANIFEST_NAME: Final = "manifest.json"


class DatasetFolder(ResumableFolder):
    """Folder of a dataset that can be resumed."""

    def __init__(
        self, path: Path, settings: Mapping[str, Any], *, resume: bool
    ) -> None:
        """Create the folder, or resume the one of an earlier run.

        Raises:
            ExportError: the folder cannot be written, or holds something else.
            InputError: the folder belongs to a dataset with other settings.
        """
        self.settings = settings
        super().__init__(path, settings, work="dataset", resume=resume)

    def store(self, key: str, made: NetworkFiles) -> None:
        """Write the files of a network, then its record, with which it is finished.

        Raises:
            ExportError: a file cannot be written.
        """
        for name, data in made.shards.items():
            self.write(name, data)
        for name, files in made.folders.items():
            replace_folder(files, self.path / name)
        self.write_json(f"{FINISHED_NAME}/{key}.json", asdict(made.record))

    def load(self, key: str) -> NetworkRecord | None:
        """Record of a finished network; None if it is not finished."""
        try:
            found = json.loads((self.path / FINISHED_NAME / f"{key}.json").read_bytes())
            return NetworkRecord(**found)
        except (OSError, ValueError, TypeError, RecursionError):
            return None

    def write_manifest(self, networks: Mapping[str, NetworkRecord]) -> Path:
        """Write the dataset's settings and the records of its networks.

        Raises:
            ExportError: it cannot be written.
        """
        manifest = {
            **self.settings,
            "num_windows": sum(one.num_windows for one in networks.values()),
            "networks": {key: asdict(one) for key, one in networks.items()},
        }
        return self.write_json(MANIFEST_NAME, manifest)


WINDOWS_PER_SHARD: Final = 80
FOLDERS_PER_NETWORK: Final = 20
"""Scenario folders per network; fewer than in a shard, for a greater variety of roads."""
_MAX_NUM: Final = 1_000_000
_MAX_SEED: Final = 20_000


@lru_cache(maxsize=8)
def usual_families(count: int) -> tuple[str, ...]:
    """Families of the first networks of a dataset, distributed as evenly as possible."""
    num = dict.fromkeys(FAMILY_SHARES, 0)
    chosen: list[str] = []
    for _ in range(count):
        name = min(num, key=lambda one: (num[one] + 0.5) / FAMILY_SHARES[one])
        num[name] += 1
        chosen.append(name)
    return tuple(chosen)


@dataclass(frozen=True, kw_only=True)
class DatasetPlan:
    """Specification of a dataset."""

    num: int
    """Number of windows or scenario folders."""
    seed: int
    families: tuple[str, ...] = ()
    """Families of procedural roads, in equal shares; all in their usual shares if empty."""
    maps: tuple[Path, ...] = ()
    """Roots of real scenarios whose maps are used in place of procedural networks."""
    networks: tuple[Path, ...] = ()
    """Folders of SUMO scenarios that are used with their demand; a name each."""
    as_shards: bool = False
    with_noise: bool = False

    def __post_init__(self) -> None:
        for root in (*self.maps, *self.networks):
            check_path(root)
        if self.networks and (self.families or self.maps):
            raise InputError(
                "--networks excludes --families and --maps; leave out one of them."
            )
        if len(set(self.cities)) < len(self.cities):
            raise InputError("Two folders of --networks have equal names; rename one.")
        unknown = [name for name in self.families if name not in FAMILIES]
        if unknown:
            raise InputError(
                f"There is no family of roads {unknown[0][:60]!r}; choose among "
                f"{', '.join(FAMILIES)}."
            )
        if not 1 <= self.num <= _MAX_NUM:
            raise InputError(f"--num is {self.num}; expected 1 to {_MAX_NUM}.")
        if not 0 <= self.seed < _MAX_SEED:
            raise InputError(f"--seed is {self.seed}; expected 0 to {_MAX_SEED - 1}.")
        if self.as_shards and self.with_noise:
            raise InputError(
                "Shards hold true states, and noise is added when they are read; leave "
                "out --noise or --shards."
            )

    def family(self, index: int) -> str:
        """Family of the procedural network of an index."""
        if self.families:
            return self.families[index % len(self.families)]
        return usual_families(index + 1)[index]

    @property
    def cities(self) -> tuple[str, ...]:
        """Names of the folders of SUMO scenarios."""
        return tuple(city_name(folder) for folder in self.networks)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that finished networks depend on."""
        families = () if self.maps else (self.families or FAMILIES)
        return {
            # With another version, traffic may change.
            "version": version("pd-editor"),
            "num": self.num,
            "seed": self.seed,
            "families": self.cities or families,
            "maps": list(map(os.path.realpath, (*self.maps, *self.networks))),
            "form": "shards" if self.as_shards else "folders",
            "noise": self.with_noise,
        }


@dataclass(frozen=True, kw_only=True)
class DatasetRecord:
    """Finished networks and failures of a dataset."""

    networks: Mapping[str, NetworkRecord]
    """Finished networks by the names of their files."""
    failures: Mapping[str, str]
    """Reason of each network without windows."""
    num_resumed: int
    notes: tuple[str, ...] = ()
    """What cities lack."""

    @property
    def num_windows(self) -> int:
        """Number of windows in all networks."""
        return sum(one.num_windows for one in self.networks.values())

    @property
    def num_agents(self) -> int:
        """Number of agents in all networks."""
        return sum(one.num_agents for one in self.networks.values())


def build_dataset(
    plan: DatasetPlan,
    folder: DatasetFolder,
    engine: WorkEngine,
    *,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> DatasetRecord:
    """Build the networks that are not finished yet, and write the manifest.

    Further networks replace those with fewer windows than planned, so that a dataset
    has fewer windows than requested only if many networks fail.

    Raises:
        SynthesisError: SUMO is missing, or not a single network gave a window.
        InputError: a SUMO scenario cannot be used.
        ExportError: the folder cannot be written.
    """
    for tool in ("netconvert", "sumo"):
        sumo_tool(tool)
    notes = [note for city in plan.networks for note in read_sumo_scenario(city).notes]
    places = scenario_folders(plan.maps) if plan.maps else [*plan.networks]
    networks: dict[str, NetworkRecord] = {}
    failures: dict[str, str] = {}
    num_resumed = num_planned = 0
    for _ in range(8):
        missing = plan.num - sum(one.num_windows for one in networks.values())
        usable = [one for one in places if not _is_hopeless(one, plan, failures)]
        if missing <= 0 or (places and not usable):
            break
        items = _items(plan, usable, missing, num_planned)
        num_planned += len(items)
        done = {key for key in items if folder.load(key) is not None}
        num_resumed += len(done)
        failed = run_items(
            engine,
            make_network,
            items,
            on_value=folder.store,
            on_progress=on_progress,
            done=done,
        )
        failures |= {key: failure.reason for key, failure in failed.items()}
        found = {key: folder.load(key) for key in items}
        networks |= {key: one for key, one in found.items() if one is not None}
    if not networks:
        reason = next(iter(failures.values()), "there is no map")
        raise SynthesisError(f"Not a single network gave traffic; the first: {reason}")
    folder.write_manifest(networks)
    return DatasetRecord(
        networks=networks,
        failures=failures,
        num_resumed=num_resumed,
        notes=tuple(notes),
    )


def _items(
    plan: DatasetPlan,
    places: Sequence[Path],
    num_windows: int,
    first: int,
) -> dict[str, NetworkItem]:
    """Further networks with equal numbers of windows, numbered from ``first``."""
    share = WINDOWS_PER_SHARD if plan.as_shards else FOLDERS_PER_NETWORK
    kinds = len(places) or len(plan.families or FAMILIES)
    if plan.maps:
        # Windows per real map; fewer than per network, because real maps are small.
        share = min(share, 25)
    count = math.ceil(num_windows / share)
    if first == 0:  # Few windows are distributed over all families of roads.
        count = max(count, min(kinds, num_windows))
    items = {}
    for number in range(count):
        index = first + number
        place = places[index % kinds] if places else None
        family = plan.family(index) if place is None else ""
        label = family if place is None else _label(place, plan)
        item = NetworkItem(
            key=f"{label}-{index:05d}",
            family=family,
            map_folder=place if plan.maps else None,
            city_folder=place if plan.networks else None,
            seed=plan.seed * 100_000 + index,
            num_windows=num_windows // count + (number < num_windows % count),
            as_shard=plan.as_shards,
            with_noise=plan.with_noise,
        )
        items[item.key] = item
    return items


def _label(place: Path, plan: DatasetPlan) -> str:
    return city_name(place) if plan.networks else f"av2-{place.name}"


def _is_hopeless(place: Path, plan: DatasetPlan, failures: Mapping[str, str]) -> bool:
    """Whether a place failed repeatedly; once may be chance, if no agent was eligible."""
    label = _label(place, plan)
    return sum(key.rpartition("-")[0] == label for key in failures) > 1
