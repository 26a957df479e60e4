"""Recipes with arrays, numbers and texts that fit nothing: one sentence each."""

import base64
import json
import zlib

import numpy as np
import pytest

from pd_editor.base.errors import EditError, RecipeError
from pd_editor.editor.commands import AdoptTrajectory, ReplaceTraffic, command_from_json
from pd_editor.editor.commands.agents import DuplicateAgents
from pd_editor.editor.commands.json_values import to_json
from pd_editor.editor.commands.poses import PlaceAgent
from pd_editor.scene.agent_kind import AgentKind
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass


def array(*shape: int) -> dict[str, object]:
    raw = np.full(shape, 1.0, "<f4").tobytes()
    text = base64.b64encode(zlib.compress(raw)).decode()
    return {"dtype": "float32", "shape": list(shape), "zlib": text}


def adopted(**changes: object) -> dict[str, object]:
    fields = {
        "command": "AdoptTrajectory",
        "agent_id": "100",
        "position_m": array(60, 2),
        "heading_rad": array(60),
        "velocity_mps": array(60, 2),
    }
    return fields | changes


def replaced(sample: dict[str, object] | None = None, **changes: object):
    arrays = {
        "ids": ["100"],
        "kinds": ["vehicle"],
        "size_m": array(1, 2),
        "position_m": array(1, 60, 2),
        "heading_rad": array(1, 60),
        "velocity_mps": array(1, 60, 2),
    }
    return {
        "command": "ReplaceTraffic",
        "sample": arrays | (sample or {}),
        "generator": "lane-follower",
        "seed": 1,
        "request": {"agent_ids": ["100"]},
    } | changes


def test_what_the_cases_start_from_is_read():
    """Otherwise the cases below could be refused for another reason than theirs."""
    adopts = command_from_json(adopted(), "Entry 1")
    assert isinstance(adopts, AdoptTrajectory)
    assert adopts.agent_id == "100"
    np.testing.assert_array_equal(adopts.position_m, np.ones((60, 2)))
    replaces = command_from_json(replaced(), "Entry 1")
    assert isinstance(replaces, ReplaceTraffic)
    assert replaces.sample.ids == ("100",)
    np.testing.assert_array_equal(replaces.sample.position_m, np.ones((1, 60, 2)))


SHAPES = [(), (60,), (2, 60), (60, 3), (0,), (1, 1, 1, 1), (59, 2), (60, 2, 1)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["position_m", "heading_rad", "velocity_mps"])
def test_arrays_of_another_shape_are_refused_on_reading(name, shape):
    """IndexError, TypeError and ValueError before (fault 3)."""
    if shape == (60,) and name == "heading_rad":
        return
    for bad in (adopted(**{name: array(*shape)}), replaced({name: array(*shape)})):
        with pytest.raises(RecipeError, match=r"Entry 1 .* shape"):
            command_from_json(bad, "Entry 1")


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (replaced({"size_m": array(1)}), r"size_m has the shape \[1\]; expected"),
        (replaced({"size_m": array(2, 2)}), r"with G = 2 as before|size_m"),
        (replaced(seed=10**21), "whole number up to"),
        (replaced(seed=-1), "The seed is -1; expected 0 to"),
        (replaced(generator="a\0b"), "without control characters"),
        (replaced(generator="x" * 300), "generator's name"),
        (replaced(request={"agent_ids": [], "num_samples": 10**6}), "samples is"),
        (replaced(request={"agent_ids": [], "num_denoising_steps": 0}), "steps is 0"),
        (replaced(request={"agent_ids": [], "quality": "best"}), "quality"),
        (
            replaced(request={"agent_ids": [], "num_new_agents": {"bus": 10**6}}),
            "new agents is 1000000; expected 0 to 500",
        ),
        (
            replaced(
                request={
                    "agent_ids": [],
                    "guidance": [{"name": "avoidance", "parameters": {"tries": 1e9}}],
                }
            ),
            "number of tries",
        ),
        (adopted(agent_id="\ud800"), "without control characters"),
        (adopted(agent_id="x" * 10_000), "at most 8192 characters"),
    ],
)
def test_numbers_and_texts_out_of_range_are_refused_on_reading(bad, words):
    """Checked where the recipe is read, with the limit (faults 2, 5)."""
    with pytest.raises(RecipeError, match=words) as told:
        command_from_json(json.loads(json.dumps(bad)), "Entry 1")
    assert str(told.value).isprintable()


def test_absurd_velocities_are_refused():
    """A million metres a second is no edit (fault 9)."""
    fast = to_json(np.full((60, 2), 1e6, np.float32))
    with pytest.raises(RecipeError, match=r"move at 1e\+06 m/s"):
        command_from_json(adopted(velocity_mps=fast), "Entry 1")


def placed(agent_id: str, heading_rad: float = 0.0) -> PlaceAgent:
    return PlaceAgent(
        agent_id=agent_id,
        kind=AgentKind.VEHICLE,
        x_m=0.0,
        y_m=0.0,
        heading_rad=heading_rad,
        speed_mps=0.0,
    )


@pytest.mark.parametrize("name", ["a\nb", "a\0b", "\ud800", "x" * 256])
def test_new_ids_must_be_printable_and_short(name):
    """Such an id could not be exported or journaled (fault 5)."""
    with pytest.raises(EditError, match="cannot be an agent's id") as told:
        placed(name).apply(two_agents_that_pass())
    str(told.value).encode()


def test_an_absurd_heading_is_refused():
    """Finite, and yet no heading (fault 9)."""
    with pytest.raises(EditError, match=r"Heading is 5.7\d*e\+301 deg; expected"):
        placed("a", heading_rad=1e300)


def test_edits_cannot_make_a_scene_too_large():
    """The limit of files holds for edits too (fault 1)."""
    full = scenario_with(straight_drivers([(0, 0, 0, 1)] * 500))
    for command in (
        placed("a"),
        DuplicateAgents(agent_ids=("100",), new_ids=("b",)),
    ):
        with pytest.raises(EditError, match="501 agents; at most 500"):
            command.apply(full)
