"""Recipes as text, their replay, and drawing generated entries again."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import RecipeError
from pd_editor.editor.commands import DeleteAgents, TransformAgents
from pd_editor.editor.commands.traffic import traffic_command
from pd_editor.editor.recipe import Recipe, regenerate, replay
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.scenario import Provenance
from tests.editor.command_strategies import (
    any_command,
    busy_scenario,
    ignore_random_checks,
)
from tests.editor.fake_generators import DriftGenerator

pytestmark = ignore_random_checks
BASE = replace(
    busy_scenario(),
    provenance=Provenance(source="demo:two-lanes", content_sha256="c0ffee"),
)


def recipe_of(*commands) -> Recipe:
    return Recipe(base=BASE.reference, commands=commands, created_at="today")


@settings(max_examples=60, deadline=None)
@given(commands=st.lists(any_command(BASE), max_size=5))
def test_text_there_and_back(commands):
    recipe = recipe_of(*commands)
    text = recipe.to_text()
    assert Recipe.from_text(text) == recipe
    assert Recipe.from_text(text.encode()) == recipe
    assert Recipe.from_text(text).to_text() == text


def test_the_format_is_plain_and_stays():
    text = recipe_of(TransformAgents(agent_ids=("100",), dx_m=1.5)).to_text()
    assert json.loads(text) == {
        "format": "pd-editor recipe",
        "version": 1,
        "created_at": "today",
        "base": {
            "scenario_id": "two-lane-road",
            "source": "demo:two-lanes",
            "content_sha256": "c0ffee",
            "base": None,
            "is_bent": False,
            "edited_ids": [],
            "current_step": BASE.current_step,
        },
        "notes": [],
        "variant": {"name": "", "tags": [], "note": ""},
        "commands": [
            {
                "command": "TransformAgents",
                "agent_ids": ["100"],
                "dx_m": 1.5,
                "dy_m": 0.0,
                "rotation_rad": 0.0,
            }
        ],
    }


def edited(**changes) -> str:
    return json.dumps(json.loads(recipe_of().to_text()) | changes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "The recipe is not valid JSON."),
        ("[" * 100_000, "The recipe is not valid JSON."),
        (b"\xff\xfe\x00", "The recipe is not valid JSON."),
        ("[]", 'This is not a recipe; its format is "pd-editor recipe".'),
        (edited(format="x"), 'This is not a recipe; its format is "pd-editor recipe".'),
        (edited(version=2), "The recipe is of version 2; this program reads up to 1."),
        (edited(version="1"), "The recipe names no version."),
        (edited(commands={}), "The recipe lacks its list of commands."),
        (edited(extra=1), "The recipe has an unknown field 'extra'."),
        (edited(base=None), "The recipe's base must be an object, not None."),
        (edited(base={}), "The recipe's base lacks the field 'scenario_id'."),
        (
            edited(commands=[{"command": "SetFocalAgent", "agent_id": "1"}, 7]),
            "Entry 2 must be an object that names its command.",
        ),
        (
            edited(commands=[{"command": "Fly"}]),
            "Entry 1 is of the unknown command 'Fly'.",
        ),
    ],
)
def test_bad_texts_get_one_sentence(text, message):
    with pytest.raises(RecipeError) as caught:
        Recipe.from_text(text)
    assert str(caught.value) == message


def test_replay_refuses_another_base():
    recipe = recipe_of(TransformAgents(agent_ids=("100",), dx_m=1.5))
    other_id = replace(BASE, scenario_id="other")
    other_hash = replace(BASE, provenance=Provenance(content_sha256="bad"))
    with pytest.raises(RecipeError, match="belongs to scenario two-lane-road"):
        replay(recipe, other_id)
    with pytest.raises(RecipeError, match="has other contents"):
        replay(recipe, other_hash)
    moved = replay(recipe, other_hash, allow_other_base=True)
    assert np.allclose(moved.agents.position_m[0, :, 1], 0)


def test_replay_names_the_entry_that_fails():
    recipe = recipe_of(
        TransformAgents(agent_ids=("100",), dx_m=1.5),
        DeleteAgents(agent_ids=("ghost",)),
    )
    with pytest.raises(RecipeError) as caught:
        replay(recipe, BASE)
    assert str(caught.value) == (
        "Entry 2 (Delete agent ghost): There is no agent 'ghost' here; expected one of 100, 101, 102, 103, 104, 105."
    )


def test_replay_shows_each_step():
    recipe = recipe_of(*(TransformAgents(agent_ids=("100",), dx_m=1.0),) * 3)
    seen = []
    replay(recipe, BASE, on_step=lambda number, s: seen.append((number, s)))
    assert [number for number, _ in seen] == [1, 2, 3]
    assert [s.agents.position_m[0, s.current_step, 0] for _, s in seen] == [1, 2, 3]


def generated(seed: int, generator: DriftGenerator) -> Recipe:
    shift = TransformAgents(agent_ids=("100",), dx_m=1.0)
    request = GenerationRequest(
        scenario=shift.apply(BASE), agent_ids=("100", "101"), seed=seed
    )
    traffic = run_to_end(generator.generate(request))
    return recipe_of(shift, traffic_command(request, traffic), shift)


def test_regenerating_says_whether_it_is_the_same():
    recipe = Recipe.from_text(generated(5, DriftGenerator()).to_text())
    scenario, (entry,) = regenerate(recipe, BASE, DriftGenerator())
    assert (entry.number, entry.is_equal, entry.max_difference_m) == (2, True, 0.0)
    same = replay(recipe, BASE)
    assert (scenario.agents.position_m == same.agents.position_m).all()

    changed = DriftGenerator(extra_mps=1.0)
    scenario, (entry,) = regenerate(recipe, BASE, changed)
    assert not entry.is_equal
    assert entry.max_difference_m == pytest.approx(6.0, abs=1e-3)
    assert not np.allclose(scenario.agents.position_m, same.agents.position_m)


def test_another_generator_does_not_regenerate():
    recipe = generated(5, DriftGenerator())
    with pytest.raises(RecipeError, match="Entry 2 was sampled by drift, not by other"):
        regenerate(recipe, BASE, DriftGenerator(name="other"))
