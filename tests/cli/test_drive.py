import json
from pathlib import Path

from pd_editor.editor.scenario_store import open_scenario
from tests.cli.shell import JUNCTION, Shell, files_of

POLICY = """
import numpy as np
from pd_editor.scene.policy import Controls

class Coasts:
    name = "coasts"
    def reset(self, scene, ego_id, route_m, seed):
        self.asked = 0
    def plan(self, observation):
        return Controls(acceleration_mps2=np.full(20, -0.2), curvature_1pm=np.zeros(20))
"""


def test_policies_drive_and_are_scored(shell: Shell, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "coasting.py").write_text(POLICY)
    options = ("--seconds", 3, "--model", "lane-follower", "--out", tmp_path / "out")
    result = shell.run(
        "drive", JUNCTION, "--policies", "idm", "coasting:Coasts", *options
    )
    assert (result.code, result.err) == (0, "")
    *folders, idm, coasts = result.lines
    assert idm.startswith("idm: ")
    assert " m in 3.0 s, " in idm
    assert coasts.startswith("coasts: ")
    (one, _) = map(Path, folders)
    opened = open_scenario(one)
    assert opened.time_axis.num_future_steps == 30
    (command,) = json.loads((one / "recipe.json").read_text())["commands"]
    assert command["policies"] == {"AV": "idm"}
    again = shell.run("replay", one, "--out", tmp_path / "again")
    assert again.code == 0
    assert files_of(Path(again.lines[0])) == files_of(one)


def test_what_is_no_policy_is_refused(shell: Shell, tmp_path: Path):
    out = ("--out", tmp_path, "--model", "lane-follower")
    assert "There is no policy 'idn'; the nearest is idm" in shell.refused(
        "drive", JUNCTION, "--policies", "idn", *out
    )
    assert "expected an object with a name" in shell.refused(
        "drive", JUNCTION, "--policies", "math:pi", *out
    )
    assert "There is no agent 'nobody'" in shell.refused(
        "drive", JUNCTION, "--policies", "idm", "--ego", "nobody", *out
    )
    assert not list(tmp_path.iterdir())
