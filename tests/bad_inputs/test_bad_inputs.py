"""A small part of the campaign of bad inputs; all of it is a benchmark."""

import os

import pytest

from tests.bad_inputs.inputs import bad_input
from tests.bad_inputs.isolation import ending_of

NUM_OF_EACH = 12
SEED = 7


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
@pytest.mark.parametrize(
    "kind", ["tracks", "maps", "recipes", "journals", "uploads", "arguments"]
)
def test_bad_inputs_are_told_in_one_sentence(kind, tmp_path):
    """No traceback, no hang, no gigabytes (faults 1 to 5, 7, 9 and 10)."""
    for number in range(NUM_OF_EACH):
        folder = tmp_path / str(number)
        folder.mkdir()
        ending = ending_of(bad_input(kind, number, SEED, folder), folder)
        assert ending.verdict in ("refused", "accepted"), (kind, number, ending)
