import shutil
from dataclasses import replace
from pathlib import Path
from threading import Thread

import pytest

from pd_editor.base.errors import InputError
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.formats.dataset import CardFilter, DatasetIndex
from tests.scene.av2_io.small_files import SCENARIO
from tests.scene.formats.test_commonroad import text as commonroad_text
from tests.scene.formats.test_opendrive import lane, road, section
from tests.scene.formats.test_opendrive import write as write_road

CITIES = ("austin", "miami")


def write(folder: Path, scenario_id: str, city: str, num_agents: int) -> None:
    folder.mkdir(parents=True)
    scenario = replace(
        SCENARIO,
        scenario_id=scenario_id,
        city=city,
        agents=SCENARIO.agents.taken(range(num_agents)),
    )
    for name, data in scenario_files(scenario).items():
        (folder / name).write_bytes(data)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Ten scenarios a0..a9 in two splits; cities and numbers of agents alternate."""
    for number in range(10):
        split = "train" if number < 6 else "val"
        name = f"a{number}"
        write(tmp_path / split / name, name, CITIES[number % 2], 1 + number // 5)
    return tmp_path


def ids(cards) -> list[str]:
    return [card.scenario_id for card in cards]


def test_all_scenarios_are_found_in_order(root: Path) -> None:
    index = DatasetIndex(root)
    assert index.num_found == 0
    assert ids(index.filter()) == [f"a{number}" for number in range(10)]
    assert (index.num_found, index.num_skipped, index.is_complete) == (10, 0, True)
    assert index.cities() == CITIES


def test_cards_say_what_the_scenario_says(root: Path) -> None:
    for card in DatasetIndex(root).filter():
        scenario = read_scenario(card.folder)
        assert card.scenario_id == scenario.scenario_id
        assert card.city == scenario.city
        assert card.num_agents == len(scenario.agents)
        assert card.split == card.folder.parent.name
        assert card.has_future


def test_scenarios_of_the_root_are_of_no_split(root: Path) -> None:
    assert DatasetIndex(root / "val").splits() == ()
    index = DatasetIndex(root / "val")
    assert {card.split for card in index.filter()} == {""}
    assert index.splits() == ("",)
    assert {c.split for c in DatasetIndex(root / "val" / "a8").filter()} == {""}


def test_filters(root: Path) -> None:
    index = DatasetIndex(root)
    for wanted, numbers in (
        (CardFilter(city="miami"), (1, 3, 5, 7, 9)),
        (CardFilter(min_agents=2), (5, 6, 7, 8, 9)),
        (CardFilter(max_agents=1, city="austin"), (0, 2, 4)),
        (CardFilter(words=("nothing",)), ()),
    ):
        assert ids(index.filter(wanted)) == [f"a{number}" for number in numbers]


def test_a_search_goes_on_where_it_stopped(root: Path) -> None:
    index, wanted = DatasetIndex(root), CardFilter(city="miami")
    first = index.search(wanted, max_folders=4)
    assert (ids(first.cards), first.next_start) == (["a1", "a3"], 4)
    assert index.num_found == 4
    assert not first.is_complete
    rest = index.search(wanted, first.next_start)
    assert ids(rest.cards) == ["a5", "a7", "a9"]
    assert rest.is_complete


def test_next_and_previous_under_a_filter(root: Path) -> None:
    index, wanted = DatasetIndex(root), CardFilter(city="miami")
    a0, a5, a9 = (
        one.folder for one in index.filter() if one.scenario_id in ("a0", "a5", "a9")
    )
    after, before = index.after(a5, wanted), index.before(a5, wanted)
    assert after is not None
    assert before is not None
    assert (before.scenario_id, after.scenario_id) == ("a3", "a7")
    assert index.after(a9) is None
    assert index.before(a0) is None
    with pytest.raises(InputError, match="zz: is no scenario folder of"):
        index.after(root / "zz")


def test_walking_forwards_and_back_visits_all(root: Path) -> None:
    index = DatasetIndex(root)
    card = index.search(CardFilter(), max_folders=1).cards[0]
    there = [card]
    while (card := index.after(card.folder)) is not None:
        there.append(card)
    back = [there[-1]]
    while (card := index.before(back[-1].folder)) is not None:
        back.append(card)
    assert len(there) == 10
    assert back[::-1] == there


def test_incomplete_and_damaged_folders_are_counted(root: Path) -> None:
    (root / "train" / "a0" / "log_map_archive_a0.json").unlink()
    (root / "train" / "a1" / "scenario_a1.parquet").unlink()
    (root / "train" / "a2" / "scenario_a2.parquet").write_bytes(b"damaged")
    (root / "val" / "empty").mkdir()
    (root / "readme.txt").write_text("")
    # What the program itself writes beside scenes is no broken scene.
    (root / "finished").mkdir()
    (root / "finished" / "network-1.json").write_text("{}")
    index = DatasetIndex(root)
    assert ids(index.filter()) == [f"a{number}" for number in range(3, 10)]
    assert index.num_skipped == 4


def test_a_scenario_folder_is_a_dataset_of_one(root: Path) -> None:
    index = DatasetIndex(root / "val" / "a8")
    assert ids(index.filter()) == ["a8"]


def test_links_in_circles_end(root: Path) -> None:
    (root / "val" / "circle").symlink_to(root, target_is_directory=True)
    index = DatasetIndex(root)
    assert index.scan() < 100
    assert index.is_complete


def test_an_empty_root(tmp_path: Path) -> None:
    index = DatasetIndex(tmp_path)
    assert ids(index.filter()) == []
    assert index.search(CardFilter()).is_complete


def test_a_missing_root(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such dataset folder"):
        DatasetIndex(tmp_path / "gone")


def test_threads_share_an_index(root: Path) -> None:
    index = DatasetIndex(root)
    found: list[list[str]] = []
    threads = [
        Thread(target=lambda: found.append(ids(index.filter()))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [[f"a{number}" for number in range(10)]] * 4


def test_the_real_dataset(av2_root: Path, av2_scenario_folders: list[Path]) -> None:
    index = DatasetIndex(av2_root)
    cards = list(index.filter())
    assert {card.folder for card in cards} == set(av2_scenario_folders)
    for card in cards:
        assert card.has_future == (not card.split.startswith("test"))


def test_scenarios_of_one_id_are_told_apart_by_their_folders(root: Path) -> None:
    """A copy or subset beside the original has its ids; file names may differ from ids."""
    shutil.copytree(root / "val", root / "copies" / "val")
    shutil.copytree(root / "val" / "a8", root / "val" / "z8")
    index = DatasetIndex(root)
    folders = [card.folder for card in index.filter()]
    walked = folders[:1]
    while (card := index.after(walked[-1])) is not None:
        walked.append(card.folder)
        assert len(walked) <= len(folders)
    assert walked == folders
    while (card := index.before(walked[-1])) is not None:
        walked.append(card.folder)
        assert len(walked) < 2 * len(folders)
    assert walked == folders + folders[-2::-1]


def test_files_of_other_formats_are_scenes_of_a_dataset(tmp_path):
    """Beside and below one another; what no format knows is passed over."""
    (tmp_path / "val").mkdir()
    (tmp_path / "val" / "town.xml").write_text(commonroad_text())
    (tmp_path / "val" / "page.xml").write_text("<html/>")
    write_road(tmp_path, road(section(lane(-1), lane(1))))
    cards = list(DatasetIndex(tmp_path).filter())
    assert [(one.scenario_id, one.split, one.folder.name) for one in cards] == [
        ("road", "", "road.xodr"),
        ("town", "val", "town.xml"),
    ]
    bare, town = cards
    assert (bare.num_agents, bare.has_future) == (0, False)
    assert town.num_agents > 0
    index = DatasetIndex(tmp_path)
    assert index.after(bare.folder).folder == town.folder


def test_files_of_one_name_up_to_a_dot_are_told_apart(tmp_path):
    """Both were listed as "town": one could not be chosen."""
    for name in ("town.v1.xml", "town.v2.xml"):
        (tmp_path / name).write_text(commonroad_text())
    assert ids(DatasetIndex(tmp_path).filter()) == ["town.v1", "town.v2"]
