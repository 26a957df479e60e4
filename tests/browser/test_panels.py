"""Agent list, agent panel, road panel, history and candidates, by real mouse."""

import numpy as np
import pytest
from playwright.sync_api import Locator, expect

from pd_editor.viewer.agents.agent_panel import MORE
from tests.analysis.findings.builders import finding

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.until(lambda: page.tab().ui.overlay.is_ready, "the overlay")
    page.workspace.playback.pause()
    return page


def rows(editor):
    return editor.page.locator(".pd-agents-row")


def list_has_rows(editor) -> None:
    editor.until(lambda: rows(editor).count() > 5, "the rows of the list")


def row_of(editor, agent_id: str):
    return rows(editor).filter(has=editor.page.locator(".pd-name", has_text=agent_id))


def select(editor, *agent_ids: str) -> None:
    editor.tab().ui.post(lambda: editor.session.select(agent_ids))
    editor.until(lambda: editor.session.selection == agent_ids, "a selection")


def top_of(locator) -> float:
    return locator.bounding_box()["y"]


def test_the_list_searches_selects_and_lights_up_agents(editor):
    """Search, click, Ctrl and Shift click, the buttons, pointing, scrolling to a row."""
    session, page = editor.session, editor.page
    ids = session.scenario.agents.ids
    editor.key("Control+f")
    list_has_rows(editor)
    # Only rows in sight have elements.
    assert rows(editor).count() < len(ids)
    assert page.get_by_label("Search agents").evaluate(
        "element => element === document.activeElement"
    )
    rows(editor).nth(2).click()
    editor.until(lambda: session.selection == (ids[2],), "one agent")
    rows(editor).nth(5).click(modifiers=["Shift"])
    editor.until(lambda: session.selection == ids[2:6], "a range")
    rows(editor).nth(3).click(modifiers=["Control"])
    editor.until(lambda: set(session.selection) == {ids[2], *ids[4:6]}, "one less")
    rows(editor).nth(6).hover()
    editor.until(lambda: editor.tab().ui.model.pointed_id == ids[6], "an agent lit up")
    lit = editor.node("/marks/pointed").batched_scales
    assert lit.max() > 0.5

    page.get_by_label("Search agents").fill("pedestrian")
    people = [
        name
        for name, kind in zip(ids, session.scenario.agents.kinds, strict=True)
        if kind.value == "pedestrian"
    ]
    status = page.locator(".pd-agents-count")
    editor.until(
        lambda: status.inner_text().startswith(f"{len(people)} of {len(ids)}"), "people"
    )
    page.get_by_role("button", name="All", exact=True).click()
    editor.until(lambda: set(session.selection) == set(people), "all of the list")
    # The page inverts what it shows as selected.
    chosen = page.locator(".pd-agents-row[aria-selected=true]")
    editor.until(lambda: chosen.count() > 0, "the selection in the page")
    page.get_by_label("Search agents").fill("")
    page.get_by_role("button", name="Invert", exact=True).click()
    editor.until(
        lambda: set(session.selection) == set(ids) - set(people), "all the others"
    )
    page.get_by_role("button", name="None", exact=True).click()
    editor.until(lambda: session.selection == (), "none")

    # Keys walk the rows, and reach neither another scenario nor the camera.
    base, looked_at = session.base, np.array(editor.client.camera.look_at)
    rows(editor).nth(0).click()
    for key, wanted in (("End", ids[-1]), ("Home", ids[0])):
        page.keyboard.press(key)
        editor.until(lambda wanted=wanted: session.selection == (wanted,), key)
    page.keyboard.press("PageDown")
    editor.until(lambda: session.selection[0] not in (ids[0], ids[1]), "a page on")
    page.keyboard.press("PageUp")
    editor.until(lambda: session.selection == (ids[0],), "a page back")
    assert session.base is base
    assert np.allclose(looked_at, editor.client.camera.look_at)
    assert page.get_by_text("Not possible").count() == 0

    # The row of an agent that is selected elsewhere comes into sight.
    select(editor, ids[-1])
    row_of(editor, ids[-1]).wait_for(state="visible")
    expect(row_of(editor, ids[-1])).to_have_attribute("aria-selected", "true")
    page.get_by_role("button", name="Same kind", exact=True).click()
    kind = session.scenario.agents.kinds[-1]
    editor.until(
        lambda: len(session.selection) == session.scenario.agents.kinds.count(kind),
        "the same kind",
    )
    editor.key("Control+f")
    editor.until(
        lambda: not editor.tab().elements.agent_list.is_open, "the list closed"
    )


def test_the_list_sorts_by_distance_to_the_focal_agent(editor):
    editor.page.get_by_role("button", name="Agent list (Ctrl+F)").click()
    list_has_rows(editor)
    editor.page.get_by_role(
        "button", name="Sort by distance to the focal agent"
    ).click()
    names = [
        text.strip() for text in rows(editor).locator(".pd-name").all_inner_texts()
    ]
    scenario = editor.session.scenario
    agents, now = scenario.agents, scenario.current_step
    assert names[0] == scenario.focal_id
    focal = agents.position_m[agents.row_of[scenario.focal_id], now]
    gap = np.linalg.norm(agents.position_m[:, now] - focal, axis=-1)
    gap = [round(float(gap[agents.row_of[name]]), 1) for name in names[:8]]
    assert gap == sorted(gap)


def test_an_agent_under_the_pointer_is_lit_in_the_list(editor):
    """The row of what the pointer rests on; the ego is found by that word."""
    scenario, page = editor.session.scenario, editor.page
    editor.go_to_now()
    editor.key("Control+f")
    list_has_rows(editor)
    page.get_by_label("Search agents").fill("ego")
    editor.until(lambda: rows(editor).count() == 1, "the ego")
    expect(rows(editor).locator(".pd-name")).to_have_text("AV")
    page.get_by_label("Search agents").fill("")
    list_has_rows(editor)
    agents, now = scenario.agents, scenario.current_step
    position = agents.position_m[agents.row_of[scenario.focal_id], now]
    page.mouse.move(*editor.pixel((*position, 1.0)))
    lit = page.locator(".pd-agents-row.pd-lit .pd-name")
    editor.until(lambda: lit.count() == 1, "a row that is lit")
    expect(lit).to_have_text(scenario.focal_id)
    page.mouse.move(*editor.pixel((*(position + 9.0), 0.0)))
    editor.until(lambda: lit.count() == 0, "no row that is lit")


def test_a_number_that_is_left_empty_or_refused_lets_the_focus_go(editor):
    """Keys such as Delete were the field's, which had come to the focus again."""
    page = editor.page
    select(editor, editor.session.scenario.focal_id)
    editor.open_tab("Agents")
    field = editor.row("Speed (m/s)").locator("input").first
    for text in ("Delete", "-"):
        field.click()
        page.keyboard.press("Control+a")
        page.keyboard.press(text)
        field.evaluate("field => field.blur()")
        page.wait_for_timeout(300)
        expect(field).not_to_be_focused()


def test_several_agents_show_empty_fields_that_apply_to_all(editor):
    """(D32)"""
    session = editor.session
    agents, now = session.scenario.agents, session.scenario.current_step
    there = np.flatnonzero(agents.is_valid[:, now])
    first = int(there[0])
    other = next(row for row in there if agents.kinds[row] != agents.kinds[first])
    chosen = (agents.ids[first], agents.ids[int(other)])
    editor.open_tab("Agents")
    speed = editor.row("Speed (m/s)").locator("input").first
    expect(speed).to_be_hidden()
    expect(editor.page.get_by_role("button", name="Place on road")).to_be_visible()
    select(editor, *chosen)
    expect(editor.page.get_by_role("button", name="Place on road")).to_be_hidden()
    editor.page.get_by_text("2 agents:").wait_for()
    expect(speed).to_have_value("")
    editor.open_folder(MORE)
    expect(editor.row("Kind").locator("input").first).to_have_value("mixed")
    editor.fill("Speed (m/s)", 4)
    editor.until(lambda: len(session.entries) == 1, "the speed of both")
    assert np.allclose(
        session.scenario.agents.speed_mps()[session.scenario.agents.rows(chosen), now],
        4,
    )
    select(editor, session.scenario.focal_id)
    expect(editor.page.get_by_role("button", name="Make focal")).to_be_hidden()
    select(editor)
    expect(speed).to_be_hidden()


def test_a_number_is_finished_by_enter_and_then_undone_by_its_key(editor):
    """The browser took back the typing, which made a new edit."""
    session, page = editor.session, editor.page
    select(editor, session.scenario.focal_id)
    editor.open_tab("Agents")
    speed = editor.row("Speed (m/s)").locator("input").first
    for count, value in enumerate(("4", "5"), start=1):
        speed.click()
        page.keyboard.press("Control+a")
        page.keyboard.type(value)
        page.keyboard.press("Enter")
        editor.until(lambda count=count: len(session.entries) == count, "an edit")
    page.keyboard.press("Control+z")
    editor.until(lambda: session.state.position == 1, "an undo")
    expect(speed).to_have_value("4")
    assert len(session.entries) == 2


def test_a_field_that_is_emptied_shows_its_number_again(editor):
    session, page = editor.session, editor.page
    select(editor, session.scenario.focal_id)
    for tab, label in (("Agents", "Speed (m/s)"), ("Road", "Bend")):
        editor.open_tab(tab)
        field = editor.row(label).locator("input:not([type=hidden])").first
        shown = field.input_value()
        assert shown
        for left in ("Delete", "-"):
            field.click()
            page.keyboard.press("Control+a")
            page.keyboard.press(left)
            expect(field).not_to_have_value(shown)
            page.keyboard.press("Tab")
            expect(field).to_have_value(shown)
    assert not session.entries


def test_a_number_is_taken_as_it_was_typed_or_refused(editor):
    """Whole numbers dropped what they did not take: 15 for 1.5, 13 for 1e3."""
    page = editor.page
    editor.open_tab("Road")
    bend = editor.row("Bend").locator("input:not([type=hidden])").first
    bar = editor.run_bar.get_by_role("spinbutton", name="Seed")
    editor.open_tab("Generate")
    editor.open_folder("How many")
    cars = editor.row("Vehicles").locator("input").first
    editor.fill("Vehicles", 12)
    editor.set_number("Seed", 12)

    def typed(field: Locator, text: str, shown: str, told: str = "") -> None:
        field.click()
        page.keyboard.press("Control+a")
        page.keyboard.type(text)
        page.keyboard.press("Tab")
        expect(field).to_have_value(shown)
        # The focus stays where it went.
        expect(field).not_to_be_focused()
        if told:
            expect(page.get_by_text(told)).to_be_visible()
            editor.close_notifications()
            expect(page.get_by_text(told)).to_be_hidden()

    for text in ("1.5", "2,5", "3 cars"):
        typed(cars, text, "12", f"Vehicles: {text} is no whole number; 12 stays.")
    typed(cars, "1e1", "10")
    typed(bar, "1.5", "12", "Seed: 1.5 is no whole number; 12 stays.")
    typed(bar, "2,5", "12", "Seed: 2.5 is no whole number; 12 stays.")
    editor.open_tab("Road")
    typed(bend, "2,5", "2.5")
    typed(bend, "\u22124", "-4")
    typed(bend, "3m", "-4", "Bend: 3m is no number; -4 stays.")
    session = editor.session
    editor.until(lambda: not session.state.is_previewing, "the end of the edits")
    assert session.scenario.applied_warp.warp.terms[0].power == -4


def test_shape_and_anchors_of_the_road_panel(editor):
    """(D27, D29) Undo takes the shape back, anchors that cannot be are not offered."""
    session = editor.session
    editor.open_tab("Road")
    reset = editor.page.get_by_role("button", name="Reset road")
    expect(reset).to_be_disabled()
    bend = editor.row("Bend")
    start = top_of(reset) - top_of(bend)
    editor.open_folder("Where it bends")
    editor.row("Anchor").locator("input").first.click()
    options = editor.page.get_by_role("option").all_inner_texts()
    assert "Selected agent" not in options
    assert "Focal agent" in options
    editor.page.keyboard.press("Escape")
    editor.fill("Waves", 3)
    editor.until(lambda: len(session.entries) == 1, "waves")
    editor.page.get_by_text("Shape", exact=True).click()
    editor.fill("Wave length (m)", 20)
    editor.until(lambda: len(session.entries) == 2, "a wave length")
    assert session.entries[-1].label == "Road: length of the waves 60 to 20 m"
    editor.key("Control+z")
    length = editor.row("Wave length (m)").locator("input:not([type=hidden])").first
    editor.until(lambda: length.input_value() == "60", "the length as before")
    assert top_of(reset) - top_of(bend) == pytest.approx(start, abs=0.5)
    editor.tick("Slow agents to the friction limit")
    editor.until(lambda: len(session.entries) == 2, "slower agents")
    editor.page.get_by_text("slowed:").wait_for()
    assert top_of(reset) - top_of(bend) == pytest.approx(start, abs=0.5)
    reset.click()
    editor.until(lambda: session.scenario.applied_warp is None, "the straight road")


def test_rows_of_the_history_keep_their_place(editor):
    """(D28)"""
    session = editor.session
    select(editor, session.scenario.focal_id)
    editor.open_tab("Agents")
    for number, speed in enumerate((3.0, 4.0, 5.0), start=1):
        editor.fill("Speed (m/s)", speed)
        editor.until(lambda n=number: len(session.entries) == n, f"edit {number}")
    editor.open_tab("History")
    row = editor.page.get_by_role("button", name="1. Set agent")
    # Nothing of the text is cut off, such as the lower part of a "g".
    text = row.locator(".mantine-Button-label").bounding_box()
    assert text["height"] >= 16
    before = top_of(row)
    row.click()
    editor.until(lambda: session.state.position == 1, "a jump back")
    assert top_of(row) == pytest.approx(before, abs=0.5)
    undone = editor.page.get_by_role("button", name="(undone) 3. Set agent")
    undone.wait_for()
    editor.page.get_by_text("1 edit in force").wait_for()
    undone.click()
    editor.until(lambda: session.state.position == 3, "a jump forward")
    # Unused rows take no room, and a long label makes the panel no wider.
    assert (
        editor.page.get_by_role("button", name="\N{EN DASH}", exact=True).count() == 0
    )
    newest = editor.page.get_by_role(
        "button", name="\N{BLACK RIGHT-POINTING TRIANGLE} 3. Set agent"
    )
    # Measured in one step: the page draws the row's own label again on the next change.
    right = newest.evaluate(
        "button => { const label = button.querySelector('.mantine-Button-label');"
        " label.textContent = 'a long label of an edit '.repeat(6);"
        " return button.getBoundingClientRect().right; }"
    )
    assert right <= editor.page.viewport_size["width"]


def test_the_same_key_closes_the_list_from_its_search_field(editor):
    drawer = editor.page.get_by_role("region", name="Agent list")
    editor.key("Control+f")
    search = editor.page.get_by_label("Search agents")
    expect(search).to_be_focused()
    search.press("Control+f")
    expect(drawer).to_be_hidden()


def tab(editor, name: str):
    return editor.page.get_by_role("tab", name=name, exact=True)


def place_of_focal(editor) -> np.ndarray:
    scenario = editor.session.scenario
    row = scenario.agents.row_of[scenario.focal_id]
    return np.append(scenario.agents.position_m[row, scenario.current_step], 1.0)


@pytest.mark.parametrize("former", ["Scene", "Road", "Study"])
def test_an_agent_that_is_clicked_is_shown_until_nothing_is_selected(editor, former):
    """Its speed, kind and lock were two tabs away."""
    editor.go_to_now()
    if former != "Scene":
        editor.open_tab(former)
    editor.until(
        lambda: editor.workspace.view.panel_tab == former, "the tab on the server"
    )
    editor.click_at(place_of_focal(editor))
    expect(tab(editor, "Agents")).to_have_attribute("aria-selected", "true")
    editor.key("Escape")
    expect(tab(editor, former)).to_have_attribute("aria-selected", "true")
    editor.click_at(place_of_focal(editor))
    expect(tab(editor, "Agents")).to_have_attribute("aria-selected", "true")
    # A tab that the user opens stays.
    editor.open_tab("View")
    editor.key("Escape")
    editor.until(lambda: not editor.session.selection, "nothing selected")
    editor.settle()
    expect(tab(editor, "View")).to_have_attribute("aria-selected", "true")


def test_a_tool_that_is_in_use_keeps_its_tab(editor):
    editor.go_to_now()
    editor.open_tab("Road")
    editor.until(lambda: editor.workspace.view.panel_tab == "Road", "the tab")
    editor.key("w")
    mode = lambda: editor.tab().ui.model.mode  # noqa: E731
    editor.until(mode, "the road to be bent")
    editor.click_at(place_of_focal(editor))
    editor.settle()
    assert mode() is not None
    expect(tab(editor, "Road")).to_have_attribute("aria-selected", "true")


def test_what_is_told_of_a_slider_covers_no_tab(editor):
    """It lay on the tabs above the first one."""
    editor.open_tab("Road")
    slider = editor.page.locator(".mantine-Slider-root").first
    slider.hover()
    told = editor.page.get_by_role("tooltip")
    told.wait_for()
    editor.settle()
    box, row = told.bounding_box(), slider.bounding_box()
    panel = editor.page.locator("[data-scrollarea-viewport]").first.bounding_box()
    assert box["x"] + box["width"] <= panel["x"]
    assert box["y"] < row["y"] < box["y"] + box["height"]
    # Its number is beside it; a second one over its handle was cut by the tabs.
    editor.page.mouse.down()
    expect(editor.page.locator(".mantine-Slider-label").first).to_be_hidden()
    editor.page.mouse.up()


def test_a_list_without_a_row_is_small(editor):
    """Of 300 px of white over the road, two lines said something."""
    editor.page.locator(".pd-chip-main").click()
    dialog = editor.page.get_by_role("dialog", name="Problems")
    expect(dialog).to_be_visible()
    assert dialog.bounding_box()["height"] < 90


def test_notices_are_listed_where_there_is_no_problem(editor, monkeypatch):
    """A list that was opened had closed headlines alone."""
    elements = editor.tab().elements
    watch = editor.tab().ui.model.findings
    monkeypatch.setattr(type(watch), "notices", (finding("near-pass", "one"),))
    editor.tab().ui.post(elements.chip.show)
    editor.page.locator(".pd-chip-main").click()
    rows = editor.page.locator(".pd-problem-row")
    expect(rows).to_have_count(1)
    editor.page.get_by_role("button", name="1 notice").click()
    expect(rows).to_have_count(0)


def test_a_refused_action_is_named(editor):
    """The notice says what was not done, and stands below the toolbar."""
    select(editor)
    editor.key("Delete")
    # In one look: on a busy machine it may be gone before a second one.
    editor.page.wait_for_function(
        "() => { const notice = [...document.querySelectorAll("
        "'.mantine-Notification-root')].find(one => one.innerText.includes('Not deleted')"
        " && one.innerText.includes('Nothing is selected. Select an agent first.'));"
        " return notice && notice.getBoundingClientRect().top > 52; }"
    )
    editor.page.get_by_text("Not deleted").wait_for(state="detached")


def test_possible_trajectories_are_told_apart(editor):
    """(D30)"""
    session = editor.session
    select(editor, session.scenario.focal_id)
    editor.open_tab("Agents")
    use = editor.page.get_by_role("button", name="Use this trajectory")
    # What chooses among them takes no room until there are some.
    expect(use).to_be_hidden()
    editor.press("Show possible trajectories")
    expect(use).to_be_disabled()
    hide = editor.page.get_by_role("button", name="Hide possible trajectories")
    before = top_of(use) - top_of(hide)
    editor.until(lambda: editor.tab().elements.candidates.view.shown, "the fan")
    choice = editor.field("Trajectory")
    labels = editor.until(
        lambda: len(choice.options) > 1 and choice.options, "the words"
    )
    assert any("Left at the junction" in label for label in labels)
    assert any("Change to the right lane" in label for label in labels)
    told = editor.page.get_by_text("Collides with")
    for label in labels[1:]:
        editor.choose("Trajectory", label)
        if told.count():
            break
    told.wait_for()
    assert top_of(use) - top_of(hide) == pytest.approx(before, abs=0.5)
    use.click()
    editor.until(lambda: len(session.entries) == 1, "the trajectory")
    assert session.entries[0].label.startswith("Use a trajectory for agent")


def test_a_slider_dragged_with_a_rest_is_one_edit_and_the_tabs_stay_in_sight(editor):
    """One drag of the mouse is one undo step; tabs do not scroll away with the panel.

    (W8) Each tab is scrolled on its own: another one opened with its top out of sight.
    """
    page, session = editor.page, editor.session
    editor.open_tab("Road")
    editor.open_folder("Where it bends")
    tab_bar = page.get_by_role("tab", name="Road", exact=True)
    top = top_of(tab_bar)
    thumb = editor.row("Bend").get_by_role("slider")
    thumb.scroll_into_view_if_needed()
    box = thumb.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 15, y, steps=3)
    editor.until(lambda: session.scenario.applied_warp is not None, "a bend")
    first = session.scenario.applied_warp.warp
    page.wait_for_timeout(1600)
    page.mouse.move(x + 30, y, steps=3)
    editor.until(lambda: session.scenario.applied_warp.warp != first, "a stronger bend")
    assert not session.entries
    page.mouse.up()
    editor.until(lambda: session.entries, "an edit")
    assert len(session.entries) == 1
    assert not session.state.is_previewing

    # The panel scrolls to its end, the tabs and the name stay where they are.
    page.mouse.move(x, y)
    page.mouse.wheel(0, 3000)
    viewport = page.locator("[data-scrollarea-viewport]").filter(has=tab_bar)
    editor.until(lambda: viewport.evaluate("e => e.scrollTop") > 50, "a scroll")
    assert top_of(tab_bar) == pytest.approx(top, abs=0.5)
    hit = tab_bar.evaluate(
        "e => { const r = e.getBoundingClientRect(); return e.contains("
        " document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2)); }"
    )
    assert hit
    page.get_by_role("tab", name="Generate", exact=True).click()
    editor.row("Replace").wait_for()
    editor.until(lambda: viewport.evaluate("e => e.scrollTop") == 0, "its top")
    page.get_by_role("tab", name="Road", exact=True).click()
    editor.until(lambda: viewport.evaluate("e => e.scrollTop") > 50, "where it was")
