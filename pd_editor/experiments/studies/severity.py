"""Severity curves: metrics by power of the warp, with intervals over scenes."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int

from pd_editor.experiments.evaluation.road_condition import DEFAULT_ANCHOR, PLAIN
from pd_editor.experiments.evaluation.summary import (
    Estimate,
    mean_over_scenes,
    scene_weights,
)
from pd_editor.experiments.studies.variant_rows import (
    STUDY_AGENTS,
    STUDY_METRICS,
    StudyAgents,
)

_SEED: Final = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class SeverityCurve:
    """Means of all study metrics at P powers of a kind of warp; 0 is the plain road."""

    method: str
    kind: str
    anchor: str
    agents: StudyAgents
    power: Float[np.ndarray, "P"]
    estimates: dict[str, Estimate]
    """Means [P] with intervals, by metric."""
    num_scenes: Int[np.ndarray, "P"]
    """Number of scenes with values of the first metric."""

    @property
    def road(self) -> str:
        """Kind of warp, and its anchor if it is not the focal agent."""
        return road_title(self.kind, self.anchor)


def road_title(kind: str, anchor: str) -> str:
    """Kind of warp, and its anchor if it is not the focal agent."""
    return kind if anchor == DEFAULT_ANCHOR else f"{kind} ahead of the {anchor}"


def severity_curves(
    rows: pa.Table, agents: StudyAgents = STUDY_AGENTS[0]
) -> tuple[SeverityCurve, ...]:
    """One curve for each method, kind of warp and anchor, in the order of the rows.

    Failed variants have no values. Scenes are resampled for the intervals, since seeds
    and agents of one scene are correlated.
    """
    wanted = np.array(rows["agents"].to_pylist(), object) == agents
    rows = rows.filter(pa.array(wanted))
    if not len(rows):
        return ()
    names = ("method", "condition", "kind", "anchor", "folder")
    columns = {name: np.array(rows[name].to_pylist(), object) for name in names}
    power = rows["power"].to_numpy()
    scenes, scene = np.unique(columns["folder"].astype(str), return_inverse=True)
    weights = scene_weights(len(scenes), _SEED)
    sums = np.stack([rows[f"{name}_sum"].to_numpy() for name in STUDY_METRICS])
    counts = np.stack([rows[f"{name}_count"].to_numpy() for name in STUDY_METRICS])
    is_plain = columns["condition"] == PLAIN
    curves = []
    for method, kind, anchor in _families(columns, is_plain):
        here = (columns["method"] == method) & (
            is_plain | ((columns["kind"] == kind) & (columns["anchor"] == anchor))
        )
        powers, cell = np.unique(power[here], return_inverse=True)
        table = np.zeros((2, len(STUDY_METRICS), len(powers), len(scenes)))
        for target, values in zip(table, (sums, counts), strict=True):
            for metric in range(len(STUDY_METRICS)):
                np.add.at(target[metric], (cell, scene[here]), values[metric, here])
        estimates = {
            name: mean_over_scenes(table[0, index], table[1, index], weights)
            for index, name in enumerate(STUDY_METRICS)
        }
        curves.append(
            SeverityCurve(
                method=method,
                kind=kind,
                anchor=anchor,
                agents=agents,
                power=powers,
                estimates=estimates,
                num_scenes=(table[1, 0] > 0).sum(axis=-1),
            )
        )
    return tuple(curves)


def _families(
    columns: dict[str, np.ndarray], is_plain: np.ndarray
) -> list[tuple[str, str, str]]:
    """Methods, kinds and anchors of warped rows, each once."""
    keys = zip(columns["method"], columns["kind"], columns["anchor"], strict=True)
    return list(
        dict.fromkeys(
            key for key, plain in zip(keys, is_plain.tolist(), strict=True) if not plain
        )
    )
