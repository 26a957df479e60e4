import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.threats.encounter import Track, encounter, gaps_m, side_of
from pd_editor.scene.geometry.angles import unit_vector
from tests.analysis.threats.tracks import only_one

STEP_S = 0.1
NUM_STEPS = 30


def straight(
    start: tuple[float, float], heading: float, speed: float, size: tuple[float, float]
) -> Track:
    time = STEP_S * np.arange(NUM_STEPS)
    velocity = speed * unit_vector(np.array(heading))
    return Track(
        position_m=np.array(start, float) + time[:, None] * velocity,
        heading_rad=np.full(NUM_STEPS, heading),
        velocity_mps=np.tile(velocity, (NUM_STEPS, 1)),
        size_m=np.array(size, float),
    )


coordinates = st.floats(-15, 15)
tracks = st.builds(
    straight,
    st.tuples(coordinates, coordinates),
    st.floats(-3, 3),
    st.floats(0, 12),
    st.tuples(st.floats(0.5, 12), st.floats(0.5, 3)),
)


def shapely_gaps(first: Track, second: Track) -> np.ndarray:
    one, two = (
        np.asarray(shapely.polygons(track.at().corners_m()))
        for track in (first, second)
    )
    return shapely.distance(one, two)


@given(tracks, tracks)
def test_least_gap_is_that_of_shapely_boxes(first: Track, second: Track) -> None:
    several = Track(
        position_m=np.stack([first.position_m, first.position_m + 40.0]),
        heading_rad=np.stack([first.heading_rad] * 2),
        velocity_mps=np.stack([first.velocity_mps] * 2),
        size_m=first.size_m,
    )
    expected = shapely_gaps(first, second)
    gap = gaps_m(several, second)
    assert gap[0].min() == pytest.approx(expected.min(), abs=1e-6)
    assert (gap[0] <= expected + 1e-6).all()
    assert gap[1].min() == pytest.approx(
        shapely_gaps(only_one(several.taken(np.array([1]))), second).min(), abs=1e-6
    )


def test_encounter_with_a_standing_agent_ahead() -> None:
    # 20 m between centres, 4 m boxes, 8 m/s: contact after 2 s.
    found = encounter(
        straight((0, 0), 0.0, 8.0, (4, 2)), straight((20, 0), 0.0, 0.0, (4, 2)), STEP_S
    )
    assert found.is_contact
    assert found.gap_m == 0
    assert found.at_s == pytest.approx(2.0, abs=0.11)
    assert found.relative_speed_mps == pytest.approx(8.0)
    assert found.side == "rear"
    assert found.least_time_to_collision_s == pytest.approx(0.0, abs=0.11)


def test_encounter_of_agents_that_pass_each_other() -> None:
    found = encounter(
        straight((0, 3.0), 0.0, 8.0, (4, 2)),
        straight((20, 0), 0.0, 0.0, (4, 2)),
        STEP_S,
    )
    assert not found.is_contact
    assert found.gap_m == pytest.approx(1.0)
    assert found.side == "left"
    assert found.least_time_to_collision_s is None


@pytest.mark.parametrize(
    ("angle", "side"),
    [(0, "front"), (np.pi / 2, "left"), (np.pi, "rear"), (-np.pi / 2, "right")],
)
@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
def test_side_is_that_of_the_threatened_box(
    angle: float, side: str, heading: float
) -> None:
    other = straight((3, 4), heading, 0.0, (4.6, 1.9))
    place = other.position_m[0] + 4 * unit_vector(np.array(heading + angle))
    first = straight((place[0], place[1]), heading + angle + np.pi, 0.0, (4.6, 1.9))
    assert side_of(first, other, 0) == side
