"""Speed limits of bends against the closed form of a circle."""

from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.sumo.sumo_tools import (
    LATERAL_MPS2,
    LEAST_SPEED_MPS,
    curve_speed_mps,
    write_with_curve_speeds,
)


def _arc(radius_m: float, angle_rad: float) -> np.ndarray:
    angle = np.linspace(0.0, angle_rad, 60)
    return radius_m * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("radius_m", [8.0, 20.0, 60.0, 150.0])
def test_an_arc_is_taken_at_the_root_of_radius_times_acceleration(radius_m: float):
    speed = curve_speed_mps(_arc(radius_m, 1.2))
    assert speed == pytest.approx(np.sqrt(LATERAL_MPS2 * radius_m), rel=0.03)


def test_a_straight_line_has_no_limit_and_a_kink_has_one():
    straight = np.column_stack([np.linspace(0.0, 50.0, 11), np.zeros(11)])
    assert curve_speed_mps(straight) > 1000.0
    assert curve_speed_mps(straight[:2]) == np.inf
    kink = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert LEAST_SPEED_MPS <= curve_speed_mps(kink) < 4.0


def test_junction_lanes_are_measured_with_what_they_join(tmp_path: Path):
    net = tmp_path / "net.net.xml"
    net.write_text(
        """<net>
        <edge id="a"><lane id="a_0" speed="20" shape="0,0 50,0"/></edge>
        <edge id=":j" function="internal">
            <lane id=":j_0" speed="20" shape="50,0 50,8"/></edge>
        <edge id="b"><lane id="b_0" speed="20" shape="50,8 50,60"/></edge>
        <connection from="a" to="b" fromLane="0" toLane="0" via=":j_0"/>
        <connection from=":j" to="b" fromLane="0" toLane="0"/>
        </net>"""
    )
    copy = tmp_path / "copy.net.xml"
    write_with_curve_speeds(net, copy)
    text = copy.read_text()
    assert text.count('speed="20.00"') == 2
    with pytest.raises(SynthesisError, match="none"):
        write_with_curve_speeds(tmp_path / "none.xml", copy)
