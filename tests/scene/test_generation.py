"""Requests and results that would only remove agents are refused."""

import numpy as np
import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    Region,
    TrafficSample,
    check_placed,
    check_room,
)


def request_in(
    center_m: tuple[float, float], *, fits: bool = True
) -> GenerationRequest:
    return GenerationRequest(
        scenario=open_scenario("roundabout"),
        agent_ids=(),
        samples_num_agents=fits,
        num_new_agents={} if fits else {AgentKind.VEHICLE: 2},
        region=Region(center_m=center_m, half_side_m=15.0),
    )


def test_a_region_without_road_is_told_before_the_run() -> None:
    """A parking lot was emptied, and six equal samples of nothing were offered."""
    lanes = request_in((0.0, 0.0)).scenario.road_map.lanes
    far = float(max(np.abs(lane.centerline).max() for lane in lanes)) + 100.0
    with pytest.raises(
        GenerationError,
        match="no mapped road in this region: 4 agents would only be removed",
    ):
        check_room(request_in((far, far)), 4)
    # Nobody would go, or numbers are given.
    check_room(request_in((far, far)), 0)
    check_room(request_in((far, far), fits=False), 4)
    for lane in lanes[:5]:
        x, y = lane.centerline[0, :2].tolist()
        check_room(request_in((x, y)), 4)


def sample(*ids: str, x: float = 0.0) -> TrafficSample:
    position = np.full((len(ids), 61, 2), x)
    return TrafficSample(
        ids=ids,
        kinds=(AgentKind.VEHICLE,) * len(ids),
        size_m=np.ones((len(ids), 2)),
        position_m=position,
        heading_rad=position[..., 0],
        velocity_mps=position,
    )


def test_a_result_without_any_agent_is_refused_where_others_would_go() -> None:
    empty = GeneratedTraffic(samples=(sample(), sample()), generator="test")
    with pytest.raises(GenerationError, match="so 1 agent would only be removed"):
        check_placed(empty, 1)
    check_placed(empty, 0)
    check_placed(GeneratedTraffic(samples=(sample(), sample("a")), generator="t"), 1)


def test_equal_samples_are_known() -> None:
    assert sample().is_equal(sample())
    assert sample("a").is_equal(sample("a"))
    assert not sample("a").is_equal(sample("b"))
    assert not sample("a").is_equal(sample("a", x=1.0))
    assert sample("a", "b").without({"b"}).is_equal(sample("a"))
