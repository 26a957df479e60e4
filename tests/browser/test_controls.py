"""How many controls the panel and the run bar show at once."""

import pytest
from playwright.sync_api import expect

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.editor.commands import AddGuidance
from tests.browser.editor_page import PAUSE_MS

pytestmark = [pytest.mark.browser, pytest.mark.slow]

TABS = ("Scene", "Road", "Agents", "Generate", "Study", "History", "View")
MOST = 14
COUNT = """() => {
  const seen = [...document.querySelectorAll('input:not([type=hidden]), button, select')]
    .filter((one) => {
      const place = one.closest('[data-scrollarea-viewport], [role=group][aria-label=Run]');
      const { top, height } = one.getBoundingClientRect();
      const isThere = one.checkVisibility({ visibilityProperty: true, opacityProperty: true }) && height > 0;
      const isInSight = isThere && top + height / 2 < innerHeight && !one.closest('[inert]');
      const isPart = one.matches('.mantine-NumberInput-control');
      const isOffered = !one.disabled && !one.matches('[data-disabled]');
      return place && isInSight && isOffered && !isPart;
    });
  return seen.map((one) => one.ariaLabel || one.labels?.[0]?.textContent
    || one.textContent.trim());
}"""


def test_few_controls_are_seen_at_once(open_editor):
    editor = open_editor()
    editor.page.set_viewport_size({"width": 1600, "height": 900})
    editor.go_to_now()
    for tab in TABS:
        editor.open_tab(tab)
        if tab == "Agents":
            editor.select((editor.session.scenario.focal_id,))
        editor.page.wait_for_timeout(4 * PAUSE_MS)
        shown = editor.page.evaluate(COUNT)
        assert 5 < len(shown) <= MOST, (tab, shown)


def test_terms_of_an_agent_show_the_fields_of_the_chosen_one(open_editor):
    editor = open_editor()
    page, session = editor.page, editor.session
    page.set_viewport_size({"width": 1600, "height": 900})
    editor.go_to_now()
    agent_id = session.scenario.focal_id
    editor.select((agent_id,))
    editor.open_tab("Agents")
    goal = GoalPoint(agent_id=agent_id, point_m=(0.0, 0.0))
    editor.tab().ui.post(lambda: session.apply(AddGuidance(term=goal)))
    rows = page.get_by_role("list", name="Guidance terms").get_by_role("listitem")
    expect(rows).to_have_count(1)
    tools = page.get_by_role("toolbar", name="Add guidance")
    tools.get_by_role("button", expanded=False).click()
    tools.get_by_role("button", name="Speed", exact=True).click()
    expect(rows).to_have_count(2)
    for place in (1, 0):
        rows.nth(place).get_by_title("Select vehicle").click()
        expect(rows.nth(place).get_by_role("slider")).to_be_visible()
        expect(rows.nth(1 - place).get_by_role("slider")).to_be_hidden()
    rows.nth(1).get_by_role("button", name="Delete").click()
    expect(rows).to_have_count(1)
    page.mouse.move(400, 300)
    page.wait_for_timeout(4 * PAUSE_MS)
    shown = page.evaluate(COUNT)
    assert any(one.startswith("Time of Goal") for one in shown)
    assert len(shown) <= MOST, shown


def test_folders_open_by_keys(open_editor):
    editor = open_editor()
    editor.open_tab("Scene")
    head = editor.page.get_by_role("button", name="From a folder")
    head.focus()
    for key, is_open in (("Enter", True), (" ", False), ("Enter", True)):
        editor.page.keyboard.press(key)
        expect(head).to_have_attribute("aria-expanded", str(is_open).lower())
    # It opens over frames, which a busy machine draws late.
    head.locator("+ div:not([inert])").wait_for()
    editor.page.keyboard.press("Tab")
    expect(editor.row("Folder").locator("input")).to_be_focused()


def test_a_folded_panel_opens_at_its_tab_again(open_editor):
    editor = open_editor()
    page = editor.page
    editor.open_tab("Road")
    page.get_by_role("button", name="Collapse").click()
    page.get_by_role("tab", name="Path Diffuser Editor").wait_for()
    page.wait_for_timeout(4 * PAUSE_MS)
    editor.reload()
    expect(page.get_by_role("tab", name="Road")).to_have_attribute(
        "aria-selected", "true"
    )


def test_tab_passes_lists_without_opening_them(open_editor):
    """A list that opened lay on the fields below."""
    editor = open_editor()
    editor.go_to_now()
    editor.select((editor.session.scenario.focal_id,))
    editor.open_tab("Agents")
    page = editor.page
    editor.row("Heading (deg)").locator("input:not([type=hidden])").first.click()
    page.keyboard.press("Tab")
    assert page.locator("input.mantine-Select-input:focus").count() == 1
    page.wait_for_timeout(4 * PAUSE_MS)
    assert page.locator("[role=listbox]:visible").count() == 0
    page.keyboard.press("ArrowDown")
    page.locator("[role=option]:visible").first.wait_for()


def test_tab_comes_to_the_tools_first_and_then_to_the_panel(open_editor):
    """The tools were behind the whole panel and all that lies over the picture."""
    editor = open_editor()
    page = editor.page
    order = page.evaluate(
        "[...document.querySelectorAll('.pd-bar button, .pd-track, [role=tab]')]"
        ".filter(one => one.checkVisibility({visibilityProperty: true}))"
        ".map(one => one.role ?? 'tool')"
    )
    assert list(dict.fromkeys(order)) == ["tool", "slider", "tab"]
