"""Splits lanes into segments with the lengths of Argoverse 2 maps."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.sumo_to_av2.lane_chains import LaneChain
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.geometry.wide_line import WideLine, pieces

_MEDIAN_M: Final = 22.0
_SPREAD: Final = 0.92
"""Standard deviation of the logarithm of the length."""
_LEAST_M: Final = 1.5
_MOST_M: Final = 150.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainSections:
    """Segments of a chain; lanes of one edge are split at the same positions."""

    parts: tuple[WideLine, ...]
    num_before: int
    """Number of junction segments before the road's own ones."""
    num_own: int


def edge_cuts(net: SumoNet, random: np.random.Generator) -> dict[str, list[float]]:
    """Sample the fractions along each normal edge at which its lanes are split."""
    cuts = {}
    for edge in net.junction_of:
        length = _length_m(net.lanes_of_edge[edge][-1])
        at, fractions = 0.0, []
        while True:
            step = _MEDIAN_M * np.exp(_SPREAD * random.normal())
            at += float(np.clip(step, _LEAST_M, _MOST_M))
            if at > length - _LEAST_M:
                break
            fractions.append(at / length)
        cuts[edge] = fractions
    return cuts


def chain_sections(
    chain: LaneChain, line: WideLine, fractions: list[float]
) -> ChainSections:
    """Split a chain at fractions of its road's lane, and at that lane's ends."""
    row = chain.lanes.index(chain.main)
    start = sum(_length_m(lane) for lane in chain.lanes[:row])
    length = _length_m(chain.main)
    total = float(arc_length(line.points_m)[-1])
    cuts = [start + fraction * length for fraction in fractions]
    opens, closes = start > _LEAST_M, total - start - length > _LEAST_M
    if chain.main.is_internal or length < _LEAST_M:
        opens = closes = False
    before = [start] if opens else []
    after = [start + length] if closes else []
    parts = pieces(line, [*before, *cuts, *after])
    return ChainSections(
        parts=tuple(parts), num_before=len(before), num_own=len(cuts) + 1
    )


def _length_m(lane: SumoLane) -> float:
    return float(arc_length(lane.shape_m)[-1])
