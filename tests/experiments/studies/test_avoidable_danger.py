"""Avoidable dangers of real scenes, against boxes of shapely."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.box_overlaps import MIN_OVERLAP_M2
from pd_editor.base.errors import EditError
from pd_editor.experiments.studies.outcomes import avoidable_dangers, ego_of
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.scenario import Scenario
from tests.builders import empty_tracks, scenario_with

SCENES = ("000ace8b", "000e1588", "00195499")


def real_scenario(root: Path, name: str) -> Scenario:
    (folder,) = (root / "val").glob(f"{name}*")
    return read_scenario(folder)


def boxes(scenario: Scenario, agent_id: str) -> np.ndarray:
    agents, now = scenario.agents, scenario.current_step
    (row,) = agents.rows([agent_id])
    there = agents.is_valid[row, now:]
    corners = box_corners(
        agents.position_m[row, now:],
        agents.heading_rad[row, now:],
        np.broadcast_to(agents.size_m[row], (there.size, 2)),
    )
    return np.where(there, np.asarray(shapely.polygons(corners)), np.array(None))


def shared_m2(scenario: Scenario, one: str, other: str) -> np.ndarray:
    both = shapely.intersection(boxes(scenario, one), boxes(scenario, other))
    return np.nan_to_num(shapely.area(both))


@pytest.mark.parametrize("name", SCENES)
def test_the_ego_hits_what_it_could_avoid(av2_root: Path, name: str):
    scenario = real_scenario(av2_root, name)
    found = avoidable_dangers(scenario)
    assert found
    assert [one.impact_mps for one in found] == sorted(
        (one.impact_mps for one in found), reverse=True
    )
    for one in found[:2]:
        endangered = one.behaviour.apply(scenario)
        shared = shared_m2(endangered, one.ego_id, one.agent_id)
        step = int(np.argmax(shared > MIN_OVERLAP_M2))
        assert shared[step] > MIN_OVERLAP_M2
        assert step * scenario.time_axis.step_s == pytest.approx(one.time_s)
        escaped = one.escape.apply(endangered)
        others = set(scenario.agents.ids) - {one.ego_id}
        at_start = {
            other
            for other in others
            if shared_m2(escaped, one.ego_id, other)[0] > MIN_OVERLAP_M2
        }
        for other in others - at_start:
            hit = shared_m2(escaped, one.ego_id, other).max()
            assert hit <= MIN_OVERLAP_M2 + 1e-6, other


def test_without_an_ego_it_says_so():
    with pytest.raises(EditError, match="neither an ego"):
        ego_of(replace(scenario_with(empty_tracks(110)), focal_id=""))
