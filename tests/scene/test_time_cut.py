"""Recordings are cut to the past and future that are asked for, and replayed so."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import InputError
from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import (
    export_into,
    exported_files,
    open_base,
    open_scenario,
)
from pd_editor.editor.session import EditorSession
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import straight_drivers, two_agents_that_pass


def long_recording(step_s: float = 0.1, num_steps: int = 200) -> Scenario:
    axis = TimeAxis(
        num_steps=num_steps,
        step_s=step_s,
        end_timestamp_ns=(num_steps - 1) * step_s * 1e9,
    )
    states = [(0.0, 0.0, 0.0, 5.0), (0.0, 3.5, 0.0, 6.0)]
    agents = straight_drivers(states, time_axis=axis)
    return replace(
        two_agents_that_pass(), agents=agents, time_axis=axis, focal_id=agents.ids[0]
    )


def recording_of_minutes(folder: Path) -> Path:
    """A file in a new folder, with a recording that is longer than scenes may be."""
    session = EditorSession(open_scenario("roundabout"))
    files = exported_files(session.scenario, session.recipe(), None, "commonroad")
    (data,) = [files[one] for one in files if one.endswith(".xml")]
    folder.mkdir(parents=True)
    slow = data.replace(b'timeStepSize="0.1"', b'timeStepSize="1.5"')
    (folder / "minutes.xml").write_bytes(slow)
    return folder / "minutes.xml"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_files(scenario_files(long_recording()), tmp_path / "long", forbidden=None)
    return tmp_path / "long"


@pytest.mark.parametrize(
    ("step_s", "current_s", "until_s", "now", "num_steps"),
    [
        (0.1, 5.0, 6.0, 49, 110),
        (0.1, 1.0, 8.0, 9, 90),
        (0.1, 5.0, None, 49, 200),
        (0.5, 5.0, 6.0, 9, 22),
        (0.5, 2.0, 3.0, 3, 10),
    ],
)
def test_steps_are_counted_in_seconds(
    step_s: float,
    current_s: float,
    until_s: float | None,
    now: int,
    num_steps: int,
    tmp_path: Path,
):
    """Five seconds of a recording at 10 Hz end with step 49, at 2 Hz with step 9."""
    whole = long_recording(step_s)
    write_files(scenario_files(whole), tmp_path / "long", forbidden=None)
    found = open_scenario(tmp_path / "long", current_s=current_s, until_s=until_s)
    axis = found.time_axis
    assert (axis.current_step, axis.num_steps) == (now, num_steps)
    assert axis.step_s == pytest.approx(step_s)
    assert axis.duration_s == pytest.approx((num_steps - 1) * step_s)
    assert found.agents.num_steps == num_steps
    shift = found.origin_city_m - whole.origin_city_m
    gap = found.agents.position_m + shift - whole.agents.position_m[:, :num_steps]
    assert np.abs(gap).max() < 1e-9
    assert (found.agents.observed.sum(axis=1) == now + 1).all()


def test_a_cut_recording_is_written_read_and_replayed(folder: Path, tmp_path: Path):
    session = EditorSession(open_scenario(folder, current_s=5.0, until_s=6.0))
    session.apply(TransformAgents(agent_ids=session.scenario.agents.ids[:1], dx_m=1.0))
    written = export_into(tmp_path / "out", session.scenario, session.recipe())
    recipe = Recipe.from_text((written / "recipe.json").read_bytes())
    again = replay(recipe, open_base(recipe.base))
    np.testing.assert_array_equal(
        again.agents.position_m, session.scenario.agents.position_m
    )
    read = open_scenario(written)
    assert read.time_axis.current_step == 49
    assert read.time_axis.num_steps == 110
    with pytest.raises(Exception, match="other contents"):
        replay(recipe, open_scenario(folder))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"current_s": 30.0}, "has 200 steps of 0.1 s"),
        ({"until_s": -1.0}, "--until is -1"),
        ({"current_s": float("nan")}, "--current is nan"),
        ({"until_s": 0.01}, "expected a current step"),
    ],
)
def test_what_cannot_be_cut_is_told(options: dict, words: str, folder: Path):
    with pytest.raises(InputError, match=words):
        open_scenario(folder, **options)


def test_what_is_short_enough_stays_as_it_is(folder: Path):
    whole = open_scenario(folder)
    assert open_scenario(folder, until_s=100.0).reference == whole.reference
