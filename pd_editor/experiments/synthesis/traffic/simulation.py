"""Simulates traffic on a network for some minutes, as a recording."""

import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import fields, replace
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.recordings.recording import Recording, TrafficTracks
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo.simulation_output import (
    STATES_NAME,
    RawTracks,
    read_raw_tracks,
    read_signals,
    state_outputs,
)
from pd_editor.experiments.synthesis.sumo.sumo_tools import (
    SIMULATION_LIMIT_S,
    run_sumo_tool,
    write_with_curve_speeds,
)
from pd_editor.experiments.synthesis.traffic.demand import (
    TrafficGraph,
    read_traffic_graph,
    sample_demand,
)
from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions
from pd_editor.experiments.synthesis.traffic.parked_vehicles import (
    sample_parked_vehicles,
)
from pd_editor.experiments.synthesis.traffic.pedestrians import sample_pedestrians
from pd_editor.experiments.synthesis.traffic.tracks import (
    has_artefact,
    traffic_tracks,
    without_overlaps,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.signals import Signal

STEP_S: Final = 0.1
WARM_UP_S: Final = 20.0
"""Time in which the initial vehicles reach an equilibrium; it is discarded."""

LATERAL_RESOLUTION_M: Final = 0.6
"""Lateral resolution of SUMO's sublane model."""

JAM_SHARE: Final = 0.42
"""Share of slow time above which the demand exceeds the capacity of the roads."""

JAM_S: Final = 90.0
"""Vehicles that wait longer at the head of a lane are removed."""
LEAST_GREEN_S: Final = 7.0


def simulate(
    network: Network,
    seed: int,
    *,
    duration_s: float = 160.0,
    demand: DemandOptions | None = None,
) -> Recording:
    """Simulate road users of all kinds, and add parked vehicles and pedestrians.

    Equal networks, seeds and options give equal arrays. Positions are in the frame of
    the network's road map.

    Raises:
        SynthesisError: SUMO is missing, or refused the network or the traffic.
    """
    options = demand or DemandOptions()
    graph = read_traffic_graph(network.net_file)
    random = np.random.default_rng(seed)
    tracks, signals = _traffic(network, graph, options, duration_s, seed, random)
    for _ in range(2):
        if _slow_share(tracks) <= JAM_SHARE:
            break
        # The flow is reduced by this factor.
        options = replace(options, flow_per_lane=0.6 * options.flow_per_lane)
        tracks, signals = _traffic(network, graph, options, duration_s, seed, random)
    num_steps = round(duration_s / STEP_S)
    return finished_recording(
        network, seed, tracks, signals, options, num_steps, random
    )


def finished_recording(
    network: Network,
    seed: int,
    tracks: TrafficTracks,
    signals: tuple[Signal, ...],
    options: DemandOptions,
    num_steps: int,
    random: np.random.Generator,
) -> Recording:
    """Remove artefacts of the simulator, and add who stands or walks beside the road."""
    tracks = tracks.taken(~has_artefact(tracks, STEP_S))
    tracks = tracks.taken(without_overlaps(tracks))
    if network.footways is not None and network.footways.lines_m:
        pedestrians = sample_pedestrians(
            network.footways, tracks, options, num_steps, STEP_S, random
        )
        tracks = tracks.joined(pedestrians)
    parked = sample_parked_vehicles(network, tracks, options.parking, random)
    return _recording(network, seed, tracks, parked, signals, num_steps)


def _traffic(
    network: Network,
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    seed: int,
    random: np.random.Generator,
) -> tuple[TrafficTracks, tuple[Signal, ...]]:
    """Tracks of all simulated road users, and signals, after the warm-up."""
    end_s = WARM_UP_S + duration_s
    sampled = sample_demand(graph, options, end_s, random)
    plans = sample_signal_plans(network.net_file, options, random)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plans.extend(state_outputs([one.attrib["id"] for one in plans]))
        sampled.write(folder / "trips.rou.xml")
        ElementTree.ElementTree(plans).write(
            folder / "signals.add.xml", encoding="utf-8"
        )
        write_with_curve_speeds(network.net_file, folder / "roads.net.xml")
        files = "--route-files trips.rou.xml --additional-files signals.add.xml"
        raw = run_traffic(folder, seed, files, (0.0, end_s))
        signals = read_signals(
            folder / STATES_NAME,
            network.net_file,
            network.road_map,
            network.lane_of_sumo,
            first_s=WARM_UP_S,
            num_steps=round(duration_s / STEP_S),
            step_s=STEP_S,
        )
    return traffic_tracks(raw, sampled.types, STEP_S), signals


def _slow_share(tracks: TrafficTracks) -> float:
    """Share of the vehicles' time at very low speed."""
    drives = np.array([kind is not AgentKind.PEDESTRIAN for kind in tracks.kinds], bool)
    rows = drives[tracks.agent]
    if not rows.any():
        return 0.0
    speed = np.linalg.norm(tracks.velocity_mps[rows], axis=1)
    return float((speed < 2.0).mean())


def run_traffic(
    folder: Path,
    seed: int,
    options: str,
    span_s: tuple[float, float],
    *,
    warm_up_s: float = WARM_UP_S,
    step_s: float = STEP_S,
) -> RawTracks:
    """Simulate a span of time on a folder's ``roads.net.xml``, with further options.

    Returns the states after the warm-up, which begin with step 0. In longer steps than
    usual, vehicles keep to the middle of their lanes.

    Raises:
        SynthesisError: SUMO is missing, or refused a file.
    """
    begin_s = span_s[0] + warm_up_s
    files = "--net-file roads.net.xml --fcd-output vehicles.parquet"
    files += " --person-fcd-output persons.parquet"
    files += " --fcd-output.attributes id,x,y,angle,type"
    clock = f"--step-length {step_s} --device.fcd.begin {begin_s}"
    clock += f" --begin {span_s[0]} --end {span_s[1]}"
    model = f"--lateral-resolution {LATERAL_RESOLUTION_M if step_s == STEP_S else 0}"
    model += f" --seed {seed % 2**31} --pedestrian.striping.stripe-width 0.5"
    rules = f"--time-to-teleport {JAM_S} --time-to-teleport.remove true"
    rules += " --collision.action none --intermodal-collision.action none"
    rules += " --max-depart-delay 15 --ignore-route-errors true"
    quiet = "--no-step-log true --no-warnings true --duration-log.disable true"
    quiet += " --xml-validation never"
    arguments = f"{files} {options} {clock} {model} {rules} {quiet}".split()
    run_sumo_tool("sumo", arguments, folder, limit_s=SIMULATION_LIMIT_S)
    paths = folder / "vehicles.parquet", folder / "persons.parquet"
    return read_raw_tracks(paths, step_s).shifted(round(begin_s / step_s))


def _recording(
    network: Network,
    seed: int,
    tracks: TrafficTracks,
    parked: Boxes,
    signals: tuple[Signal, ...],
    num_steps: int,
) -> Recording:
    num_parked = len(parked.heading_rad)
    standing = TrafficTracks(
        ids=tuple(f"parked-{row:04d}" for row in range(num_parked)),
        kinds=(AgentKind.VEHICLE,) * num_parked,
        size_m=parked.size_m,
        first_step=np.zeros(num_parked, int),
        first_row=np.arange(num_parked + 1) * num_steps,
        position_m=np.repeat(parked.position_m, num_steps, axis=0),
        heading_rad=np.repeat(parked.heading_rad, num_steps),
        velocity_mps=np.zeros((num_parked * num_steps, 2)),
    )
    everyone = tracks.joined(standing)
    return Recording(
        **{one.name: getattr(everyone, one.name) for one in fields(everyone)},
        name=f"{network.name}-{seed}",
        road_map=network.road_map,
        city=network.family,
        origin_city_m=np.zeros(2),
        step_s=STEP_S,
        num_steps=num_steps,
        is_parked=np.arange(len(everyone.ids)) >= len(tracks.ids),
        signals=signals,
    )


def sample_signal_plans(
    net_file: Path, options: DemandOptions, random: np.random.Generator
) -> ElementTree.Element:
    """Sample an additional file for SUMO with a new program for each traffic light.

    Raises:
        SynthesisError: the file is missing or no SUMO network.
    """
    try:
        lights = list(ElementTree.parse(net_file).getroot().iter("tlLogic"))
    except (OSError, ElementTree.ParseError) as error:
        raise SynthesisError(
            f"{net_file} is not a readable SUMO network ({error})."
        ) from error
    is_actuated = bool(random.random() < options.actuated_share)
    share = random.uniform(*options.green_share)
    root = ElementTree.Element("additional")
    for light in lights:
        root.append(_plan(light, share, is_actuated, random))
    return root


def _plan(
    light: ElementTree.Element,
    share: float,
    is_actuated: bool,
    random: np.random.Generator,
) -> ElementTree.Element:
    plan = ElementTree.Element(
        "tlLogic",
        {
            "id": light.attrib["id"],
            "type": "actuated" if is_actuated else "static",
            "programID": "sampled",
            "offset": f"{random.uniform(0.0, 60.0):.0f}",
        },
    )
    for phase in light.iter("phase"):
        green_s = float(phase.attrib["duration"])
        changed = {"state": phase.attrib["state"]}
        if "y" not in phase.attrib["state"] and green_s > LEAST_GREEN_S:
            green_s = max(share * green_s, LEAST_GREEN_S)
            if is_actuated:
                changed |= {"minDur": f"{LEAST_GREEN_S}", "maxDur": f"{1.5 * green_s}"}
        changed["duration"] = f"{green_s:.1f}"
        ElementTree.SubElement(plan, "phase", changed)
    return plan
