"""Traffic signals of foreign files: words, times, and what is left out."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import FormatError
from pd_editor.editor.commands import DeleteAgents
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_base, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.scene.formats.file_signal import (
    FileSignal,
    cyclic_signal,
    sampled_signals,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState
from tests.builders import straight_lane
from tests.scene.formats.test_recordings import STEPS, as_gpudrive, description

STOP, CAUTION, GO = SignalState.STOP, SignalState.CAUTION, SignalState.GO
UNKNOWN = SignalState.UNKNOWN


@pytest.mark.parametrize(
    ("word", "state"),
    [
        ("LANE_STATE_STOP", STOP),
        ("LANE_STATE_ARROW_STOP", STOP),
        ("arrow_caution", CAUTION),
        ("LANE_STATE_FLASHING_CAUTION", CAUTION),
        ("TRAFFIC_LIGHT_GREEN", GO),
        ("redYellow", STOP),
        ("g", GO),
        ("o", CAUTION),
        ("O", UNKNOWN),
        (None, UNKNOWN),
    ],
)
def test_words_of_all_formats_have_a_state(word: Any, state: SignalState):
    unknown: set[str] = set()
    one = FileSignal(signal_id="s", stop_m={}, begins_s=[0.0], words=[word])
    assert one.states(np.zeros(1), unknown).tolist() == [state]
    assert not unknown


@given(
    durations=st.lists(st.floats(0.5, 9), min_size=1, max_size=4),
    offset=st.floats(-20, 20),
    time=st.floats(-50, 50),
)
def test_cycles_go_on_in_both_directions(durations, offset, time):
    words = ["red", "green", "yellow", "red"][: len(durations)]
    one = cyclic_signal("s", {}, list(zip(durations, words, strict=True)), offset)
    here, later = one.states(time + np.array([0.0, sum(durations)]), set())
    # Counted off phase by phase.
    left, row = (time + 1e-3 - offset) % sum(durations), 0
    while row < len(durations) - 1 and left >= durations[row]:
        left -= durations[row]
        row += 1
    if min(left, abs(durations[row] - left)) > 1e-6:
        assert (
            here == later == {"red": STOP, "green": GO, "yellow": CAUTION}[words[row]]
        )


def test_what_is_left_out_is_told():
    lanes = [straight_lane(1, (0, 0), (9, 0)), straight_lane(2, (0, 4), (9, 4))]
    found = [
        FileSignal(
            signal_id="a", stop_m={1: None, 7: None}, begins_s=[0.0], words=["up"]
        ),
        FileSignal(signal_id="b", stop_m={1: None, 2: np.array([9.0, 4.0])}),
        FileSignal(signal_id="c", stop_m={7: None}, begins_s=[0.0, 1.0], words=["go"]),
    ]
    signals, told = sampled_signals(found, lanes, np.zeros(1))
    assert [one.lane_ids for one in signals] == [(1,), (2,)]
    assert [one.states.tolist() for one in signals] == [[UNKNOWN], [UNKNOWN]]
    assert told == (
        "Signals without a lane of their own are left out: 1.",
        "Signals with more or fewer states than times: 1.",
        "States of signals with unknown words ('up') are unknown.",
    )


def word(step: int) -> str | None:
    return None if step > 80 else "LANE_STATE_GO" if step < 30 else "LANE_STATE_STOP"


def scenarionet(**more: Any) -> dict[str, Any]:
    light = {
        "lane": 2,
        "stop_point": np.array([103.0, 0, 0]),
        "state": {"object_state": [word(step) for step in range(STEPS)]},
    }
    return description(dynamic_map_states={"2": light | more})


def gpudrive(**more: Any) -> dict[str, Any]:
    steps = [step for step in range(STEPS) if word(step)]
    light = {
        "state": [
            str(word(step)).removeprefix("LANE_STATE_").lower() for step in steps
        ],
        "time_index": steps,
        **{axis: [at] * len(steps) for axis, at in (("x", 103.0), ("y", 0.0))},
    }
    found = as_gpudrive()
    for row, road in enumerate(found["roads"], start=1):
        road["id"] = row
    return found | {"tl_states": {"2": light | more}}


def opened(folder: Path, found: dict[str, Any]) -> Scenario:
    if "tl_states" in found:
        path = folder / "one.json"
        path.write_text(json.dumps(found))
    else:
        path = folder / "one.pkl"
        path.write_bytes(pickle.dumps(found))
    return open_scenario(path)


@pytest.mark.parametrize("found", [scenarionet(), gpudrive()])
def test_recorded_signals_open_at_their_steps(tmp_path: Path, found: dict[str, Any]):
    scene = opened(tmp_path, found)
    (signal,) = scene.signals
    lane = scene.road_map.lane_of[signal.lane_ids[0]]
    place = scene.stop_lines_m()[0, 1] + scene.origin_city_m
    np.testing.assert_allclose(place, [103.0, 0.0], atol=1e-6)
    assert lane.predecessors
    first = scene.current_step - 10
    expected = np.repeat([UNKNOWN, GO, STOP], [first, 30, 51])
    np.testing.assert_array_equal(signal.states[: first + 81], expected)
    assert not signal.states[first + 81 :].any()


@pytest.mark.parametrize("found", [scenarionet, gpudrive])
def test_hostile_signals_are_left_out_or_refused(tmp_path: Path, found):
    key = "object_state" if found is scenarionet else "state"
    short = {"state": {key: ["go"]}} if found is scenarionet else {"state": ["go"]}
    scene = opened(tmp_path, found(**short))
    assert "Signals with more or fewer states than times: 1." in scene.provenance.notes
    bad = {"state": 3} if found is scenarionet else {"time_index": ["x"]}
    with pytest.raises(FormatError):
        opened(tmp_path, found(**bad))
    if found is scenarionet:
        scene = opened(tmp_path, found(lane="none"))
        assert scene.signals == ()
        assert "Signals without a lane" in " ".join(scene.provenance.notes)


def test_edits_of_a_scene_with_signals_are_replayed_with_them(tmp_path: Path):
    scene = opened(tmp_path, scenarionet())
    session = EditorSession(scene)
    session.apply(DeleteAgents(agent_ids=("11",)))
    recipe = Recipe.from_text(session.recipe().to_text())
    again = replay(recipe, open_base(recipe.base))
    for one, other in zip(again.signals, scene.signals, strict=True):
        np.testing.assert_array_equal(one.states, other.states)
