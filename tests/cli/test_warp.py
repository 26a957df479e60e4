from pathlib import Path

import numpy as np
import pytest

from pd_editor.cli.warp import warp
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M
from tests.cli.shell import JUNCTION, Shell


def test_the_road_bends_to_the_left_ahead_of_the_focal_agent(
    shell: Shell, tmp_path: Path
):
    result = shell.run(
        "warp", JUNCTION, "--kind", "smooth-turn", "--power", 6, "--out", tmp_path
    )
    assert (result.code, result.err) == (0, "")
    bent = tmp_path / f"{JUNCTION}-smooth-turn-p6"
    assert result.lines[0] == str(bent)
    assert "Curvature up to" in result.lines[1]
    assert "at mu = 0.7." in result.lines[1]
    before, after = open_scenario(JUNCTION), open_scenario(bent)
    row, step = before.agents.row_of[before.focal_id], before.current_step
    heading = before.agents.heading_rad[row, step]
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    moved = after.agents.position_m - before.agents.position_m
    offset = before.agents.position_m - before.agents.position_m[row, step]
    np.testing.assert_allclose(moved @ ahead, 0, atol=2e-3)
    assert (moved @ left)[offset @ ahead > 6].min() > 0
    np.testing.assert_allclose((moved @ left)[offset @ ahead < 5], 0, atol=2e-3)


def test_one_kind_is_given_bare_or_in_a_tuple(tmp_path: Path):
    bare = warp(JUNCTION, kind="ripple-road", power=2, out=tmp_path / "a")
    several = warp(
        JUNCTION,
        kind=("ripple-road",),
        power=(2.0,),
        length=(DEFAULT_LENGTH_M["ripple-road"],),
        out=str(tmp_path / "b"),
    )
    for name in ("recipe.json", f"scenario_{bare.folder.name}.parquet"):
        assert (bare.folder / name).read_bytes() == (several.folder / name).read_bytes()


def test_kinds_add_up(shell: Shell, tmp_path: Path):
    common = ("--kind", "smooth-turn", "ripple-road", "--power", -6, 2, "--length")
    result = shell.run("warp", JUNCTION, *common, 20, 40, "--out", tmp_path / "both")
    assert result.code == 0
    base = open_scenario(JUNCTION).agents.position_m
    both = open_scenario(Path(result.lines[0])).agents.position_m
    parts = [
        warp(JUNCTION, kind=kind, power=power, length=length, out=tmp_path / kind)
        for kind, power, length in (("smooth-turn", -6, 20), ("ripple-road", 2, 40))
    ]
    total = sum(part.scenario.agents.position_m - base for part in parts)
    np.testing.assert_allclose(both - base, total, atol=2e-3)


def test_friction_slows_agents(tmp_path: Path):
    common = {"kind": "smooth-turn", "power": 10, "anchor": "ego"}
    free = warp(JUNCTION, **common, out=tmp_path / "free")
    slow = warp(JUNCTION, **common, friction=0.1, out=tmp_path / "slow")
    assert "at mu = 0.1" in slow.remarks[0]
    one, other = free.scenario.agents, slow.scenario.agents
    # At equal times a late agent may be the faster one, but it is never farther.
    assert (travelled_m(other) <= travelled_m(one) + 0.3).all()
    assert (other.speed_mps().max(axis=1) <= one.speed_mps().max(axis=1) + 0.3).all()
    assert (other.speed_mps() < one.speed_mps() - 1).any()


def travelled_m(agents):
    """Way from the current step on."""
    steps = np.diff(agents.position_m[:, 49:], axis=1)
    return np.linalg.norm(steps, axis=-1).cumsum(axis=1)


def test_a_pose_is_an_anchor(tmp_path: Path):
    scenario = open_scenario(JUNCTION)
    row = scenario.agents.row_of["AV"]
    x, y = scenario.agents.position_m[row, scenario.current_step]
    degrees = np.degrees(scenario.agents.heading_rad[row, scenario.current_step])
    common = {"kind": "double-turn", "power": 3}
    ego = warp(JUNCTION, **common, anchor="ego", out=tmp_path / "ego")
    named = warp(JUNCTION, **common, anchor="AV", out=tmp_path / "named")
    pose = warp(JUNCTION, **common, anchor=f"{x},{y},{degrees}", out=tmp_path / "pose")
    expected = ego.scenario.agents.position_m
    np.testing.assert_array_equal(named.scenario.agents.position_m, expected)
    np.testing.assert_allclose(pose.scenario.agents.position_m, expected, atol=1e-9)


def test_power_zero_changes_nothing(tmp_path: Path):
    done = warp(JUNCTION, kind="smooth-turn", power=0, out=tmp_path)
    assert done.remarks == ("With power 0 the road stays as it was.",)
    assert done.scenario.agents is not None
    np.testing.assert_array_equal(
        done.scenario.agents.position_m, open_scenario(JUNCTION).agents.position_m
    )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--power 20", "Power 20 is outside -10..10."),
        ("--power nan", "A warp's numbers must be finite."),
        ("--power 1 2", "1 kinds and 2 powers were given"),
        ("--power 1 --length 5 6", "1 kinds and 2 lengths were given"),
        ("--power 1 --length 0", "Length 0 m is outside 1..500 m."),
        ("--power 1 --border -1", "Border -1 m is outside 0..500 m."),
        ("--power 1 --exponent 1", "Exponent 1 is outside 2..8."),
        ("--power 1 --friction 0", "Friction coefficient 0 is outside 0.01..2."),
        ("--power 1 --friction inf", "must be a finite number"),
        (
            "--power 1 --anchor missing",
            "There is no agent 'missing' here; expected one of ",
        ),
        ("--power 1 --anchor 1,2", "Anchor '1,2' is no pose"),
        ("--power 1 --anchor 1,2,x", "Anchor '1,2,x' is no pose"),
        ("--power 1 --anchor -1,2,nan", "Anchor '-1,2,nan' is no pose"),
    ],
)
def test_bad_numbers_are_refused(
    shell: Shell, tmp_path: Path, options: str, sentence: str
):
    command = ("warp", JUNCTION, "--kind", "smooth-turn", "--out", tmp_path / "out")
    assert sentence in shell.refused(*command, *options.split())
    assert not (tmp_path / "out").exists()


def test_kinds_are_given_once_each(shell: Shell, tmp_path: Path):
    command = ("warp", JUNCTION, "--out", tmp_path, "--power", 1, 2, "--kind")
    refused = shell.refused(*command, "smooth-turn", "smooth-turn")
    assert refused == "A kind was given twice; each may be used once."
    assert "No kind was given" in shell.refused(
        "warp", JUNCTION, "--out", tmp_path, "--kind", "--power"
    )
