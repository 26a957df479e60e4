"""Traffic of others' scenarios: kinds, sizes, signals, and everyone on the road."""

import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.recordings.recording import Recording
from pd_editor.experiments.synthesis.sumo.sumo_scenario import read_sumo_scenario
from pd_editor.experiments.synthesis.traffic.city_traffic import (
    cropped_net,
    simulate_city,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.signals import SignalState
from tests.experiments.synthesis.small_city import small_city

CITIES = os.environ.get("PD_EDITOR_SUMO_CITIES")
WALKS = AgentKind.PEDESTRIAN


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_city(tmp_path_factory.mktemp("cities") / "crossing")


@pytest.fixture(scope="module")
def recording(city: Path) -> Recording:
    return simulate_city(city, 1, duration_s=60.0)


def rows_of(recording: Recording, *kinds: AgentKind) -> np.ndarray:
    agents = [
        kind in kinds and not parked
        for kind, parked in zip(recording.kinds, recording.is_parked, strict=True)
    ]
    return np.repeat(agents, np.diff(recording.first_row))


def test_kinds_and_sizes_are_those_of_the_types(recording: Recording):
    size = {
        name: size
        for name, size in zip(recording.ids, recording.size_m, strict=True)
        if not name.startswith("parked")
    }
    kind = dict(zip(recording.ids, recording.kinds, strict=True))
    expected = {
        "cars": (AgentKind.VEHICLE, 3.5, 6.0),
        "usual": (AgentKind.VEHICLE, 3.5, 6.0),
        "inner": (AgentKind.VEHICLE, 3.9, 5.4),
        "mixed": (AgentKind.VEHICLE, 3.5, 13.0),
        "trucks": (AgentKind.VEHICLE, 5.9, 13.0),
        "bus": (AgentKind.BUS, 10.0, 14.0),
        "bikes": (AgentKind.CYCLIST, 1.4, 2.2),
        "walks": (WALKS, 0.4, 1.0),
    }
    for flow, (wanted, low, high) in expected.items():
        own = [name for name in size if name.split(".")[0] == flow]
        assert own, flow
        assert {kind[name] for name in own} == {wanted}, flow
        assert all(low < size[name][0] < high for name in own), flow
    assert len({size[name][0] for name in size if name.startswith("cars")}) > 3


def test_the_network_is_full_and_stays_so(recording: Recording):
    assert recording.num_steps == 600
    ends = recording.first_step + np.diff(recording.first_row)
    drives = np.array([kind is AgentKind.VEHICLE for kind in recording.kinds])
    for step in (0, 300, 599):
        there = (recording.first_step <= step) & (ends > step)
        assert (there & drives & ~recording.is_parked).sum() >= 4


def test_vehicles_are_on_lanes_and_point_where_they_go(recording: Recording):
    road = shapely.union_all(
        [
            shapely.Polygon(lane.outline_m()).buffer(0)
            for lane in recording.road_map.lanes
        ]
    )
    rows = rows_of(recording, AgentKind.VEHICLE, AgentKind.BUS)
    place = recording.position_m[rows]
    assert shapely.contains_xy(road, *place.T).mean() > 0.99
    speed = recording.velocity_mps[rows]
    fast = np.hypot(*speed.T) > 2.0
    heading = recording.heading_rad[rows]
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    along = (speed * ahead).sum(axis=-1) / np.maximum(np.hypot(*speed.T), 1e-9)
    assert (along[fast] > np.cos(0.6)).all()


def test_passengers_of_buses_are_not_pedestrians(recording: Recording):
    speed = np.hypot(*recording.velocity_mps[rows_of(recording, WALKS)].T)
    assert len(speed)
    assert np.quantile(speed, 0.999) < 3.0


def test_signals_have_known_states_and_both_ways_take_turns(recording: Recording):
    states = np.array([one.states for one in recording.signals])
    assert len(states) >= 2
    assert (states != SignalState.UNKNOWN).all()
    assert {SignalState.GO, SignalState.STOP} <= set(states.ravel().tolist())
    known = recording.road_map.lane_of.keys()
    assert all(lane in known for one in recording.signals for lane in one.lane_ids)


@pytest.mark.slow
def test_the_seed_chooses_time_and_drivers(city: Path, recording: Recording):
    again = simulate_city(city, 1, duration_s=60.0)
    assert again.ids == recording.ids
    assert np.array_equal(again.position_m, recording.position_m)
    other = simulate_city(city, 2, duration_s=60.0)
    assert other.ids != recording.ids


def test_a_time_without_anybody_is_refused(tmp_path: Path):
    ends = "".join(
        f'<trip id="{depart}" depart="{depart}" from="wc" to="ce"/>'
        for depart in (0, 9000)
    )
    city = small_city(tmp_path, f"<routes>{ends}</routes>")
    with pytest.raises(SynthesisError, match="nobody is under way at"):
        simulate_city(city, 1, duration_s=10.0)


def test_what_sumo_refuses_is_told_with_the_city(tmp_path: Path):
    cars = '<flow id="a" type="no" begin="0" end="60" period="3" from="wc" to="ce"/>'
    city = small_city(tmp_path / "harbour", f"<routes>{cars}</routes>")
    with pytest.raises(SynthesisError, match=r"harbour-.* type 'no' .* is not known"):
        simulate_city(city, 1, duration_s=20.0)


def test_demand_of_a_minute_is_enough(tmp_path: Path):
    cars = '<flow id="a" begin="0" end="60" period="3" from="wc" to="ce"/>'
    city = small_city(tmp_path, f"<routes>{cars}</routes>")
    recording = simulate_city(city, 1, duration_s=20.0)
    assert not recording.is_parked.all()


def test_a_crop_keeps_what_reaches_into_the_square(city: Path):
    net = read_sumo_scenario(city).net
    east = net.lanes["ce_0"].shape_m[-1]
    kept = cropped_net(net, east, 40.0)
    assert {"ce", "ec"} <= kept.lanes_of_edge.keys()
    assert "wc" not in kept.lanes_of_edge
    assert all(one in kept.lanes for link in kept.links for one in link)
    assert set(kept.junction_of) == {"ce", "ec"}
    whole = cropped_net(net, east, 1000.0)
    assert whole.lanes.keys() == net.lanes.keys()
    assert whole.links == net.links


@pytest.mark.slow
@pytest.mark.skipif(CITIES is None, reason="needs PD_EDITOR_SUMO_CITIES")
def test_cyclists_of_a_real_city_are_there():
    recording = simulate_city(Path(CITIES or "") / "Doerpfeldstr", 1, duration_s=20.0)
    assert {AgentKind.VEHICLE, AgentKind.CYCLIST} <= set(recording.kinds)
    assert recording.signals
