"""Signals stay in the files that are written; they were lost, and nobody was told."""

import json

import numpy as np
import pytest

from pd_editor.base.errors import MapFileError
from pd_editor.editor.commands import SampleSignals
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.av2_io.read import read_scenario_bytes
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.scenario import Scenario


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return SampleSignals(seed=1).apply(open_scenario("signalised-junction"))


def test_signals_are_read_as_they_were_written(scenario: Scenario):
    files = scenario_files(scenario)
    found = read_scenario_bytes(*files.values(), name=scenario.scenario_id)
    assert len(found.signals) == len(scenario.signals) > 0
    for one, other in zip(found.signals, scenario.signals, strict=True):
        assert (one.signal_id, one.lane_ids) == (other.signal_id, other.lane_ids)
        np.testing.assert_array_equal(one.states, other.states)
        np.testing.assert_allclose(one.stop_share, other.stop_share)
    assert found.road_map.source_fields == scenario.road_map.source_fields
    assert scenario_files(found) == files


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("states", [1, 2], "'states' is not a number of 0 to 3 for each of 110 steps"),
        ("states", [4] * 110, "'states' is not a number of 0 to 3"),
        ("states", "1" * 110, "'states' is not a list of whole numbers"),
        ("stop_share", [], "'stop_share' is not a number of 0 to 1 for each lane"),
        ("stop_share", 3, "'stop_share' is not"),
        ("lane_ids", [1], "'lane_ids' names a lane that is not there"),
        ("id", "a\nb", "'id' is no text of one line"),
    ],
)
def test_signals_that_do_not_fit_are_refused(
    scenario: Scenario, field: str, value, message: str
):
    tracks, road = scenario_files(scenario).values()
    archive = json.loads(road)
    archive["pd_editor_signals"]["0"][field] = value
    with pytest.raises(MapFileError, match="pd_editor_signals, 0: field") as error:
        read_scenario_bytes(tracks, json.dumps(archive).encode(), name="x")
    assert message in str(error.value)
