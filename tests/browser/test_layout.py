"""Elements over the picture leave each other, and the focal agent, room."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.editor.commands import AddGuidance, DuplicateAgents

pytestmark = [pytest.mark.browser, pytest.mark.slow]

Box = tuple[float, float, float, float]


def box_of(locator) -> Box:
    """Left, top, right and bottom on the page."""
    box = locator.bounding_box()
    return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]


def overlap(one: Box, other: Box) -> bool:
    return (
        one[0] < other[2]
        and other[0] < one[2]
        and one[1] < other[3]
        and other[1] < one[3]
    )


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.page.set_viewport_size({"width": 1440, "height": 900})
    page.go_to_now()
    page.close_notifications()
    return page


def collide(editor, count: int = 1) -> None:
    """Put copies of agents onto them."""
    session = editor.session
    agents, now = session.scenario.agents, session.scenario.current_step
    copied = tuple(np.array(agents.ids)[agents.is_valid[:, now]][:count].tolist())
    names = tuple(f"copy-{one}" for one in copied)
    command = DuplicateAgents(agent_ids=copied, new_ids=names, dx_m=0.4)
    editor.tab().ui.post(lambda: session.apply(command))


def strip_beside_a_problem(editor, count: int):
    """The strip of some samples of a scene with a collision."""
    collide(editor)
    editor.open_tab("Generate")
    editor.open_folder("Model settings")
    editor.choose("Model", "lane-follower")
    editor.set_number("Samples", count)
    editor.choose_scope("All agents")
    editor.run("Regenerate", "everybody")
    strip = editor.page.get_by_role("region", name="Samples", exact=True)
    expect(strip).to_be_visible()
    expect(strip.locator(".pd-sample")).to_have_count(count)
    return strip


def test_lists_scale_bar_and_strip_do_not_cover_each_other(editor):
    """The scale bar lay on buttons of the agent list, the problems on the strip."""
    page = editor.page
    strip = strip_beside_a_problem(editor, 2)
    agents, scale = page.locator(".pd-agents.pd-solid").first, ".pd-scalebar"
    for width in (1440, 1920):
        page.set_viewport_size({"width": width, "height": 900 + (width - 1440) // 2})
        editor.settle()
        editor.key("Control+f")
        expect(
            page.get_by_placeholder("Search by id, kind, focal, ego")
        ).to_be_visible()
        boxes = [box_of(one) for one in (agents, page.locator(scale), strip)]
        for index, one in enumerate(boxes):
            assert not any(overlap(one, other) for other in boxes[index + 1 :])
        # Two cards need no more; the focal agent is in the middle.
        assert boxes[2][2] < 520
        page.get_by_role("button", name="Close the agent list").click()
        page.locator(".pd-chip-main").click()
        problems = page.locator(".pd-problems.pd-solid")
        expect(problems).to_be_visible()
        assert not overlap(box_of(strip), box_of(problems))
        page.locator(".pd-chip-main").click()
        expect(problems).to_be_hidden()
    editor.screenshot("layout_samples")


@pytest.mark.parametrize("size", [(1280, 720), (1100, 800)])
def test_problems_are_listed_beside_the_strip_on_a_laptop(editor, size):
    """Up to 1,300 px the list lay on the cards and their buttons."""
    page = editor.page
    strip = strip_beside_a_problem(editor, 4)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    editor.settle()
    page.locator(".pd-chip-main").click()
    problems = page.locator(".pd-problems.pd-solid")
    expect(problems).to_be_visible()
    assert not overlap(box_of(strip), box_of(problems))
    for part in (
        strip.locator(".pd-sample").first,
        strip.get_by_role("button", name="Close"),
    ):
        assert box_of(part)[2] <= box_of(strip)[2]
    editor.screenshot(f"layout_laptop_{size[0]}")
    page.locator(".pd-chip-main").click()
    expect(problems).to_be_hidden()


def test_a_low_list_keeps_its_buttons(editor):
    """Buttons hung out of a list over branches."""
    page = editor.page
    page.set_viewport_size({"width": 1280, "height": 720})
    editor.select(editor.session.scenario.agents.ids[:1])
    editor.key("Control+f")
    # The field takes the focus, and would take the next key, too.
    expect(page.get_by_placeholder("Search by id, kind, focal, ego")).to_be_focused()
    editor.key("u")
    expect(page.get_by_role("region", name="Branches", exact=True)).to_be_visible()
    agents = page.get_by_role("region", name="Agent list")
    lock = agents.get_by_role("button", name="Lock", exact=True)
    lock.scroll_into_view_if_needed()
    assert box_of(lock)[3] <= box_of(agents)[3]


def test_the_legend_beside_a_list_keeps_off_the_focal_agent(editor):
    page = editor.page
    editor.key("Control+f")
    expect(page.get_by_placeholder("Search by id, kind, focal, ego")).to_be_visible()
    legend = page.locator(".pd-legend-box")
    expect(legend).to_be_hidden()
    page.set_viewport_size({"width": 1920, "height": 1080})
    expect(legend).to_be_visible()
    picture = box_of(page.locator("#root canvas").first)
    assert box_of(legend)[2] < (picture[0] + picture[2]) / 2 - 60


def test_the_status_chip_shows_all_of_its_words(editor):
    """It cut them where a button stands beside them: "3 problems, not y..."."""
    page, session = editor.page, editor.session
    collide(editor)
    x, y = session.scenario.agents.position_m[
        session.scenario.agents.row_of[session.scenario.focal_id],
        session.scenario.current_step,
    ].tolist()
    term = GoalPoint(agent_id=session.scenario.focal_id, point_m=(x, y))
    editor.tab().ui.post(lambda: session.apply(AddGuidance(term=term)))
    chip = page.locator(".pd-chip")
    expect(chip).to_contain_text("problem")
    expect(chip).to_contain_text("guidance not run")
    editor.select(())
    focal = session.scenario.focal_id
    regenerate = editor.run_bar.get_by_role("button", name=f"Regenerate {focal}")
    expect(regenerate).to_be_visible()
    words = chip.locator(".pd-clipped")
    assert words.evaluate("e => e.scrollWidth <= e.clientWidth"), words.inner_text()
    editor.screenshot("layout_chip")


def test_a_page_at_twice_its_zoom_keeps_all_in_sight(open_editor):
    page = open_editor().page
    page.set_viewport_size({"width": 640, "height": 360})
    page.reload()
    panel = page.get_by_role("tab", name="Path Diffuser Editor")
    panel.wait_for()
    tools = page.get_by_role("toolbar", name="Tools")
    page.get_by_role("button", name="Agent list").click()
    lock = page.get_by_role("region", name="Agent list").get_by_role(
        "button", name="Lock", exact=True
    )
    expect(lock).to_be_visible()
    run = page.get_by_role("group", name="Run", exact=True)
    for one in (tools, lock, run, page.locator(".pd-chip")):
        left, top, right, bottom = box_of(one)
        assert min(left, top) >= 0, one
        assert right < 640, one
        assert bottom < 360, one
    panel.click()
    page.get_by_role("tab", name="Agents", exact=True).wait_for()


def test_at_200_percent_on_a_laptop_nothing_is_cut_off(editor):
    """Half of the tools and crosses were beyond an open panel, rows under the tools."""
    page = editor.page
    strip = strip_beside_a_problem(editor, 2)
    page.set_viewport_size({"width": 640, "height": 360})
    editor.settle()
    picture = box_of(page.locator("#pd-overlay"))
    assert picture[2] < 300
    for part in (".pd-bar button", ".pd-timeline-bar > *", ".pd-run > *"):
        for one in page.locator(part).all():
            assert not one.is_visible() or box_of(one)[2] < picture[2], part
    expect(page.locator(".pd-legend-list")).to_be_hidden()
    for key, name in (
        ("i", "Close the scorecard"),
        ("Control+f", "Close the agent list"),
    ):
        editor.key(key)
        close = page.get_by_role("button", name=name)
        expect(close).to_be_visible()
        assert box_of(close)[2] < picture[2]
        close.click()
        expect(close).to_be_hidden()
    # Clicks reach what opens over the tools.
    strip.get_by_role("button", name="Compare with the one in use").click()
    pair = page.get_by_role("dialog", name="Comparison with another sample")
    pair.get_by_role("button", name="Close").click()
    strip.get_by_role("button", name="Close").click()
    page.locator(".pd-chip-main").click()
    page.locator(".pd-problem-row").first.click()
    editor.until(lambda: editor.session.selection, "the agents of the problem")
    # The verb tells runs apart.
    for verb in ("Regenerate", "Resample"):
        words = page.locator(".pd-run > button > span", has_text=verb)
        assert words.evaluate("one => one.clientWidth") > 20
