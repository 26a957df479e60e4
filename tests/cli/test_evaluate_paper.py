"""``pd-editor evaluate --paper`` from trained folders to the page."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pd_editor.cli import paper
from pd_editor.experiments.evaluation.paper.pictures import PaperPicture
from pd_editor.model.checkpoints.model_folder import TrainedStage, save_model
from pd_editor.model.initial_state.network.agent_count_prior import AgentCounts
from pd_editor.model.stages import INITIAL_STATES, TRAJECTORIES
from tests.cli.shell import Shell
from tests.experiments.evaluation.small_dataset import write_dataset
from tests.model.initial_state.scenes import small_model as small_placer
from tests.model.trajectory.scenes import small_model as small_driver


def write_variant(folder: Path, *own: str) -> None:
    """A model with random weights, whose own stages have runs beside it."""
    driver, placer = small_driver(), small_placer()
    placer.set_agent_counts(
        AgentCounts(
            half_side_m=np.full(3, 62.0),
            lane_m=np.full(3, 200.0),
            counts=np.ones((3, 5, 2, 2), int),
        )
    )
    save_model(
        folder,
        {
            "traj": TrainedStage(kind=TRAJECTORIES, config=driver.config, model=driver),
            "init": TrainedStage(
                kind=INITIAL_STATES, config=placer.config, model=placer
            ),
        },
    )
    for stage in own:
        (folder / "runs" / stage).mkdir(parents=True)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    write_variant(folder / "models" / "pd-seed0", "init", "traj")
    write_variant(folder / "models" / "mha-seed0", "init")
    write_dataset(folder / "data")
    return folder


def command(study: Path, out: Path, *more: str) -> list[str]:
    data, models = str(study / "data" / "val"), str(study / "models")
    words = ["evaluate", "--paper", "--data", data, "--models", models]
    words += ["--out", str(out), "--samples", "1", "--workers", "1"]
    return [*words, *more]


@pytest.mark.slow
def test_the_page_has_all_tables_and_figures_and_the_run_goes_on(
    shell: Shell, study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    drawn = PaperPicture(name="states", caption="A caption.", png=b"png", pdf=b"pdf")
    monkeypatch.setattr(paper, "_pictures", lambda *_: [drawn])
    out = tmp_path / "report"
    roads = ["--warps", "none"]
    result = shell.run(*command(study, out, *roads))
    assert result.code == 0, result.err
    page = (out / "paper.html").read_text()
    for number in ("I:", "II:", "II, corrected", "III:", "IV:"):
        assert f"Table {number}" in page
    for name in ("MHA, raw", "PD, guided", "constant velocity", "lane follower", "GT"):
        assert name in page
    # Roads that were not asked for are not evaluated, and the report says so.
    evaluated = pq.read_table(
        out / "trajectories-all-agents" / "rows.parquet", columns=["warp"]
    )
    assert set(evaluated["warp"].to_pylist()) == {"none"}
    assert "no warped roads were asked for" in page
    assert ", map perturbation" not in page
    assert page.count("data:image/png;base64") == 1
    assert (out / "figures" / "states.pdf").read_bytes() == b"pdf"
    text = (out / "paper.md").read_text()
    assert text in result.out
    # What is finished is not done again, and the numbers are the same.
    rows = out / "states" / "rows.parquet"
    before = rows.read_bytes()
    assert shell.run(*command(study, out, *roads, "--resume")).code == 0
    assert rows.read_bytes() == before
    assert (out / "paper.md").read_text() == text


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--methods", "path-diffuser"], "--paper chooses methods"),
        (["--states", "sampled"], "--paper chooses methods"),
    ],
)
def test_options_of_the_other_evaluation_are_refused(
    shell: Shell, study: Path, tmp_path: Path, more: list[str], sentence: str
):
    assert sentence in shell.refused(*command(study, tmp_path / "x", *more))
    assert not (tmp_path / "x").exists()


def test_models_without_the_paper_are_refused(
    shell: Shell, study: Path, tmp_path: Path
):
    words = command(study, tmp_path / "x")
    words.remove("--paper")
    assert "--models is for --paper" in shell.refused(*words)


def test_weights_that_do_not_fit_are_refused_at_once(
    shell: Shell, study: Path, tmp_path: Path
):
    write_variant(tmp_path / "models" / "pd-seed0", "init", "traj")
    config = tmp_path / "models" / "pd-seed0" / "config.json"
    config.write_text(config.read_text().replace('"width": 32', '"width": 64'))
    words = command(study, tmp_path / "x")
    words[words.index("--models") + 1] = str(tmp_path / "models")
    told = shell.refused(*words)
    assert "safetensors" in told
    assert "expected" in told
    assert not (tmp_path / "x").exists()
