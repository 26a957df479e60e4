"""A short random walk; ``benchmarks.random_walks`` takes long ones."""

from pathlib import Path

import numpy as np

from pd_editor.base.installed_files import demo_folder
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.viewer.state.session_shelf import SessionShelf
from pd_editor.viewer.state.workspace import Workspace
from tests.random_walk import walk

DEMOS = ("crosswalk", "queue", "bus-stop")


def test_random_edits_of_several_scenarios_keep_every_promise(tmp_path: Path):
    """(D2, D3): no traceback, undo exact, replay and export equal, one focal track."""
    folders = [demo_folder(name) for name in DEMOS]
    workspace = Workspace(
        open_scenario(folders[0]), dataset=None, shelf=SessionShelf(tmp_path)
    )
    rng = np.random.default_rng(15)
    counts = walk(workspace, folders, rng, 250, tmp_path / "out")
    workspace.close()
    workspace.shelf.close()
    assert counts.checked == len(DEMOS)
    assert counts.refused < counts.commands / 3
