"""Steering by a real mouse: goals, paths, stop lines and other agents."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowPath, snapped
from pd_editor.analysis.guidance.kinds.speed import StopAtLine, TargetSpeed
from pd_editor.editor.recipe import Recipe
from pd_editor.viewer.guidance.term_marks import OFFER

pytestmark = [pytest.mark.browser, pytest.mark.slow]


class Steered:
    """An editor with a moving vehicle selected, and places on the road ahead of it."""

    def __init__(self, editor) -> None:
        self.editor, self.page, self.session = editor, editor.page, editor.session
        scenario = editor.session.scenario
        agents, now = scenario.agents, scenario.current_step
        self.place = agents.position_m[:, now]
        velocity = agents.velocity_mps[:, now]
        # Away from the picture's edges and from the queue.
        self.row, self.other = (agents.row_of[name] for name in ("car-0009", "AV"))
        self.agent_id, self.other_id = "car-0009", "AV"
        self.along = velocity[self.row] / np.hypot(*velocity[self.row])
        editor.click_at(self.place[self.row])
        editor.until(lambda: self.session.selection == (self.agent_id,), "a selection")
        editor.open_tab("Agents")

    @property
    def guidance(self) -> tuple:
        return self.session.scenario.guidance

    def ahead(self, metres: float, left: float = 0.0) -> np.ndarray:
        aside = left * np.array([-self.along[1], self.along[0]])
        return self.place[self.row] + metres * self.along + aside

    def tool(self, name: str) -> None:
        bar = self.page.get_by_role("toolbar", name="Add guidance")
        shown = bar.get_by_role("button", name=name, exact=True)
        more = bar.get_by_role("button", expanded=False)
        expect(shown.or_(more).first).to_be_visible()
        if not shown.count():
            more.click()
        shown.click()

    def banner(self, text: str) -> None:
        bar = self.page.get_by_role("status", name="Mode")
        bar.get_by_text(text).wait_for()

    def click(self, point_m) -> None:
        self.editor.settle()
        x, y = self.editor.pixel(point_m)
        self.page.mouse.move(x, y)
        self.page.mouse.click(x, y)

    def flag(self, index: int) -> tuple[float, float]:
        """The middle of the cloth of a flag on the page."""
        self.editor.settle()
        cloth = self.page.locator(f"[data-guide='{index}'] .pd-guide-cloth")
        cloth.wait_for()
        box = cloth.bounding_box()
        assert box is not None
        return box["x"] + box["width"] / 3, box["y"] + box["height"] / 2

    def num_edits(self) -> int:
        return len(self.session.entries)


@pytest.fixture
def steered(open_editor):
    editor = open_editor()
    editor.go_to_now()
    editor.look_from_above()
    editor.close_notifications()
    return Steered(editor)


def test_a_path_is_clicked_point_by_point(steered):
    """Each click was refused as a path that is too short."""
    editor, page = steered.editor, steered.page
    points = [steered.ahead(12.0, 0.5), steered.ahead(24.0, -0.5), steered.ahead(34.0)]
    # Points near the middle of a lane are taken to be on it.
    scenario = steered.session.scenario
    on_lane = [snapped(scenario, steered.agent_id, one) for one in points]

    def begun() -> None:
        steered.tool("Path")
        steered.banner("click its points")
        for point in points[:2]:
            steered.click(point)
        assert page.locator(".pd-guide-point").count() == 3

    def drawn(*ends) -> None:
        editor.until(lambda: steered.guidance, "a path")
        (path,) = steered.guidance
        assert isinstance(path, FollowPath)
        there = [steered.place[steered.row], *ends]
        # Between points on lanes, more ones follow these.
        gap = np.linalg.norm(
            np.subtract(path.points_m, np.array(there)[:, None]), axis=-1
        )
        assert gap.min(axis=1).max() < 0.3
        assert (np.diff(gap.argmin(axis=1)) > 0).all()
        assert steered.session.selection == (steered.agent_id,)
        editor.key("Control+z")
        editor.until(lambda: not steered.guidance, "undo")

    begun()
    page.mouse.dblclick(*editor.pixel(points[2]))
    drawn(*on_lane)
    # Enter ends it as well; Backspace takes a point back, and deletes no agent.
    begun()
    page.keyboard.press("Backspace")
    steered.click(points[2])
    page.keyboard.press("Enter")
    drawn(on_lane[0], on_lane[2])
    # A drag goes on with what was clicked; Escape leaves nothing.
    begun()
    editor.drag_pixels(editor.pixel(points[1]), editor.pixel(points[2]))
    page.keyboard.press("Escape")
    page.get_by_role("status", name="Mode").wait_for(state="hidden")
    assert page.locator(".pd-guide-point").count() == 0
    assert not steered.guidance


def test_an_offered_flag_is_dragged_by_its_foot(steered):
    """The point that is meant drew a selection box, which dropped the selection."""
    editor = steered.editor
    steered.flag(OFFER)
    foot = editor.pixel(_end_of(steered.session.scenario, steered.row))
    editor.drag_pixels(foot, editor.pixel(steered.ahead(12.0)))
    editor.until(lambda: steered.num_edits() == 1, "a goal")
    assert np.linalg.norm(steered.guidance[0].point_m - steered.ahead(12.0)) < 1.0
    assert steered.session.selection == (steered.agent_id,)


def test_a_goal_flag_is_dragged_along_the_road_and_undone(steered):
    editor, page, session = steered.editor, steered.page, steered.session
    before = session.scenario
    camera = np.array(editor.client.camera.position)
    x, y = steered.flag(OFFER)
    end = np.array(editor.pixel(steered.ahead(12.0)))
    foot = np.array(editor.pixel(_end_of(before, steered.row)))
    editor.drag_pixels((x, y), (x + end[0] - foot[0], y + end[1] - foot[1]))
    editor.until(lambda: steered.num_edits() == 1, "a goal")
    (goal,) = steered.guidance
    assert isinstance(goal, GoalPoint)
    assert np.linalg.norm(goal.point_m - steered.ahead(12.0)) < 1.0
    assert np.allclose(editor.client.camera.position, camera, atol=0.01)
    page.get_by_role("listitem", name="Goal of vehicle car-0009").wait_for()
    # The pointer on the flag tells what it is.
    page.mouse.move(*steered.flag(0))
    page.get_by_text("vehicle car-0009: be here at the end").wait_for()

    # Dragged once more, then off the map: refused in a sentence, and nothing changes.
    x, y = steered.flag(0)
    editor.drag_pixels((x, y), (x, y - 30))
    editor.until(lambda: steered.num_edits() == 2, "a moved goal")
    moved = session.scenario
    x, y = steered.flag(0)
    editor.drag_pixels((x, y), editor.pixel(steered.ahead(-6.0, -22.0)))
    refused = page.get_by_text("off the road; drop it on the road")
    refused.filter(visible=True).first.wait_for()
    editor.until(lambda: session.scenario is moved, "the scenario before the drag")
    assert steered.num_edits() == 2
    # Escape during a drag.
    x, y = steered.flag(0)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 40, steps=6)
    editor.until(lambda: session.state.is_previewing, "a preview")
    page.keyboard.press("Escape")
    editor.until(lambda: session.scenario is moved, "the scenario before the drag")
    page.mouse.up()
    assert steered.num_edits() == 2
    editor.key("Control+z")
    editor.key("Control+z")
    editor.until(lambda: session.scenario is before, "the scenario before")
    assert steered.flag(OFFER)


def test_path_stop_line_and_agents_are_drawn_and_picked(steered):
    editor, page = steered.editor, steered.page
    editor.key("d")
    steered.banner("drag along the path")
    camera = np.array(editor.client.camera.position)
    points = [steered.ahead(d, 1.0 * np.sin(d / 5.0)) for d in np.linspace(2, 24, 20)]
    page.mouse.move(*editor.pixel(points[0]))
    page.mouse.down()
    for point in points:
        page.mouse.move(*editor.pixel(point))
        page.wait_for_timeout(15)
    page.mouse.up()
    editor.until(lambda: len(steered.guidance) == 1, "a path")
    (path,) = steered.guidance
    assert isinstance(path, FollowPath)
    assert 2 <= len(path.points_m) <= 12
    assert np.linalg.norm(path.points_m[-1] - points[-1]) < 0.8
    assert np.allclose(editor.client.camera.position, camera, atol=0.01)

    steered.tool("Stop line")
    steered.banner("click the lane where it should stop")
    steered.click(steered.ahead(18.0))
    editor.until(lambda: len(steered.guidance) == 2, "a stop line")
    line = steered.guidance[1]
    assert isinstance(line, StopAtLine)
    across = np.subtract(*line.line_m)
    assert 2.0 < np.hypot(*across) < 6.0
    assert abs(across @ steered.along) < 0.3
    assert np.linalg.norm(np.mean(line.line_m, axis=0) - steered.ahead(18.0)) < 2.0

    for tool, kind in (("Yield to", YieldTo), ("Threaten", Threaten)):
        steered.tool(tool)
        steered.banner(tool)
        steered.click(steered.ahead(0.0, 20.0))
        page.get_by_text("No other agent is there").first.wait_for()
        assert editor.tab().elements.steering.mode.is_active
        editor.close_notifications()
        steered.click(steered.place[steered.other])
        editor.until(lambda kind=kind: isinstance(steered.guidance[-1], kind), tool)
        assert steered.guidance[-1].other_id == "AV"
        assert steered.session.selection == ("car-0009",)

    # Long ids do not make the list wider than the panel.
    beyond = page.evaluate(
        "() => { const list = document.querySelector('.pd-guidance');"
        " for (const words of list.querySelectorAll('.pd-guidance-words'))"
        "   words.textContent = 'Threaten a-long-id-of-an-agent '.repeat(3);"
        " const seen = list.closest('[data-scrollarea-viewport], .mantine-Paper-root');"
        " return list.getBoundingClientRect().right - seen.getBoundingClientRect().right; }"
    )
    assert beyond <= 0

    # Escape ends a mode; the agent stays selected, and nothing changes.
    before = steered.session.scenario
    editor.key("t")
    steered.banner("click where it should drive to")
    editor.key("Escape")
    page.get_by_role("status", name="Mode").wait_for(state="hidden")
    assert steered.session.scenario is before
    assert steered.session.selection == ("car-0009",)
    editor.screenshot("70_guidance_top")

    # All of it survives a reload, and the recipe has it.
    terms = steered.guidance
    recipe = Recipe.from_text(steered.session.recipe().to_text())
    assert [command.term for command in recipe.commands] == list(terms)
    editor.reload()
    assert editor.session.scenario.guidance == terms
    expect(page.locator(".pd-guidance-row")).to_have_count(len(terms))
    expect(page.locator("[data-guide='1'] .pd-guide-line")).to_have_count(1)


def test_the_focus_stays_on_a_tool_that_keys_use(steered):
    """Each state made the tools anew, and the focus was lost."""
    editor, page = steered.editor, steered.page
    tool = page.get_by_role("toolbar", name="Add guidance").get_by_role("button").first
    tool.focus()
    page.keyboard.press("Enter")
    expect(tool).to_have_attribute("aria-pressed", "true")
    editor.settle()
    expect(tool).to_be_focused()
    page.keyboard.press("Enter")
    expect(tool).to_have_attribute("aria-pressed", "false")
    editor.settle()
    expect(tool).to_be_focused()


def test_terms_are_switched_weighed_changed_and_deleted_in_the_list(steered):
    editor, page, session = steered.editor, steered.page, steered.session
    steered.tool("Speed")
    editor.until(lambda: len(steered.guidance) == 1, "a target speed")
    (term,) = steered.guidance
    assert isinstance(term, TargetSpeed)
    row = page.get_by_role("listitem", name="Target speed of vehicle car-0009")
    speed = row.get_by_role("spinbutton", name="Speed")
    speed.fill("6.5")
    speed.press("Enter")
    editor.until(lambda: steered.guidance[0].speed_mps == 6.5, "another speed")
    speed.fill("700")
    speed.press("Enter")
    page.get_by_text("expected 0 to 60").first.wait_for()
    editor.until(lambda: speed.input_value() == "6.5", "the speed in force")
    row.get_by_role("switch").click()
    editor.until(lambda: not steered.guidance[0].is_on, "a term switched off")
    row.get_by_role("switch").click()
    editor.until(lambda: steered.guidance[0].is_on, "a term switched on")
    count = steered.num_edits()
    slider = row.get_by_role("slider")
    box = slider.bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 2, y)
    page.mouse.down()
    for share in (0.55, 0.65, 0.75, 0.9):
        page.mouse.move(box["x"] + share * box["width"], y)
        page.wait_for_timeout(60)
    page.mouse.up()
    editor.until(
        lambda: steered.num_edits() == count + 1 and not session.state.is_previewing,
        "one edit for the whole drag",
    )
    assert steered.guidance[0].weight > 2.0
    row.get_by_role("button", name="Delete").click()
    editor.until(lambda: not steered.guidance, "a term deleted")
    row.wait_for(state="detached")
    editor.key("Control+z")
    editor.until(lambda: steered.guidance, "the term is back")
    row.wait_for()
    assert steered.guidance[0].weight > 2.0


def test_a_number_is_typed_while_the_one_before_it_is_answered(steered):
    editor, page = steered.editor, steered.page
    steered.tool("Comfort")
    editor.until(lambda: len(steered.guidance) == 1, "comfort limits")
    fields = page.get_by_role("listitem", name="Comfort limits").get_by_role(
        "spinbutton"
    )
    first, second = fields.nth(0), fields.nth(1)
    (former,) = steered.guidance
    first.fill("2")
    first.press("Tab")
    expect(second).to_be_focused()
    page.keyboard.type("5")
    # The reply to the first number comes while the second one is typed.
    editor.until(lambda: steered.guidance != (former,), "the first number")
    editor.settle()
    page.keyboard.type(".5")
    page.keyboard.press("Tab")
    editor.until(lambda: steered.num_edits() == 3, "the second number")
    (term,) = steered.guidance
    assert (term.max_acceleration_mps2, term.max_braking_mps2) == (2.0, 5.5)
    expect(first).to_have_value("2")
    expect(second).to_have_value("5.5")


def test_a_refused_number_does_not_stay_while_the_strength_has_the_focus(steered):
    editor, page = steered.editor, steered.page
    steered.tool("Speed")
    editor.until(lambda: len(steered.guidance) == 1, "a target speed")
    row = page.get_by_role("listitem", name="Target speed of vehicle car-0009")
    speed = row.get_by_role("spinbutton", name="Speed")
    in_force = speed.input_value()
    speed.fill("99999999")
    speed.press("Tab")
    expect(row.get_by_role("slider")).to_be_focused()
    page.get_by_text("expected 0 to 60").first.wait_for()
    expect(speed).to_have_value(in_force)
    # A strength that is set by keys counts on from where it is.
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    editor.until(lambda: steered.guidance[0].weight == 3.0, "a strength")


def test_the_menu_of_the_road_drives_the_selected_agent_there(steered):
    editor, page = steered.editor, steered.page
    editor.settle()
    page.mouse.click(*editor.pixel(steered.ahead(15.0, 0.5)), button="right")
    page.get_by_role("menuitem", name="Drive agent car-0009 here").click()
    editor.until(lambda: len(steered.guidance) == 1, "a goal")
    goal = np.array(steered.guidance[0].point_m)
    assert np.linalg.norm(goal - steered.ahead(15.0, 0.5)) < 0.5
    page.mouse.click(*editor.pixel(steered.place[steered.other]), button="right")
    page.get_by_role("menuitem", name="Agent car-0009 yields to it").click()
    editor.until(lambda: len(steered.guidance) == 2, "yielding")
    assert steered.guidance[1] == YieldTo(agent_id="car-0009", other_id="AV")


def test_a_run_tells_what_was_asked_and_achieved(steered):
    editor, page, session = steered.editor, steered.page, steered.session
    steered.tool("Speed")
    editor.until(lambda: len(steered.guidance) == 1, "a target speed")
    row = page.get_by_role("listitem", name="Target speed of vehicle car-0009")
    speed = row.get_by_role("spinbutton", name="Speed")
    speed.fill("50")
    speed.press("Enter")
    # Told before the run: beside the term, and when the run starts.
    row.get_by_text("ask for less").wait_for()
    editor.close_notifications()
    # Told on every tab: nothing has followed the term yet.
    editor.open_tab("Scene")
    chip = page.get_by_role("status", name="Status")
    chip.get_by_text("guidance not run").wait_for()
    editor.run("Regenerate", "car-0009")
    page.get_by_text("A guidance problem").first.wait_for()
    editor.until(lambda: steered.num_edits() == 3, "a run", 120)
    chip.get_by_text("guidance not run").wait_for(state="detached")
    editor.open_tab("Agents")
    row.get_by_text("Asked: 50.0 m/s").wait_for()
    table = page.get_by_role("table", name="Realism of the last run")
    table.get_by_text("Mean acceleration").wait_for()
    editor.screenshot("71_guidance_report")
    # The report is of this traffic: it goes with an undo, and comes again.
    editor.key("Control+z")
    editor.until(lambda: session.state.position == 2, "an undo")
    table.wait_for(state="hidden")
    editor.key("Control+Shift+z")
    editor.until(lambda: session.state.position == 3, "a redo")
    table.wait_for()


def _end_of(scenario, row: int) -> np.ndarray:
    """The last point of an agent's trajectory."""
    steps = np.flatnonzero(scenario.agents.is_valid[row])
    return scenario.agents.position_m[row, steps[-1]]


def test_what_could_happen_is_listed_previewed_and_made_by_a_click(open_editor):
    editor = open_editor()
    editor.pause()
    editor.go_to_now()
    editor.open_tab("Agents")
    page, session = editor.page, editor.session
    page.get_by_role("button", name="What could happen to the ego?").click()
    lines = page.locator(".pd-possible-line")
    lines.first.wait_for()
    assert page.locator(".pd-guide-arc").count() > 0
    lines.first.hover()
    page.locator(".pd-guide-arc.pd-guide-chosen").wait_for()
    lines.first.click()
    editor.until(lambda: session.scenario.guidance, "the term")
    assert len(session.entries) == 1
    assert "AV" in session.scenario.guidance[0].named_ids
    expect(lines.first).to_have_attribute("aria-pressed", "true")


def test_agents_under_arcs_are_selected_and_arcs_leave_with_their_list(open_editor):
    """A click on an agent at an arc's foot made a threat; arcs stayed in other tabs."""
    editor = open_editor()
    editor.pause()
    editor.go_to_now()
    editor.open_tab("Agents")
    page, session = editor.page, editor.session
    ask = page.get_by_role("button", name="What could happen to")
    arcs = page.locator(".pd-guide-arc")
    told = page.locator(".pd-legend-arc").first
    expect(told).to_be_hidden()
    ask.click()
    page.locator(".pd-possible-line").first.wait_for()
    expect(told).to_be_visible()
    found = page.locator(".pd-possible-line b").all_inner_texts()
    agents, now = session.scenario.agents, session.scenario.current_step

    def on_screen(name: str) -> bool:
        try:
            x, y = editor.pixel(agents.position_m[agents.row_of[name], now])
        except AssertionError:
            return False
        return page.evaluate(
            "([x, y]) => Boolean(document.elementFromPoint(x, y)"
            ".closest('canvas, .pd-guide-arc'))",
            [x, y],
        )

    name = next(n for n in (one.split()[-1] for one in found) if on_screen(n))
    editor.click_at(agents.position_m[agents.row_of[name], now])
    editor.until(lambda: session.selection == (name,), "the agent")
    assert session.scenario.guidance == ()
    expect(ask).to_have_text("What could happen to the ego?")
    lines = page.locator(".pd-possible-line span")
    assert lines.evaluate_all("all => all.every(e => e.scrollWidth <= e.clientWidth)")
    editor.open_tab("Road")
    expect(arcs).to_have_count(0)
    expect(told).to_be_hidden()
