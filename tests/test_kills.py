"""What the benchmark of kills counts: one edit more than told, and edits that are lost."""

import pytest

from benchmarks.kills import found_afterwards
from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.journal import Journal
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession


@pytest.mark.parametrize(
    ("num_told", "position", "expected"),
    [
        (3, 2, "same"),
        (3, 3, "ahead"),  # the undo was written and not told
        (2, 2, "lost"),  # two lines more than told
        (4, 4, "lost"),  # told, and not in the journal
    ],
)
def test_a_journal_may_be_one_line_ahead_of_what_was_told(
    tmp_path, num_told, position, expected
):
    """(Reliability 12) The labels differed after 3 of 200 kills: an edit more, untold."""
    base = open_scenario("crosswalk")
    session = EditorSession(base, journal=Journal(tmp_path / "journals"))
    for dx in (1.0, 2.0, 3.0):
        move = TransformAgents(agent_ids=(base.focal_id,), dx_m=dx)
        session.apply(move)
    session.undo()
    labels = [entry.label for entry in session.entries]
    assert session.journal_path is not None
    name = session.journal_path.name
    session.close()
    told = {
        name: {"labels": (labels + labels)[:num_told], "position": position},
    }
    out = tmp_path / "out"
    out.mkdir()
    counts = found_afterwards(tmp_path, out, told)
    assert counts["journals"] == 1
    found = {key: counts[key] for key in ("lost", "ahead")}
    assert found == {key: int(key == expected) for key in ("lost", "ahead")}
