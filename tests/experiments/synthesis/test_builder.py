import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import ExportError, InputError, SynthesisError
from pd_editor.experiments.recordings.shards import ShardReader
from pd_editor.experiments.synthesis import dataset_builder as corpus_networks
from pd_editor.experiments.synthesis.dataset_builder import (
    WINDOWS_PER_SHARD,
    DatasetFolder,
    DatasetPlan,
    build_dataset,
    usual_families,
)
from pd_editor.experiments.synthesis.road_network.generator import FAMILY_SHARES
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import check_with_official_loaders
from tests.experiments.recordings.recordings import drive
from tests.experiments.synthesis.serial_engine import SerialEngine
from tests.experiments.synthesis.small_city import small_city

TRIPS = """<routes>
  <flow id="a" type="private" begin="0" end="900" period="5" from="wc" to="ce"/>
  <flow id="b" begin="0" end="900" period="5" from="ec" to="cn"/>
</routes>"""
SMALL = ("winding-street", "dead-ends")  # quickly made
TWO = DatasetPlan(num=5, seed=7, families=SMALL, as_shards=True)


def build(plan: DatasetPlan, path: Path, engine=None, *, resume: bool = False):
    folder = DatasetFolder(path, plan.settings, resume=resume)
    return build_dataset(plan, folder, engine or SerialEngine())


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def drives(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """No SUMO: traffic made by hand; keys that hold a name of the list fail."""
    failing: list[str] = []

    def recording(item):
        if any(name in item.key for name in failing):
            raise SynthesisError(f"{item.key} cannot be driven on.")
        return drive(seed=item.seed, name=item.key)

    monkeypatch.setattr(corpus_networks, "_recording", recording)
    return failing


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("corpus") / "all"
    build(TWO, path)
    return path


def test_simulated_shards_hold_the_windows(simulated: Path):
    reader = ShardReader(simulated)
    assert len(reader) == TWO.num
    assert len(reader.recordings) == 2
    ids = set()
    for index in range(len(reader)):
        scenario = reader.window(index)
        ids.add(scenario.scenario_id)
        assert scenario.focal_id in scenario.agents.ids
    assert len(ids) == TWO.num
    manifest = json.loads((simulated / "manifest.json").read_text())
    assert manifest["num_windows"] == TWO.num
    assert manifest["seed"] == TWO.seed
    assert set(manifest["networks"]) == {"winding-street-00000", "dead-ends-00001"}


@pytest.mark.slow
def test_workers_do_not_change_the_bytes(simulated: Path, tmp_path: Path):
    build(TWO, tmp_path / "again", LocalProcesses(num_workers=2))
    assert contents(tmp_path / "again") == contents(simulated)


def test_a_resumed_run_gives_the_same_bytes(drives: list[str], tmp_path: Path):
    num = 3 * WINDOWS_PER_SHARD + 5
    plan = DatasetPlan(num=num, seed=1, families=("grid",), as_shards=True)
    build(plan, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        build(plan, tmp_path / "parts", SerialEngine(stop_after=2))
    (tmp_path / "parts" / ".grid-00003.shard.new").write_bytes(b"torn")
    engine = SerialEngine()
    record = build(plan, tmp_path / "parts", engine, resume=True)
    assert record.num_resumed == 2
    assert engine.keys[:2] == ["grid-00002", "grid-00003"]
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


@pytest.mark.parametrize("with_noise", [False, True])
def test_scenario_folders_are_read_by_argoverse(
    drives: list[str], tmp_path: Path, with_noise: bool
):
    plan = DatasetPlan(num=6, seed=1, families=("grid", "town"), with_noise=with_noise)
    record = build(plan, tmp_path / "set")
    assert (record.num_windows, len(record.networks)) == (6, 2)
    folders = sorted((tmp_path / "set").glob("*/scenario_*.parquet"))
    assert len(folders) == 6
    for path in folders:
        check_with_official_loaders(path.parent)
        scenario = read_scenario(path.parent)
        assert scenario.scenario_id == path.parent.name
        assert scenario.agents.has_known_size.all()
    again = tmp_path / "again"
    with pytest.raises(KeyboardInterrupt):
        build(plan, again, SerialEngine(stop_after=1))
    build(plan, again, resume=True)
    assert contents(again) == contents(tmp_path / "set")


def test_failed_networks_are_made_up_for(drives: list[str], tmp_path: Path):
    drives.append("town")
    plan = DatasetPlan(num=20, seed=1, families=("grid", "town"), as_shards=True)
    record = build(plan, tmp_path / "set")
    assert record.num_windows == 20
    assert all(key.startswith("town") for key in record.failures)
    assert len(ShardReader(tmp_path / "set")) == 20


def test_nothing_but_failures_is_an_error(drives: list[str], tmp_path: Path):
    drives.append("grid")
    plan = DatasetPlan(num=3, seed=1, families=("grid",), as_shards=True)
    with pytest.raises(SynthesisError, match="cannot be driven on"):
        build(plan, tmp_path / "set")


def test_a_recording_without_movers_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(corpus_networks, "_recording", lambda _: drive(1))
    plan = DatasetPlan(num=3, seed=1, families=("grid",), as_shards=True)
    with pytest.raises(SynthesisError, match="no agent drives"):
        build(plan, tmp_path / "set")


def test_families_have_their_usual_shares_all_along():
    chosen = usual_families(400)
    assert usual_families(40) == chosen[:40]
    for name, share in FAMILY_SHARES.items():
        for num in (100, 400):
            assert abs(chosen[:num].count(name) - share * num) < 1.5


def test_bad_wishes_are_refused(tmp_path: Path):
    for wish, sentence in (
        ({"num": 0}, "--num is 0"),
        ({"seed": -1}, "--seed is -1"),
        ({"families": ("moon",)}, "no family of roads 'moon'"),
        ({"as_shards": True, "with_noise": True}, "leave out --noise or --shards"),
    ):
        with pytest.raises(InputError, match=sentence):
            DatasetPlan(**{"num": 5, "seed": 0, **wish})
    for wish in ({"families": ("grid",), "maps": (tmp_path,)}, {"maps": (tmp_path,)}):
        with pytest.raises(InputError, match="--networks excludes"):
            DatasetPlan(num=5, seed=0, networks=(tmp_path / "a",), **wish)
    twins = tmp_path / "a" / "town", tmp_path / "b" / "town"
    with pytest.raises(InputError, match=r"Two folders .* equal names"):
        DatasetPlan(num=5, seed=0, networks=twins)
    plan = DatasetPlan(num=2, seed=0, maps=(tmp_path,))
    with pytest.raises(InputError, match="no Argoverse 2 scenario"):
        build(plan, tmp_path / "set")


def test_folders_are_guarded(drives: list[str], tmp_path: Path):
    plan = DatasetPlan(num=3, seed=1, families=("grid",), as_shards=True)
    build(plan, tmp_path / "set")
    with pytest.raises(ExportError, match="--resume"):
        build(plan, tmp_path / "set")
    other = DatasetPlan(num=3, seed=2, families=("grid",), as_shards=True)
    with pytest.raises(InputError, match=r"other settings \(seed\)"):
        build(other, tmp_path / "set", resume=True)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("hello")
    with pytest.raises(ExportError, match="no dataset to go on with"):
        build(plan, tmp_path / "mine", resume=True)
    with pytest.raises(ExportError, match="cannot be written"):
        build(plan, tmp_path / "mine" / "letter.txt" / "deeper")


def test_cities_of_others_are_driven_in(tmp_path: Path):
    one = small_city(tmp_path / "north-side", signals=False)
    other = small_city(tmp_path / "south.side", footways=False, demand=TRIPS)
    plan = DatasetPlan(num=4, seed=1, networks=(one, other), as_shards=True)
    record = build(plan, tmp_path / "set")
    assert record.num_windows == 4
    assert record.notes == ("north-side has no signals.", "south-side has no footways.")
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_text())
    assert manifest["families"] == ["north-side", "south-side"]
    assert set(manifest["networks"]) == {"north-side-00000", "south-side-00001"}
    reader = ShardReader(tmp_path / "set")
    scenes = [reader.window(index) for index in range(len(reader))]
    assert {one.city for one in scenes} == {"north-side", "south-side"}
    assert any(one.signals for one in scenes if one.city == "south-side")
    (other / "demand.rou.xml").unlink()
    with pytest.raises(InputError, match=r"demand.rou.xml, which is missing"):
        build(plan, tmp_path / "again")


@pytest.mark.real_data
def test_traffic_on_real_maps_keeps_their_places(
    av2_scenario_folders: list[Path], tmp_path: Path
):
    """Maps that cannot be read are left out; the rest are driven on."""
    good = next(one for one in av2_scenario_folders if one.parent.name == "train")
    root = tmp_path / "real"
    shutil.copytree(good, root / good.name)
    bad = root / "0-broken"
    bad.mkdir()
    for path in good.iterdir():
        name = path.name.replace(good.name, "0-broken")
        (bad / name).write_bytes(path.read_bytes())
    (bad / "log_map_archive_0-broken.json").write_text("{}")
    plan = DatasetPlan(num=4, seed=1, maps=(root,))
    record = build(plan, tmp_path / "set")
    assert record.num_windows == 4
    assert {key.split("-")[1] for key in record.failures} == {"0"}
    real = read_scenario(good)
    lanes = real.road_map.lane_of
    for path in (tmp_path / "set").glob("*/scenario_*.parquet"):
        scenario = read_scenario(path.parent)
        assert scenario.city == real.city
        shift = scenario.origin_city_m - real.origin_city_m
        for lane in scenario.road_map.lanes:
            original = lanes[lane.lane_id].centerline_m
            assert np.abs(lane.centerline_m + shift - original).max() < 1e-3
