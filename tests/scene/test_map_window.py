"""Parts of maps: whole lanes of a square, what is on them, and maps beyond the limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import InputError, LargeMapError
from pd_editor.editor.commands import DeleteAgents
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import (
    lanes_of_file,
    open_base,
    open_part,
    open_scenario,
)
from pd_editor.editor.session import EditorSession
from pd_editor.scene import scene_limits
from pd_editor.scene.base_reference import MapWindow, SceneCut
from pd_editor.scene.formats.file_scene import FileScene
from pd_editor.scene.scene_cut import densest_windows
from tests.builders import straight_lane
from tests.scene.formats.test_opendrive import LINE, lane, road, section, write

SPACING_M = 60.0


def city(folder: Path, side: int = 6) -> Path:
    """Roads of two lanes each way on a grid of ``side`` times ``side`` places."""
    lanes = section(*(lane(number) for number in (-2, -1, 1, 2)))
    return write(
        folder,
        *(
            road(
                lanes,
                f"{row * side + column}",
                geometry=LINE.replace('x="0"', f'x="{SPACING_M * column}"').replace(
                    'y="0"', f'y="{SPACING_M * row}"'
                ),
            )
            for row in range(side)
            for column in range(side)
        ),
    )


def length_within(lanes, window: MapWindow) -> float:
    """Of centre lines, by small steps; the oracle of the densest windows."""
    total = 0.0
    for one in lanes:
        ends = one.centerline_m
        steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
        middles = (ends[1:] + ends[:-1]) / 2
        away = np.abs(middles - (window.x_m, window.y_m)).max(axis=1)
        total += float(steps[away <= window.radius_m].sum())
    return total


@pytest.fixture
def low_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes of 100 lanes, since maps of 2,000 take long to make."""
    monkeypatch.setattr(scene_limits, "MAX_LANES", 100)


def test_a_map_beyond_the_limits_opens_through_a_window(tmp_path, low_limit):
    path = city(tmp_path)
    with pytest.raises(LargeMapError, match=r"144 lanes; at most 100 .*--around X Y"):
        open_scenario(path)
    assert len(lanes_of_file(lambda: open_scenario(path))) == 144
    part = open_scenario(path, around=(180.0, 180.0), radius_m=70.0)
    # Rows at 120, 180 and 240 m; roads of 50 m that begin at 60, 120, 180 and 240 m.
    assert len(part.road_map.lanes) == 3 * 4 * 4
    assert part.scenario_id == "road-x180-y180"
    assert part.provenance.file_format == "OpenDRIVE"
    low, high = (one + part.origin_city_m for one in part.road_map.bounds_m)
    assert (low > 55).all()
    assert (high < 295).all()
    assert part.road_map.drivable_areas
    again = open_base(part.reference)
    assert again.reference == part.reference
    with pytest.raises(LargeMapError, match="at most 100"):
        open_scenario(path, around=(180.0, 180.0), radius_m=5000.0)
    with pytest.raises(InputError, match="no lane within 10 m of 9000, 0"):
        open_scenario(path, around=(9000.0, 0.0), radius_m=10.0)


def test_a_window_of_a_demo_cuts_links_and_tracks_and_replays():
    whole = open_scenario("roundabout")
    middle = tuple(whole.agents.position_m[0, whole.current_step] + whole.origin_city_m)
    window = MapWindow(x_m=float(middle[0]), y_m=float(middle[1]), radius_m=30.0)
    part = open_part("roundabout", SceneCut(window=window))
    ids = set(part.road_map.lane_of)
    assert 0 < len(ids) < len(whole.road_map.lanes)
    for one in part.road_map.lanes:
        former = whole.road_map.lane_of[one.lane_id]
        assert set(one.successors) == set(former.successors) & ids
        assert np.array_equal(one.centerline, former.centerline)
    assert whole.agents.ids[0] in part.agents.row_of
    assert len(part.agents) <= len(whole.agents)
    assert part.focal_id in part.agents.row_of
    session = EditorSession(part)
    gone = next(one for one in part.agents.ids if one != part.focal_id)
    session.apply(DeleteAgents(agent_ids=(gone,)))
    recipe = Recipe.from_text(session.recipe().to_text())
    replayed = replay(recipe, open_base(recipe.base))
    assert replayed.agents.ids == session.scenario.agents.ids


def test_a_window_holds_no_pavement_of_elsewhere():
    """Junctions of a SUMO network are one area of many parts."""
    junctions = shapely.MultiPolygon([shapely.box(x, 0, x + 9, 9) for x in (0, 900)])
    whole = FileScene(
        path=Path("town"),
        name="town",
        lanes=(straight_lane(1, (0.0, 0.0), (20.0, 0.0)),),
        more_paved=[junctions],
    )
    window = MapWindow(x_m=0.0, y_m=0.0, radius_m=50.0)
    part = whole.within(window)
    assert [one.bounds for one in part.more_paved] == [(0.0, 0.0, 9.0, 9.0)]
    assert not replace(whole, more_paved=()).within(window).more_paved


@given(st.integers(0, 2**32), st.integers(1, 6))
def test_densest_windows_are_apart_and_none_is_fuller(seed: int, count: int):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-500, 500, (30, 2))
    lanes = tuple(
        straight_lane(number, tuple(one), tuple(one + rng.uniform(5, 60, 2)))
        for number, one in enumerate(starts)
    )
    found = densest_windows(lanes, count, 50.0)
    assert 1 <= len(found) <= count
    for row, one in enumerate(found):
        for other in found[:row]:
            apart = max(abs(one.x_m - other.x_m), abs(one.y_m - other.y_m))
            # Places are whole metres.
            assert apart >= 2 * 50 - 1.01
    best = length_within(lanes, found[0])
    for place in rng.uniform(-500, 500, (20, 2)):
        window = MapWindow(x_m=place[0], y_m=place[1], radius_m=35.0)
        assert length_within(lanes, window) <= best + 12.0


def test_bad_windows_are_refused_in_a_sentence(tmp_path):
    for around, radius, words in (
        (None, 5.0, "--around X Y"),
        ((0.0, float("nan")), 5.0, "expected metres"),
        ((0.0, 0.0), -1.0, "a radius up to 5000"),
    ):
        with pytest.raises(InputError, match=words):
            open_scenario("roundabout", around=around, radius_m=radius)
