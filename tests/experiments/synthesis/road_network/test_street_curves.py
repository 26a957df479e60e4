import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.experiments.synthesis.road_network.streets import (
    CurveKind,
    between_poses,
    curve,
    random_warp,
)

START, END = np.array([3.0, -4.0]), np.array([120.0, 45.0])


def turned(line: np.ndarray) -> np.ndarray:
    step = np.diff(line, axis=0)
    return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


@given(st.sampled_from(list(CurveKind)), st.floats(-1.2, 1.2))
def test_curves_join_their_ends(kind: CurveKind, turn: float) -> None:
    line = curve(START, END, kind, turn)
    assert np.allclose(line[[0, -1]], [START, END], atol=1e-6)
    step = np.linalg.norm(np.diff(line, axis=0), axis=-1)
    assert step.max() < 3.5


@pytest.mark.parametrize("kind", [CurveKind.ARC, CurveKind.CLOTHOID])
def test_curves_turn_by_the_angle_asked_for(kind: CurveKind) -> None:
    heading = turned(curve(START, END, kind, 0.8))
    assert heading[-1] - heading[0] == pytest.approx(0.8, abs=0.05)


def test_an_arc_has_one_radius_and_a_clothoid_bends_most_in_its_middle() -> None:
    arc = np.diff(turned(curve(START, END, CurveKind.ARC, 0.8)))
    assert np.ptp(arc[1:-1]) < 0.1 * arc.mean()
    clothoid = np.diff(turned(curve(START, END, CurveKind.CLOTHOID, 0.8)))
    assert abs(int(np.argmax(clothoid)) - len(clothoid) // 2) <= 2
    assert clothoid[1] < 0.2 * clothoid.max()


def test_an_s_curve_ends_as_it_began() -> None:
    heading = turned(curve(START, END, CurveKind.S_CURVE, 0.8))
    assert heading[-1] == pytest.approx(heading[0], abs=0.05)
    assert heading.max() - heading.min() == pytest.approx(0.8, abs=0.1)


def test_between_poses_leaves_and_arrives_as_asked() -> None:
    ahead, onward = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    heading = turned(between_poses(START, ahead, END, onward))
    assert heading[0] == pytest.approx(0.0, abs=0.1)
    assert heading[-1] == pytest.approx(np.pi / 2, abs=0.1)


def test_bent_land_is_gentle() -> None:
    warp = random_warp(np.random.default_rng(0), 10.0)
    line = np.stack([np.linspace(0, 500, 501), np.zeros(501)], axis=-1)
    assert np.abs(np.diff(turned(warp(line)))).max() < 1 / 40
