"""Simulates a time and a place of a SUMO scenario with counted demand."""

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final
from xml.etree import ElementTree
from zlib import crc32

import numpy as np
from jaxtyping import Bool, Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo.curve_speeds import write_with_curve_speeds
from pd_editor.experiments.synthesis.sumo.floating_car_data import (
    RawTracks,
    read_raw_tracks,
)
from pd_editor.experiments.synthesis.sumo.signal_states import (
    STATES_NAME,
    read_signals,
    state_outputs,
)
from pd_editor.experiments.synthesis.sumo.sumo_scenario import (
    SumoScenario,
    read_sumo_scenario,
)
from pd_editor.experiments.synthesis.sumo_to_av2.map_conversion import net_road_map
from pd_editor.experiments.synthesis.sumo_to_av2.net_crop import cropped_net
from pd_editor.experiments.synthesis.traffic.demand_config import (
    DemandOptions,
    ParkingOptions,
)
from pd_editor.experiments.synthesis.traffic.simulation import (
    ROADS_NAME,
    STEP_S,
    WARM_UP_S,
    finished_recording,
    run_traffic,
)
from pd_editor.experiments.synthesis.traffic.track_smoothing import traffic_tracks
from pd_editor.experiments.synthesis.traffic.vehicle_types import (
    MODELS,
    SampledType,
    VehicleModel,
    sample_pedestrian_type,
    sample_vehicle_type,
)
from pd_editor.scene.agent_kind import AgentKind

FILL_S: Final = 600.0
"""Time in which the empty network is filled, in long steps; it is discarded."""
_STATE_NAME: Final = "state.xml.gz"
_REACTION: Final = "--default.action-step-length 0.3"
"""Drivers decide less often than states are recorded, which halves the time."""
REACH_M: Final = 700.0
"""Half of the side of the square that is recorded about a place with traffic."""
TYPES_PER_TYPE: Final = 24
"""Sampled drivers and vehicles in place of one type of the files."""
_OPTIONS: Final = DemandOptions(parking=ParkingOptions(kerb_share=0.0))
"""Files say where there is room to park: rows along other kerbs are not invented."""
_ON_FOOT: Final = "pedestrian"
_USUAL_TYPES: Final = {
    "DEFAULT_VEHTYPE": "passenger",
    "DEFAULT_TAXITYPE": "taxi",
    "DEFAULT_BIKETYPE": "bicycle",
    "DEFAULT_PEDTYPE": _ON_FOOT,
}
"""Classes of SUMO's own types."""
_LIKE: Final = {
    "moped": "motorcycle", "coach": "bus", "trailer": "truck", "emergency": "delivery",
}  # fmt: skip
"""Classes that are as a class with models; all others are as ``passenger``."""
_FAR_M: Final = 2.0
"""Difference in length from which a vehicle is not of a model of its class: some files
let cars use bus lanes by calling them buses."""


def simulate_city(folder: Path, seed: int, *, duration_s: float = 160.0) -> Recording:
    """Simulate a scenario; the seed chooses time, place, drivers and vehicles.

    Raises:
        InputError: a file is missing or damaged, or names an edge that does not exist.
        SynthesisError: SUMO is missing or refused a file, or there is no traffic.
    """
    scenario = read_sumo_scenario(folder)
    random = np.random.default_rng([seed, crc32(scenario.name.encode())])
    begin_s = _begin_s(scenario, duration_s, random)
    num_steps = round(duration_s / STEP_S)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        raw, types = _simulated(scenario, work, seed, begin_s, duration_s, random)
        center = _place(scenario, raw, types, random)
        network = _network(scenario, work, center, random)
        signals = read_signals(
            work / STATES_NAME,
            network.net_file,
            network.road_map,
            network.lane_of_sumo,
            first_s=begin_s + WARM_UP_S,
            num_steps=num_steps,
            step_s=STEP_S,
        )
    raw = raw.taken((np.abs(raw.front_m - center) < REACH_M).all(axis=1))
    type_of = {one: types[kind] for one, kind in raw.type_of.items()}
    tracks = traffic_tracks(raw, type_of, STEP_S)
    made = finished_recording(network, seed, tracks, _OPTIONS, num_steps, random)
    return replace(made, signals=signals)


def _begin_s(
    scenario: SumoScenario, duration_s: float, random: np.random.Generator
) -> float:
    """A time at which somebody departs, if possible in a filled network."""
    first, last = scenario.departures_s[[0, -1]]
    latest = max(last - duration_s - WARM_UP_S, first)
    earliest = min(first + FILL_S, latest)
    times = np.clip(scenario.departures_s, earliest, latest)
    return float(np.rint(random.choice(np.unique(times))))


def _simulated(
    scenario: SumoScenario,
    folder: Path,
    seed: int,
    begin_s: float,
    duration_s: float,
    random: np.random.Generator,
) -> tuple[RawTracks, dict[str, SampledType]]:
    """States from the beginning on, and the types of all road users."""
    types, root = _sampled_types(scenario, random)
    (folder / "types.add.xml").write_bytes(etree.tostring(root))
    names = scenario.write(folder, "net.net.xml")
    write_with_curve_speeds(folder / "net.net.xml", folder / ROADS_NAME)
    lights = ElementTree.parse(folder / ROADS_NAME).iter("tlLogic")
    outputs = ElementTree.Element("additional")
    outputs.extend(state_outputs({one.attrib["id"]: None for one in lights}))
    ElementTree.ElementTree(outputs).write(folder / "signals.add.xml")
    files = ",".join(["types.add.xml", *names, "signals.add.xml"])
    options = f"--additional-files {files} {' '.join(scenario.options)}"
    fill = f"{options} --save-state.times {begin_s} --save-state.files {_STATE_NAME}"
    span_s = begin_s - FILL_S, begin_s + 1.0
    run_traffic(folder, seed, fill, span_s, is_recorded=False)
    first_s = begin_s + WARM_UP_S
    drive = f"{options} --load-state {_STATE_NAME} {_REACTION}"
    run_traffic(folder, seed, drive, (begin_s, first_s + duration_s))
    raw = read_raw_tracks(
        (folder / "vehicles.parquet", folder / "persons.parquet"), STEP_S
    ).shifted(round(first_s / STEP_S))
    return raw.taken(~_rides(raw, _walks(raw, types))), types


def _rides(raw: RawTracks, walks: Bool[np.ndarray, "A"]) -> Bool[np.ndarray, "P"]:
    """Which states are those of persons in vehicles, whose positions they have."""
    place = np.column_stack([raw.step, np.rint(100.0 * raw.front_m)])
    _, at = np.unique(place, axis=0, return_inverse=True)
    on_foot = walks[raw.agent]
    has_vehicle = np.zeros(len(place), bool)
    has_vehicle[at[~on_foot]] = True
    return on_foot & has_vehicle[at]


def _place(
    scenario: SumoScenario,
    raw: RawTracks,
    types: Mapping[str, SampledType],
    random: np.random.Generator,
) -> Float[np.ndarray, "2"]:
    """A place with traffic."""
    drives = np.flatnonzero(~_walks(raw, types)[raw.agent])
    if not len(drives):
        raise SynthesisError(
            f"{scenario.net_file}: nobody drives there; expected demand for it."
        )
    return raw.front_m[random.choice(drives)]


def _walks(raw: RawTracks, types: Mapping[str, SampledType]) -> Bool[np.ndarray, "A"]:
    kinds = [types[raw.type_of[one]].kind for one in raw.names]
    return np.array([one is AgentKind.PEDESTRIAN for one in kinds], bool)


def _network(
    scenario: SumoScenario,
    folder: Path,
    center_m: Float[np.ndarray, "2"],
    random: np.random.Generator,
) -> Network:
    """The part of the scenario's network about a place."""
    net = cropped_net(scenario.net, center_m, REACH_M)
    mapped = net_road_map(net, random, bay_share=0.0)
    return Network(
        name=scenario.name,
        family=scenario.name,
        folder=folder,
        net_file=folder / ROADS_NAME,
        road_map=mapped.road_map,
        lane_of_sumo=mapped.lane_of_sumo,
        has_signals=net.has_signals,
        parking_strips_m=net.parking_strips_m,
    )


def _sampled_types(
    scenario: SumoScenario, random: np.random.Generator
) -> tuple[dict[str, SampledType], etree._Element]:
    """Types in place of those of the files, and distributions of them by the old names."""
    sampled: dict[str, SampledType] = {}
    root = etree.Element("additional")
    told = {
        one.get("id", ""): one for part in scenario.types for one in part.iter("vType")
    }
    usual = {
        name: etree.Element("vType", id=name, vClass=vehicle_class)
        for name, vehicle_class in _USUAL_TYPES.items()
    }
    drawn: dict[str, list[str]] = {}
    for name, one in {**usual, **told}.items():
        drawn[name] = [f"{name}:{number}" for number in range(TYPES_PER_TYPE)]
        for type_id in drawn[name]:
            sampled[type_id] = _sampled_type(type_id, one, random)
            root.append(etree.Element("vType", sampled[type_id].element.attrib))
    shares = {name: {name: 1.0} for name in drawn}
    shares |= {
        part.get("id", ""): _shares(part)
        for part in scenario.types
        if part.tag == "vTypeDistribution"
    }
    for name, parts in shares.items():
        ids = [type_id for part in parts for type_id in drawn.get(part, [part])]
        chance = [
            f"{share / TYPES_PER_TYPE:.6f}"
            for part, share in parts.items()
            for _ in drawn.get(part, [part])
        ]
        etree.SubElement(
            root, "vTypeDistribution",
            id=name, vTypes=" ".join(ids), probabilities=" ".join(chance),
        )  # fmt: skip
    return sampled, root


def _shares(distribution: etree._Element) -> dict[str, float]:
    """Probability of each type of a distribution, whose types are inside or named."""
    named = (distribution.get("vTypes") or "").split()
    chances = (distribution.get("probabilities") or "1 " * len(named)).split()
    inside = distribution.findall("vType")
    named += [one.get("id", "") for one in inside]
    chances += [one.get("probability", "1") for one in inside]
    return dict(zip(named, map(float, chances), strict=False))


def _sampled_type(
    type_id: str, told: etree._Element, random: np.random.Generator
) -> SampledType:
    """Sample a driver and vehicle that are like a type of a file."""
    vehicle_class = told.get("vClass", "passenger")
    if vehicle_class == _ON_FOOT:
        return sample_pedestrian_type(type_id, random)
    like = _LIKE.get(vehicle_class, vehicle_class)
    models = [one for one in MODELS if one.sumo_class == like]
    models = models or [one for one in MODELS if one.sumo_class == "passenger"]
    if "length" in told.attrib:
        length = float(told.attrib["length"])

        def apart(model: VehicleModel) -> float:
            return abs(model.length_m[0] - length)

        nearest = min(models, key=apart)
        models = [nearest if apart(nearest) < _FAR_M else min(MODELS, key=apart)]
    shares = np.array([_OPTIONS.shares[one.name] for one in models])
    model = models[random.choice(len(models), p=shares / shares.sum())]
    model = replace(model, sumo_class=vehicle_class)
    return sample_vehicle_type(type_id, model, _OPTIONS, random)
