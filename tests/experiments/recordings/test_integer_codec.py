import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.experiments.recordings.recording import coded, decoded


@given(st.lists(st.lists(st.integers(-(10**6), 10**6), max_size=6), max_size=5))
@settings(deadline=None)
def test_integers_come_back(series):
    first_row = np.concatenate([[0], np.cumsum([len(one) for one in series])])
    first_row = first_row.astype(np.int64)
    values = np.array([value for one in series for value in one], np.int64)
    columns = np.stack([values, values[::-1]], axis=-1)
    data = coded(columns, first_row)
    np.testing.assert_array_equal(decoded(data, first_row, 2), columns)


def test_a_missing_byte_is_noticed():
    first_row = np.array([0, 3])
    data = coded(np.array([[5], [-7], [9]]), first_row)
    with pytest.raises(ValueError, match="do not hold 1 columns of 3 numbers"):
        decoded(data[:-1], first_row, 1)
