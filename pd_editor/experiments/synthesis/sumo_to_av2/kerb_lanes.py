"""Wide kerb lanes that include the parking strip, as in many Argoverse 2 maps."""

from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import offset_line, without_repeats

SHARE_OF_SINGLE: Final = 0.55
"""Share of wide kerb lanes among streets with one lane per direction. A third of the
vehicles parked beside lanes in Argoverse 2 are within 2 m of the centre lines of lanes
that are 5 to 6 m wide."""
SHARE_OF_SEVERAL: Final = 0.3


def with_wide_kerb_lanes(net: SumoNet, random: np.random.Generator) -> SumoNet:
    """Widen some lanes of a net by the parking strip beside them.

    Traffic stays where it was, left of the new centre lines; vehicles park on the lane.
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
    """Widen a lane on its right."""
    middle = offset_line(without_repeats(lane.shape_m, 1e-3), -by_m / 2)
    return replace(lane, shape_m=middle, width_m=lane.width_m + by_m)
