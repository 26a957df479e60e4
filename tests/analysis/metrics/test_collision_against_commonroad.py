"""Collisions of real road users against CommonRoad's drivability checker.

The checker calls every common point of two rectangles a collision. The same question
is put to ``boxes_touch``; that tables count only boxes that share more than 0.05 m^2
is accounted for apart, with areas by shapely.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.box_overlaps import (
    MIN_OVERLAP_M2,
    boxes_touch,
    overlapping_pairs,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import box_corners, overlap_area
from tests.oracles.environment import Oracle

STEPS = np.arange(4, 110, 5)
"""The state's step, 49, and every fifth one before and after."""
MIN_EQUAL = 0.99
ROUNDING_M2 = 1e-9
"""``overlap_area`` leaves so little at most between boxes that stand apart."""

pytestmark = [pytest.mark.slow, pytest.mark.oracle, pytest.mark.real_data]


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedPairs:
    """All pairs of road users of one scene at one step, P each."""

    is_near: np.ndarray
    """Whether the circles around the boxes meet: nothing else can touch."""
    touch: np.ndarray
    """By ``boxes_touch``."""
    has_area: np.ndarray
    """By ``overlap_area``."""
    counts: np.ndarray
    """By ``overlapping_pairs``, as tables count."""
    commonroad: np.ndarray
    """By the checker."""
    shared_m2: np.ndarray
    """By shapely; 0 for pairs that are not near."""


def boxes_at(agents: AgentTracks, step: int) -> list[list[float]]:
    """Boxes of the agents that exist at a step, as the checker's script reads them."""
    valid = agents.is_valid[:, step]
    columns = (agents.position_m[:, step], agents.heading_rad[:, step, None])
    return np.hstack([*columns, agents.size_m])[valid].tolist()


def compared(agents: AgentTracks, step: int, found: list[list[int]]) -> ComparedPairs:
    agents = agents.taken(np.flatnonzero(agents.is_valid[:, step]))
    position, heading = agents.position_m[:, step], agents.heading_rad[:, step]
    size, num_agents = agents.size_m, len(agents)
    a, b = np.triu_indices(num_agents, 1)

    def among_all(pairs: np.ndarray) -> np.ndarray:
        table = np.zeros((num_agents, num_agents), bool)
        table[pairs[:, 0], pairs[:, 1]] = True
        assert not table[b, a].any()
        return table[a, b]

    offset = position[b] - position[a]
    reach = np.hypot(size[:, 0], size[:, 1]) / 2
    is_near = np.hypot(*offset.T) <= reach[a] + reach[b]
    corners = box_corners(position, heading, size)
    boxes = np.asarray(shapely.polygons(corners))
    shared = np.zeros(len(a))
    shared[is_near] = shapely.area(
        shapely.intersection(boxes[a[is_near]], boxes[b[is_near]])
    )
    return ComparedPairs(
        is_near=is_near,
        touch=boxes_touch(agents.at(a, step), agents.at(b, step)),
        has_area=overlap_area(corners[a], corners[b]) > ROUNDING_M2,
        counts=among_all(overlapping_pairs(agents, step)),
        commonroad=among_all(np.array(found, int).reshape(-1, 2)),
        shared_m2=shared,
    )


@pytest.fixture(scope="module")
def pairs(
    oracle: Callable[[str], Oracle], av2_scenario_folders: list[Path]
) -> ComparedPairs:
    """Pairs of all full scenarios (train and val) at all compared steps."""
    scenes = []
    for folder in av2_scenario_folders:
        if folder.parent.name in ("train", "val"):
            agents = read_scenario(folder).agents
            is_user = agents.kind_mask(ROAD_USER_KINDS)
            scenes.append(agents.taken(np.flatnonzero(is_user)))
    boxes = [[boxes_at(agents, step) for step in STEPS.tolist()] for agents in scenes]
    answers = oracle("commonroad").ask("commonroad_pairs.py", boxes)
    parts = [
        compared(agents, step, found)
        for agents, answer in zip(scenes, answers, strict=True)
        for step, found in zip(STEPS.tolist(), answer, strict=True)
    ]
    assert len(parts) == len(scenes) * len(STEPS) > 0
    return ComparedPairs(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ComparedPairs.__dataclass_fields__
        }
    )


def test_touching_pairs_are_those_of_commonroad(
    pairs: ComparedPairs, say: Callable[[str], None]
):
    theirs = pairs.commonroad
    groups = {
        "all pairs": np.ones(len(theirs), bool),
        "pairs whose circles meet": pairs.is_near,
        "pairs that either calls touching": pairs.touch | theirs,
    }
    assert theirs.sum() > 100
    for name, group in groups.items():
        same = (pairs.touch == theirs)[group]
        area_same = (pairs.has_area == theirs)[group]
        say(
            f"{name}: {same.sum()} of {same.size} equal ({same.mean():.4%}), "
            f"by shared area {area_same.sum()} ({area_same.mean():.4%})"
        )
        assert same.mean() >= MIN_EQUAL, name
        assert area_same.mean() >= MIN_EQUAL, name


def test_what_tables_count_differs_by_the_area_rule_alone(
    pairs: ComparedPairs, say: Callable[[str], None]
):
    theirs, counts = pairs.commonroad, pairs.counts
    grazes = theirs & (pairs.shared_m2 <= MIN_OVERLAP_M2)
    same = counts == theirs
    say(
        f"counted {counts.sum()}, touching {theirs.sum()}, of these {grazes.sum()} "
        f"share no more than {MIN_OVERLAP_M2} m^2; "
        f"{same.sum()} of {same.size} pairs equal ({same.mean():.4%}), "
        f"{same[pairs.is_near].mean():.4%} of those whose circles meet"
    )
    assert same.mean() >= MIN_EQUAL
    assert (counts == (theirs & ~grazes)).mean() >= MIN_EQUAL
    assert (counts == (theirs & ~grazes))[theirs | counts].mean() >= MIN_EQUAL
