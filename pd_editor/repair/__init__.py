"""Mending scenes: onto lanes, apart, and slow enough; pure functions, no torch."""

from pd_editor.repair.future_retiming import retime_futures, wait_for_others
from pd_editor.repair.gap_speeds import slow_for_gaps
from pd_editor.repair.lane_projection import project_to_lanes
from pd_editor.repair.repair_scene import repair_scene
from pd_editor.repair.report import RepairChange, RepairProblem, RepairReport
from pd_editor.repair.separation import separate_overlaps

__all__ = [
    "RepairChange",
    "RepairProblem",
    "RepairReport",
    "project_to_lanes",
    "repair_scene",
    "retime_futures",
    "separate_overlaps",
    "slow_for_gaps",
    "wait_for_others",
]
