"""The first whole journey, walked in a real browser by label and by projected clicks."""

import io
import json
import zipfile

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.upload import scenario_from_upload
from pd_editor.viewer.agents.agent_panel import MORE
from pd_editor.viewer.files.export_panel import OTHER_WAYS
from tests.editor.same_scenario import same_scenario

pytestmark = pytest.mark.browser


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.until(lambda: page.workspace.playback.is_playing, "the demo to play")
    page.go_to_now()
    page.until(lambda: not page.workspace.playback.is_playing, "a pause")
    return page


def labels(editor) -> list[str]:
    return [entry.label for entry in editor.session.entries]


def state_of(editor, agent_id: str):
    scenario = editor.session.scenario
    row = scenario.agents.row_of[agent_id]
    step = scenario.current_step
    return (
        scenario.agents.position_m[row, step],
        float(scenario.agents.heading_rad[row, step]),
        float(np.hypot(*scenario.agents.velocity_mps[row, step])),
    )


def roof(editor, agent_id: str) -> tuple[float, float, float]:
    """A point that a person would click to hit a vehicle."""
    (x, y), heading, _ = state_of(editor, agent_id)
    return float(x - 0.9 * np.cos(heading)), float(y - 0.9 * np.sin(heading)), 1.2


def test_from_demo_to_export(editor):
    session, focal = editor.session, editor.session.scenario.focal_id
    opened = session.scenario
    editor.screenshot("01_opened")

    editor.click_at(roof(editor, focal))
    editor.until(lambda: session.selection == (focal,), "the focal agent selected")

    before, _, _ = state_of(editor, focal)
    x, y, z = roof(editor, focal)
    editor.drag((x, y, z), (x + 4.0, y + 2.0, z))
    editor.until(lambda: len(session.entries) == 1, "one undo step for one drag")
    after, _, _ = state_of(editor, focal)
    assert np.allclose(after - before, [4.0, 2.0], atol=0.4)
    editor.key("Control+z")
    editor.until(lambda: session.scenario is opened, "the very scenario again")
    assert session.selection == (focal,)

    editor.open_tab("Road")
    editor.fill("S-bend", 6)
    editor.until(lambda: session.scenario.applied_warp is not None, "a warp")
    editor.until(
        lambda: labels(editor) == ["Bend the road: S-bend +6"], "the end of it"
    )
    editor.screenshot("02_warped")
    expect(editor.page.get_by_text("Friction-limited speed")).to_contain_text("7.6 m/s")

    editor.open_tab("Agents")
    editor.fill("Speed (m/s)", 6.5)
    editor.until(
        lambda: (
            abs(state_of(editor, focal)[2] - 6.5) < 1e-6 and len(labels(editor)) == 2
        ),
        "a new speed",
    )

    editor.open_tab("Agents")
    editor.press("Show possible trajectories")
    editor.until(
        lambda: editor.tab().elements.candidates.view.shown is not None, "the fan"
    )
    editor.screenshot("03_candidates")
    editor.press("Hide possible trajectories")
    editor.choose_scope("All agents")
    editor.run("Regenerate", "everybody")
    editor.until(lambda: len(labels(editor)) == 3, "new futures")
    editor.screenshot("04_regenerated")

    editor.open_tab("Scene")
    with editor.page.expect_download() as download:
        editor.press("Download zip")
    content = download.value.path().read_bytes()
    exported = scenario_from_upload({"export.zip": content})
    assert exported.agents.ids == session.scenario.agents.ids
    assert exported.time_axis.num_steps == 110
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        name = next(n for n in archive.namelist() if n.endswith("recipe.json"))
        recipe = Recipe.from_text(archive.read(name))
    again = replay(recipe, open_scenario("signalised-junction"))
    assert same_scenario(again, session.scenario)


def test_a_candidate_clicked_on_the_road_is_adopted(editor):
    session, focal = editor.session, editor.session.scenario.focal_id
    row = session.scenario.agents.row_of[focal]
    editor.click_at(roof(editor, focal))
    editor.open_tab("Agents")
    editor.press("Show possible trajectories")
    fan = editor.until(lambda: editor.tab().elements.candidates.view.shown, "the fan")
    agents = session.scenario.agents
    others = agents.position_m[agents.is_valid[:, 49], 49]
    moving = np.flatnonzero(fan.is_valid[0] & ~fan.is_standstill[0])
    paths = fan.position_m[0, moving]
    gap = np.linalg.norm(paths[:, :, None] - others, axis=-1).min(axis=-1)
    path, step = np.unravel_index(gap.argmax(), gap.shape)
    editor.click_at(paths[path, step])
    editor.until(lambda: len(session.entries) == 1, "the adoption")
    end = session.scenario.agents.position_m[row, -1]
    ends = fan.position_m[0, moving, -1]
    assert np.linalg.norm(ends - end, axis=-1).min() < 1e-3
    assert editor.tab().elements.candidates.view.shown is None


def test_a_candidate_chosen_in_the_list_is_adopted(editor):
    session, focal = editor.session, editor.session.scenario.focal_id
    session_row = session.scenario.agents.row_of[focal]
    editor.click_at(roof(editor, focal))
    editor.open_tab("Agents")
    editor.press("Show possible trajectories")
    view = editor.until(lambda: editor.tab().elements.candidates.view.shown, "the fan")
    # The panel lists the candidates just after the picture shows them.
    choice = editor.field("Trajectory")
    editor.until(
        lambda: any("slowing to stop" in label for label in choice.options), "the list"
    )
    labels_shown = choice.options
    still = next(label for label in labels_shown if "slowing to stop" in label)
    editor.choose("Trajectory", still)
    editor.press("Use this trajectory")
    editor.until(lambda: len(session.entries) == 1, "the adoption")
    index = int(np.flatnonzero(view.is_valid[0])[labels_shown.index(still) - 1])
    future = session.scenario.agents.position_m[session_row, 49:]
    assert np.allclose(future, view.position_m[0, index], atol=1e-4)


def test_place_duplicate_turn_and_delete(editor):
    session = editor.session
    num_before = len(session.scenario.agents)
    (x, y), heading, _ = state_of(editor, session.scenario.focal_id)
    ahead = (x + 12 * np.cos(heading), y + 12 * np.sin(heading))
    editor.open_tab("Agents")
    editor.choose("New agent", "bus")
    editor.press("Place on road")
    editor.click_at(ahead)
    editor.until(lambda: len(session.scenario.agents) == num_before + 1, "a bus")
    editor.press("Stop placing")
    (placed,) = session.selection
    agents = session.scenario.agents
    row = agents.row_of[placed]
    assert agents.kinds[row] is AgentKind.BUS
    assert agents.has_made_up_past[row]
    assert agents.observed[row, 49]
    assert agents.is_valid[row, 49:].all()

    editor.fill("Heading (deg)", 30)
    editor.until(
        lambda: abs(np.degrees(state_of(editor, placed)[1]) - 30) < 1e-6, "a turn"
    )
    editor.open_folder(MORE)
    editor.press("Duplicate")
    editor.until(lambda: len(session.scenario.agents) == num_before + 2, "a copy")
    editor.press("Delete")
    editor.until(lambda: len(session.scenario.agents) == num_before + 1, "it gone")
    editor.key("Control+z")
    editor.until(lambda: len(session.scenario.agents) == num_before + 2, "it back")
    assert len(session.selection) == 1


@pytest.mark.slow
def test_a_dragged_anchor_friction_and_writing_to_a_folder(editor, tmp_path):
    session = editor.session
    editor.open_tab("Road")
    editor.open_folder("Where it bends")
    editor.choose("Anchor", "A point that I drag")
    editor.fill("Bend", 8)
    editor.until(lambda: len(labels(editor)) == 1, "a warp")
    before = session.scenario.applied_warp.warp.anchor
    # The arrow that points ahead; it is drawn above the ground.
    heading = before.rotation_rad
    tip = np.array([before.x_m, before.y_m]) + 4.0 * np.array(
        [np.cos(heading), np.sin(heading)]
    )
    start = editor.pixel((*tip, 0.3))
    editor.drag_pixels(start, (start[0], start[1] - 60))
    editor.until(lambda: len(labels(editor)) == 2, "the anchor dragged, one undo step")
    after = session.scenario.applied_warp.warp.anchor
    assert np.hypot(after.x_m - before.x_m, after.y_m - before.y_m) > 1.0

    speeds = session.scenario.agents.speed_mps().max()
    editor.tick("Slow agents to the friction limit")
    editor.until(lambda: len(labels(editor)) == 3, "slower agents")
    assert session.scenario.applied_warp.friction_coefficient == 0.7
    assert session.scenario.agents.speed_mps().max() <= speeds + 1e-9
    editor.screenshot("08_friction")

    editor.open_tab("Scene")
    editor.open_folder(OTHER_WAYS)
    editor.fill("Into folder", tmp_path)
    editor.press("Write to folder")
    editor.until(lambda: list(tmp_path.glob("*/recipe.json")), "the folder")
    (written,) = (path.parent for path in tmp_path.glob("*/recipe.json"))
    assert written.name.startswith("signalised-junction-")
    again = open_scenario(written)
    assert again.agents.ids == session.scenario.agents.ids
    recipe = Recipe.from_text((written / "recipe.json").read_bytes())
    assert same_scenario(
        replay(recipe, open_scenario("signalised-junction")), session.scenario
    )


def test_box_selection_in_the_top_view_and_multiple_edits(editor):
    session = editor.session
    looked_at = editor.client.camera.update_timestamp
    editor.key("v")
    editor.until(
        lambda: (
            editor.client.camera.fov < 0.2
            and editor.client.camera.update_timestamp > looked_at
        ),
        "the browser's word that it looks from above",
    )
    editor.settle()
    editor.page.wait_for_timeout(300)
    center, _, _ = state_of(editor, session.scenario.focal_id)
    start = editor.pixel(center + np.array([-35.0, 25.0]))
    editor.drag_pixels(start, editor.pixel(center + np.array([35.0, -25.0])))
    editor.until(lambda: len(session.selection) > 1, "several agents")
    editor.screenshot("05_box_selected")
    chosen = session.selection
    for agent_id in chosen:
        position, _, _ = state_of(editor, agent_id)
        assert np.all(np.abs(position - center) <= [37.0, 27.0])
    editor.key("Escape")
    editor.until(lambda: session.selection == (), "nothing selected")


@pytest.mark.slow
def test_playback_theme_layers_and_history(editor):
    session = editor.session
    editor.key("Space")
    step = editor.workspace.playback.step
    editor.until(lambda: editor.workspace.playback.step > step + 3, "playback")
    editor.pause()
    editor.seek(2.0)
    editor.until(lambda: editor.workspace.playback.step == 69, "the scrubber's time")
    editor.open_tab("View")
    editor.tick("Dark theme")
    editor.until(lambda: editor.workspace.is_dark, "darkness")
    editor.tick("Centre lines")
    editor.screenshot("06_dark")

    editor.click_at(roof_now(editor))
    editor.until(lambda: session.selection, "a selection")
    editor.open_tab("Agents")
    for number, speed in enumerate((3.0, 4.0, 5.0), start=1):
        editor.fill("Speed (m/s)", speed)
        editor.until(lambda n=number: len(labels(editor)) == n, f"edit {number}")
    editor.open_tab("History")
    editor.page.get_by_role("button", name="1. Set").first.click()
    editor.until(lambda: session.state.position == 1, "a jump back")
    editor.page.get_by_role("button", name="3. Set").first.click()
    editor.until(lambda: session.state.position == 3, "a jump forward")
    editor.screenshot("07_history")


def roof_now(editor) -> tuple[float, float, float]:
    """Where the focal agent is drawn at the playhead."""
    row = editor.session.scenario.agents.row_of[editor.session.scenario.focal_id]
    x, y = editor.tab().ui.model.poses.position_m[row]
    return float(x), float(y), 1.0


def test_recipe_text_in_the_export_is_plain_json(editor):
    editor.click_at(roof(editor, editor.session.scenario.focal_id))
    editor.open_tab("Agents")
    editor.open_folder(MORE)
    editor.press("Snap to lane")
    editor.until(lambda: len(labels(editor)) == 1, "an edit")
    data = json.loads(editor.session.recipe().to_text())
    assert data["base"]["source"] == "demo:signalised-junction"
    assert data["commands"][0]["command"] == "SnapToLane"
