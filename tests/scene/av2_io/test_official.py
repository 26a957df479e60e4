from dataclasses import replace
from pathlib import Path

import pytest

from pd_editor.base.errors import ExportError
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.write import check_with_official_loaders, scenario_files
from tests.scene.av2_io.small_files import SCENARIO


def write(folder: Path, files: dict[str, bytes]) -> None:
    for name, data in files.items():
        (folder / name).write_bytes(data)


def test_small_scenarios_are_accepted(tmp_path: Path) -> None:
    write(tmp_path, scenario_files(SCENARIO))
    check_with_official_loaders(tmp_path)


def test_maps_of_lanes_alone_are_accepted(tmp_path: Path) -> None:
    road_map = replace(SCENARIO.road_map, drivable_areas=())
    write(tmp_path, scenario_files(replace(SCENARIO, road_map=road_map)))
    check_with_official_loaders(tmp_path)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    files = scenario_files(SCENARIO)
    for name in files:
        write(tmp_path, files)
        (tmp_path / name).write_bytes(b"{}")
        with pytest.raises(ExportError, match="av2's own loader refused it"):
            check_with_official_loaders(tmp_path)


def test_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="found 0 track files and 0 maps"):
        check_with_official_loaders(tmp_path)


def test_a_scenario_without_one_focal_track_is_refused(tmp_path: Path) -> None:
    """(D2): av2 loads such files without a word."""
    agents = SCENARIO.agents
    scored = (AgentCategory.SCORED,) * len(agents)
    none = replace(SCENARIO, agents=replace(agents, categories=scored))
    other = replace(SCENARIO, focal_id=agents.ids[1])
    for spoiled, found in ((none, "are none"), (other, f"are '{agents.ids[0]}'")):
        write(tmp_path, scenario_files(spoiled))
        with pytest.raises(ExportError, match=f"{found}; expected exactly one track"):
            check_with_official_loaders(tmp_path)
