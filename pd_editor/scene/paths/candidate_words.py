"""Unique descriptions of candidates: route and speed."""

from collections import Counter
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.motion_primitives import CandidateSet
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.thresholds import STANDING_MPS

STRAIGHT_RAD: Final = np.radians(20.0)
"""A smaller change of heading counts as straight on."""
U_TURN_RAD: Final = np.radians(150.0)
SAME_SPEED_MPS: Final = 0.4
SHIFT_M: Final = 0.2
"""Smaller changes of the offset from the lane are not mentioned."""


def candidate_texts(found: CandidateSet, road_map: RoadMap) -> tuple[str, ...]:
    """Describe each valid candidate of the first agent.

    Texts that would be equal also name the length of the candidate.
    """
    valid = np.flatnonzero(found.is_valid[0])
    texts = [
        f"{_route(found, i, road_map)}, {_speed(found, i)}" for i in valid.tolist()
    ]
    counts = Counter(texts)
    length = np.linalg.norm(np.diff(found.position_m[0, valid], axis=1), axis=-1).sum(1)
    texts = [
        f"{text} ({metres:.0f} m)" if counts[text] > 1 else text
        for text, metres in zip(texts, length, strict=True)
    ]
    seen: Counter[str] = Counter()
    unique = []
    counts = Counter(texts)
    for text in texts:
        seen[text] += 1
        is_alone = counts[text] == 1
        unique.append(text if is_alone else f"{text}, way {seen[text]}")
    return tuple(unique)


def _route(found: CandidateSet, index: int, road_map: RoadMap) -> str:
    heading = found.heading_rad[0, index]
    turn = float(wrap_angle(np.diff(heading)).sum())
    shift = float(found.lateral_shift_m[0, index])
    side = "left" if shift > 0 else "right"
    if found.is_lane_change[0, index]:
        return f"Change to the {side} lane"
    if abs(turn) >= U_TURN_RAD:
        way = "U-turn"
    elif abs(turn) >= STRAIGHT_RAD:
        way = "Left" if turn > 0 else "Right"
        place = _turns_at_junction(found, index, road_map)
        way += " at the junction" if place else " along the bend"
    else:
        way = "Straight on"
    if abs(shift) > SHIFT_M:
        way += f", {abs(shift):.1f} m to the {side}"
    return way


def _turns_at_junction(found: CandidateSet, index: int, road_map: RoadMap) -> bool:
    """Whether a candidate drives along a lane in a junction."""
    position = found.position_m[0, index]
    for lane_id in found.lane_ids[0][_slot(found, index)]:
        lane = road_map.lane_of.get(lane_id)
        if lane is not None and lane.is_intersection:
            gap = np.linalg.norm(position[:, None] - lane.centerline_m, axis=-1)
            if gap.min() < _ON_LANE_M:
                return True
    return False


_ON_LANE_M: Final = 2.5


def _slot(found: CandidateSet, index: int) -> int:
    """Index of a candidate into ``lane_ids``, which holds the valid ones only."""
    return int(found.is_valid[0, :index].sum())


def _speed(found: CandidateSet, index: int) -> str:
    speed: Float[np.ndarray, "H"] = np.hypot(*found.velocity_mps[0, index].T)
    start, end = float(speed[0]), float(speed[-1])
    if found.is_standstill[0, index]:
        return "standing" if start < STANDING_MPS else "slowing to stop"
    if end > start + SAME_SPEED_MPS:
        return f"speeding up to {end:.1f} m/s"
    if end < start - SAME_SPEED_MPS:
        return f"slowing to {end:.1f} m/s"
    return f"{end:.1f} m/s"
