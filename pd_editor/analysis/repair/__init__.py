"""Post-processing of scenes: snap to lanes, separate overlaps, limit speeds, smooth motion, yield."""

from pd_editor.analysis.repair.retimed_trajectories import (
    retime_for_comfort,
    yield_to_others,
)
from pd_editor.analysis.repair.state_repairs import (
    project_to_lanes,
    separate_overlaps,
    slow_for_gaps,
)

__all__ = [
    "project_to_lanes",
    "retime_for_comfort",
    "separate_overlaps",
    "slow_for_gaps",
    "yield_to_others",
]
