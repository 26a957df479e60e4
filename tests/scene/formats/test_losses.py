"""What of a scene comes back from each format, and that the rest is told."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.formats.scene_format import parts_of
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from tests.scene.formats.test_recording_writers import (
    signalled,
    there_and_back,
    written,
)

WORDS = {
    "marks": "marking",
    "paved": "drivable areas",
    "neighbors": "neighbours",
    "junctions": "intersection",
}
"""How parts are called in sentences of a format's own."""


def full_scene() -> Scenario:
    """A scene with something of every part."""
    scenario = signalled()
    road_map, agents = scenario.road_map, scenario.agents
    lanes = list(road_map.lanes)
    for row, one in enumerate(lanes):
        lines = {
            name: getattr(one, name) + np.array([0.0, 0.0, 2.0])
            for name in ("centerline", "left", "right")
        }
        lanes[row] = replace(one, **lines)
    alone = [n for n, one in enumerate(lanes) if one.left_neighbor is None]
    bike, inner = alone[:2]
    lanes[bike] = replace(lanes[bike], kind=LaneKind.BIKE)
    oncoming = next(one.lane_id for one in lanes if leads_against(one, lanes[inner]))
    lanes[inner] = replace(lanes[inner], left_neighbor=oncoming)
    kinds = [AgentKind.VEHICLE, *AgentKind] * len(agents)
    rows = np.arange(len(agents))
    agents = replace(
        agents,
        kinds=tuple(kinds[: len(agents)]),
        has_known_size=rows % 2 == 0,
        activity=np.where(rows % 3, Activity.UNKNOWN, Activity.PARKED).astype(np.int8),
        has_made_up_past=rows % 4 == 0,
    )
    return replace(
        scenario,
        agents=agents,
        road_map=replace(road_map, lanes=tuple(lanes)),
        time_axis=replace(scenario.time_axis, current_step=55),
        source_fields={"weather": "dry"},
    )


def leads_against(one: Any, other: Any) -> bool:
    ways = [n.centerline_m[-1] - n.centerline_m[0] for n in (one, other)]
    return ways[0] @ ways[1] < 0 and one.left_neighbor is None


def facts(scenario: Scenario) -> dict[str, Any]:
    """Each part of a scene, without ids and as far as it can be counted."""
    road_map, agents = scenario.road_map, scenario.agents
    known, now = road_map.lane_of, scenario.current_step
    focal = agents.row_of.get(scenario.focal_id)
    links = [n for one in known.values() for n in one.successors]
    back = [n for one in known.values() for n in one.predecessors]
    beside = [n for one in known.values() for n in (one.left_neighbor, one.right_neighbor)]  # fmt: skip
    return {
        "signals": sorted(
            tuple(one.states[now - 5 : now + 50].tolist())
            for one in scenario.signals
            for _ in one.lane_ids
        ),
        "signal names": sorted(one.signal_id for one in scenario.signals),
        "shared signals": sorted(len(one.lane_ids) for one in scenario.signals),
        "fields": scenario.source_fields,
        "links": sum(n in known for n in links),
        "neighbors": sum(n in known for n in beside) - len(road_map.oncoming),
        "oncoming": len(road_map.oncoming),
        "outside": sum(n not in known for n in links + back),
        "lane kinds": Counter(one.kind for one in known.values()),
        "junctions": sum(one.is_intersection for one in known.values()),
        "marks": Counter(
            mark for one in known.values() for mark in (one.left_mark, one.right_mark)
        ),
        "heights": bool(known and next(iter(known.values())).left[:, 2].any()),
        "crosswalks": len(road_map.crosswalks),
        "paved": round(area_m2(road_map), -3),
        "city": scenario.city,
        "now": np.round(agents.position_m[0, now] + scenario.origin_city_m, 1).tolist(),
        "focal": None
        if focal is None
        else np.round(
            agents.position_m[focal, 60] + scenario.origin_city_m, 1
        ).tolist(),
        "categories": Counter(agents.categories),
        "static kinds": Counter(agents.kinds),
        "assumed": int(agents.has_known_size.sum()),
        "made up": int(agents.has_made_up_past.sum()),
        "activity": Counter(agents.activity.tolist()),
    }


def area_m2(road_map: RoadMap) -> float:
    rings = [one.boundary[:, :2] for one in road_map.drivable_areas]
    nexts = [np.roll(ring, -1, axis=0) for ring in rings]
    return sum(
        abs(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())) / 2
        for a, b in zip(rings, nexts, strict=True)
    )


@pytest.mark.parametrize(
    "name", ["av2", "commonroad", "gpudrive", "opendrive", "scenarionet", "sumo"]
)
def test_nothing_is_lost_untold(name: str, tmp_path: Path):
    """Elevations, kinds of static objects, the current step, the city were, in some."""
    scenario = full_scene()
    before = facts(scenario)
    parts = parts_of(scenario)
    assert before.keys() == parts.keys()
    assert all(is_in for _, is_in in parts.values())
    after = facts(there_and_back(scenario, name, tmp_path))
    told = " ".join(written(scenario, name).losses).lower()
    lost = {part for part, value in before.items() if after[part] != value}
    untold = {n for n in lost if parts[n][0] not in told and WORDS.get(n, "-") not in told}  # fmt: skip
    assert not untold
    assert lost or name == "av2"


def test_only_what_is_in_a_scene_is_told_as_lost():
    scenario = open_scenario("roundabout")
    agents = scenario.agents
    assert EGO_ID in agents.ids
    plain = replace(
        scenario,
        city="",
        agents=replace(agents, has_known_size=np.ones(len(agents), bool)),
    )
    told = " ".join(written(plain, "commonroad").losses)
    for part in ("signals", "heights", "city", "static kinds", "assumed", "activity"):
        assert parts_of(scenario)[part][0] not in told.lower()


def test_neighbours_that_lead_the_other_way_are_none_to_change_to(tmp_path: Path):
    """CommonRoad was told that they lead the same way, and ScenarioNet, which has no others."""
    scenario = full_scene()
    ((_, other),) = scenario.road_map.oncoming
    (xml,) = (
        data
        for file, data in written(scenario, "commonroad").files.items()
        if file.endswith(".xml")
    )
    assert xml.count(b'drivingDir="opposite"') == 1
    assert f'<adjacentLeft ref="{other}" drivingDir="opposite"/>'.encode() in xml
    found = there_and_back(scenario, "scenarionet", tmp_path)
    assert not found.road_map.oncoming


def test_a_scene_without_an_ego_is_told(tmp_path: Path):
    scenario = signalled()
    agents = scenario.agents
    ids = tuple("one" if name == EGO_ID else name for name in agents.ids)
    focal = scenario.focal_id
    without = replace(scenario, agents=replace(agents, ids=ids), focal_id=focal)
    for name in ("gpudrive", "scenarionet"):
        told = f"There is no ego: {focal} is the car that drives itself."
        assert told in written(without, name).losses
        assert told not in written(scenario, name).losses
