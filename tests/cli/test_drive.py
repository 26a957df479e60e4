import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import pd_editor
from pd_editor.cli.output import read_plans
from pd_editor.editor.commands import DeleteAgents
from pd_editor.editor.scenario_store import export_into, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.experiments.closed_loop.policies import policy_of
from tests.cli.shell import JUNCTION, Shell, files_of

POLICY = """
import numpy as np
from pd_editor.scene.policy import Controls

class Coasts:
    name = "coasts"
    def reset(self, scene, ego_id, route_m, seed):
        pass
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
    *folders, idm, coasts, told = result.lines
    assert told == f"{tmp_path / 'out' / 'report.html'} compares the policies."
    assert idm.startswith("idm: ")
    assert " m in 3.0 s, " in idm
    assert coasts.startswith("coasts: ")
    report = (tmp_path / "out" / "report.md").read_text()
    assert "| idm | 1 | 0 | " in report
    assert f"`pd-editor edit {Path(folders[1]).name}`" in report
    (one, other) = map(Path, folders)
    opened = open_scenario(one)
    assert opened.time_axis.num_future_steps == 30
    (command,) = json.loads((one / "recipe.json").read_text())["commands"]
    assert command["policies"] == {"AV": "idm"}
    again = shell.run("replay", one, "--out", tmp_path / "again")
    assert again.code == 0
    assert files_of(Path(again.lines[0])) == files_of(one)
    scene = open_scenario(other)
    plans = read_plans(other, scene)["AV"]
    assert sorted(plans) == [scene.current_step + 5 * one for one in range(6)]
    track = scene.agents.position_m[scene.agents.row_of["AV"]]
    for at, line in plans.items():
        # Each plan begins where the agent then was, and is driven until the next one.
        np.testing.assert_allclose(line[:6], track[at : at + 6], atol=0.02)


@pytest.mark.slow
def test_films_of_drives_show_the_plans(shell: Shell, tmp_path: Path):
    options = ("--seconds", 1, "--model", "lane-follower", "--out", tmp_path)
    drive = ("drive", JUNCTION, "--policies", "constant-velocity", *options)
    (folder, *_) = shell.run(*drive).lines
    look = ("--height", 120, "--follow", "AV", "--radius", 15)

    def film(name: str, scene: str | Path = folder) -> bytes:
        out = tmp_path / name
        assert shell.run("render", scene, *look, "--out", out).code == 0
        return out.read_bytes()

    shown = film("shown.gif")
    assert film("recipe.gif", Path(folder) / "recipe.json") == shown
    file = Path(f"{folder}-plans.json")
    file.write_text("[[]]")
    refused = shell.refused("render", folder, *look, "--out", tmp_path / "bad.gif")
    assert f"{file}: holds no plans of pd-editor drive." in refused
    file.unlink()
    assert film("without.gif") != shown


def test_guidance_and_locks_of_the_shell_hold(shell: Shell, tmp_path: Path):
    guide = ("--guide", "speed-limit:speed=4", "stop-at-line:agent=AV,line=500/0+503/0")
    options = ("--lock", "car-0071=1.5", "--seconds", 2, "--out", tmp_path / "out")
    result = shell.run("drive", JUNCTION, *guide, *options)
    assert (result.code, result.err) == (0, "")
    folder, limit, stop = result.lines
    assert limit.startswith("speed limit of all agents: ")
    assert stop.startswith(
        "stop line of agent AV: asked stops before the line, achieved"
    )
    assert Path(f"{folder}-guidance.csv").read_text().count("\n") == 3
    commands = json.loads((Path(folder) / "recipe.json").read_text())["commands"]
    assert len(commands) == 4
    before = files_of(tmp_path / "out")
    assert shell.run("drive", JUNCTION, *guide, *options).lines == result.lines
    assert files_of(tmp_path / "out") == before
    assert "--guide" in shell.refused("drive", JUNCTION, "--guide", "gaol", *options)


def test_what_is_no_policy_is_refused(shell: Shell, tmp_path: Path, monkeypatch):
    out = ("--out", tmp_path, "--model", "lane-follower")
    assert "There is no policy 'idn'; the nearest is idm" in shell.refused(
        "drive", JUNCTION, "--policies", "idn", *out
    )
    assert "expected an object with a name" in shell.refused(
        "drive", JUNCTION, "--policies", "math:pi", *out
    )
    assert "There is no agent 'nobody' here; expected one of " in shell.refused(
        "drive", JUNCTION, "--policies", "idm", "--ego", "nobody", *out
    )
    for name in (7, "", "x" * 300):
        path = "unnamed_" + str(name)[:1]
        (tmp_path.parent / f"{path}.py").write_text(
            "from pd_editor.experiments.closed_loop.policies import IdmOnRoute\n"
            f"class P(IdmOnRoute):\n    name = {name!r}\n"
        )
        monkeypatch.chdir(tmp_path.parent)
        assert f"{path}:P has no usable name (TypeError: {name!r}"[
            :60
        ] in shell.refused("drive", JUNCTION, "--policies", f"{path}:P", *out)
    assert not list(tmp_path.iterdir())


def test_the_focal_agent_is_driven_where_there_is_no_ego(tmp_path: Path):
    """Maps that were filled have no ego, and each drive had to name somebody."""
    session = EditorSession(open_scenario(JUNCTION))
    session.apply(DeleteAgents(agent_ids=("AV",)))
    scene = export_into(tmp_path, session.scenario, session.recipe())
    driven = pd_editor.drive(
        scene, policies="idm", seconds=1, model="lane-follower", out=tmp_path / "out"
    )
    recipe = json.loads((driven.folders[0] / "recipe.json").read_text())
    assert recipe["commands"][-1]["policies"] == {session.scenario.focal_id: "idm"}


def test_drives_over_scenes_are_reported_and_go_on(shell: Shell, tmp_path: Path):
    """What is written stays; one scene that fails ends no other."""
    out, broken = tmp_path / "out", tmp_path / "broken.json"
    broken.write_text("{}")
    options = ("--seconds", 1, "--model", "lane-follower", "--out", out)
    scenes = (JUNCTION, broken, "roundabout")
    policies = ("--policies", "constant-velocity", "idm")
    first = shell.run("drive", *scenes, *policies, *options)
    assert "broken" in first.err
    folders = [Path(one) for one in first.lines[:4]]
    before = {one: files_of(one) for one in folders}
    times = [(one / "recipe.json").stat().st_mtime_ns for one in folders]
    report = (out / "report.md").read_text()
    assert report.count("`pd-editor edit ") == 4
    for policy in ("constant-velocity", "idm"):
        (line,) = [x for x in report.splitlines() if x.startswith(f"| {policy} | 2 |")]
        assert "[" in line
    assert "broken.json" in report
    page = (out / "report.html").read_text()
    shutil.rmtree(folders[0])
    again = shell.run("drive", *scenes, *policies, *options)
    assert again.lines == first.lines
    assert {one: files_of(one) for one in folders} == before
    assert (out / "report.html").read_text() == page
    later = [(one / "recipe.json").stat().st_mtime_ns for one in folders]
    assert [a == b for a, b in zip(times, later, strict=True)] == [False, *[True] * 3]


def test_further_agents_are_driven(shell: Shell, tmp_path: Path):
    agents = open_scenario(JUNCTION).agents
    other = next(
        name
        for name in agents.ids
        if name != "AV" and agents.is_valid[agents.row_of[name], 49]
    )
    options = ("--seconds", 1, "--model", "lane-follower", "--out", tmp_path)
    result = shell.run(
        "drive", JUNCTION, "--policies", "idm", "--also", f"{other}=idm", *options
    )
    (command,) = json.loads((Path(result.lines[0]) / "recipe.json").read_text())[
        "commands"
    ]
    assert command["policies"] == {"AV": "idm", other: "idm"}
    assert "is not ID=NAME of an agent that nobody else drives" in shell.refused(
        "drive", JUNCTION, "--policies", "idm", "--also", "AV=idm", *options
    )
    made = pd_editor.drive(
        JUNCTION,
        policies="idm",
        also={other: policy_of("constant-velocity")},
        seconds=1.0,
        model="lane-follower",
        out=tmp_path / "python",
    )
    (command,) = json.loads((made.folder / "recipe.json").read_text())["commands"]
    assert command["policies"][other] == "constant-velocity"
    report = (tmp_path / "python" / "report.md").read_text()
    assert f"'{other}=<constant-velocity, an object of Python>'" in report
    assert "Two policies have one name" in shell.refused(
        "drive",
        JUNCTION,
        "--policies",
        "idm",
        "pd_editor.experiments.closed_loop.policies:IdmOnRoute",
        *options,
    )


def test_a_drive_that_fails_has_no_score_and_is_made_again(
    shell: Shell, tmp_path: Path, monkeypatch
):
    """It was scored as if it had driven, and the shell said that all was well."""
    monkeypatch.chdir(tmp_path)
    policy, out = tmp_path / "mine" / "policy.py", tmp_path / "out"
    policy.parent.mkdir()
    making = "\ndef make_policy(folder):\n    return Coasts()\n"
    fails = "if observation.time_s > 1: raise ValueError('lost')\n        return "
    policy.write_text(POLICY.replace("return ", fails) + making)
    words = (
        "drive",
        JUNCTION,
        "--policies",
        "idm",
        "mine",
        "--seconds",
        3,
        "--out",
        out,
    )
    words += ("--model", "lane-follower")
    result = shell.run(*words)
    told = "AV at 1.5 s: The policy coasts failed (ValueError: lost in policy.py"
    assert result.code == 2
    assert f"{JUNCTION}, coasts: {told}" in result.err
    assert f"coasts: failed. {told}" in result.out
    report = (out / "report.md").read_text()
    assert "| idm | 1 | 0 | " in report
    assert "| coasts | 1 | 1 | 0.0 | - |" in report
    assert f"| coasts | {JUNCTION} | failed | failed. {told}" in report
    assert f"| {JUNCTION}, coasts | {told}" in report
    kept = (out / "signalised-junction-idm-s0" / "recipe.json").stat().st_mtime_ns
    policy.write_text(POLICY + making)
    again = shell.run(*words)
    assert (again.code, again.err) == (0, "")
    assert "| coasts | 1 | 0 | " in (out / "report.md").read_text()
    now = (out / "signalised-junction-idm-s0" / "recipe.json").stat().st_mtime_ns
    assert now == kept


def test_objects_and_classes_are_policies_in_python(tmp_path: Path):
    """Names alone were taken."""
    space: dict = {}
    exec(POLICY, space)
    options = {"seconds": 1, "model": "lane-follower", "out": tmp_path}
    made = pd_editor.drive(JUNCTION, policies=space["Coasts"](), **options)
    assert [one.policy for one in made.records] == ["coasts"]
    # The line to repeat it names no policy that the shell does not have.
    told = (tmp_path / "report.md").read_text()
    assert "--policies '<coasts, an object of Python>'" in told
    assert f"--out {tmp_path}" in told
    both = pd_editor.drive(JUNCTION, policies=[space["Coasts"], "idm"], **options)
    assert [one.policy for one in both.records] == ["coasts", "idm"]
    assert both.failures == {}
