"""Simulates a time and a place of a SUMO scenario with counted demand."""

import tempfile
from copy import deepcopy
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Final
from xml.etree import ElementTree
from zlib import crc32

import numpy as np
from jaxtyping import Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo.map_conversion import net_road_map
from pd_editor.experiments.synthesis.sumo.simulation_output import (
    STATES_NAME,
    read_signals,
    state_outputs,
)
from pd_editor.experiments.synthesis.sumo.sumo_scenario import (
    SumoScenario,
    read_sumo_scenario,
)
from pd_editor.experiments.synthesis.sumo.sumo_tools import write_with_curve_speeds
from pd_editor.experiments.synthesis.traffic.demand_config import (
    MODELS,
    DemandOptions,
    ParkingOptions,
    SampledType,
    VehicleModel,
    sample_pedestrian_type,
    sample_vehicle_type,
)
from pd_editor.experiments.synthesis.traffic.simulation import (
    STEP_S,
    WARM_UP_S,
    finished_recording,
    run_traffic,
)
from pd_editor.experiments.synthesis.traffic.tracks import traffic_tracks
from pd_editor.scene.formats.packed_file import read_unpacked
from pd_editor.scene.formats.sumo_net import SumoNet
from pd_editor.scene.formats.xml_file import added

_LIKE: Final = {
    "moped": "motorcycle", "coach": "bus", "trailer": "truck", "emergency": "delivery",
}  # fmt: skip
"""Classes that are as a class with models; all others are as ``passenger``."""


def simulate_city(folder: Path, seed: int, *, duration_s: float = 160.0) -> Recording:
    """Simulate a scenario; the seed chooses time, place, drivers and vehicles.

    Raises:
        InputError: a file is missing or damaged, or names an edge that does not exist.
        SynthesisError: SUMO is missing or refused a file, or there is no traffic.
    """
    fill_s, reach_m = 600.0, 700.0  # This time fills the largest of known networks.
    scenario = read_sumo_scenario(folder)
    random = np.random.default_rng([seed, crc32(scenario.name.encode())])
    # Files say where there is room to park: rows along other kerbs are not invented.
    options = DemandOptions(parking=ParkingOptions(kerb_share=0.0))
    first, last = scenario.span_s
    latest = max(last - duration_s - WARM_UP_S, (first + last) / 2)
    begin_s = float(np.rint(random.uniform(min(first + fill_s, latest), latest)))
    fill_s = min(fill_s, begin_s - first)
    num_steps = round(duration_s / STEP_S)
    with tempfile.TemporaryDirectory(prefix=f"{scenario.name}-") as name:
        work = Path(name)
        types, files = _write_files(scenario, work, options, random)
        # What is not recorded is simulated in steps of a second.
        save = f"{files} --save-state.times {begin_s} --save-state.files state.xml.gz"
        span_s = begin_s - fill_s, begin_s + 1.0
        filled = run_traffic(work, seed, save, span_s, warm_up_s=fill_s, step_s=1.0)
        if not filled.names:
            raise SynthesisError(f"{folder}: nobody is under way at {begin_s:.0f} s.")
        center = random.choice(filled.front_m)
        network = _network(
            scenario, work, cropped_net(scenario.net, center, reach_m), random
        )
        _write_outputs(work, center, reach_m)
        load = f"{files},outputs.add.xml --load-state state.xml.gz"
        load += " --fcd-output.filter-shapes square"
        span_s = begin_s, begin_s + WARM_UP_S + duration_s
        raw = run_traffic(work, seed, load, span_s)
        signals = read_signals(
            work / STATES_NAME,
            network.net_file,
            network.road_map,
            network.lane_of_sumo,
            first_s=begin_s + WARM_UP_S,
            num_steps=num_steps,
            step_s=STEP_S,
        )
    type_of = {name: types[kind] for name, kind in raw.type_of.items()}
    tracks = traffic_tracks(raw, type_of, STEP_S)
    return finished_recording(
        network, seed, tracks, signals, options, num_steps, random
    )


def _write_files(
    scenario: SumoScenario,
    folder: Path,
    options: DemandOptions,
    random: np.random.Generator,
) -> tuple[dict[str, SampledType], str]:
    """Write network and demand, with types of our own in place of those of the files.

    Returns the types, and SUMO's option with the names of the files.
    """
    (folder / "net.net.xml").write_bytes(read_unpacked(scenario.net_file)[0])
    write_with_curve_speeds(folder / "net.net.xml", folder / "roads.net.xml")
    types: dict[str, SampledType] = {}
    names = []
    for number, root in enumerate(map(deepcopy, scenario.files)):
        for told in list(root.iter("vType")):
            choice = etree.Element("vTypeDistribution", id=told.get("id", ""))
            for type_id in _drawn(told.get("id", "")):
                types[type_id] = _sampled_type(type_id, told, options, random)
                added(choice, "vType", **types[type_id].element.attrib)
            parent = told.getparent()
            if parent.tag == choice.tag:
                share = told.get("probability", "1")
                for key, text in (
                    ("vTypes", choice.get("id")),
                    ("probabilities", share),
                ):
                    parent.set(key, f"{parent.get(key, '')} {text}")
                parent.remove(told)
                parent.addprevious(choice)
            else:
                parent.replace(told, choice)
        for mixed in root.xpath("//vTypeDistribution[@vTypes]"):
            parts, shares = (
                mixed.get(k, "").split() for k in ("vTypes", "probabilities")
            )
            ids, copies = (
                map(_drawn, parts),
                ([one] * len(_drawn("")) for one in shares),
            )
            for key, texts in (("vTypes", ids), ("probabilities", copies)):
                if text := " ".join(chain.from_iterable(texts)):
                    mixed.set(key, text)
        names.append(f"demand{number}.add.xml")
        (folder / names[-1]).write_bytes(etree.tostring(root))
    return types, f"--additional-files {','.join(names)}"


def _drawn(name: str) -> list[str]:
    """Ids of the types that stand for a type of a file."""
    return [f"{name}:{row}" for row in range(24)]


def _sampled_type(
    type_id: str,
    told: etree._Element,
    options: DemandOptions,
    random: np.random.Generator,
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

        # Some files let cars use bus lanes by calling them buses.
        nearest = min(models, key=apart)
        models = [nearest if apart(nearest) < 2.0 else min(MODELS, key=apart)]
    shares = np.array([options.shares[one.name] for one in models])
    model = models[random.choice(len(models), p=shares / shares.sum())]
    model = replace(model, sumo_class=vehicle_class)
    return sample_vehicle_type(type_id, model, options, random)


def _network(
    scenario: SumoScenario, folder: Path, net: SumoNet, random: np.random.Generator
) -> Network:
    """The network of a part of a scenario's net."""
    mapped = net_road_map(net, random, bay_share=0.0)
    return Network(
        name=scenario.name,
        family=scenario.name,
        folder=folder,
        net_file=folder / "roads.net.xml",
        road_map=mapped.road_map,
        lane_of_sumo=mapped.lane_of_sumo,
        has_signals=net.has_signals,
        parking_strips_m=net.parking_strips_m,
    )


def _write_outputs(
    folder: Path, center_m: Float[np.ndarray, "2"], reach_m: float
) -> None:
    """Have SUMO write the states of signals, and know the square that is recorded."""
    root = ElementTree.Element("additional")
    lights = ElementTree.parse(folder / "roads.net.xml").iter("tlLogic")
    root.extend(state_outputs(dict.fromkeys(one.attrib["id"] for one in lights)))
    corners = center_m + reach_m * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in corners)
    ElementTree.SubElement(root, "poly", id="square", shape=shape, color="red")
    ElementTree.ElementTree(root).write(folder / "outputs.add.xml")


def cropped_net(
    net: SumoNet, center_m: Float[np.ndarray, "2"], reach_m: float
) -> SumoNet:
    """Keep whole edges of which a lane reaches into a square, and what is beside them."""

    def is_near(points_m: Float[np.ndarray, "N 2"]) -> bool:
        low, high = points_m.min(axis=0) - center_m, points_m.max(axis=0) - center_m
        return bool((low < reach_m).all() and (high > -reach_m).all())

    edges = {lane.edge for lane in net.lanes.values() if is_near(lane.shape_m)}
    lanes = {name: lane for name, lane in net.lanes.items() if lane.edge in edges}
    return replace(
        net,
        lanes=lanes,
        links=tuple(one for one in net.links if lanes.keys() >= set(one)),
        junction_of={k: ends for k, ends in net.junction_of.items() if k in edges},
        junction_areas_m={k: a for k, a in net.junction_areas_m.items() if is_near(a)},
        walking_areas_m=tuple(area for area in net.walking_areas_m if is_near(area)),
        crossings=tuple(one for one in net.crossings if is_near(one[0])),
        turns=tuple(one for one in net.turns if lanes.keys() >= {one.start, one.end}),
    )
