import json
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest
from viser import LocalStorageHandle

from pd_editor.base.errors import InputError
from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.scene.base_reference import SceneCut
from pd_editor.viewer.state.workspace import Workspace
from pd_editor.viewer.viewer_app import ViewerApp
from tests.cli.shell import ROOT
from tests.scene.test_time_cut import recording_of_minutes
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until

SCRIPT = """
import sys, time
from pathlib import Path
from pd_editor.viewer import viewer_app

viewer_app.WARM_UP_AFTER_S = 0.0
app = viewer_app.ViewerApp(viewer_app.ViewerOptions(reference="crosswalk", port=0, state=Path(sys.argv[1])))
app._warm_up.start()
time.sleep(float(sys.argv[2]))
app.stop()
"""


@pytest.mark.parametrize(
    "seconds", [1.5, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.5, 2.5))]
)
def test_ending_while_a_model_is_loaded_is_a_clean_end(tmp_path: Path, seconds: float):
    """A thread that ended inside torch aborted the process at its exit."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path), str(seconds)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_moment_of_a_recording_of_minutes_is_asked_for_at_first(tmp_path: Path):
    """The command ended with a sentence, and no page opened."""
    path = recording_of_minutes(tmp_path / "data")
    with running_app(tmp_path / "state", str(path)) as app, connected_tab(app) as tab:
        assert tab.session.base.time_axis.num_future_steps == 60
        until(lambda: tab.inputs().get("Current moment (s)"))
        tab.type("Current moment (s)", 30.0)
        tab.press("Open this part")
        until(
            lambda: tab.session.base.provenance.cut == SceneCut(current_s=30, until_s=6)
        )


def one_workspace(app: ViewerApp, tab: FakeTab) -> Workspace:
    return next(one for one in app.workspaces() if one.session is tab.session)


@pytest.mark.parametrize(("host", "shares"), [("127.0.0.1", True), ("0.0.0.0", False)])
def test_visitors_of_an_open_server_see_only_their_own_work(
    tmp_path: Path, host: str, shares: bool
):
    """Another browser listed, downloaded and removed what was saved here."""
    with (
        running_app(tmp_path, "queue", host=host) as app,
        connected_tab(app) as one,
        connected_tab(app) as other,
    ):
        first, second = one_workspace(app, one), one_workspace(app, other)
        for name in ("crosswalk", "bus-stop"):
            ids = (one.session.scenario.focal_id,)
            edit = SetAgentSpeed(agent_ids=ids, speed_mps=3.0)
            one.run(lambda edit=edit: one.session.apply(edit))
            one.run(first.save if name == "crosswalk" else lambda: None)
            one.run(lambda name=name: first.open_reference(name))
        assert len(first.shelf.unfinished()) == len(first.library.cards()) == 1
        assert (first.shelf is second.shelf) == shares
        assert len(second.shelf.unfinished()) == (1 if shares else 0)
        assert len(second.library.cards()) == (1 if shares else 0)
        if not shares:
            (saved,) = first.library.cards()
            second.library.remove(saved.name)
            with pytest.raises(InputError):
                second.library.zipped([saved.name])
            assert first.library.cards() == [saved]


def test_a_visitor_finds_its_work_again_after_a_restart(tmp_path: Path):
    folders: list[Path] = []
    for visitor in ("key of one", "key of one", "../../other"):
        stored = json.dumps({"visitor": visitor, "sessions": []})
        with (
            mock.patch.object(LocalStorageHandle, "get_item", return_value=stored),
            running_app(tmp_path, "queue", host="0.0.0.0") as app,
            connected_tab(app) as tab,
        ):
            folders.append(tab.tab.workspace.shelf.folder)
    assert folders[0] == folders[1] != folders[2]
    assert all(folder.parent == tmp_path / "visitors" for folder in folders)
    assert "one" not in folders[0].name
