"""A format of one's own: the example, joined by an entry point as a package does it."""

from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import InputError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats import registry
from pd_editor.scene.formats.registry import ENTRY_POINTS, formats


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest):
    """Formats with one of another package."""
    point = EntryPoint(
        name="csv-folder",
        value=getattr(request, "param", "examples.csv_format:FORMAT"),
        group=ENTRY_POINTS,
    )
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([point]))
    formats.cache_clear()
    yield
    formats.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two lanes in a row, and a car that drives along both."""
    path = tmp_path / "my_street"
    path.mkdir()
    (path / "lanes.csv").write_text(
        "lane,x_m,y_m\na,0,0\na,60,0\nb,60,0\nb,120,10\nc,0,3.5\nc,60,3.5\n"
    )
    rows = [f"car,{n / 5},{10 * n / 5},0,0" for n in range(40)]
    (path / "tracks.csv").write_text(
        "\n".join(["agent,time_s,x_m,y_m,heading_rad", *rows])
    )
    return path


@pytest.mark.usefixtures("joined")
def test_a_folder_opens_like_any_scene(folder: Path):
    scenario = open_scenario(folder)
    assert scenario.scenario_id == "my_street"
    assert [lane.successors for lane in scenario.road_map.lanes] == [(2,), (), ()]
    agents = scenario.agents
    assert agents.ids == ("car",)
    known = agents.is_valid[0]
    # Five states a second become ten.
    assert known.sum() == 79
    speed = agents.speed_mps()[0, known]
    np.testing.assert_allclose(speed, 10.0, atol=1e-9)


@pytest.mark.usefixtures("joined")
def test_a_broken_file_is_one_sentence(folder: Path):
    (folder / "tracks.csv").write_text(
        "agent,time_s,x_m,y_m,heading_rad\ncar,0,a,0,0\n"
    )
    with pytest.raises(InputError, match="my_street: cannot be read"):
        open_scenario(folder)


@pytest.mark.usefixtures("joined")
@pytest.mark.parametrize(
    "joined", ["examples.csv_format:read", "examples.none:A"], indirect=True
)
def test_an_entry_point_that_names_no_format_is_told(folder: Path):
    with pytest.raises(InputError, match="csv-folder"):
        open_scenario(folder)
