"""Pictures of lists, whose agents move under the pointer."""

import re
from dataclasses import replace

import numpy as np

from pd_editor.editor.library.thumbnail import STANDS, PictureFrame, thumbnail
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


def test_who_turns_is_turned_about_its_box_before_it_is_moved():
    """Boxes slid through bends with the heading of t = 0."""
    agents = straight_drivers([(3.0, 2.0, 0.0, 5.0)])
    heading = agents.heading_rad.copy()
    heading[0] = np.linspace(0.0, 2.0, heading.shape[1])
    scenario = scenario_with(replace(agents, heading_rad=heading))
    picture = thumbnail(scenario, PictureFrame(middle_m=(0.0, 0.0)))
    kinds = re.findall(r'type="(\w+)" additive="sum"', picture)
    # A browser applies the last transform of the list first.
    assert kinds == ["translate", "rotate"]
    moves, turns = re.findall(r'values="([^"]*)"', picture)
    assert moves.count(";") == turns.count(";")
    degrees = [float(one.split()[0]) for one in turns.split(";")]
    ahead = heading[0, scenario.current_step :: 10]
    # Counter-clockwise, with y down.
    np.testing.assert_allclose(degrees, -np.degrees(ahead - ahead[0]), atol=0.5)
    (corners,) = re.findall(r'<polygon[^>]* points="([^"]*)"', picture)
    middle = np.mean([[float(x) for x in one.split(",")] for one in corners.split()], 0)
    assert turns.split(";")[0].split()[1:] == [f"{one:.1f}" for one in middle]
