"""Artefacts that were put into tracks on purpose are found."""

import numpy as np
import pytest
import shapely

from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.sumo.simulation_output import RawTracks
from pd_editor.experiments.synthesis.traffic.demand_config import (
    MODELS,
    DemandOptions,
    sample_vehicle_type,
)
from pd_editor.experiments.synthesis.traffic.tracks import (
    has_artefact,
    overlapping_pairs,
    traffic_tracks,
    without_overlaps,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import box_corners

STEP_S = 0.1
COUNT = 60


def _tracks(positions: list[np.ndarray], headings: list[np.ndarray]) -> TrafficTracks:
    count = len(positions)
    velocity = [np.gradient(track, STEP_S, axis=0) for track in positions]
    return TrafficTracks(
        ids=tuple(f"v{index}" for index in range(count)),
        kinds=(AgentKind.VEHICLE,) * count,
        size_m=np.tile([4.5, 1.9], (count, 1)),
        first_step=np.zeros(count, int),
        first_row=np.arange(count + 1) * COUNT,
        position_m=np.concatenate(positions),
        heading_rad=np.concatenate(headings),
        velocity_mps=np.concatenate(velocity),
    )


def _straight(y_m: float, speed_mps: float = 10.0) -> np.ndarray:
    x = speed_mps * STEP_S * np.arange(COUNT)
    return np.column_stack([x, np.full(COUNT, y_m)])


def test_artefacts_are_found_and_good_tracks_are_not_accused():
    ahead = np.zeros(COUNT)
    jump = _straight(20.0)
    jump[30:, 0] += 8.0
    angle = np.arange(COUNT) * 15.0 * STEP_S / 20.0
    bend = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    tracks = _tracks(
        [_straight(0.0), jump, _straight(40.0), bend, _straight(60.0, 0.0)],
        [ahead, ahead, ahead + 0.8, angle + np.pi / 2, ahead],
    )
    found = has_artefact(tracks, STEP_S)
    assert found.tolist() == [False, True, True, True, False]


@pytest.mark.parametrize("seed", range(3))
def test_overlapping_pairs_are_those_of_shapely(seed: int):
    random = np.random.default_rng(seed)
    positions, headings = [], []
    for _ in range(12):
        start, heading = random.uniform(0.0, 60.0, 2), random.uniform(-np.pi, np.pi)
        way = 0.1 * random.uniform(0.0, 12.0) * np.arange(COUNT)
        direction = np.array([np.cos(heading), np.sin(heading)])
        positions.append(start + way[:, None] * direction)
        headings.append(np.full(COUNT, heading))
    tracks = _tracks(positions, headings)
    corners = box_corners(
        tracks.position_m, tracks.heading_rad, tracks.size_m[tracks.agent]
    )
    boxes = np.array(shapely.polygons(corners)).reshape(12, COUNT)
    expected = {
        (one, other)
        for one in range(12)
        for other in range(one + 1, 12)
        if shapely.intersects(boxes[one], boxes[other]).any()
    }
    assert {tuple(pair) for pair in overlapping_pairs(tracks).tolist()} == expected
    left = tracks.taken(without_overlaps(tracks))
    assert len(overlapping_pairs(left)) == 0
    assert len(left.ids) >= 12 - len(expected)


def test_smoothing_keeps_even_motion_and_splits_at_gaps():
    random = np.random.default_rng(0)
    sampled = sample_vehicle_type("type-a", MODELS[0], DemandOptions(), random)
    steps = np.concatenate([np.arange(30), np.arange(40, 70)])
    front = np.column_stack([0.9 * steps, np.full(len(steps), 3.0)])
    raw = RawTracks(
        names=("a",),
        agent=np.zeros(len(steps), int),
        step=steps,
        front_m=front,
        heading_rad=np.zeros(len(steps)),
    )
    tracks = traffic_tracks(raw, {"a": sampled}, STEP_S)
    assert tracks.ids == ("a", "a-1")
    assert tracks.first_step.tolist() == [0, 40]
    assert tracks.step.tolist() == steps.tolist()
    expected = front - [sampled.size_m[0] / 2, 0.0]
    assert np.allclose(tracks.position_m, expected)
    assert np.allclose(tracks.velocity_mps, [9.0, 0.0])
