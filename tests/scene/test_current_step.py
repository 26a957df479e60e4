"""Scenarios at another current step, and references that name theirs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.scenario import Scenario
from tests.editor.same_scenario import same_tracks

DEMOS = Path(__file__).parents[2] / "assets" / "demos"


def read_at(folder: Path, step: int, tmp_path: Path) -> Scenario:
    """The scenario whose file says another current step."""
    copy = tmp_path / folder.name
    copy.mkdir()
    for file in folder.iterdir():
        if file.suffix == ".parquet":
            table = pq.read_table(file)
            column = pa.array([step] * len(table), pa.int64())
            pq.write_table(
                table.append_column("current_step", column), copy / file.name
            )
        elif file.is_file():
            (copy / file.name).write_bytes(file.read_bytes())
    return read_scenario(copy)


def assert_same(one: Scenario, other: Scenario, atol_m: float = 0.0) -> None:
    """Everything is equal; places may differ by a rounding error, if one is given."""
    assert one.time_axis == other.time_axis
    np.testing.assert_array_equal(one.origin_city_m, other.origin_city_m)
    place_m = other.agents.position_m
    np.testing.assert_allclose(one.agents.position_m, place_m, rtol=0, atol=atol_m)
    assert same_tracks(replace(one.agents, position_m=place_m), other.agents)
    maps = one.road_map, other.road_map
    lines = zip(*(each.polylines for each in maps), strict=True)
    rings = ([a.boundary for a in each.drivable_areas] for each in maps)
    for mine, theirs in (*lines, *zip(*rings, strict=True)):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=atol_m)


@pytest.mark.parametrize("step", [0, 30, 50, 109])
@pytest.mark.parametrize("demo", ["roundabout", "crosswalk"])
def test_another_step_is_that_of_a_file_that_names_it(
    demo: str, step: int, tmp_path: Path
) -> None:
    folder = DEMOS / demo
    found = read_scenario(folder).at_step(step)
    # Demos lie at the origin of their city, where a shift by whole metres rounds.
    assert_same(found, read_at(folder, step, tmp_path), atol_m=1e-12)


@pytest.mark.real_data
def test_another_step_of_real_scenarios_is_that_of_a_file_that_names_it(
    av2_scenario_folders: list[Path], tmp_path: Path
) -> None:
    for folder in av2_scenario_folders[::20]:
        last = read_scenario(folder).time_axis.num_steps - 1
        wanted = read_at(folder, min(50, last), tmp_path)
        assert_same(read_scenario(folder).at_step(min(50, last)), wanted)


def test_the_same_step_is_the_same_scenario() -> None:
    scenario = open_scenario("crosswalk")
    assert scenario.at_step(scenario.current_step) is scenario


def test_recipes_replay_at_the_step_that_they_name() -> None:
    scenario = open_scenario("crosswalk")
    shift = TransformAgents(agent_ids=(scenario.focal_id,), dx_m=1.0)
    recipe = Recipe(base=scenario.reference, commands=(shift,), created_at="today")
    assert recipe.base.current_step == scenario.current_step == 49
    assert replay(recipe, scenario).current_step == 49
    named = replace(recipe.base, current_step=30)
    assert replay(replace(recipe, base=named), scenario).current_step == 30
    unnamed = replace(recipe, base=replace(recipe.base, current_step=None))
    assert Recipe.from_text(unnamed.to_text()).base.current_step is None
    assert replay(unnamed, scenario).current_step == 49
