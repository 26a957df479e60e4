"""Families: values cover ranges evenly, and a recipe takes them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import AddGuidance, SetAgentSpeed, SetRoadWarp
from pd_editor.editor.commands.json_values import to_json
from pd_editor.editor.family import members
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.varied_numbers import (
    numbers_in_words,
    range_example,
    values_in_words,
    varied,
    varied_numbers,
    varied_values,
)
from pd_editor.scene.base_reference import BaseReference
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm


def recipe() -> Recipe:
    """A warp, then two changes of speed."""
    anchor = RigidMotion(x_m=1.0, y_m=2.0, rotation_rad=float(np.radians(30.0)))
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=10.0)
    return Recipe(
        base=BaseReference(scenario_id="a", source="demo:a", content_sha256=""),
        commands=(
            SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,))),
            SetAgentSpeed(agent_ids=("one",), speed_mps=3.0),
            SetAgentSpeed(agent_ids=("other",), speed_mps=4.0),
        ),
    )


@given(st.integers(1, 40), st.integers(0, 2**32), st.floats(-9, 0), st.floats(0.1, 9))
def test_each_part_of_a_range_is_used_once(count, seed, low, width):
    texts = (f"power={low:.3f}..{low + width:.3f}", "2.speed_mps=1..2")
    numbers = varied_numbers(recipe(), texts)
    made = list(members(numbers, count, seed))
    assert len(made) == count
    assert made == list(members(numbers, count, seed))
    for one in numbers:
        values = np.array([own[one] for own in made])
        share = (values - one.low) / (one.high - one.low)
        parts = np.clip(np.floor(share * count), 0, count - 1)
        # Values are rounded, so that one may lie on the border of the next part.
        assert np.abs(np.sort(parts) - np.arange(count)).max() <= 1
        assert (np.diff(np.sort(share)) >= 0).all()
        assert share.min() >= -1e-3
        assert share.max() <= 1 + 1e-3


def test_a_number_changes_where_it_is_named_and_nowhere_else():
    template = recipe()
    numbers = varied_numbers(template, ("power=1..1", "3.speed_mps=9..9", "x_m=7..7"))
    (values,) = members(numbers, 1, 0)
    result = varied(template, values)
    warp, first, second = result.commands
    assert isinstance(warp, SetRoadWarp)
    assert warp.warp is not None
    assert (warp.warp.terms[0].power, warp.warp.anchor.x_m) == (1.0, 7.0)
    assert (warp.warp.terms[0].length_m, warp.warp.anchor.y_m) == (10.0, 2.0)
    assert first == template.commands[1]
    assert second == replace(first, agent_ids=("other",), speed_mps=9.0)
    assert [one.name for one in numbers] == ["power", "speed_mps", "x_m"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("power", "expected NAME=LOW..HIGH"),
        ("power=1..e", "expected NAME=LOW..HIGH"),
        ("power=5..2", "ends before it begins"),
        (
            "speed_mps=1..2",
            "several numbers of this name; there are 2.speed, 3.speed",
        ),
        (
            "seed=1..2",
            "no number of this name; there are power, length, border",
        ),
        ("9.power=1..2", "no number of this name"),
        ("4.seed=1..2", "no number of this name"),
    ],
)
def test_what_names_no_number_is_told(text: str, words: str):
    with pytest.raises(RecipeError, match=words):
        varied_numbers(recipe(), (text,))


def test_no_range_and_two_of_one_number_are_told():
    with pytest.raises(RecipeError, match="needs a range"):
        varied_numbers(recipe(), ())
    with pytest.raises(RecipeError, match="Two ranges are of the same number"):
        varied_numbers(recipe(), ("power=1..2", "1.power=3..4"))


def test_traffic_at_the_end_has_a_seed_of_its_own():
    template = recipe()
    assert ", seed 0, " in numbers_in_words(template, adds=True)
    numbers = varied_numbers(template, ("seed=5..5", "power=1..1"), adds=True)
    (values,) = members(numbers, 1, 0)
    assert len(varied(template, values).commands) == len(template.commands)


def test_numbers_are_told_by_names_that_mean_them_alone():
    line = FollowPath(agent_id="one", points_m=((1.0, 2.0), (30.0, 4.0)))
    template = recipe()
    commands = (*template.commands, AddGuidance(term=line))
    template = replace(template, commands=commands)
    told = numbers_in_words(template)
    # (Field names with places of points filled the panel.)
    assert told == (
        "power 5, length 10 m, border 5 m, exponent 3, 2.speed 3 m/s, 3.speed 4 m/s, weight 1, "
        "7 coordinates (x, y, ...)"
    )
    quantities = (one.split(" ")[:2] for one in told.split(", ")[:7])
    for name, value in (*quantities, ("x", 1), ("points.1.0", 30), ("points_m.0.1", 2)):
        (number,) = varied_numbers(template, (f"{name}={value}..{value}",))
        (values,) = members((number,), 1, 0)
        again = varied(template, values)
        assert to_json(again.commands) == to_json(template.commands)
    many = replace(template, commands=template.commands * 100)
    assert numbers_in_words(many).endswith(", ...")
    (number,) = varied_numbers(template, (range_example(template),))
    assert (number.name, number.low, number.high) == ("power", 2.5, 10.0)
    assert range_example(replace(template, commands=()), adds=True) == "seed=1..99"


def test_values_that_a_command_refuses_are_told():
    numbers = varied_numbers(recipe(), ("power=99..99",))
    (values,) = members(numbers, 1, 0)
    with pytest.raises(RecipeError, match=r"Entry 1 .*outside -10\.\.10"):
        varied(recipe(), values)
    with pytest.raises(RecipeError, match="1 to 10000 members, not 0"):
        list(members(numbers, 0, 0))


@given(st.floats(-90, 90))
def test_angles_are_degrees_to_users_and_radians_in_recipes(angle_deg: float):
    (number,) = varied_numbers(recipe(), (f"rotation_deg={angle_deg:.2f}..90",))
    made = varied(recipe(), {number: angle_deg})
    assert isinstance(made.commands[0], SetRoadWarp)
    assert made.commands[0].warp is not None
    rotation_rad = made.commands[0].warp.anchor.rotation_rad
    np.testing.assert_allclose(np.degrees(rotation_rad), angle_deg, atol=1e-12)
    variant = replace(made.variant, varied=(".".join(number.path), "2.speed_mps"))
    values = varied_values(replace(made, variant=variant))
    np.testing.assert_allclose(values.pop("rotation_deg"), angle_deg, atol=1e-6)
    assert values == {"speed_mps": 3.0}


def test_values_are_told_with_their_units():
    values = {"power": 4.0, "gap_m": 8.0, "2.speed_mps": 3.0, "rotation_deg": 20.0}
    told = "power 4, gap 8 m, 2.speed 3 m/s, rotation 20°"
    assert values_in_words(values) == told
    values = {"point_m.0": 1.23456, "seed": 1234567.0}
    assert values_in_words(values) == "point.0 1.235 m, seed 1234567"
