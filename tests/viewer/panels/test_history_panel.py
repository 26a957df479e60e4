"""The list of edits: rows that keep their place, pages that reach all of them."""

from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.viewer.panels.history_panel import NEWER, OLDER, PRESENT, ROWS
from tests.viewer.fake_browser import FakeTab


def edit(tab: FakeTab, count: int) -> None:
    agent_id = tab.session.scenario.agents.ids[1]
    for number in range(1, count + 1):
        command = SetAgentSpeed(agent_ids=(agent_id,), speed_mps=number / 2)
        tab.run(lambda command=command: tab.ui.apply(command))


def texts(tab: FakeTab) -> list[str]:
    return [row.label for row in tab.tab.panels.history._rows]


def test_pages_reach_every_edit_and_rows_keep_their_place(tab):
    """(D28)"""
    panel = tab.tab.panels.history
    edit(tab, 30)
    first = texts(tab)
    assert first[0].startswith("\N{BLACK RIGHT-POINTING TRIANGLE} 30. Set agent")
    assert "30 edits in force" in panel._counts.text
    seen = {text.lstrip("\N{BLACK RIGHT-POINTING TRIANGLE} ") for text in first}
    for _ in range(2):
        tab.run(lambda: panel._turn_page(OLDER))
        seen |= set(texts(tab))
    assert "Scenario opened" in seen
    assert sum(text[0].isdigit() for text in seen) == 30
    tab.run(lambda: panel._turn_page(OLDER))
    assert "Scenario opened" in texts(tab)

    # A jump leaves the page, and the rows where they are; only their looks change.
    tab.run(lambda: panel._turn_page(NEWER))
    before = texts(tab)
    tab.run(lambda: panel._jump(5))
    after = texts(tab)
    at = 30 - ROWS - 5
    assert after[5] == f"\N{BLACK RIGHT-POINTING TRIANGLE} {before[5]}"
    assert after[4] == f"(undone) {before[4]}"
    assert after[6] == before[6]
    assert panel._rows[4].color != panel._rows[5].color != panel._rows[6].color
    assert f"{at} edits in force, {30 - at} undone" in panel._counts.text
    tab.run(lambda: panel._turn_page(NEWER))
    tab.run(lambda: panel._turn_page(PRESENT))
    assert texts(tab) == after


def test_a_selection_does_not_turn_the_page(tab):
    """(D28)"""
    edit(tab, 20)
    panel = tab.tab.panels.history
    tab.run(lambda: panel._turn_page(OLDER))
    shown = texts(tab)
    tab.run(lambda: tab.session.select(tab.session.scenario.agents.ids))
    assert texts(tab) == shown
    assert all(row.visible for row in panel._rows)
    assert panel._rows[-1].disabled


def test_a_page_that_is_not_offered_is_not_turned_to(tab: FakeTab, caplog):
    """It was a KeyError in the server's log (5 of 200 random sessions)."""
    panel = tab.tab.panels.history
    page = panel._page
    tab.run(lambda: panel._turn_page("True"))
    assert panel._page == page
