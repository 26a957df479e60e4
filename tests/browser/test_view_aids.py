"""Compass, scale bar, measuring, and what a reload or another scenario shows."""

import re
from itertools import pairwise

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.browser.view_page import camera_rests, distance_m, ground, ready, tool

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FRAMES = """nodes => {
  const log = window.pdFrames = [];
  const mesh = name => {
    let found = "";
    __viserMutable.nodeRefFromName[name]?.traverse(
      part => { if (!found && part.isMesh) found = part.uuid; });
    return found;
  };
  const look = () => {
    const still = document.querySelector(".pd-still");
    log.push({
      isHeld: !still.classList.contains("pd-gone"),
      meshes: nodes.map(mesh),
      camera: __viserMutable.camera.position.toArray().map(v => v.toFixed(2)).join(),
    });
  };
  const context = __viserMutable.canvas.getContext("webgl2");
  const clear = Object.getPrototypeOf(context).clear;
  context.clear = function (...bits) { look(); return clear.apply(this, bits); };
  look();
  __viserMutable.requestRender();
}"""
"""Notes for every picture that the page draws what it is made of."""


@pytest.fixture
def editor(open_editor):
    return ready(open_editor())


def test_compass_turns_the_view_and_the_scale_bar_is_right(editor):
    """(design 10) North or heading up is kept between views; the scale bar is true."""
    page = editor.page
    scale = page.get_by_role("img", name="Scale:")
    assert "at the centre" in scale.get_attribute("aria-label")
    compass = page.get_by_role("button", name="Compass")

    def look() -> np.ndarray:
        camera = editor.client.camera
        return np.subtract(camera.look_at, camera.position)

    editor.drag_pixels((80, 200), (200, 200))
    camera_rests(editor)
    assert abs(look()[0]) > 1.0
    height = editor.client.camera.position[2]
    compass.click()
    editor.until(lambda: abs(look()[0]) < 1e-3 and look()[1] > 0, "a look to the north")
    assert np.isclose(editor.client.camera.position[2], height, atol=1e-2)

    editor.key("v")
    editor.until(lambda: editor.tab().elements.viewpoint.is_top, "the top view")
    camera_rests(editor)
    words = scale.get_attribute("aria-label")
    length = float(re.fullmatch(r"Scale: (\d+) m", words).group(1))
    pixels = page.locator(".pd-scalebar-line").bounding_box()["width"]
    canvas = page.locator("#root canvas").first.bounding_box()
    x, y = canvas["width"] / 2, canvas["height"] / 2
    assert np.isclose(
        np.linalg.norm(ground(editor, x, y) - ground(editor, x + pixels, y)),
        length,
        rtol=0.01,
    )
    assert str(int(length))[0] in "125"

    scenario = editor.session.scenario
    row = scenario.agents.row_of[scenario.focal_id]
    heading = scenario.agents.heading_rad[row, scenario.current_step]
    up = (np.cos(heading), np.sin(heading), 0)
    page.get_by_role("button", name="Compass: north is up").click()
    camera_rests(editor)
    assert np.allclose(editor.client.camera.up_direction, up, atol=1e-3)
    for _ in range(2):
        editor.key("v")
        camera_rests(editor)
    assert np.allclose(editor.client.camera.up_direction, up, atol=1e-3)
    page.get_by_role("button", name="Compass: focal agent").click()
    camera_rests(editor)
    assert np.allclose(editor.client.camera.up_direction, (0, 1, 0), atol=1e-3)


def test_measuring_by_clicks(editor):
    """(design 10) Metres along the clicks, seconds at the selected agent's speed."""
    page = editor.page
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    speed = np.where(agents.is_valid[:, step], agents.speed_mps()[:, step], 0)
    fast = agents.ids[int(speed.argmax())]
    editor.tab().ui.post(lambda: editor.session.select((fast,)))
    editor.until(lambda: editor.session.selection, "the selection")
    tool(editor, "Top view").click()
    camera_rests(editor)
    editor.key("m")
    editor.until(lambda: editor.tab().elements.measure.is_active, "measuring")
    tool(editor, "Measure").and_(page.locator("[aria-pressed=true]")).wait_for()
    pixels = [(150, 200), (350, 240), (300, 420)]
    points = [ground(editor, *pixel) for pixel in pixels]
    for pixel in pixels:
        page.mouse.move(*pixel)
        page.mouse.click(*pixel)
    page.mouse.dblclick(*pixels[-1])
    stretches = [np.linalg.norm(b - a) for a, b in pairwise(points)]
    total = page.locator(".pd-measure-total")
    parts = page.locator(".pd-measure-part")

    def number(text: str) -> float:
        return float(text.split()[0])

    editor.until(lambda: parts.count() == 2, "two stretches")
    for text, stretch in zip(parts.all_inner_texts(), stretches, strict=True):
        assert np.isclose(number(text), stretch, rtol=0.01, atol=0.06)
    whole, seconds = total.inner_text().splitlines()
    assert np.isclose(number(whole), sum(stretches), rtol=0.01, atol=0.1)
    assert np.isclose(
        number(seconds), sum(stretches) / speed.max(), rtol=0.02, atol=0.1
    )
    assert fast in seconds

    # It stays with the road while the camera moves, by a drag as well.
    dot = page.locator(".pd-measure-layer circle").nth(1)
    page.mouse.move(350, 240)
    page.mouse.wheel(0, -240)
    camera_rests(editor)
    page.mouse.move(500, 300)
    page.mouse.down()
    page.mouse.move(540, 330, steps=6)
    page.mouse.up()
    camera_rests(editor)
    expect(parts).to_have_count(2)

    def is_on_its_point() -> bool:
        x, y = points[1]
        expected = page.evaluate(f"pdOverlay.project([{x}, {y}, 0])")
        found = [float(dot.get_attribute(name)) for name in ("cx", "cy")]
        return np.allclose(found, expected, atol=1.5)

    editor.until(is_on_its_point, "the point to follow the road")

    page.keyboard.press("Backspace")
    dots = page.locator(".pd-measure-layer circle")
    editor.until(lambda: dots.count() == 2, "one point less")
    assert not editor.session.entries, "no agent was deleted"
    assert editor.session.selection == (fast,), "nothing else was clicked"
    editor.key("Escape")
    editor.until(
        lambda: not editor.tab().elements.measure.is_active, "the end of measuring"
    )
    editor.until(lambda: page.locator(".pd-measure-total").count() == 0, "no label")
    assert editor.session.selection == (fast,)
    # Placing ends measuring, and the other way round.
    tab = editor.tab()

    def modes() -> tuple[bool, bool]:
        return tab.elements.measure.is_active, tab.elements.placing.is_active

    for key, expected in (
        ("m", (True, False)),
        ("p", (False, True)),
        ("m", (True, False)),
    ):
        editor.key(key)
        editor.until(lambda expected=expected: modes() == expected, f"{key} to switch")


def test_a_reload_shows_the_same_tab_view_time_and_selection(editor):
    """(D35) Tab of the panel, view, camera, playhead and selection are back."""
    focal = editor.session.scenario.focal_id
    tool(editor, "Top view").click()
    editor.page.get_by_role("button", name="Compass").click()
    camera_rests(editor)
    editor.page.mouse.move(300, 300)
    editor.page.mouse.wheel(0, -300)
    editor.tab().ui.post(lambda: editor.session.select((focal,)))
    editor.seek(2.0)
    editor.open_tab("Road")
    editor.until(
        lambda: editor.workspace.view.panel_tab == "Road", "the tab to be kept"
    )
    camera_rests(editor)
    camera = editor.client.camera
    before = [np.array(camera.position), np.array(camera.look_at), camera.up_direction]
    step = editor.workspace.playback.step
    editor.reload()
    ready_again = editor.tab()
    editor.until(lambda: ready_again.ui.overlay.is_ready, "the overlay")
    editor.page.locator("[role=tab][aria-selected=true]", has_text="Road").wait_for()
    camera_rests(editor)
    camera = editor.client.camera
    after = (camera.position, camera.look_at, camera.up_direction)
    for kept, now in zip(before, after, strict=True):
        assert np.allclose(kept, now, rtol=1e-3, atol=0.05)
    assert editor.tab().elements.viewpoint.is_top
    assert camera.fov < 0.2
    assert editor.workspace.playback.step == step
    assert editor.session.selection == (focal,)
    assert editor.workspace.view.panel_tab == "Road"
    # A plain drag still draws a box in the top view, and does not turn the camera.
    up = np.array(camera.up_direction)
    editor.drag_pixels((60, 300), (160, 420))
    assert np.allclose(editor.client.camera.up_direction, up, atol=1e-4)


def test_another_scenario_comes_in_one_step_and_is_framed(editor):
    """(D20, D5) No frame shows the former road from the new camera, or no road."""
    page = editor.page
    nodes = list(editor.tab().elements.picture.map.road_nodes)
    assert "/map/road" in nodes
    nodes = ["/map/road", "/map/lanes"]
    start = editor.client.camera.position.copy()
    page.evaluate(FRAMES, nodes)
    editor.tab().ui.post(lambda: editor.workspace.open_reference("roundabout"))
    editor.until(
        lambda: editor.session.scenario.scenario_id == "roundabout", "the other scene"
    )
    editor.until(
        lambda: page.evaluate(
            "(__viserMutable.requestRender(), pdFrames.some(f => f.isHeld)"
            " && !pdFrames.at(-1).isHeld)"
        ),
        "the new picture",
    )
    frames = page.evaluate("pdFrames")
    former, last = frames[0], frames[-1]
    assert former["camera"] != last["camera"]
    for old, new in zip(former["meshes"], last["meshes"], strict=True):
        assert new
        assert old != new
    shown = {
        (*frame["meshes"], frame["camera"]) for frame in frames if not frame["isHeld"]
    }
    assert shown == {
        (*former["meshes"], former["camera"]),
        (*last["meshes"], last["camera"]),
    }
    assert not np.allclose(editor.client.camera.position, start, atol=1.0)

    # The same scenario opened once more is framed anew, though its name is the same.
    framed = editor.client.camera.position.copy()
    page.mouse.move(300, 300)
    page.mouse.wheel(0, 400)
    camera_rests(editor)
    assert not np.allclose(editor.client.camera.position, framed, atol=1.0)
    editor.tab().ui.post(lambda: editor.workspace.open_reference("roundabout"))
    editor.until(
        lambda: np.allclose(editor.client.camera.position, framed, atol=1e-2),
        "the scene framed anew",
    )


@pytest.mark.parametrize("debug", [False, True])
def test_visers_own_settings_are_for_developers(open_editor, debug):
    """(D21) The gear is hidden unless asked for; the title names the scenario."""
    editor = open_editor(debug=debug)
    editor.until(lambda: editor.tab().ui.overlay.is_ready, "the overlay")
    gear = editor.page.locator("button:has(svg.tabler-icon-adjustments)")
    expect(gear).to_have_count(1)
    editor.until(lambda: gear.first.is_visible() == debug, "the gear")
    editor.until(
        lambda: editor.page.title() == "signalised-junction - Path Diffuser Editor",
        "the title",
    )
    if debug:
        return
    # Close to a car, nothing of it is cut away by the near plane.
    editor.page.mouse.move(300, 330)
    for _ in range(12):
        editor.page.mouse.wheel(0, -500)
        editor.page.wait_for_timeout(30)
    camera_rests(editor)
    near = editor.page.evaluate("__viserMutable.camera.near")
    assert near < 0.5
    assert distance_m(editor) < 4.2
    # From far above, near and far enclose the road: its layers are 1 cm apart.
    tool(editor, "Top view").click()
    editor.key("Home")
    camera_rests(editor)
    distance = distance_m(editor)

    def depth() -> list[float]:
        return editor.page.evaluate(
            "[__viserMutable.camera.near, __viserMutable.camera.far]"
        )

    editor.until(lambda: depth()[0] > 0.4 * distance, "the near plane to follow")
    assert distance < depth()[1] < 2 * distance
