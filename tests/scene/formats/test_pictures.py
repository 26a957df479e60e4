"""Films and figures: that they open, show the scene to scale, and say what is wrong."""

import io
import re
from dataclasses import replace

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pd_editor.base.errors import ExportError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.figure import FigureLook, figure
from pd_editor.scene.formats.film import FilmLook, film
from pd_editor.scene.formats.pictures import LOOKS, picture
from pd_editor.scene.formats.recorded_map import CenterLane, lanes_of
from pd_editor.scene.formats.registry import writer
from pd_editor.scene.palette import LIGHT, agent_color
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor, warp_scenario
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.top_view import Frame, middle_of, roles_shown

SMALL = FilmLook(height_px=240)


def short(name: str = "merge", steps: int = 8) -> Scenario:
    scenario = open_scenario(name)
    agents = scenario.agents
    there = agents.is_valid.copy()
    there[:, scenario.current_step + steps :] = False
    there[:, : scenario.current_step] = False
    return replace(scenario, agents=replace(agents, is_valid=there))


def frames_of(content: bytes) -> list[np.ndarray]:
    with av.open(io.BytesIO(content)) as container:
        return [one.to_ndarray(format="rgb24") for one in container.decode(video=0)]


def place_of(color: tuple[int, int, int], pixels: np.ndarray) -> np.ndarray:
    """Mean column and row of the pixels of a colour, but for the loss of the encoder."""
    near = np.abs(pixels[..., :3].astype(int) - color).max(axis=-1) < 24
    assert near.any()
    return np.argwhere(near).mean(axis=0)[::-1]


def focal(scenario: Scenario) -> tuple[int, tuple[int, int, int]]:
    row = scenario.agents.row_of[scenario.focal_id]
    return row, agent_color(scenario, LIGHT, row)


def test_a_film_that_stands_shows_the_focal_agent_move_to_scale():
    scenario = short(steps=12)
    pictures = frames_of(film(scenario, "mp4", SMALL))
    # Twenty frames a second, the last step included.
    assert len(pictures) == 23
    assert pictures[0].shape == (240, 426, 3)
    row, color = focal(scenario)
    now = scenario.current_step
    way = (
        scenario.agents.position_m[row, now + 11] - scenario.agents.position_m[row, now]
    )
    seen = place_of(color, pictures[-1]) - place_of(color, pictures[0])
    # 80 m or more are 240 pixels high; south is below.
    scale = np.linalg.norm(seen) / np.linalg.norm(way)
    assert 0.3 < scale < 3.2
    apart = np.array([seen[0], -seen[1]]) / scale - way
    assert np.linalg.norm(apart) < 0.15 * np.linalg.norm(way)


def test_a_film_that_follows_keeps_its_agent_in_the_middle():
    scenario = short(steps=30)
    look = replace(SMALL, follow=scenario.focal_id, radius_m=20.0)
    _, color = focal(scenario)
    for pixels in frames_of(film(scenario, "webm", look))[::10]:
        # The line ahead of it has its colour in part.
        assert np.abs(place_of(color, pixels) - (213, 120)).max() < 20


def test_a_gif_goes_on_for_as_long_as_the_scene():
    told: list[tuple[int, int]] = []
    content = film(short(), "gif", SMALL, lambda *now: told.append(now))
    image = Image.open(io.BytesIO(content))
    frames = getattr(image, "n_frames", 1)
    assert frames * image.info["duration"] == 800
    assert told[-1] == (frames, frames)


def size_of(pdf: bytes) -> list[float]:
    box = re.search(rb"/MediaBox \[([^\]]+)\]", pdf)
    assert box is not None
    return [float(one) for one in box[1].split()]


def test_a_figure_is_as_wide_as_told_and_carries_its_fonts():
    scenario = short()
    for look in (FigureLook(width_mm=88), FigureLook(at_s=(0, 0.3, 0.5))):
        pdf = figure(scenario, "pdf", look)
        *_, width, height = size_of(pdf)
        assert width == pytest.approx(look.width_mm / 25.4 * 72, abs=0.01)
        assert height < width
        assert b"/Type3" not in pdf
        assert pdf == figure(scenario, "pdf", look)


def of_all_kinds() -> Scenario:
    """A scene with at least one agent of each kind that is not the focal one, at t = 0."""
    scenario = open_scenario("signalised-junction")
    agents = scenario.agents
    kinds = tuple(([*AgentKind] * len(agents.ids))[: len(agents.ids)])
    return replace(scenario, agents=replace(agents, kinds=kinds))


def test_kinds_of_one_colour_have_one_entry_in_the_legend():
    scenario = of_all_kinds()
    names = roles_shown(scenario, LIGHT, range(len(scenario.agents.ids)))
    assert list(names)[:2] == ["Focal agent", "Ego"]
    assert "Other object" in names
    assert len(set(names.values())) == len(names) == 10


def test_the_legend_keeps_off_the_bar_of_the_scale():
    """It ran over the bar and the edge of the sheet."""
    few, many = (
        np.array(Image.open(io.BytesIO(figure(one, "png", FigureLook(width_mm=88)))))
        for one in (short(), of_all_kinds())
    )
    foot = many[55 * 300 * 10 // 254 + 60 :, :, :3].min(axis=-1) < 200
    assert many.shape[0] > few.shape[0]
    mm = many.shape[1] / 88
    assert not foot[:, -round(mm) :].any()
    ink = foot.any(axis=0)
    bar = np.flatnonzero(foot[:, -round(3 * mm)])
    begin = many.shape[1] - round(1.7 * mm) - round(15.0 * mm)
    gaps = "".join("#" if one else " " for one in ink[: begin + 1])
    assert len(bar) < 10
    assert " " * round(mm) in gaps[-round(16 * mm) :]


half = st.floats(1.0, 50.0)
pairs = st.tuples(half, half).map(np.array)


@given(place=pairs, half_m=pairs, ground=pairs)
def test_a_frame_shows_no_more_beyond_the_map_than_it_must(place, half_m, ground):
    """A third of the sheet was blank where the map ends."""
    low = np.minimum(place, ground) - 1.0
    high = np.maximum(place, ground) + 1.0
    whole = Frame(middle_m=(low + high) / 2, half_m=(high - low) / 2)
    moved = Frame(middle_m=place, half_m=half_m).onto(whole)
    beyond = np.maximum(low - moved.middle_m + half_m, moved.middle_m + half_m - high)
    assert (beyond <= np.maximum(half_m - whole.half_m, 0) + 1e-9).all()
    assert (np.abs(moved.middle_m - place) <= half_m + 1e-9).all()


def test_agents_of_a_figure_stand_where_they_are():
    scenario = short()
    content = figure(scenario, "png", FigureLook(width_mm=100, radius_m=25))
    pixels = np.array(Image.open(io.BytesIO(content)).convert("RGB"))
    row, color = focal(scenario)
    per_m = pixels.shape[1] / (2 * 25 * 1.6)
    # The focal agent is in the middle, its legend's patch aside.
    above = pixels[: -int(pixels.shape[0] * 0.1)]
    near = np.abs(above.astype(int) - color).max(axis=-1) < 40
    area = near.sum() / per_m**2
    length, width = scenario.agents.size_m[row]
    assert area == pytest.approx(0.9 * length * width, rel=0.1)
    assert place_of(color, above)[0] == pytest.approx(
        pixels.shape[1] / 2, abs=4 * per_m
    )


def test_an_original_is_drawn_above_the_warped_road():
    scenario = short("roundabout")
    pose = pose_of_anchor(scenario, "focal")
    term = WarpTerm(kind="smooth-turn", power=6.0, length_m=30.0)
    warped = warp_scenario(scenario, RoadWarp(anchor=pose, terms=(term,)))
    tall, plain = (
        size_of(figure(warped, "pdf", FigureLook(compares=compares)))[-1]
        for compares in (True, False)
    )
    assert tall > 1.7 * plain
    assert figure(warped, "svg", FigureLook()) != figure(scenario, "svg", FigureLook())
    with pytest.raises(ExportError, match="no original to compare"):
        figure(scenario, "pdf", FigureLook(compares=True))


@pytest.mark.parametrize("ending", ["pdf", "svg", "png"])
def test_figures_tell_who_made_the_scene(ending: str):
    scenario = short()
    origin = replace(scenario.provenance, attribution="By A. Author")
    content = figure(replace(scenario, provenance=origin), ending)
    assert b"By A. Author" in content


def test_names_are_drawn_as_text():
    scenario = short()
    plain, named = (
        figure(scenario, "svg", FigureLook(has_names=names)) for names in (False, True)
    )
    assert len(named) > len(plain)


@pytest.mark.parametrize(
    ("look", "words"),
    [
        (FigureLook(follow="nobody"), "has no agent 'nobody'"),
        (FigureLook(at_s=(99.0,)), r"no moment 99 s; its time is .* s"),
        (FigureLook(width_mm=1.0), "20 to 1000 mm, not 1"),
        (FigureLook(radius_m=0.0), "radius"),
        (FilmLook(follow="nobody"), "has no agent 'nobody'"),
        (FilmLook(height_px=7), "120 to 2160 pixels high, not 7"),
        (FilmLook(radius_m=-1.0), "radius"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(look: FigureLook | FilmLook, words: str):
    ending = "pdf" if isinstance(look, FigureLook) else "mp4"
    with pytest.raises(ExportError, match=words):
        picture(short(), ending, look)


def test_a_map_alone_is_drawn_where_it_has_a_road():
    """The figure of a ring of 300 m was empty."""
    angle = np.linspace(0.0, 1.9 * np.pi, 60)
    line = np.column_stack([300 * np.cos(angle), 300 * np.sin(angle)])
    lane = CenterLane(key="ring", line=line)
    road = RoadMap(lanes=lanes_of([lane]))
    scene = open_scenario("roundabout")
    empty = replace(scene, road_map=road, agents=scene.agents.taken([]), focal_id="")
    assert np.hypot(*middle_of(empty, "")) == pytest.approx(300, abs=2)


@pytest.mark.slow
@pytest.mark.parametrize("ending", LOOKS)
def test_a_scene_without_agents_or_road_is_drawn(ending: str):
    scenario = short(steps=2)
    empty = scenario.without_agents(scenario.agents.ids)
    for one in (empty, replace(empty, road_map=RoadMap(lanes=()))):
        assert picture(one, ending, replace(LOOKS[ending]))


def test_they_are_formats_to_export_to():
    scenario = short(steps=2)
    for ending in ("svg", "gif"):
        write = writer(ending).write
        assert write is not None
        assert list(write(scenario).files) == [f"merge.{ending}"]


def test_a_film_shows_plans_while_they_are_in_force():
    scenario = short(steps=12)
    agents, now = scenario.agents, scenario.current_step
    here = agents.position_m[agents.row_of[scenario.focal_id], now]
    line = here + np.linspace([0, 4], [30, 4], 20)
    plans = {scenario.focal_id: {now + 6: line}, "nobody": {now: line}}
    look = replace(SMALL, plans=plans, follow=scenario.focal_id)
    without = frames_of(film(scenario, "mp4", replace(look, plans={})))
    planned = [
        np.mean(np.abs(one.astype(int) - other) > 60) > 1e-4
        for one, other in zip(
            frames_of(film(scenario, "mp4", look)), without, strict=True
        )
    ]
    # Films have two frames a step.
    assert not any(planned[:12])
    assert all(planned[12:])
