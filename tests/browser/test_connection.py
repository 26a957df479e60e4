"""A server that goes away and comes back under an open page."""

import re

import pytest
from playwright.sync_api import expect

from pd_editor.editor.commands import DeleteAgents
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.browser.view_page import ready

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FLASHES = """
(() => {
  window.__bare = [];
  const look = () => {
    const root = document.getElementById("pd-overlay");
    const shown = [...(root?.querySelectorAll("button") ?? [])].filter(
      (one) => one.checkVisibility() && one.innerText.match(/^(Download|Cancel)$/));
    if (shown.length) window.__bare.push(shown[0].innerText);
    requestAnimationFrame(look);
  };
  look();
})()
"""


def test_a_lost_connection_is_told_on_the_picture_and_so_is_its_return(
    open_editor, tmp_path
):
    """The picture and the toolbar looked alive; the return flashed chips without words."""
    editor = ready(open_editor())
    page, app = editor.page, editor.app
    (agent_id, *_) = (
        one for one in editor.session.scenario.agents.ids if one.startswith("car")
    )
    editor.tab().ui.post(
        lambda: editor.tab().ui.apply(DeleteAgents(agent_ids=(agent_id,)))
    )
    editor.until(lambda: editor.session.entries, "an edit")
    page.evaluate(FLASHES)
    alert = page.locator(".pd-connection-bar")
    expect(alert).to_be_hidden()

    app.server._websock_server.disconnect_all_clients()
    expect(alert).to_have_text("Connected again. All edits are here.")
    expect(alert).to_be_hidden()

    host, port = app.server.get_host(), app.server.get_port()
    app.stop()
    expect(alert).to_have_text(
        re.compile(r"Connection lost\. Edits up to [\d:]+.* are saved\. Reconnecting")
    )
    play = page.get_by_role("button", name="Play", exact=True)
    assert play.evaluate("one => getComputedStyle(one).pointerEvents") == "none"
    again = ViewerApp(
        ViewerOptions(
            reference="signalised-junction",
            host=host,
            port=port,
            state=tmp_path / "state",
        )
    )
    try:
        expect(alert).to_contain_text("started anew. Your edits are under")
        page.keyboard.press("n")
        expect(page.get_by_role("tab", name="Unfinished 1")).to_be_visible()
        assert page.evaluate("window.__bare") == []
        expect(page.locator(".pd-lost")).to_have_count(0)
    finally:
        again.stop()


def test_a_page_with_the_token_of_an_earlier_start_says_what_to_do(
    open_editor, tmp_path
):
    """It said "Reconnecting" for ever."""
    editor = ready(open_editor(token=True))
    app = editor.app
    host, port = app.server.get_host(), app.server.get_port()
    app.stop()
    alert = editor.page.locator(".pd-connection-bar")
    expect(alert).to_contain_text("Reconnecting")
    again = ViewerApp(
        ViewerOptions(
            reference="queue",
            host=host,
            port=port,
            state=tmp_path / "state",
            token=True,
        )
    )
    try:
        expect(alert).to_contain_text("open the one that it printed. Edits up to")
    finally:
        again.stop()
