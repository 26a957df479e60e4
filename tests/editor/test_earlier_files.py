"""Recipes and journals that the code of commit 3b06ae4 wrote, with their results."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.scenario_store import open_scenario
from pd_editor.scene.scenario import Scenario
from tests.editor.same_scenario import same_scenario

DATA = Path(__file__).parents[1] / "data" / "version_1"
DEMOS = {
    "warped": "signalised-junction",
    "resampled": "roundabout",
    "edited": "crosswalk",
}


def check(name: str, scenario: Scenario) -> None:
    with np.load(DATA / "states.npz") as kept:
        known = {
            key.partition("/")[2]: kept[key] for key in kept if key.startswith(name)
        }
    agents = scenario.agents
    assert agents.ids == tuple(known["ids"].tolist())
    np.testing.assert_array_equal(agents.is_valid, known["is_valid"])
    np.testing.assert_allclose(agents.position_m, known["position_m"], atol=1e-4)
    np.testing.assert_allclose(agents.heading_rad, known["heading_rad"], atol=1e-5)
    lanes = np.concatenate([one.centerline_m for one in scenario.road_map.lanes])
    np.testing.assert_allclose(lanes, known["lane"], atol=1e-4)


@pytest.mark.parametrize("name", DEMOS)
def test_an_earlier_recipe_replays_to_the_same_scene(name: str):
    recipe = Recipe.from_text((DATA / f"{name}.recipe.json").read_text())
    check(name, replay(recipe, open_scenario(DEMOS[name])))


@pytest.mark.parametrize("name", DEMOS)
def test_an_earlier_journal_is_restored_with_its_history(name: str, tmp_path: Path):
    shutil.copy(DATA / f"{name}.journal", tmp_path / f"{name}.journal")
    (work,) = find_unfinished(tmp_path)
    base = open_scenario(DEMOS[name])
    session = restore(work, base)
    check(name, session.scenario)
    with np.load(DATA / "states.npz") as kept:
        assert len(session.entries) == kept[f"{name}/num_entries"]
    while session.can_undo:
        session.undo()
    # Those files do not name their current step, which was the first predicted one.
    assert session.scenario.current_step == 50
    assert same_scenario(session.scenario, base.at_step(50))
    session.close()
