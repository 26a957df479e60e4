"""Mending scenes: onto lanes, apart, and slow enough; pure functions, no torch."""

from pd_editor.repair.braking_speeds import slow_for_gaps
from pd_editor.repair.lane_projection import project_to_lanes
from pd_editor.repair.repair_report import RepairChange, RepairProblem, RepairReport
from pd_editor.repair.repair_scene import repair_scene
from pd_editor.repair.separation import separate_overlaps
from pd_editor.repair.trajectory_retiming import retime_futures, wait_for_others

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
