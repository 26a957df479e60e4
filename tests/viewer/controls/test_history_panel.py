"""What the list of edits says of itself."""

from pd_editor.editor.commands import TransformAgents
from pd_editor.viewer.controls.history_panel import ROWS
from tests.viewer.fake_browser import FakeTab


def test_the_shown_edits_are_counted_from_one(tab: FakeTab):
    """(W17) It told "Rows 1 to 0 of 1" after the first edit."""
    (first, _) = tab.session.scenario.agents.ids
    for number in range(1, ROWS + 1):
        move = TransformAgents(agent_ids=(first,), dx_m=0.1 * number)
        tab.run(lambda move=move: tab.ui.apply(move))
        if number in (1, 3, ROWS):
            span = "1" if number == 1 else f"{number} to {max(number - ROWS + 1, 1)}"
            # Told where something is hidden.
            shown = f"Shown: {span} of {number}, newest first."
            assert (shown in tab.text()) == (number == ROWS)
            # Buttons that turn pages stood over a single edit.
            assert tab.field("Edits").visible == (number == ROWS)
    tab.enter(tab.field("Edits"), "Older")
    assert "Shown: the scenario as opened." in tab.text()
