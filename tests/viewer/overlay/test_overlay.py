"""The Python side of the overlay: what it sends, and what it makes of answers."""

import numpy as np
import pytest

from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.viewer.overlay.messages import (
    CompareState,
    MapWindowState,
    PanelEvent,
    PlayheadState,
)
from tests.builders import two_agents_that_pass
from tests.viewer.fake_browser import connected_tab, running_app


@pytest.fixture
def tab(tmp_path):
    write_files(
        scenario_files(two_agents_that_pass()), tmp_path / "scene", forbidden=None
    )
    with (
        running_app(tmp_path / "library", str(tmp_path / "scene")) as app,
        connected_tab(app) as opened,
    ):
        yield opened


def test_events_reach_their_element_alone(tab):
    overlay, heard = tab.ui.overlay, []
    overlay.on("panel", heard.append)
    tab.hear("panel", kind="tab", title="Road")
    tab.hear("panel", kind="hold")
    assert heard == [PanelEvent(kind="tab", title="Road"), PanelEvent(kind="hold")]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        "null",
        '{"element":"missing","event":{}}',
        '{"element":"panel","event":3}',
        '{"element":["panel"],"event":{}}',
        '{"element":"panel","event":{"kind":"leave"}}',
        '{"element":"panel","event":{"kind":"tab","title":7}}',
        "9" * 70_000,
    ],
)
def test_garbage_is_dropped(tab, text):
    heard = []
    tab.ui.overlay.on("panel", heard.append)
    tab.type("overlay", text)
    assert heard == []
    assert tab.run(lambda: "still working") == "still working"


def test_an_element_is_sent_again_only_when_it_changes(tab, monkeypatch):
    overlay, sent = tab.ui.overlay, []
    monkeypatch.setattr(overlay, "_run", sent.append)
    for text in ("one", "one", "other"):
        overlay.show(CompareState(text=text))
    assert len(sent) == 2
    with pytest.raises(ValueError, match="JSON"):
        overlay.show(MapWindowState(square=(0.0, 0.0, float("nan"))))


def test_numbers_of_numpy_are_numbers(tab, monkeypatch):
    """The progress of possible encounters was one: each step of it was told as a bug."""
    sent = []
    monkeypatch.setattr(tab.ui.overlay, "_run", sent.append)
    head = PlayheadState(
        step=np.float64(1.25),  # pyright: ignore[reportArgumentType]
        is_playing=False,
        speed=1.0,
        loops=True,
    )
    tab.run(lambda: tab.ui.overlay.show(head))
    assert '"step":1.25' in sent[-1]
