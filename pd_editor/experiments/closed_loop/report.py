"""Report of policies over many scenes: means with intervals, who failed where."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.closed_loop.scores import DriveScores, nuplan_scores
from pd_editor.experiments.evaluation.summary import (
    mean_over_scenes,
    scene_weights,
)
from pd_editor.experiments.report import (
    Report,
    ReportTable,
    Section,
    command_section,
    table_of_first,
)

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


def policy_values(drives: Sequence[Drive]) -> dict[str, Float[np.ndarray, "P N"]]:
    """Scores of P policies in N scenes, in the order of the drives; NaN where there is none.

    A drive that failed has the score 0 and no other value.
    """
    policies, scenes = (
        list(dict.fromkeys(getattr(one, what) for one in drives))
        for what in ("policy", "scene")
    )
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
    policies = list(dict.fromkeys(one.policy for one in drives))
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
        "in which each is kept. The score is nuPlan's aggregate, where progress counts "
        "beside that of the policy which comes furthest in the scene; a drive that failed has "
        "the score 0 and counts nowhere else. Scenes carry no speed limits, so none is scored.",
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
    policies, scenes = (
        list(dict.fromkeys(getattr(one, what) for one in drives))
        for what in ("policy", "scene")
    )
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
