import math

import torch
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    POSITION_UNIT_M,
    decode_activity,
    decode_states,
    encode_states,
    unit_vectors,
)
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.thresholds import MOVING_MPS


@given(
    st.floats(-62, 62),
    st.floats(-62, 62),
    st.floats(-math.pi, math.pi),
    st.floats(MOVING_MPS, 40),
)
def test_moving_states_there_and_back(x: float, y: float, heading: float, speed: float):
    pose = torch.tensor([x, y, heading], dtype=torch.float64)
    state = decode_states(encode_states(pose, torch.tensor(speed, dtype=torch.float64)))
    expected = [x, y, math.cos(heading), math.sin(heading), speed]
    torch.testing.assert_close(
        state, torch.tensor(expected, dtype=torch.float64), rtol=1e-9, atol=1e-9
    )


def test_standing_agents_have_a_code_of_their_own():
    speed = torch.tensor([0.0, 0.2, 0.49, 0.5, 1.0])
    codes = encode_states(torch.zeros(5, 3), speed)[:, 4]
    assert (codes[:3] == codes[0]).all()
    assert codes[3] - codes[0] > 0.8
    decoded = decode_states(encode_states(torch.zeros(5, 3), speed))[:, 4]
    torch.testing.assert_close(decoded, torch.tensor([0, 0, 0, 0.5, 1.0]))


def test_positions_are_told_in_units_of_half_the_square():
    pose = torch.tensor([POSITION_UNIT_M, -POSITION_UNIT_M / 2, 0.0])
    codes = encode_states(pose, torch.zeros(()))
    assert codes[:2].tolist() == [1.0, -0.5]


def test_unit_vectors_have_length_one_even_of_nothing():
    vectors = torch.tensor([[3.0, 4.0], [0.0, 0.0], [-1e-3, 0.0]])
    expected = torch.tensor([[0.6, 0.8], [1.0, 0.0], [-1.0, 0.0]])
    torch.testing.assert_close(unit_vectors(vectors), expected)


def test_activities_there_and_back():
    activity = torch.tensor([Activity.PARKED, Activity.WAITING, Activity.DRIVING])
    speed = torch.tensor([0.0, 0.3, 4.0])
    codes = encode_states(torch.zeros(3, 3), speed, activity)
    assert torch.equal(decode_activity(codes), activity)
    without = encode_states(torch.zeros(3, 3), speed)
    assert torch.equal(codes[:, :NUM_MOTION_PARTS], without)
    assert (decode_activity(without) == Activity.UNKNOWN).all()
    unknown = encode_states(torch.zeros(3, 3), speed, torch.zeros_like(activity))
    assert (unknown[:, NUM_MOTION_PARTS:] == 0).all()


def test_an_activity_agrees_with_the_speed():
    """Whatever its codes are: what moves is neither parked nor waits."""
    codes = encode_states(torch.zeros(64, 3), torch.linspace(0, 3, 64))
    noise = torch.randn((64, 3), generator=torch.Generator().manual_seed(0))
    codes = torch.cat([codes, noise], dim=-1)
    moves = decode_states(codes)[:, 4] > 0
    assert 0 < moves.sum() < 64
    assert torch.equal(decode_activity(codes) == Activity.DRIVING, moves)
    assert len(decode_activity(codes).unique()) == 3
