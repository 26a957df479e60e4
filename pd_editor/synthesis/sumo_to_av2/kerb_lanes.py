"""Lanes along the kerb that take in the room to park, as maps often draw them."""

from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.geometry.polyline import offset_line, without_repeats
from pd_editor.synthesis.sumo.sumo_net import SumoLane, SumoNet

SHARE_OF_SINGLE: Final = 0.55
"""Of streets with one lane a direction. A third of the vehicles that stand beside lanes
in Argoverse 2 do so within 2 m of the centre lines of lanes that are 5 to 6 m wide."""
SHARE_OF_SEVERAL: Final = 0.3


def with_wide_kerb_lanes(net: SumoNet, random: np.random.Generator) -> SumoNet:
    """The net with some lanes as wide as they and the parking strip beside them.

    Traffic drives where it did, so left of the new centre lines; parked vehicles stand
    on the lane.
    """
    lanes = dict(net.lanes)
    for edge in net.junction_of:
        beside = net.lanes_of_edge[edge]
        num_driven = sum(lane.kind is not None for lane in beside)
        share = SHARE_OF_SINGLE if num_driven == 1 else SHARE_OF_SEVERAL
        is_wide = random.random() < share
        for strip in beside:
            if strip.is_parking and is_wide:
                for lane in beside:
                    if lane.index == strip.index + 1 and lane.kind is not None:
                        lanes[lane.sumo_id] = _widened(lane, strip.width_m)
    return replace(net, lanes=lanes)


def _widened(lane: SumoLane, by_m: float) -> SumoLane:
    """The lane with more width on its right."""
    middle = offset_line(without_repeats(lane.shape_m, 1e-3), -by_m / 2)
    return replace(lane, shape_m=middle, width_m=lane.width_m + by_m)
