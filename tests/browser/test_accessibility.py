"""Accessibility by axe-core, an independent checker: no serious fault in any tab."""

import re
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.browser, pytest.mark.slow]

AXE = Path(__file__).parents[2] / "client/node_modules/axe-core/axe.min.js"
TABS = ("Scene", "Road", "Agents", "Generate", "Study", "History", "View")
GRAVE = ("serious", "critical")


def faults(editor) -> list[str]:
    """What axe finds now; names of controls are set a moment after they appear."""
    editor.page.wait_for_timeout(800)
    found = editor.page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{one['id']}: {node['html'][:200]}"
        for one in found["violations"]
        if one["impact"] in GRAVE
        for node in one["nodes"]
    ]


def contrast(editor) -> float:
    """Of the chosen tab's words, which axe takes for words on a picture."""
    tab, back = editor.page.evaluate(
        "[document.querySelector('[data-scrollarea-viewport] [aria-selected=true]'),"
        " document.querySelector('[data-scrollarea-viewport] [role=tablist]')]"
        ".map((one, at) => getComputedStyle(one)[at ? 'backgroundColor' : 'color'])"
    )
    low, high = sorted(map(luminance, (tab, back)))
    return (high + 0.05) / (low + 0.05)


def luminance(color: str) -> float:
    """Of ``rgb(...)``, as WCAG defines it."""
    parts = np.array(re.findall(r"[\d.]+", color)[:3], float) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.skipif(not AXE.exists(), reason="needs the tools of `make check`")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_fault(open_editor, scheme):
    editor = open_editor()
    editor.page.emulate_media(color_scheme=scheme)
    editor.go_to_now()
    editor.close_notifications()
    editor.page.evaluate(AXE.read_text())
    for tab in TABS:
        editor.open_tab(tab)
        assert not faults(editor), tab
        assert contrast(editor) >= 4.5, tab
    session = editor.session
    name = session.scenario.agents.ids[0]
    editor.tab().ui.post(lambda: session.select((name,)))
    editor.key("Control+f")
    editor.page.get_by_role("region", name="Agent list").wait_for()
    assert not faults(editor), "agent list"
    editor.key("Control+f")
    editor.key("i")
    editor.page.get_by_role("region", name="Scorecard").wait_for()
    assert not faults(editor), "scorecard"
    editor.key("n")
    editor.page.locator(".pd-start-drawn").first.wait_for()
    assert not faults(editor), "all scenarios"
