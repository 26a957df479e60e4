"""Traffic on a network for some minutes, as a recording."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import ElementTree

import numpy as np

from pd_editor.recordings.recording import Recording
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.synthesis.road_network.network import Network
from pd_editor.synthesis.sumo.curve_speeds import write_with_curve_speeds
from pd_editor.synthesis.sumo.floating_car_data import read_raw_tracks
from pd_editor.synthesis.sumo.signal_plans import draw_signal_plans
from pd_editor.synthesis.sumo.sumo_tools import SIMULATION_LIMIT_S, run_sumo_tool
from pd_editor.synthesis.sumo.traffic_graph import TrafficGraph, read_traffic_graph
from pd_editor.synthesis.traffic.artefact_filter import has_artefact, without_overlaps
from pd_editor.synthesis.traffic.demand import draw_demand
from pd_editor.synthesis.traffic.demand_config import DemandOptions
from pd_editor.synthesis.traffic.parked_vehicles import (
    ParkedVehicles,
    draw_parked_vehicles,
)
from pd_editor.synthesis.traffic.pedestrians import draw_walkers
from pd_editor.synthesis.traffic.track_smoothing import TrafficTracks, traffic_tracks

STEP_S: Final = 0.1
WARM_UP_S: Final = 20.0
"""Time in which vehicles that are put onto the roads find their places."""

LATERAL_RESOLUTION_M: Final = 0.6
"""Of SUMO's sublane model."""

SLOW_MPS: Final = 2.0
JAM_SHARE: Final = 0.42
"""Traffic that is slower for more of its time is more than the roads carry."""
LESS_FLOW: Final = 0.6
"""Share of it that is tried instead."""
MAX_RETRIES: Final = 2

JAM_S: Final = 90.0
"""Whoever waits longer at the head of a lane is taken off the road."""


def simulate(
    network: Network,
    seed: int,
    *,
    duration_s: float = 160.0,
    demand: DemandOptions | None = None,
) -> Recording:
    """Road users of all kinds on a network, and vehicles parked beside its roads.

    The same network, seed and options give the same arrays. Positions are in the
    frame of the network's road map.

    Raises:
        SynthesisError: SUMO is missing, or refused the network or the traffic.
    """
    options = demand or DemandOptions()
    graph = read_traffic_graph(network.net_file)
    random = np.random.default_rng(seed)
    tracks = _traffic(network, graph, options, duration_s, seed, random)
    for _ in range(MAX_RETRIES):
        if _slow_share(tracks) <= JAM_SHARE:
            break
        options = replace(options, flow_per_lane=LESS_FLOW * options.flow_per_lane)
        tracks = _traffic(network, graph, options, duration_s, seed, random)
    tracks = tracks.taken(~has_artefact(tracks, STEP_S))
    tracks = tracks.taken(without_overlaps(tracks))
    num_steps = round(duration_s / STEP_S)
    if network.footways is not None and network.footways.lines_m:
        walkers = draw_walkers(
            network.footways, tracks, options, num_steps, STEP_S, random
        )
        tracks = tracks.joined(walkers)
    parked = draw_parked_vehicles(network, tracks, options.parking, random)
    return _recording(network, seed, tracks, parked, num_steps)


def _traffic(
    network: Network,
    graph: TrafficGraph,
    options: DemandOptions,
    duration_s: float,
    seed: int,
    random: np.random.Generator,
) -> TrafficTracks:
    """Tracks of everyone who is simulated, after the warm-up."""
    end_s = WARM_UP_S + duration_s
    drawn = draw_demand(graph, options, end_s, random)
    plans = draw_signal_plans(network.net_file, random)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawn.write(folder / "trips.rou.xml")
        ElementTree(plans).write(folder / "signals.add.xml", encoding="utf-8")
        write_with_curve_speeds(network.net_file, folder / "roads.net.xml")
        _run(folder, seed, end_s)
        raw = read_raw_tracks(
            (folder / "vehicles.parquet", folder / "persons.parquet"), STEP_S
        )
    return traffic_tracks(raw.shifted(round(WARM_UP_S / STEP_S)), drawn.types, STEP_S)


def _slow_share(tracks: TrafficTracks) -> float:
    """Share of the vehicles' time in which they hardly move."""
    drives = np.array([kind is not AgentKind.PEDESTRIAN for kind in tracks.kinds], bool)
    rows = drives[tracks.agent]
    if not rows.any():
        return 0.0
    speed = np.linalg.norm(tracks.velocity_mps[rows], axis=1)
    return float((speed < SLOW_MPS).mean())


def _run(folder: Path, seed: int, end_s: float) -> None:
    files = "--net-file roads.net.xml --route-files trips.rou.xml --additional-files signals.add.xml"
    files += " --fcd-output vehicles.parquet"
    files += " --person-fcd-output persons.parquet"
    files += " --fcd-output.attributes id,x,y,angle"
    clock = f"--step-length {STEP_S} --device.fcd.begin {WARM_UP_S} --end {end_s}"
    model = f"--lateral-resolution {LATERAL_RESOLUTION_M} --seed {seed % 2**31}"
    model += " --pedestrian.striping.stripe-width 0.5"
    rules = f"--time-to-teleport {JAM_S} --time-to-teleport.remove true"
    rules += " --collision.action none --intermodal-collision.action none"
    rules += " --max-depart-delay 15 --ignore-route-errors true"
    quiet = "--no-step-log true --no-warnings true --duration-log.disable true"
    quiet += " --xml-validation never"
    arguments = f"{files} {clock} {model} {rules} {quiet}".split()
    run_sumo_tool("sumo", arguments, folder, limit_s=SIMULATION_LIMIT_S)


def _recording(
    network: Network,
    seed: int,
    tracks: TrafficTracks,
    parked: ParkedVehicles,
    num_steps: int,
) -> Recording:
    num_parked = len(parked.kinds)
    counts = np.concatenate([np.diff(tracks.first_row), np.full(num_parked, num_steps)])
    return Recording(
        name=f"{network.name}-{seed}",
        road_map=network.road_map,
        city=network.family,
        origin_city_m=np.zeros(2),
        step_s=STEP_S,
        num_steps=num_steps,
        ids=(*tracks.ids, *(f"parked-{row:04d}" for row in range(num_parked))),
        kinds=(*tracks.kinds, *parked.kinds),
        size_m=np.concatenate([tracks.size_m, parked.size_m]),
        is_parked=np.arange(len(counts)) >= len(tracks.ids),
        first_step=np.concatenate([tracks.first_step, np.zeros(num_parked, int)]),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(int),
        position_m=np.concatenate(
            [tracks.position_m, np.repeat(parked.position_m, num_steps, axis=0)]
        ),
        heading_rad=np.concatenate(
            [tracks.heading_rad, np.repeat(parked.heading_rad, num_steps)]
        ),
        velocity_mps=np.concatenate(
            [tracks.velocity_mps, np.zeros((num_parked * num_steps, 2))]
        ),
    )
