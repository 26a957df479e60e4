from pathlib import Path

import pytest

from pd_editor.base.errors import InputError
from pd_editor.experiments.evaluation.report.sample_figures import figure_scenes
from pd_editor.generation.lane_follower import LaneFollower
from tests.experiments.evaluation.small_dataset import make_sideways, write_dataset


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data")


def test_figures_of_trajectories_stand_beside_those_of_the_log(root: Path):
    scenes = figure_scenes([root], samples_states=False)
    assert len(scenes.scenes) == 3
    found = scenes.figures(lambda _: make_sideways("sideways"))
    assert found["samples"]["failed_scenes"] == 0
    # It stands still: far from the log where agents drive, and no path of its own.
    assert found["samples"]["min_ade"] > 5
    assert found["samples"]["path_length"] < 10 < found["recorded"]["path_length"]
    follows = scenes.figures(lambda _: LaneFollower())
    assert follows["samples"]["min_ade"] < found["samples"]["min_ade"]


def test_scenes_on_which_the_model_fails_are_counted(root: Path):
    scenes = figure_scenes([root], samples_states=False)
    found = scenes.figures(lambda _: make_sideways("raises-on-bbb"))
    assert found["samples"]["failed_scenes"] == 1
    assert "min_ade" in found["samples"]
    gone = scenes.figures(lambda _: make_sideways("raises"))
    assert gone["samples"] == {"failed_scenes": 3.0}


def test_roots_without_scenarios_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="without scenario folders: "):
        figure_scenes([tmp_path], samples_states=True)
