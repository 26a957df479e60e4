"""Scores of a drive, by the names and bounds of nuPlan's closed-loop metrics.

Source: nuplan-devkit, ``docs/metrics_description.md``. Maps without speed limits have no
score of them, and progress is told in metres, since no expert drives for so long.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.metrics.lanes import WRONG_WAY_M
from pd_editor.analysis.metrics.motion import kinematics
from pd_editor.analysis.metrics.road import is_past_lanes, outside_m
from pd_editor.analysis.metrics.safety import least_times_s
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.experiments.evaluation.summary import mean_over_scenes, scene_weights
from pd_editor.experiments.report import (
    Report,
    ReportTable,
    Section,
    command_section,
    table_of_first,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

LEAST_TTC_S: Final = 0.95
MOST_OUTSIDE_M: Final = 0.3
_FRONT_COSINE: Final = 0.7
"""Least cosine between the heading and the way to a box that the front hits."""


@dataclass(frozen=True, kw_only=True)
class DriveScores:
    """How one agent drove in a roll-out; each bound is kept or not."""

    driven_s: float
    """Time until it left the map, or the roll-out ended."""
    ego_progress_along_route_m: float
    """While it is on the drivable area, for who drives beside it gets nowhere."""
    no_ego_at_fault_collisions: bool
    num_collisions: int
    """Agents that it collided with, whoever is at fault."""
    time_to_collision_within_bound: bool
    drivable_area_compliance: bool
    driving_direction_compliance: bool
    ego_is_comfortable: bool
    is_possible_motion: bool
    """Whether accelerations and curvatures are what vehicles can do; ours."""

    @property
    def in_words(self) -> str:
        """One line."""
        kept = {
            "no collision at fault": self.no_ego_at_fault_collisions,
            "time to collision": self.time_to_collision_within_bound,
            "drivable area": self.drivable_area_compliance,
            "direction": self.driving_direction_compliance,
            "comfort": self.ego_is_comfortable,
            "possible motion": self.is_possible_motion,
        }
        missed = [name for name, is_kept in kept.items() if not is_kept]
        how = f"missed: {', '.join(missed)}" if missed else "all bounds kept"
        collisions = (
            f"{self.num_collisions} collision{'s' * (self.num_collisions != 1)}"
        )
        return (
            f"{self.ego_progress_along_route_m:.0f} m in {self.driven_s:.1f} s, "
            f"{collisions}; {how}"
        )


def drive_scores(
    rolled: Scenario, ego_id: str, route_m: Float[np.ndarray, "N 2"]
) -> DriveScores:
    """Scores of an agent from the current step on.

    Raises:
        EditError: the agent is not in the scenario.
    """
    agents, now = rolled.agents, rolled.current_step
    row = int(agents.rows([ego_id])[0])
    steps = now + np.flatnonzero(agents.is_valid[row, now:])
    hit, fault = _collisions(rolled, row, steps)
    view = recorded_traffic(rolled, [ego_id])
    count = len(view.everyone)
    (least,), _ = least_times_s(view, np.zeros((count, count), bool))
    moves = kinematics(view)
    corners = agents.boxes[row, steps].corners_m()
    off = outside_m(rolled, corners) > MOST_OUTSIDE_M
    # Who leaves by the end of the mapped road is not off it.
    way = np.broadcast_to(
        unit_vector(agents.heading_rad[row, steps])[:, None], corners.shape
    )
    off[off] = ~is_past_lanes(rolled.road_map, corners[off], way[off], least_m=0.0)
    is_off = np.asarray(off.any(axis=1))
    centers = shapely.points(agents.position_m[row, steps])
    along = np.asarray(shapely.line_locate_point(shapely.LineString(route_m), centers))
    return DriveScores(
        driven_s=float((steps[-1] - now) * rolled.time_axis.step_s),
        ego_progress_along_route_m=float(np.diff(along)[~is_off[1:]].sum()),
        no_ego_at_fault_collisions=not fault,
        num_collisions=hit,
        time_to_collision_within_bound=bool(least >= LEAST_TTC_S),
        drivable_area_compliance=not is_off.any(),
        driving_direction_compliance=_wrong_way_m(rolled, row, steps) < WRONG_WAY_M,
        ego_is_comfortable=not (moves.is_uncomfortable() & moves.is_valid).any(),
        is_possible_motion=not (moves.is_impossible() & moves.is_valid).any(),
    )


def nuplan_scores(drives: Sequence[DriveScores]) -> Float[np.ndarray, "N"]:
    """Score of each drive of one scene, as nuPlan adds them up but for speed limits.

    From 0 to 1. Progress is told beside the furthest of the drives, where nuPlan has an
    expert's.
    """
    progress = np.array([max(one.ego_progress_along_route_m, 0.0) for one in drives])
    # Nobody has to move where nobody does.
    most = progress.max(initial=0.0)
    share = progress / most if most else np.ones_like(progress)
    kept = [
        one.no_ego_at_fault_collisions
        and one.drivable_area_compliance
        and one.driving_direction_compliance
        for one in drives
    ]
    soft = [
        5 * one.time_to_collision_within_bound + 2 * one.ego_is_comfortable
        for one in drives
    ]
    makes_progress = share >= 0.2
    return np.array(kept) * makes_progress * (np.array(soft) + 5 * share) / 12


def _collisions(rolled: Scenario, row: int, steps: np.ndarray) -> tuple[int, int]:
    """Number of agents that are hit, and of those that the agent's front hits."""
    agents = rolled.agents
    users = np.flatnonzero(agents.kind_mask(ROAD_USER_KINDS))
    own = int(np.flatnonzero(users == row)[0])
    pairs, first = first_overlap(agents.taken(users), steps)
    of_ego = (pairs == own).any(axis=1)
    begun = first[of_ego] > steps[0]
    others = users[pairs[of_ego][begun].sum(axis=1) - own]
    at = first[of_ego][begun]
    moves = agents.speed_mps()[row, at] > STANDING_MPS
    gap = agents.position_m[others, at] - agents.position_m[row, at]
    gap /= np.maximum(np.linalg.norm(gap, axis=-1, keepdims=True), 1e-6)
    ahead = (gap * unit_vector(agents.heading_rad[row, at])).sum(-1)
    stands = agents.speed_mps()[others, at] <= STANDING_MPS
    return len(others), int((moves & (stands | (ahead > _FRONT_COSINE))).sum())


def _wrong_way_m(rolled: Scenario, row: int, steps: np.ndarray) -> float:
    """Way that is driven against the nearest lane."""
    position = rolled.agents.position_m[row, steps]
    lanes = nearest_lanes(rolled.road_map, position)
    moved = np.diff(position, axis=0)
    along = (moved * unit_vector(lanes.heading_rad[:-1])).sum(-1)
    return float(-np.minimum(along, 0.0)[lanes.is_valid[:-1]].sum())


_SHOWN: Final = (
    ("score", "score, %", "share"),
    ("ego_progress_along_route_m", "progress, m", "m"),
    ("driven_s", "driven, s", "s"),
    ("num_collisions", "collisions", ""),
    ("no_ego_at_fault_collisions", "none at fault, %", "share"),
    ("time_to_collision_within_bound", "time to collision, %", "share"),
    ("drivable_area_compliance", "drivable area, %", "share"),
    ("driving_direction_compliance", "direction, %", "share"),
    ("ego_is_comfortable", "comfort, %", "share"),
    ("is_possible_motion", "possible motion, %", "share"),
)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What a policy did in a scene."""

    scene: str
    policy: str
    folder: str
    """Name of the result's folder."""
    ended: str
    """When and why driven agents were not driven to the end."""
    has_failed: bool
    """Whether a policy failed."""
    scores: DriveScores | None
    """None if a policy failed, or none drove the ego."""
    guidance: tuple[str, ...] = ()
    """What was achieved of each term."""

    @property
    def in_words(self) -> str:
        """One line."""
        how = f"{self.scores.in_words}." if self.scores else "failed." * self.has_failed
        return f"{self.policy}: {' '.join(filter(None, (how, self.ended)))}"

    def to_json(self) -> dict[str, Any]:
        """Values for a file."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Drive":
        """The drive of ``to_json``.

        Raises:
            TypeError: there are other values than these.
        """
        scores = values["scores"]
        guidance = tuple(values.get("guidance", ()))
        scored = DriveScores(**scores) if scores else None
        return cls(**{**values, "scores": scored, "guidance": guidance})


def _names(drives: Sequence[Drive]) -> tuple[list[str], list[str]]:
    """Policies and scenes, in the order of the drives."""
    policies = dict.fromkeys(one.policy for one in drives)
    return list(policies), list(dict.fromkeys(one.scene for one in drives))


def policy_values(drives: Sequence[Drive]) -> dict[str, Float[np.ndarray, "P N"]]:
    """Scores of P policies in N scenes, in the order of the drives; NaN where there is none.

    A drive that failed has the score 0 and no other value.
    """
    policies, scenes = _names(drives)
    names = ["score", *(one.name for one in fields(DriveScores))]
    values = {name: np.full((len(policies), len(scenes)), np.nan) for name in names}
    for column, scene in enumerate(scenes):
        own = {policies.index(one.policy): one for one in drives if one.scene == scene}
        values["score"][list(own), column] = 0.0
        driven = {row: one.scores for row, one in own.items() if one.scores is not None}
        rows, scores = list(driven), list(driven.values())
        values["score"][rows, column] = nuplan_scores(scores)
        for name in names[1:]:
            values[name][rows, column] = [float(getattr(one, name)) for one in scores]
    return values


def drive_report(
    drives: Sequence[Drive], failures: Mapping[str, str], command: str, seed: int
) -> Report:
    """The report of all drives, and of what failed, by scene or scene and policy."""
    values = policy_values(drives)
    policies, _ = _names(drives)
    there = {name: np.isfinite(values[name]) for name, *_ in _SHOWN}
    num_failed = Counter(one.policy for one in drives if one.has_failed)
    weights = scene_weights(there["score"].shape[1], seed)
    means = {
        name: mean_over_scenes(np.nan_to_num(values[name]), is_there * 1.0, weights)
        for name, is_there in there.items()
    }
    table = ReportTable(
        title="Policies",
        header=("policy", "scenes", "failed", *(title for _, title, _ in _SHOWN)),
        rows=tuple(
            (
                policy,
                str(there["score"][row].sum()),
                str(num_failed[policy]),
                *(means[name].cell((row,), unit) for name, _, unit in _SHOWN),
            )
            for row, policy in enumerate(policies)
        ),
        note="Means over scenes with 95 % intervals by resampling scenes; bounds: share of scenes "
        "in which each is kept. The score is nuPlan's aggregate, where progress, made on the "
        "drivable area alone, counts beside that of the policy which comes furthest; a failed "
        "drive has the score 0 and counts nowhere else. Scenes carry no speed limits to score.",
    )
    return Report(
        title="Closed loop",
        sections=(
            Section(title="By policy", tables=(table,)),
            Section(title="Every drive", tables=(_gallery(drives, values),)),
            Section(
                title="What failed",
                tables=table_of_first(
                    "Scenes and drives without a score",
                    ("scene", "why"),
                    tuple(failures.items()),
                    most=len(failures),
                ),
            ),
            command_section(command),
        ),
    )


def _gallery(
    drives: Sequence[Drive], values: Mapping[str, Float[np.ndarray, "P N"]]
) -> ReportTable:
    """All drives, those with the lowest scores first."""
    policies, scenes = _names(drives)
    rows = []
    for one in drives:
        at = policies.index(one.policy), scenes.index(one.scene)
        score = float(values["score"][at])
        how = one.in_words.removeprefix(f"{one.policy}: ")
        shown = "failed" if one.has_failed else f"{100 * score:.0f}"
        edit = f"`pd-editor edit {Path(one.folder)}`"
        rows.append((score, (one.policy, one.scene, shown, how, edit)))
    rows.sort(key=lambda row: row[0])
    return ReportTable(
        title="Every drive, to open in the editor",
        header=("policy", "scene", "score, %", "how it drove", "open"),
        rows=tuple(row for _, row in rows),
        note="Paths are from the folder of this report.",
    )
