"""Post-processing of scenes: snap to lanes, separate overlaps, limit speeds, smooth motion, yield."""

from pd_editor.analysis.repair.braking_speeds import slow_for_gaps
from pd_editor.analysis.repair.lane_projection import project_to_lanes
from pd_editor.analysis.repair.retimed_trajectories import (
    retime_for_comfort,
    yield_to_others,
)
from pd_editor.analysis.repair.separation import separate_overlaps

__all__ = [
    "project_to_lanes",
    "retime_for_comfort",
    "separate_overlaps",
    "slow_for_gaps",
    "yield_to_others",
]
