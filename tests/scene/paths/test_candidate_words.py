"""Words tell candidates apart."""

import numpy as np
import pytest

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.paths.motion_primitives import candidate_texts, candidates


@pytest.fixture(scope="module")
def junction():
    return open_scenario("signalised-junction")


def test_no_two_candidates_of_an_agent_read_alike(junction):
    """(D30)"""
    agents, now = junction.agents, junction.current_step
    for row in np.flatnonzero(agents.is_valid[:, now])[:20]:
        found = candidates(junction, np.array([row]))
        texts = candidate_texts(found, junction.road_map)
        assert len(texts) == found.is_valid[0].sum()
        assert len(set(texts)) == len(texts)


def test_words_say_where_and_how_fast(junction):
    """(D30)"""
    row = junction.agents.row_of[junction.focal_id]
    found = candidates(junction, np.array([row]))
    texts = candidate_texts(found, junction.road_map)
    valid = np.flatnonzero(found.is_valid[0])
    for text, index in zip(texts, valid, strict=True):
        turn = np.unwrap(found.heading_rad[0, index])
        if text.startswith("Left"):
            assert turn[-1] - turn[0] > 0.3
            assert "at the junction" in text
        if text.startswith("Straight on"):
            assert abs(turn[-1] - turn[0]) < 0.4
        if "slowing to stop" in text:
            assert found.is_standstill[0, index]
        if "speeding up" in text:
            speed = np.hypot(*found.velocity_mps[0, index].T)
            assert speed[-1] > speed[0]
    assert {text.split(",")[0] for text in texts} >= {
        "Straight on",
        "Left at the junction",
        "Change to the right lane",
    }
