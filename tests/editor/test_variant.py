"""Names, tags and notes of edited scenarios (D6)."""

from dataclasses import replace

import pytest

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import SetAgentSpeed, SetRoadWarp
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import (
    Variant,
    free_name,
    name_from_text,
    short_id,
    tags_from_text,
)
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import two_agents_that_pass


def test_a_name_says_what_was_done():
    session = EditorSession(two_agents_that_pass())
    assert session.name == "two-lane-road"
    assert session.recipe().variant == Variant()
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    term = WarpTerm(kind="double-turn", power=-2.5, length_m=10.0)
    warp = RoadWarp(anchor=anchor, terms=(term,))
    session.apply(SetRoadWarp(warp=warp, friction_coefficient=None))
    assert session.name == "two-lane-road-double-turn-m2-5"
    session.apply(SetAgentSpeed(agent_ids=("100",), speed_mps=3.0))
    # As many as the history has; it was one less.
    assert len(session.entries) == 2
    assert session.recipe().result_id == "two-lane-road-double-turn-m2-5-2-edits"
    session.describe(Variant(name="mine"))
    assert session.recipe().result_id == "mine"
    again = EditorSession.from_recipe(session.recipe(), session.base)
    assert (again.name, len(again.entries)) == ("mine", 2)
    again.apply(SetAgentSpeed(agent_ids=("100",), speed_mps=5.0))
    assert again.name == "mine"


def test_a_name_that_a_user_did_not_type_holds_until_the_next_edit():
    """Scenarios that were made of one of a study's gallery kept its id."""
    session = EditorSession(two_agents_that_pass())
    session.apply(SetAgentSpeed(agent_ids=("100",), speed_mps=3.0))
    recipe = session.recipe()
    given = replace(recipe.variant, name="constant-velocity", is_proposed=True)
    text = replace(recipe, variant=given).to_text()
    opened = EditorSession(two_agents_that_pass())
    opened.exchange(EditorSession.from_recipe(Recipe.from_text(text), session.base))
    assert opened.name == "constant-velocity"
    assert opened.recipe().variant == given
    opened.apply(SetAgentSpeed(agent_ids=("100",), speed_mps=4.0))
    assert opened.name == "two-lane-road-2-edits"
    opened.undo()
    assert opened.name == "constant-velocity"
    opened.undo()
    assert opened.name == "two-lane-road"


def test_texts_of_users_become_names_and_tags():
    assert name_from_text(" My slow one! (2) ") == "My-slow-one-2"
    assert name_from_text("Übung & café") == "Ubung-cafe"
    assert name_from_text("x" * 200) == "x" * 80
    assert name_from_text("../..\0\ud800") == ""
    assert tags_from_text("a,  b c ,, a") == ("a", "b c")
    assert short_id("00a0adb0-2a38-4a8c-a3b0-56d2c8d6ab7c") == "00a0adb0"
    taken = {"x", "x-2"}
    assert free_name("x", taken.__contains__) == "x-3"
    assert free_name("y" * 80, {"y" * 80}.__contains__) == "y" * 78 + "-2"


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": "_a"},
        {"name": "a/b"},
        {"name": "-a"},
        {"name": "a\n"},
        {"tags": ("",)},
        {"tags": ("x",) * 21},
        {"note": "x" * 4001},
    ],
)
def test_what_does_not_fit_is_refused(wrong):
    with pytest.raises(EditError, match=r"fit|tags|note"):
        Variant(**wrong)
