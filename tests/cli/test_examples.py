import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.formats.player import Player
from pd_editor.scene.thresholds import STANDING_MPS
from tests.cli.shell import JUNCTION, ROOT, Shell
from tests.experiments.evaluation.small_dataset import write_dataset

EXAMPLES = sorted(
    path
    for part in ("*.py", "policies/*.py")
    for path in (ROOT / "examples").glob(part)
)
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
GENERATING = (
    "constant_velocity:Predictor",
    "torch_predictor:Predictor",
    "drift_generator:DriftGenerator",
    "own_sampler:generator",
)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_short(path: Path):
    assert len(path.read_text().splitlines()) <= 60


@pytest.mark.parametrize("name", GENERATING)
def test_the_shell_generates_with_an_example(shell: Shell, tmp_path: Path, name: str):
    result = shell.run(
        "generate", JUNCTION, "--model", f"examples.{name}", "--samples", 2,
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert result.code == 0, result.err
    made = [open_scenario(one) for one in sorted((tmp_path / "out").glob("*/"))]
    assert len(made) == 2
    # Two samples differ, and start where the agents are.
    now = made[0].current_step
    first, second = (one.agents.position_m for one in made)
    np.testing.assert_allclose(first[:, now], second[:, now], atol=1e-6)
    assert np.abs(first[:, -1] - second[:, -1]).max() > 0.01


def test_an_own_denoiser_drives_and_is_named(shell: Shell, tmp_path: Path):
    raw = ("--keep-to-lanes", 0, "--tries", 0)
    for name, model in (("own", "examples.own_denoiser:generator"), ("usual", None)):
        given = ("--model", model) if model else ()
        out = ("--out", tmp_path / name)
        assert shell.run("generate", JUNCTION, *given, *raw, *out).code == 0
    own, usual = (
        next(iter((tmp_path / name).glob("*/recipe.json"))) for name in ("own", "usual")
    )
    made = open_scenario(own.parent)
    agents, now = made.agents, made.current_step
    place, velocity = agents.position_m[:, now], agents.velocity_mps[:, now]
    driven = agents.is_valid[:, now:].all(axis=1) & agents.kind_mask(ROAD_USER_KINDS)
    driven &= np.hypot(*velocity.T) > STANDING_MPS
    assert driven.sum() > 10
    steps = range(agents.position_m.shape[1] - now)
    wanted = place[:, None] + velocity[:, None] * 0.1 * np.array(steps)[:, None]
    gap = np.linalg.norm(agents.position_m[:, now:] - wanted, axis=-1)[driven]
    assert gap.max() < 0.5
    assert "path-diffuser+ConstantVelocity" in own.read_text()
    hashes = [re.findall('"model_sha256": "([0-9a-f]{64})"', one.read_text())[0]
              for one in (own, usual)]  # fmt: skip
    assert hashes[0] != hashes[1]


def test_predictions_are_read_from_parquet(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    scenario = open_scenario(JUNCTION)
    row = int(np.flatnonzero(scenario.agents.is_valid.all(axis=1))[0])
    name, later = scenario.agents.ids[row], scenario.current_step + 1
    path = scenario.agents.position_m[row, later:] + scenario.origin_city_m + [1.0, 0]
    table = {
        "scenario_id": [scenario.scenario_id],
        "track_id": [name],
        "probability": [1.0],
        "predicted_trajectory_x": [path[:, 0].tolist()],
        "predicted_trajectory_y": [path[:, 1].tolist()],
    }
    model = ("--model", "examples.parquet_predictor:Predictor")
    monkeypatch.setenv("PREDICTIONS", str(tmp_path / "predictions.parquet"))
    result = shell.run("generate", JUNCTION, *model, "--out", tmp_path / "none")
    assert (result.code, result.lines) == (2, [])
    assert "there are no predictions; set PREDICTIONS." in result.err
    pq.write_table(pa.table(table), tmp_path / "predictions.parquet")
    result = shell.run("generate", JUNCTION, *model, "--out", tmp_path / "out")
    assert result.code == 0, result.err
    (folder,) = (tmp_path / "out").iterdir()
    made = open_scenario(folder)
    found = made.agents.position_m[made.agents.row_of[name], later:]
    expected = path - scenario.origin_city_m
    shift = np.linalg.norm(found - expected, axis=1)
    assert shift.max() < 1e-3


@pytest.mark.slow
def test_the_worked_example_trains_and_is_studied(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    data = write_dataset(tmp_path / "data")
    losses = []
    for name, options in (("plain", ()), ("bent", ("--bent", "--start", "plain.pt"))):
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "examples.scene_attack.road_predictor",
                "--data",
                data,
                "--out",
                f"{name}.pt",
                "--steps",
                "40",
                *options,
            ],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        )
        losses.append(float(done.stdout.split()[-1]))
    assert all(0 <= loss < 1 for loss in losses)
    monkeypatch.setenv("ROAD_PREDICTOR", str(tmp_path))
    result = shell.run(
        "study", "--data", data, "--out", tmp_path / "out", "--powers", 6,
        "--kinds", "ripple-road", "--workers", 1, "--methods",
        "examples.scene_attack.road_predictor:plain",
        "examples.scene_attack.road_predictor:bent",
    )  # fmt: skip
    assert result.code == 0, result.err
    rows = pq.read_table(tmp_path / "out" / "variants.parquet")
    assert rows["failure"].null_count == len(rows)
    assert rows["ade_count"].to_numpy().sum() > 0


def shown_by(cells: list[str]) -> list[Any]:
    """Value of the last line of each cell, which a notebook shows."""
    names: dict[str, Any] = {}
    shown = []
    for cell in cells:
        *lines, last = ast.parse(cell).body
        exec(compile(ast.Module(lines, []), "cell", "exec"), names)
        assert isinstance(last, ast.Expr)
        shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
    return shown


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_scenes(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    # Not installed with the editor.
    (tmp_path / "pandas.py").write_text("raise ImportError")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pandas", raising=False)
    cells = json.loads(path.read_text())["cells"]
    code = [one for one in cells if one["cell_type"] == "code"]
    assert not any(one["outputs"] for one in code), "kept without its outputs"
    shown = shown_by(["".join(one["source"]) for one in code])
    assert any(isinstance(one, Player) for one in shown)
