"""Scenes that end at their current step: what needs a future says so in one sentence."""

from dataclasses import replace
from pathlib import Path

import pytest

import pd_editor
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import SlowToComfort, YieldToOthers
from pd_editor.editor.scenario_store import export_into
from pd_editor.editor.session import EditorSession
from pd_editor.generation.generators import GENERATORS
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import straight_drivers, two_agents_that_collide
from tests.cli.shell import Shell

SENTENCE = "no future to generate"


def scene(num_steps: int = 50) -> Scenario:
    axis = TimeAxis(
        num_steps=num_steps,
        current_step=num_steps - 1,
        end_timestamp_ns=(num_steps - 1) * 1e8,
    )
    drivers = [(0.0, 0.0, 0.0, 5.0), (9.0, 0.0, 0.0, 2.0)]
    agents = straight_drivers(drivers, time_axis=axis)
    return replace(
        two_agents_that_collide(),
        agents=agents,
        time_axis=axis,
        focal_id=agents.ids[0],
        locks={},
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    session = EditorSession(scene())
    return export_into(tmp_path / "data" / "val", session.scenario, session.recipe())


@pytest.mark.parametrize("num_steps", [1, 2, 50, 51])
def test_no_request_can_be_made(num_steps: int):
    without = scene(num_steps)
    with pytest.raises(GenerationError, match=SENTENCE):
        GenerationRequest(scenario=without, agent_ids=without.agents.ids)


@pytest.mark.parametrize("model", sorted(GENERATORS))
def test_generate_refuses_on_the_shell(
    model: str, shell: Shell, folder: Path, tmp_path: Path
):
    for options in ((), ("--no-yielding",), ("--num-agents", "fit")):
        out = tmp_path / "out"
        command = ("generate", folder, "--model", model, "--out", out, *options)
        assert SENTENCE in shell.refused(*command)
        assert not out.exists()


def test_a_study_of_such_scenes_fails(shell: Shell, folder: Path, tmp_path: Path):
    """They counted as 0 % off-road, and a study without any result ended with 0."""
    options = ("--methods", "lane-follower", "--kinds", "ripple-road", "--powers", "4")
    root, out = folder.parents[1], tmp_path / "out"
    told = shell.refused("study", "--data", root, "--out", out, *options)
    assert told.startswith("lane-follower: failed on every variant")
    assert SENTENCE in told
    assert ".)" not in told
    assert SENTENCE in (out / "report.md").read_text()


def test_what_needs_no_future_goes_on(folder: Path, tmp_path: Path):
    session = EditorSession(scene())
    for command in (YieldToOthers, SlowToComfort):
        session.apply(command(agent_ids=session.scenario.agents.ids))
    assert not session.entries
    pd_editor.warp(folder, kind="smooth-turn", power=4, out=tmp_path / "warped")


def test_no_agent_can_threaten():
    one, other = scene().agents.ids
    threat = Threaten(agent_id=one, other_id=other)
    (problem,) = guidance_problems(scene(), (threat,), None)
    assert "ends at its current step" in problem.message
