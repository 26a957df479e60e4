"""Simulates a time and a place of a SUMO scenario with counted demand."""

import tempfile
from copy import deepcopy
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
    PERSONS_NAME,
    ROADS_NAME,
    STEP_S,
    VEHICLES_NAME,
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
from pd_editor.scene.formats.packed_file import read_unpacked
from pd_editor.scene.formats.xml_file import added

FILL_S: Final = 600.0
"""Time in which the empty network is filled, in long steps; it is discarded."""
FILL_STEP_S: Final = 1.0
REACH_M: Final = 700.0
"""Half of the side of the square that is recorded about a place with traffic."""
DRIVERS_PER_TYPE: Final = 24
_STATE_NAME: Final = "state.xml.gz"
_OUTPUTS_NAME: Final = "outputs.add.xml"
_OPTIONS: Final = DemandOptions(parking=ParkingOptions(kerb_share=0.0))
"""Files say where there is room to park: rows along other kerbs are not invented."""
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
    first, last = scenario.span_s
    latest = max(last - duration_s - WARM_UP_S, (first + last) / 2)
    begin_s = float(np.rint(random.uniform(min(first + FILL_S, latest), latest)))
    first_s, num_steps = begin_s + WARM_UP_S, round(duration_s / STEP_S)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        types, options = _write_files(scenario, work, random)
        fill = f"{options} --save-state.times {begin_s}"
        fill += f" --save-state.files {_STATE_NAME}"
        span_s = max(begin_s - FILL_S, first), begin_s + FILL_STEP_S
        run_traffic(work, seed, fill, span_s, recorded_s=begin_s, step_s=FILL_STEP_S)
        filled = read_raw_tracks((work / VEHICLES_NAME,), FILL_STEP_S).front_m
        if not len(filled):
            raise SynthesisError(f"{folder}: nobody drives at {begin_s:.0f} s.")
        center = random.choice(filled)
        network = _network(scenario, work, center, random)
        _write_outputs(work, center)
        drive = f"{options},{_OUTPUTS_NAME} --load-state {_STATE_NAME}"
        drive += " --fcd-output.filter-shapes square"
        span_s = begin_s, first_s + duration_s
        run_traffic(work, seed, drive, span_s, recorded_s=first_s)
        raw = read_raw_tracks((work / VEHICLES_NAME, work / PERSONS_NAME), STEP_S)
        signals = read_signals(
            work / STATES_NAME,
            network.net_file,
            network.road_map,
            network.lane_of_sumo,
            first_s=first_s,
            num_steps=num_steps,
            step_s=STEP_S,
        )
    type_of = {name: types[kind] for name, kind in raw.type_of.items()}
    raw = raw.shifted(round(first_s / STEP_S))
    tracks = traffic_tracks(raw.taken(~_rides(raw, type_of)), type_of, STEP_S)
    made = finished_recording(network, seed, tracks, _OPTIONS, num_steps, random)
    return replace(made, signals=signals)


def _write_files(
    scenario: SumoScenario, folder: Path, random: np.random.Generator
) -> tuple[dict[str, SampledType], str]:
    """Write network and demand, with types of our own in place of those of the files.

    Returns the types, and SUMO's option with the names of the files.
    """
    (folder / "net.net.xml").write_bytes(read_unpacked(scenario.net_file)[0])
    write_with_curve_speeds(folder / "net.net.xml", folder / ROADS_NAME)
    types: dict[str, SampledType] = {}
    names = []
    for number, root in enumerate(map(deepcopy, scenario.files)):
        for told in list(root.iter("vType")):
            name, choice = told.get("id", ""), told.getparent()
            if choice.tag != "vTypeDistribution":
                choice = etree.Element("vTypeDistribution", id=name)
                told.getparent().replace(told, choice)
            for row in range(DRIVERS_PER_TYPE):
                one = _sampled_type(f"{name}:{row}", told, random)
                types[one.type_id] = one
                share = told.get("probability", "1")
                added(choice, "vType", **one.element.attrib, probability=share)
            if told.getparent() is choice:
                choice.remove(told)
        names.append(f"demand{number}.add.xml")
        (folder / names[-1]).write_bytes(etree.tostring(root))
    return types, f"--additional-files {','.join(names)}"


def _sampled_type(
    type_id: str, told: etree._Element, random: np.random.Generator
) -> SampledType:
    """Sample a driver and vehicle that are like a type of a file."""
    vehicle_class = told.get("vClass", "passenger")
    if vehicle_class == "pedestrian":
        return sample_pedestrian_type(type_id, random)
    like = _LIKE.get(vehicle_class, vehicle_class)
    if all(one.sumo_class != like for one in MODELS):
        like = "passenger"
    models = [one for one in MODELS if one.sumo_class == like]
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


def _write_outputs(folder: Path, center_m: Float[np.ndarray, "2"]) -> None:
    """Have SUMO write the states of signals, and know the square that is recorded."""
    root = ElementTree.Element("additional")
    lights = ElementTree.parse(folder / ROADS_NAME).iter("tlLogic")
    root.extend(state_outputs(dict.fromkeys(one.attrib["id"] for one in lights)))
    corners = center_m + REACH_M * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in corners)
    ElementTree.SubElement(root, "poly", id="square", shape=shape, color="red")
    ElementTree.ElementTree(root).write(folder / _OUTPUTS_NAME)


def _rides(raw: RawTracks, types: dict[str, SampledType]) -> Bool[np.ndarray, "P"]:
    """Which states are those of persons in vehicles, whose positions they have."""
    walks = [types[one].kind is AgentKind.PEDESTRIAN for one in raw.names]
    on_foot = np.array(walks, bool)[raw.agent]
    place = np.rint(100.0 * raw.front_m).astype(int)
    key = (raw.step * 2**24 + place[:, 0]) * 2**24 + place[:, 1]
    return on_foot & np.isin(key, key[~on_foot])
