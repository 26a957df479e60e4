"""What the editor takes as a text, it reads again from recipes and journals."""

import json
import logging
from datetime import UTC
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import EditError, RecipeError
from pd_editor.editor import recipe as recipes
from pd_editor.editor.commands import (
    DeleteAgents,
    DuplicateAgents,
    PlaceAgent,
    TransformAgents,
)
from pd_editor.editor.journal import Journal
from pd_editor.editor.recipe import Recipe, moment
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.editor.variant import Variant
from pd_editor.scene.agent_kind import AgentKind
from tests.builders import two_agents_that_pass

BASE = two_agents_that_pass()
ANY_TEXT = st.text(
    st.characters(exclude_categories=("Cc", "Cs"))
    | st.sampled_from("\n\t\u00a0\u200d"),
    min_size=1,
    max_size=60,
)


def moved(session: EditorSession, times: int = 1) -> EditorSession:
    for _ in range(times):
        session.apply(TransformAgents(agent_ids=(BASE.focal_id,), dx_m=0.5))
    return session


@given(
    ANY_TEXT,
    st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=60),
)
@settings(deadline=None)
def test_every_note_and_tag_that_is_taken_is_read_again(note: str, tag: str):
    """No-break and ideographic spaces, joined emoji and soft hyphens among them."""
    session = moved(EditorSession(BASE))
    session.describe(Variant(note=note))
    try:
        session.describe(Variant(note=note, tags=(tag,)))
    except EditError:
        assert set(map(chr, [*range(32), *range(127, 160)])) & set(tag)
    again = Recipe.from_text(session.recipe().to_text()).variant
    assert (again.note, again.tags) == (session.variant.note, session.variant.tags)


@given(st.text(st.characters(), min_size=1, max_size=300))
@settings(deadline=None)
def test_every_agent_id_that_is_taken_is_read_again(name: str):
    session = EditorSession(BASE)
    try:
        session.apply(
            PlaceAgent(
                agent_id=name,
                kind=AgentKind.VEHICLE,
                x_m=0.0,
                y_m=50.0,
                heading_rad=0.0,
                speed_mps=1.0,
            )
        )
    except EditError:
        return
    assert Recipe.from_text(session.recipe().to_text()).edited_ids == {name}


@pytest.mark.parametrize(
    "note",
    ["vitesse\u00a0: 50", "右折\u3000注意", "あ" * 4000, "Ver\u00adkehr", "a\r\nb"],
)
def test_a_note_does_not_cost_the_edits_of_a_session(note: str, tmp_path: Path):
    session = moved(EditorSession(BASE, journal=Journal(tmp_path)), 3)
    session.describe(Variant(note=note, tags=("👨\u200d👩",)))
    moved(session)
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert (work.num_edits, work.variant.note) == (4, note)
    again = restore(work, BASE)
    assert again.variant == work.variant
    again.close(discard=True)


def test_a_description_that_cannot_be_read_is_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    """Edits are worth more than their note, and the good parts of it stay."""
    session = moved(EditorSession(BASE, journal=Journal(tmp_path)))
    session.describe(Variant(note="good", tags=("one",)))
    session.close()
    text = session.recipe().to_text()
    (path,) = tmp_path.glob("*.journal")
    bad = {"name": "", "tags": ["one"], "note": "a\x1b[2J", "of_later": 1}
    lines = path.read_bytes().splitlines(keepends=True)
    lines[-1] = json.dumps(json.loads(lines[-1]) | {"variant": bad}).encode() + b"\n"
    path.write_bytes(b"".join(lines))
    with caplog.at_level(logging.WARNING):
        (work,) = find_unfinished(tmp_path)
        read = Recipe.from_text(
            json.dumps(json.loads(text) | {"variant": bad, "notes": ["a\0", "b"]})
        )
    assert work.num_edits == len(read.commands) == 1
    assert work.variant == read.variant == Variant(tags=("one",))
    assert read.notes == ("b",)
    assert "left out" in caplog.text


def test_a_session_takes_no_more_edits_than_a_recipe(monkeypatch: pytest.MonkeyPatch):
    for module in ("pd_editor.editor.recipe", "pd_editor.editor.session"):
        monkeypatch.setattr(f"{module}.MAX_COMMANDS", 5)
    session = moved(EditorSession(BASE), 5)
    before = session.state
    for act in (session.apply, session.preview):
        with pytest.raises(EditError, match="at most 5 edits"):
            act(TransformAgents(agent_ids=(BASE.focal_id,), dx_m=1))
    assert session.scenario is before.scenario
    assert len(Recipe.from_text(session.recipe().to_text()).commands) == 5
    session.undo()
    moved(session)


def test_a_recipe_that_would_be_too_large_to_be_read_is_not_written(
    monkeypatch: pytest.MonkeyPatch,
):
    recipe = moved(EditorSession(BASE), 3).recipe()
    size = len(recipe.to_text())
    monkeypatch.setattr(recipes, "MAX_RECIPE_BYTES", size)
    assert Recipe.from_text(recipe.to_text()).commands == recipe.commands
    monkeypatch.setattr(recipes, "MAX_RECIPE_BYTES", size - 1)
    with pytest.raises(RecipeError, match="larger than 0 MiB"):
        recipe.to_text()


def test_a_full_journal_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pd_editor.editor.journal.MAX_JOURNAL_BYTES", 2000)
    session = moved(EditorSession(BASE, journal=Journal(tmp_path)), 50)
    assert "the journal is full" in (session.journal_problem or "")
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert 0 < work.num_edits < 50


@pytest.mark.parametrize("time_s", [3e11, 1e300, -1e18, -1.0, 0.0, 1.7e9])
def test_no_time_is_beyond_all_dates(time_s: float, tmp_path: Path):
    """A clock that was set to the year 11476, or long before 1970."""
    session = EditorSession(BASE, journal=Journal(tmp_path), clock=lambda: time_s)
    moved(session)
    assert session.recipe().created_at
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert moment(work.last_time, UTC).year <= 9999
    again = restore(work, BASE, clock=lambda: time_s)
    assert len(again.recipe().commands) == 1
    again.close(discard=True)


def test_the_id_of_a_deleted_agent_is_not_used_again():
    session = EditorSession(BASE)
    gone = next(name for name in BASE.agents.ids if name != BASE.focal_id)
    session.apply(DeleteAgents(agent_ids=(gone,)))
    place = PlaceAgent(
        agent_id=gone,
        kind=AgentKind.VEHICLE,
        x_m=0.0,
        y_m=50.0,
        heading_rad=0.0,
        speed_mps=1.0,
    )
    copy = DuplicateAgents(agent_ids=(BASE.focal_id,), new_ids=(gone,))
    for command in (place, copy):
        with pytest.raises(EditError, match="id of an agent that was deleted"):
            session.apply(command)
    session.undo()
    with pytest.raises(EditError, match="already an agent"):
        session.apply(place)
