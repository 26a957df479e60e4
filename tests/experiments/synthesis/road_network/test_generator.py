from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.road_network.generator import (
    FAMILIES,
    generate_network,
)
from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.road_map import LaneKind
from tests.experiments.synthesis.networks import network


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_streets_of_a_city_block_or_more(family: str) -> None:
    generated = network(family, 1)
    points = np.concatenate([lane.centerline_m for lane in generated.road_map.lanes])
    assert generated.family == family
    assert generated.net_file.is_file()
    assert 300 < np.ptp(points, axis=0).max() < 900
    assert len(generated.road_map.lanes) > 30
    # Around a roundabout ways fork and merge, but none crosses another.
    crosses = any(lane.is_intersection for lane in generated.road_map.lanes)
    assert crosses or family == "roundabout"


@pytest.mark.parametrize("family", ["town", "merge"])
def test_the_same_seed_makes_the_same_map(family: str, tmp_path: Path) -> None:
    origin = np.zeros(2)
    first, again = (
        map_bytes(generated.road_map, origin)
        for generated in (network(family, 1), generate_network(family, 1, tmp_path))
    )
    other = map_bytes(network(family, 2).road_map, origin)
    assert first == again
    assert first != other


def test_families_have_what_they_are_named_for() -> None:
    kinds = {
        lane.kind for family in FAMILIES for lane in network(family, 1).road_map.lanes
    }
    assert {LaneKind.VEHICLE, LaneKind.BIKE} <= kinds
    assert any(network(family, 1).has_signals for family in FAMILIES)
    assert any(network(family, 1).parking_strips_m for family in FAMILIES)
    assert any(network(family, 1).road_map.crosswalks for family in FAMILIES)


def test_an_unknown_family_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        SynthesisError, match=r"no family of roads 'moon'; expected one of grid"
    ):
        generate_network("moon", 1, tmp_path)


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SynthesisError, match="expected a folder that can be written"):
        generate_network("t-junctions", 1, tmp_path / "file")
