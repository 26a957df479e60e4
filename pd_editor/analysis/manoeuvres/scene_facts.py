"""All that an index knows of a scene: its events, and facts such as how dense and fast it is."""

from dataclasses import dataclass
from itertools import chain
from typing import Final

import numpy as np

from pd_editor.analysis.manoeuvres.events import (
    Pairs,
    SceneEvent,
    cut_ins,
    followings,
    hard_brakings,
    lane_changes,
    meetings,
    near_misses,
    on_crosswalks,
    passings,
    stops,
    turns_and_crossings,
)
from pd_editor.analysis.manoeuvres.tracks import LIMITS, LaneTracks, Motion, lane_tracks
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.lanes.lane_graph import LaneGraph, lane_graph
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

_COUNTED: Final = {
    "vehicles": AgentKind.VEHICLE,
    "buses": AgentKind.BUS,
    "motorcyclists": AgentKind.MOTORCYCLIST,
    "cyclists": AgentKind.CYCLIST,
    "pedestrians": AgentKind.PEDESTRIAN,
}
_NUMBERS: Final = ("density", "speed", "speed-p85", "curvature", "duration")
_TEXTS: Final = ("city", "junction", "format", "origin", "edited", "warped")
FACTS: Final[dict[str, type[float] | type[str]]] = {
    **dict.fromkeys(("agents", *_COUNTED, *_NUMBERS), float),
    **dict.fromkeys(_TEXTS, str),
}
"""Facts of scenes by name.

density: motor vehicles that move or stand on lanes, at the current step, per km of lane;
speed: m/s of those who move, mean and 85th percentile; curvature: degrees that lanes outside
junctions turn in 100 m; origin: id of the scenario that an edited one was made from.
"""
_YES_NO: Final = ("yes", "no")
FACT_VALUES: Final = {
    "junction": ("roundabout", "signalised", "plain", "none"),
    "edited": _YES_NO,
    "warped": _YES_NO,
}
"""All values of those that have few."""


def scene_facts(
    scenario: Scenario, motion: Motion, lanes: LaneTracks
) -> dict[str, float | str]:
    """The values of ``FACTS``, from a scenario's motion and the lanes that it follows."""
    kinds, graph = motion.agents.kinds, lane_graph(scenario.road_map)
    driving = graph.allowed(DRIVING_LANES)
    km = float(graph.lengths_m[driving].sum()) / 1000 if driving.any() else 0.0
    step = int(np.abs(motion.time_s).argmin()) if len(motion.time_s) else 0
    on_lane = (lanes.lane >= 0) & (np.abs(lanes.offset_m) <= LIMITS.off_lane_m)
    # Who has not moved has its lane at its first step alone.
    on_lane = np.where(motion.has_moved, on_lane[:, step], on_lane.any(axis=1))
    cars = motion.is_follower & ~motion.agents.kind_mask({AgentKind.CYCLIST})
    counts = motion.agents.is_valid[:, step] & on_lane & cars
    is_moving = motion.agents.is_valid & (motion.speed_mps > MOVING_MPS)
    speed = motion.speed_mps[is_moving & cars[:, None]]
    provenance = scenario.provenance
    made = bool(provenance.base or provenance.edited_ids)
    numbers = {
        "agents": len(kinds),
        **{name: kinds.count(kind) for name, kind in _COUNTED.items()},
        "density": counts.sum() / km if km else 0.0,
        "speed": speed.mean() if len(speed) else 0.0,
        "speed-p85": np.percentile(speed, 85) if len(speed) else 0.0,
        "curvature": _curvature(graph, scenario),
        "duration": scenario.time_axis.duration_s,
    }
    return {
        **{name: round(float(value), 2) for name, value in numbers.items()},
        "city": scenario.city,
        "junction": _junction(graph, scenario),
        "format": provenance.file_format or "Argoverse 2",
        "origin": provenance.base.root.scenario_id if provenance.base else "",
        "edited": "yes" if made or scenario.is_warped else "no",
        "warped": "yes" if scenario.is_warped else "no",
    }


def _turns(graph: LaneGraph) -> np.ndarray:
    """Total turn of each lane in radians, to the left."""
    search = graph.search
    turn = wrap_angle(np.diff(search.heading_rad, append=0.0))
    turn[search.last_of_lane] = 0.0
    return np.bincount(search.lane, weights=turn, minlength=len(graph.lane_ids))


def _curvature(graph: LaneGraph, scenario: Scenario) -> float:
    of = scenario.road_map.lane_of
    plain = np.array([not of[one].is_intersection for one in graph.lane_ids], bool)
    if not plain.any():
        return 0.0
    turn = np.degrees(np.abs(_turns(graph)[plain]).sum())
    return float(turn / graph.lengths_m[plain].sum() * 100)


def _junction(graph: LaneGraph, scenario: Scenario) -> str:
    if not graph.lane_ids:
        return "none"
    if _has_roundabout(graph):
        return "roundabout"
    if scenario.signals:
        return "signalised"
    lanes = scenario.road_map.lanes
    return "plain" if any(one.is_intersection for one in lanes) else "none"


def _has_roundabout(graph: LaneGraph) -> bool:
    """Whether lanes that all bend one way lead around in a short circle."""
    turns = _turns(graph)
    for sign in (1, -1):
        bends = sign * turns > np.maximum(graph.lengths_m, 1.0) / LIMITS.roundabout_m
        for start in np.flatnonzero(bends).tolist():
            angles, left = {start: abs(turns[start])}, [start]
            while left:
                one = left.pop()
                for after in graph.successors[one]:
                    if after == start and abs(angles[one] - 2 * np.pi) < np.pi / 2:
                        return True
                    if bends[after] and after not in angles and angles[one] < 2 * np.pi:
                        angles[after] = angles[one] + abs(turns[after])
                        left.append(after)
    return False


@dataclass(frozen=True, kw_only=True)
class SceneContent:
    """What happens in a scene."""

    events: tuple[SceneEvent, ...]
    """In the order of their times."""
    facts: dict[str, float | str]
    """Values by the names of ``FACTS``."""


def scene_content(scenario: Scenario) -> SceneContent:
    """Events and facts of a scenario's road users.

    They are read from the tracks and, where there is one, the map; the tracks may have
    gaps, and the lanes may be cut into any pieces.
    """
    motion = Motion.of(scenario)
    lanes = lane_tracks(scenario.road_map, motion)
    changes, met = list(lane_changes(motion, lanes)), list(meetings(motion, lanes))
    pairs = Pairs.of(motion, lanes)
    found = chain(
        changes,
        turns_and_crossings(motion, lanes),
        stops(motion, lanes),
        hard_brakings(motion),
        on_crosswalks(motion, scenario),
        followings(pairs),
        cut_ins(pairs, changes),
        met,
        passings(pairs),
        near_misses(motion, met),
    )
    found = found if len(motion) else ()
    order = sorted(found, key=lambda one: (one.begin_s, one.kind, one.agent_id))
    return SceneContent(
        events=tuple(order),
        facts=scene_facts(scenario, motion, lanes),
    )
