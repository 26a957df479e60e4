from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pd_editor.base.errors import EditError, ExportError
from tests.cli.shell import Shell
from tests.experiments.evaluation.small_dataset import write_dataset
from tests.scene.formats.test_opendrive import lane, road, section
from tests.scene.formats.test_opendrive import write as write_road

pytestmark = pytest.mark.usefixtures("no_processes")

GRID = ("--kinds", "ripple-road", "--powers", -6, 6, "--methods", "constant-velocity")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data")


def test_a_study_writes_rows_report_and_gallery(
    shell: Shell, data: Path, tmp_path: Path
):
    out = tmp_path / "out"
    options = (*GRID, "--warps", "smooth-turn:3+ripple-road:2", "--search", 6)
    options += ("--gallery", 2, "--workers", 1, "--seeds", 0, 1)
    result = shell.run("study", "--data", data, "--out", out, *options)
    assert (result.code, result.err) == (0, "")
    names = ["report.html", "report.md", "variants.parquet"]
    assert sorted(result.lines) == [str(out / name) for name in names]
    rows = pq.read_table(out / "variants.parquet")
    assert set(rows["condition"].to_pylist()) == {
        "none",
        "ripple-road:-6",
        "ripple-road:6",
        "smooth-turn:3+ripple-road:2",
    }
    assert set(rows["seed"].to_pylist()) == {0, 1}
    text = (out / "report.md").read_text()
    assert "Search against the grid: SOR, %" in text
    # The name of a column of the rows stood there, and shares without per cent.
    assert "with the highest SOR of movers" in text
    assert "off_drivable_steps" not in text
    page = (out / "report.html").read_text()
    assert page.count("<figure>") == 5
    assert len(list((out / "gallery").iterdir())) == 2
    again = shell.run("study", "--data", data, "--out", out, *options)
    assert again.code == 2
    assert "--resume" in again.err
    assert (
        shell.run("study", "--data", data, "--out", out, *options, "--resume").code == 0
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--methods", "foo"), "There is no method 'foo'"),
        (("--dangers", "-1"), "--dangers is -1"),
        (("--powers", "12"), "Power 12 is not possible"),
        (("--kinds", "bend"), "Warp 'bend' is not known"),
        (("--anchors", "me"), "Anchor 'me' is not known"),
        (("--metric", "beauty"), "--metric: 'beauty' is not known"),
        (("--friction", "3"), "--friction is 3"),
        (("--search", "-1"), "--search is -1"),
        (("--seeds", "-1"), "The seed is -1"),
        (("--address", "auto"), "--address is for --engine ray"),
        (("--warps", "x:1"), "Warp 'x:1' is not known"),
        (("--time-limit", "0"), "--time-limit is 0 s"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(
    shell: Shell, data: Path, tmp_path: Path, options, words
):
    result = shell.run("study", "--data", data, "--out", tmp_path / "out", *options)
    assert result.code == 2
    assert words in result.err
    assert len(result.err.splitlines()) == 1
    assert not (tmp_path / "out" / "finished").exists()


def test_an_empty_root_is_refused(shell: Shell, tmp_path: Path):
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    result = shell.run("study", "--data", tmp_path / "empty", "--out", out)
    assert result.code == 2
    assert "no Argoverse 2 scenario" in result.err


def test_scenes_that_cannot_be_written_are_told(
    shell: Shell, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The report says so as well, and the study does not end as if all were well."""
    reason = "gallery: cannot be written (No space left on device)."

    def full(*_: object, **__: object) -> None:
        raise ExportError(reason) from OSError(28, "No space left on device")

    monkeypatch.setattr("pd_editor.experiments.studies.study_report.export_into", full)
    options = (*GRID, "--gallery", 1, "--workers", 1)
    out = tmp_path / "out"
    assert shell.refused("study", "--data", data, "--out", out, *options) == reason
    assert reason in (out / "report.md").read_text()
    assert (out / "variants.parquet").exists()


def test_a_scene_that_cannot_be_made_again_is_told(
    shell: Shell, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refused(*_: object, **__: object) -> None:
        raise EditError("Agent 5 would move at 250 m/s.")

    monkeypatch.setattr(
        "pd_editor.experiments.studies.study_report.EditorSession.apply", refused
    )
    options = (*GRID, "--gallery", 2, "--workers", 1)
    result = shell.run("study", "--data", data, "--out", tmp_path / "out", *options)
    assert result.code == 0
    assert "Agent 5 would move at 250 m/s" in result.out


@pytest.mark.slow
def test_files_of_other_formats_are_studied_and_evaluated(
    shell: Shell, tmp_path: Path, format_files: Path
):
    data = tmp_path / "data"
    data.mkdir()
    for name in ("USA_Lanker-1_1_T-1.xml", "USA_Peach-1_1_T-1.xml"):
        (data / name).symlink_to(format_files / "commonroad" / name)
    write_road(data, road(section(lane(-1))))  # A bare road has nothing to compare.
    out = tmp_path / "out"
    options = ("--kinds", "ripple-road", "--powers", 6, "--workers", 1)
    result = shell.run("study", "--data", data, "--out", out, *options)
    assert (result.code, result.err) == (0, "")
    rows = pq.read_table(out / "variants.parquet")
    assert len(set(rows["folder"].to_pylist())) == 2
    options = ("--methods", "constant-velocity", "--warps", "none", "--workers", 1)
    result = shell.run("evaluate", "--data", data, "--out", tmp_path / "eval", *options)
    assert (result.code, result.err) == (0, "")
    rows = pq.read_table(tmp_path / "eval" / "rows.parquet")
    assert len(set(rows["scenario_id"].to_pylist())) == 2
