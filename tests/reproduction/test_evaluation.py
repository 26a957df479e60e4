"""The paper's tables from trained folders to the page."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pd_editor.base.errors import ModelError
from pd_editor.generation.checkpoints.model_folder import TrainedStage, save_model
from pd_editor.generation.initial_state.network.agent_count_prior import AgentCounts
from pd_editor.generation.stages import INITIAL_STATES, TRAJECTORIES
from reproduction import evaluation as paper
from reproduction.__main__ import PaperTables, make_tables
from reproduction.pictures import PaperPicture
from tests.experiments.evaluation.small_dataset import write_dataset
from tests.generation.initial_state.scenes import small_model as small_placer
from tests.generation.trajectory.scenes import small_model as small_driver


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


def asked(study: Path, out: Path, **more: Any) -> PaperTables:
    given: dict[str, Any] = {
        "data": (str(study / "data" / "val"),),
        "models": (study / "models",),
        "out": out,
        "samples": 1,
        "workers": 1,
    }
    return PaperTables(**given | more)


@pytest.mark.slow
def test_the_page_has_all_tables_and_figures_and_the_run_goes_on(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    drawn = PaperPicture(name="states", caption="A caption.", png=b"png", pdf=b"pdf")
    monkeypatch.setattr(paper, "_pictures", lambda *_: [drawn])
    out = tmp_path / "report"
    result = make_tables(asked(study, out, warps=("none",)))
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
    assert text in str(result)
    # What is finished is not done again, and the numbers are the same.
    rows = out / "states" / "rows.parquet"
    before = rows.read_bytes()
    make_tables(asked(study, out, warps=("none",), resume=True))
    assert rows.read_bytes() == before
    assert (out / "paper.md").read_text() == text


def test_weights_that_do_not_fit_are_refused_at_once(study: Path, tmp_path: Path):
    write_variant(tmp_path / "models" / "pd-seed0", "init", "traj")
    config = tmp_path / "models" / "pd-seed0" / "config.json"
    config.write_text(config.read_text().replace('"width": 32', '"width": 64'))
    with pytest.raises(ModelError, match=r"safetensors.*expected"):
        make_tables(asked(study, tmp_path / "x", models=(tmp_path / "models",)))
    assert not (tmp_path / "x").exists()
