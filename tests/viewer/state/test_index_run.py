"""The index of a dataset, brought up to date in the background."""

import shutil
from pathlib import Path

import pytest

from pd_editor.base.installed_files import demo_folder
from pd_editor.experiments.scene_index.index_file import INDEX_NAME, SceneIndex
from pd_editor.experiments.scene_index.query import find_scenes
from pd_editor.experiments.work_engine.work_engine import InThisProcess
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.viewer.state import index_run
from pd_editor.viewer.state.index_run import IndexRun
from tests.viewer.fake_browser import connected_tab, running_app, until

DEMOS = ("crosswalk", "merge", "roundabout")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in DEMOS:
        shutil.copytree(demo_folder(name), tmp_path / "scenes" / name)
    monkeypatch.setattr(index_run, "LocalProcesses", lambda **_: InThisProcess())
    return tmp_path / "scenes"


def opened(root: Path) -> IndexRun:
    run = IndexRun(DatasetIndex(root), root / INDEX_NAME)
    before = run.stamp
    run.look()
    until(lambda: run.stamp >= before + 3)
    return run


def indexed(run: IndexRun) -> IndexRun:
    run.start()
    until(lambda: run.fraction is None)
    return run


def test_what_is_missing_is_indexed_once(root: Path):
    run = opened(root)
    assert (run.num_missing, len(run.index.table), run.words) == (3, 0, "")
    indexed(run)
    assert (run.num_missing, run.words) == (0, "")
    found = find_scenes(run.index, "agents > 0")
    assert [Path(one.path) for one in found] == [root / name for name in DEMOS]
    next((root / "merge").glob("*.parquet")).touch()
    assert opened(root).num_missing == 1


class OneByOne:
    """Waits before each scene but the first until it is told to go on."""

    def __init__(self) -> None:
        self.goes_on = False
        self.keys: list[str] = []

    def run(self, function, items, *, on_result, on_wait):
        for key, item in items.items():
            while self.keys and not self.goes_on:
                on_wait()
            self.keys.append(key)
            InThisProcess().run(function, {key: item}, on_result=on_result)


def test_a_run_is_usable_meanwhile_cancelled_and_resumed(root: Path, monkeypatch):
    engine = OneByOne()
    monkeypatch.setattr(index_run, "REFRESH_S", 0.0)
    monkeypatch.setattr(index_run, "LocalProcesses", lambda **_: engine)
    run = opened(root)
    run.start()
    until(lambda: run.num_missing == 2)
    assert run.words.startswith("Indexing: 1 of 3 scenes, ")
    assert run.fraction == pytest.approx(1 / 3)
    assert len(find_scenes(run.index, "agents > 0")) == 1
    # Another tab has the button as well.
    run.start()
    run.cancel()
    assert run.fraction is None
    engine.goes_on = True
    indexed(run)
    assert (run.num_missing, len(engine.keys)) == (0, 3)


def test_a_broken_index_and_a_broken_scene_are_told(root: Path):
    (root / INDEX_NAME).write_bytes(b"PAR1")
    next((root / "merge").glob("*.parquet")).write_bytes(b"nothing")
    run = opened(root)
    assert run.words == f"{INDEX_NAME} cannot be read; it is to be made anew."
    indexed(run)
    assert (run.words, run.num_missing) == ("1 cannot be read.", 1)
    assert len(SceneIndex.read(root).table) == 2


def test_a_folder_that_cannot_be_written_is_told_before_the_work(tmp_path, root):
    (tmp_path / "file").write_text("")
    run = IndexRun(DatasetIndex(root), tmp_path / "file" / INDEX_NAME)
    indexed(run)
    assert "cannot be written" in run.words
    assert len(run.index.table) == 0


def test_the_app_puts_the_index_of_a_read_only_dataset_into_the_state(
    root: Path, tmp_path: Path, monkeypatch
):
    monkeypatch.setattr("os.access", lambda *_: False)
    with (
        running_app(tmp_path / "library", "roundabout", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        run = tab.tab.workspace.index_run
        assert run is not None
        assert run.file.parent == tmp_path / "library"
        assert run.file.name.endswith(INDEX_NAME)
