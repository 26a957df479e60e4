"""Post-processing of scenes: snap to lanes, separate overlaps, limit speeds, smooth motion, yield."""

from pd_editor.repair.braking_speeds import slow_for_gaps
from pd_editor.repair.comfort_retiming import retime_for_comfort
from pd_editor.repair.lane_projection import project_to_lanes
from pd_editor.repair.repair_report import RepairChange, RepairProblem, RepairReport
from pd_editor.repair.repair_scene import repair_scene
from pd_editor.repair.separation import separate_overlaps
from pd_editor.repair.trajectory_retiming import retime_trajectories, yield_to_others

__all__ = [
    "RepairChange",
    "RepairProblem",
    "RepairReport",
    "project_to_lanes",
    "repair_scene",
    "retime_for_comfort",
    "retime_trajectories",
    "separate_overlaps",
    "slow_for_gaps",
    "yield_to_others",
]
