"""Lanes, links and centre lines of real OpenDRIVE files, as another reader has them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.geometry.polyline import densify
from pd_editor.scene.road_map import Lane
from tests.oracles.environment import Oracle

pytestmark = [pytest.mark.slow, pytest.mark.oracle]
SAME_M = 0.1
"""Pyxodr goes by steps of 0.1 m; by steps of 0.02 m all gaps are below 0.02 m."""
NOT_DRIVEN = {"border", "sidewalk", "restricted", "stop", "none", None}


def gap_m(lane: Lane, origin_m: np.ndarray, other: np.ndarray) -> float:
    """Largest distance between two centre lines in the same direction."""
    own = lane.centerline_m + origin_m
    ends = np.hypot(*(own[[0, -1]] - other[[0, -1]]).T).max()
    if ends > 2.0:
        return np.inf
    lines = [shapely.simplify(shapely.LineString(one), 1e-3) for one in (own, other)]
    points = [
        shapely.points(densify(shapely.get_coordinates(one), 2.0)) for one in lines
    ]
    gaps = (
        shapely.distance(lines[0], points[1]),
        shapely.distance(lines[1], points[0]),
    )
    return float(max(one.max() for one in gaps))


def test_real_maps(format_files: Path, oracle: Callable[[str], Oracle]):
    paths = sorted((format_files / "opendrive").glob("*.xodr"))
    answers = oracle("opendrive").ask("opendrive_lanes.py", [str(one) for one in paths])
    for path, theirs in zip(paths, answers, strict=True):
        scene, name_of = open_scenario(path), {}
        driven = {n for n, one in theirs.items() if one["kind"] not in NOT_DRIVEN}
        lines = {name: np.array(theirs[name]["center_m"]) for name in driven}
        for lane in scene.road_map.lanes:
            gaps = {
                name: gap_m(lane, scene.origin_city_m, line)
                for name, line in lines.items()
            }
            name = min(gaps, key=gaps.__getitem__)
            assert gaps[name] < SAME_M, (path.name, lane.lane_id, gaps[name])
            name_of[lane.lane_id] = name
        # Each lane is there, and none twice.
        assert sorted(name_of.values()) == sorted(driven), path.name
        known = scene.road_map.lane_of
        links = {
            (name_of[one], name_of[after])
            for one, lane in known.items()
            for after in lane.successors
        }
        told = {(one, after) for one in driven for after in theirs[one]["after"]}
        assert {pair for pair in told if pair[1] in driven} <= links, path.name
