from dataclasses import replace

import numpy as np
import shapely

from pd_editor.experiments.synthesis.sumo.parking_bays import (
    with_wide_kerb_lanes,
)
from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.polyline import offset_line


def street_of(num_lanes: int) -> SumoNet:
    """A straight edge along x: pavement, parking strip, then lanes."""
    widths = (2.5, 2.2, *[3.2] * num_lanes)
    lanes, right_y = {}, 0.0
    for index, width in enumerate(widths):
        middle = np.array([[0.0, right_y + width / 2], [60.0, right_y + width / 2]])
        lanes[f"e_{index}"] = SumoLane(
            sumo_id=f"e_{index}",
            edge="e",
            index=index,
            shape_m=middle,
            width_m=width,
            admitted=frozenset([("pedestrian",), (), ("passenger",)][min(index, 2)]),
            length_m=60.0,
            speed_mps=13.0,
        )
        right_y += width
    return SumoNet(
        lanes=lanes,
        links=(),
        junction_of={"e": ("a", "b")},
        num_legs={"a": 1, "b": 1},
        junction_areas_m={},
        walking_areas_m=(),
        crossings=(),
        has_signals=False,
    )


def outline(lane: SumoLane) -> shapely.Polygon:
    left = offset_line(lane.shape_m, lane.width_m / 2)
    right = offset_line(lane.shape_m, -lane.width_m / 2)
    return shapely.Polygon(np.concatenate([left, right[::-1]]))


def test_some_lanes_cover_themselves_and_the_strip_and_all_else_stays() -> None:
    net = street_of(2)
    wide = 0
    for seed in range(40):
        after = with_wide_kerb_lanes(net, np.random.default_rng(seed))
        changed = {key for key in net.lanes if after.lanes[key] is not net.lanes[key]}
        assert changed in (set(), {"e_2"})
        if changed:
            wide += 1
            both = outline(net.lanes["e_1"]).union(outline(net.lanes["e_2"]))
            assert outline(after.lanes["e_2"]).symmetric_difference(both).area < 1e-6
    assert 0 < wide < 40


def test_single_lanes_are_wide_more_often() -> None:
    def share(net: SumoNet) -> float:
        found = [
            with_wide_kerb_lanes(net, np.random.default_rng(seed)).lanes["e_2"]
            is not net.lanes["e_2"]
            for seed in range(200)
        ]
        return float(np.mean(found))

    assert share(street_of(1)) > share(street_of(3)) + 0.1


def test_a_strip_beyond_a_bike_lane_stays() -> None:
    net = street_of(2)
    lanes = dict(net.lanes)
    lanes["e_2"] = replace(lanes["e_2"], admitted=frozenset({"tram"}))
    net = replace(net, lanes=lanes)
    for seed in range(20):
        after = with_wide_kerb_lanes(net, np.random.default_rng(seed))
        assert all(after.lanes[key] is lane for key, lane in net.lanes.items())
