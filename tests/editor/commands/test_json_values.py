"""Arrays and odd numbers in JSON."""

import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from jaxtyping import Float32

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands.json_values import from_json, to_json

ARRAY = Float32[np.ndarray, "..."]


@given(
    hnp.arrays(
        np.float32, hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=5)
    )
)
def test_arrays_survive_bit_for_bit(values):
    again = from_json(ARRAY, json.loads(json.dumps(to_json(values))), "x")
    assert again.dtype == np.float32
    assert again.shape == values.shape
    assert again.tobytes() == values.tobytes()


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_survive_bit_for_bit(value):
    again = from_json(float, json.loads(json.dumps(to_json(value))), "x")
    assert np.float64(again).tobytes() == np.float64(value).tobytes()


@pytest.mark.parametrize("data", [True, "1", None, float("nan"), 10**400, [1]])
def test_odd_numbers_are_refused(data):
    with pytest.raises(RecipeError, match=r"^x must be a"):
        from_json(float, data, "x")


def packed(raw: bytes, **changes: object) -> dict[str, object]:
    text = base64.b64encode(zlib.compress(raw)).decode()
    return {"dtype": "float32", "shape": [2], "zlib": text} | changes


@pytest.mark.parametrize(
    "data",
    [
        None,
        [1.0, 2.0],
        packed(b"12345678", dtype="float64"),
        packed(b"12345678", shape=[3]),
        packed(b"12345678", shape=[-2]),
        packed(b"12345678", shape=[10**12]),
        packed(b"12345678", shape=["2"]),
        packed(b"12345678", zlib="#"),
        packed(b"12345678", zlib="AAAA"),
        packed(b"0" * 50_000_000),
        packed(b"12345678", more=1),
    ],
)
def test_damaged_arrays_are_refused(data):
    with pytest.raises(RecipeError, match=r"^x"):
        from_json(ARRAY, data, "x")


def test_numpy_numbers_are_plain_in_json():
    values = (np.float32(0.1), np.int64(3), np.bool_(True))
    assert json.dumps(to_json(values)) == "[0.10000000149011612, 3, true]"
