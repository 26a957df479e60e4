"""Pictures of lists, whose agents move under the pointer."""

import re

import numpy as np

from pd_editor.editor.library.thumbnail import STANDS, thumbnail
from tests.builders import scenario_with, straight_drivers


def test_who_drives_moves_along_its_way_and_who_stands_does_not():
    agents = straight_drivers([(0.0, 0.0, 0.0, 5.0), (0.0, 9.0, 0.0, 0.0)])
    scenario = scenario_with(agents)
    picture = thumbnail(scenario)
    assert picture.count("<polygon") == 2
    (text,) = re.findall(r'values="([^"]*)"', picture)
    moves = [tuple(map(float, one.split(","))) for one in text.split(";")]
    np.testing.assert_allclose(moves[-1], (5.0 * (len(moves) - 1), 0.0), atol=0.1)
    assert f'dur="{len(moves) - 1}s"' in picture
    # It stands until the list shows it without this.
    assert picture.count(STANDS) == picture.count("<animate") == 1
