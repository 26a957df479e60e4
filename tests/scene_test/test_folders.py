"""The scene test as a package of its own: folders of tables in, AUC out."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import scene_test
from pd_editor.analysis.metrics.road import surroundings
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.base.installed_files import demo_names
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats import tables
from pd_editor.scene.scenario import Scenario
from scene_test import Road, Vehicles, read_folder, vehicle_features
from scene_test.__main__ import main


def stored(scenario: Scenario, folder: Path, ending: str = "") -> None:
    folder.mkdir(parents=True)
    for name, data in tables.write(scenario).files.items():
        if name.endswith(ending):
            (folder / name).write_bytes(data)


def nudged(scenario: Scenario) -> Scenario:
    """All agents a little to the left of where they are."""
    agents = scenario.agents
    aside = np.stack([-np.sin(agents.heading_rad), np.cos(agents.heading_rad)], axis=-1)
    moved = np.where(agents.is_valid[..., None], agents.position_m + 1.5 * aside, 0.0)
    return replace(
        scenario, agents=agents.with_rows(np.arange(len(agents)), position_m=moved)
    )


def by_the_product(scenes: dict[str, Scenario]) -> scene_test.Surroundings:
    found = {name: surroundings(recorded_traffic(one)) for name, one in scenes.items()}
    rows = {name: one.value[one.is_valid.all(axis=1)] for name, one in found.items()}
    return scene_test.Surroundings(
        features=np.concatenate(list(rows.values())),
        scene=np.repeat(list(rows), [len(one) for one in rows.values()]),
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Three demos, and the same with all agents moved."""
    one, other = tmp_path_factory.mktemp("recorded"), tmp_path_factory.mktemp("sampled")
    for name in demo_names()[:3]:
        stored(open_scenario(name), one / name)
        stored(nudged(open_scenario(name)), other / name)
    return one, other


@pytest.mark.slow
@pytest.mark.real_data
def test_the_auc_is_that_of_the_product_on_real_scenes(av2_root: Path, tmp_path: Path):
    names = sorted(one.name for one in (av2_root / "val").iterdir())[:4]
    recorded = {name: open_scenario(av2_root / "val" / name) for name in names}
    sampled = {name: nudged(one) for name, one in recorded.items()}
    for side, scenes in (("recorded", recorded), ("sampled", sampled)):
        for name, scenario in scenes.items():
            stored(scenario, tmp_path / side / name)
        ours, theirs = by_the_product(scenes), read_folder(tmp_path / side)
        assert ours.scene.tolist() == theirs.scene.tolist()
        np.testing.assert_allclose(ours.features, theirs.features, atol=1e-6)
    product = scene_test.scene_test(by_the_product(recorded), by_the_product(sampled))
    alone = scene_test.compare_folders(tmp_path / "recorded", tmp_path / "sampled")
    assert product is not None
    assert alone.auc == pytest.approx(product.auc, abs=0.01)
    assert alone.interval == pytest.approx(product.interval, abs=0.02)
    assert alone.telling[0][0] == product.telling[0][0]
    assert alone.interval[0] <= alone.auc <= alone.interval[1]


def test_identical_folders_cannot_be_told_apart(folders: tuple[Path, Path]):
    found = scene_test.compare_folders(folders[0], folders[0])
    assert found.auc == pytest.approx(0.5)
    assert found.interval[0] <= 0.5 <= found.interval[1]


def test_csv_says_the_same_as_parquet(folders: tuple[Path, Path], tmp_path: Path):
    for name in demo_names()[:3]:
        stored(open_scenario(name), tmp_path / name, ".csv")
    text, binary = read_folder(tmp_path), read_folder(folders[0])
    np.testing.assert_allclose(text.features, binary.features, atol=1e-6)


def test_without_areas_lanes_are_the_road(tmp_path: Path):
    stored(open_scenario("roundabout"), tmp_path / "a")
    with_areas = read_folder(tmp_path).features
    for file in tmp_path.rglob("areas.*"):
        file.unlink()
    off = scene_test.FEATURES.index("off the drivable area")
    without = read_folder(tmp_path).features
    assert without[:, off].mean() < 0.5
    assert np.array_equal(
        np.delete(without, [off, off + 1], 1), np.delete(with_areas, [off, off + 1], 1)
    )


def test_the_shell_tells_the_auc_and_what_is_wrong(
    folders: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    def run(*asked: Path) -> None:
        monkeypatch.setattr(sys, "argv", ["scene_test", *map(str, asked)])
        main()

    run(*folders)
    assert capsys.readouterr().out.startswith("AUC 0.")
    with pytest.raises(SystemExit, match=r"has no tracks\.parquet"):
        run(folders[0], tmp_path)
    stored(open_scenario("queue"), tmp_path / "a")
    with pytest.raises(SystemExit, match="two scenes"):
        run(tmp_path, tmp_path)
    (tmp_path / "a" / "lanes.parquet").write_bytes(b"no table")
    with pytest.raises(SystemExit, match="cannot be used"):
        run(folders[0], tmp_path)
    (tmp_path / "a" / "lanes.parquet").unlink()
    (tmp_path / "a" / "lanes.csv").write_text("lane,line\n1,center\n")
    with pytest.raises(SystemExit, match=r"cannot be used: .*kind"):
        run(folders[0], tmp_path)


def test_the_package_needs_nothing_of_the_editor(folders: tuple[Path, Path]):
    code = (
        "import sys, scene_test; scene_test.read_folder(sys.argv[1]);"
        "assert not [name for name in sys.modules if name.startswith('pd_editor')]"
    )
    subprocess.run([sys.executable, "-c", code, str(folders[0])], check=True)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 6),
    st.floats(-np.pi, np.pi),
    st.floats(-1e4, 1e4),
)
def test_features_do_not_depend_on_the_pose_of_a_scene(seed, count, turn, shift):
    random = np.random.default_rng(seed)
    vehicles = Vehicles(
        ids=[f"agent {row}" for row in range(count)],
        position_m=random.uniform(-30, 30, (count, 2)),
        heading_rad=random.uniform(-np.pi, np.pi, count),
        speed_mps=random.uniform(0, 10, count),
    )
    lines = [np.cumsum(random.uniform(1, 5, (4, 2)), axis=0) for _ in range(3)]
    ring = np.array([(-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0)])

    def features(turn: float, shift: float) -> np.ndarray:
        def moved(points: np.ndarray) -> np.ndarray:
            cos, sin = np.cos(turn), np.sin(turn)
            return points @ np.array([[cos, sin], [-sin, cos]]) + shift

        return vehicle_features(
            replace(
                vehicles,
                position_m=moved(vehicles.position_m),
                heading_rad=vehicles.heading_rad + turn,
            ),
            Road(
                lines_m=[moved(line) for line in lines],
                num_successors=[1, 0, 2],
                ground=shapely.Polygon(moved(ring)),
            ),
        )

    np.testing.assert_allclose(features(turn, shift), features(0.0, 0.0), atol=1e-6)
