"""Crops SUMO nets to a square, for maps of places in large cities."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from pd_editor.scene.formats.sumo_net import SumoNet


def cropped_net(
    net: SumoNet, center_m: Float[np.ndarray, "2"], reach_m: float
) -> SumoNet:
    """Keep whole edges of which a lane reaches into a square, and what is beside them."""

    def is_near(points_m: Float[np.ndarray, "N 2"]) -> bool:
        low, high = points_m.min(axis=0) - center_m, points_m.max(axis=0) - center_m
        return bool((low < reach_m).all() and (high > -reach_m).all())

    edges = {lane.edge for lane in net.lanes.values() if is_near(lane.shape_m)}
    lanes = {name: lane for name, lane in net.lanes.items() if lane.edge in edges}
    return replace(
        net,
        lanes=lanes,
        links=tuple(one for one in net.links if lanes.keys() >= set(one)),
        junction_of={k: ends for k, ends in net.junction_of.items() if k in edges},
        junction_areas_m={k: a for k, a in net.junction_areas_m.items() if is_near(a)},
        walking_areas_m=tuple(area for area in net.walking_areas_m if is_near(area)),
        crossings=tuple(one for one in net.crossings if is_near(one[0])),
        turns=tuple(one for one in net.turns if lanes.keys() >= {one.start, one.end}),
    )
