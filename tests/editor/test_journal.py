"""Journals on disk: kills, torn lines, locks, several sessions."""

import json
import logging
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import RecipeError
from pd_editor.editor import journal as journal_file
from pd_editor.editor.commands import DeleteAgents, TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import (
    Journal,
    UnfinishedWork,
    find_unfinished,
    restore,
)
from pd_editor.editor.variant import ExportMark, Variant
from tests.editor.command_strategies import busy_scenario
from tests.editor.random_edits import random_command
from tests.editor.same_scenario import same_scenario

BASE = busy_scenario()
NOW = BASE.current_step
ROOT = Path(__file__).parents[2]


_opened: list[EditorSession] = []


@pytest.fixture(autouse=True)
def _closed_at_the_end():
    yield
    while _opened:
        _opened.pop().close()


def restored(work: UnfinishedWork, base=BASE, **options) -> EditorSession:
    """As ``restore``, closed when the test ends."""
    _opened.append(restore(work, base, **options))
    return _opened[-1]


def shift(dx: float) -> TransformAgents:
    return TransformAgents(agent_ids=("100",), dx_m=dx)


def session_in(folder: Path, **options) -> EditorSession:
    _opened.append(EditorSession(BASE, journal=Journal(folder), **options))
    return _opened[-1]


def left_behind(folder: Path, *commands) -> Path:
    """The journal of a session that ended without being finished."""
    session = session_in(folder)
    for command in commands:
        session.apply(command)
    session.close()
    (work,) = find_unfinished(folder)
    return work.path


def test_a_killed_process_loses_nothing_that_was_committed(tmp_path: Path):
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.editor.journal_writer", str(tmp_path)],
        stdout=subprocess.PIPE,
        cwd=ROOT,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "edited\n"
        assert find_unfinished(tmp_path) == [], "its writer lives"
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    (work,) = find_unfinished(tmp_path)
    assert work.scenario_id == "two-lane-road"
    assert work.num_edits == 6
    assert {path.name: path.read_bytes() for path in work.base_files} == {
        "map.json": b"{}",
        "tracks.parquet": b"PAR1",
    }
    session = restored(work, BASE)
    assert session.scenario.agents.position_m[0, NOW, 0] == sum(range(1, 7))
    assert session.state.position == 6
    assert session.state.num_entries == 7
    assert session.selection == ("100", "101")
    session.redo()
    assert session.scenario.agents.position_m[0, NOW, 0] == sum(range(1, 8))
    session.jump_to(0)
    assert session.scenario is BASE


@pytest.mark.parametrize("seed", range(2))
def test_random_walks_come_back_with_their_history(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    ticks = count(100)
    session = session_in(tmp_path, clock=lambda: float(next(ticks)), max_undo=20)
    for _ in range(60):
        choice = rng.random()
        if choice < 0.25 and session.can_undo:
            session.undo()
        elif choice < 0.35 and session.can_redo:
            session.redo()
        else:
            ids = session.scenario.agents.ids
            session.select(ids[: rng.integers(3)])
            session.apply(random_command(session.scenario, rng))
    session.close()
    (work,) = find_unfinished(tmp_path)
    again = restored(work, BASE, max_undo=20)
    assert same_scenario(again.scenario, session.scenario)
    assert again.state.position == session.state.position == work.num_edits
    assert [one.command for one in again.entries] == [
        one.command for one in session.entries
    ]
    assert [one.time_s for one in again.entries] == [
        one.time_s for one in session.entries
    ]
    assert again.can_undo == session.can_undo
    for one in (session, again):
        one.undo()
    assert same_scenario(again.scenario, session.scenario)
    assert again.selection == session.selection


def test_a_session_without_edits_leaves_no_trace(tmp_path: Path):
    session = session_in(tmp_path / "journals")
    session.select(("100",))
    session.close()
    assert not (tmp_path / "journals").exists()
    assert find_unfinished(tmp_path / "journals") == []


def test_finished_work_is_gone(tmp_path: Path):
    session = session_in(tmp_path, base_files={"map.json": b"{}"})
    session.apply(shift(1.0))
    suffixes = sorted(path.suffix for path in tmp_path.iterdir())
    assert suffixes == [".base", ".journal", ".lock"]
    session.close(discard=True)
    assert list(tmp_path.iterdir()) == []


def test_discarded_work_is_gone(tmp_path: Path):
    left_behind(tmp_path, shift(1.0))
    (work,) = find_unfinished(tmp_path)
    work.discard()
    work.discard()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("torn", [b'{"do": "com', b"\xff", b'{"do": "go", "posi'])
def test_a_torn_last_line_is_ignored_and_written_over(tmp_path: Path, torn: bytes):
    path = left_behind(tmp_path, shift(1.0), shift(2.0))
    whole = path.read_bytes()
    path.write_bytes(whole + torn)
    (work,) = find_unfinished(tmp_path)
    assert work.num_edits == 2
    session = restored(work, BASE)
    session.apply(shift(4.0))
    session.close()
    assert path.read_bytes().startswith(whole + b'{"do": "commit"')
    (work,) = find_unfinished(tmp_path)
    assert restored(work, BASE).scenario.agents.position_m[0, NOW, 0] == 7


def test_every_prefix_of_a_journal_is_a_journal(tmp_path: Path):
    path = left_behind(tmp_path, shift(1.0), DeleteAgents(agent_ids=("101",)))
    content = path.read_bytes()
    ends = [index for index, byte in enumerate(content) if byte == 10]
    for length in range(ends[0] + 1, len(content) + 1):
        path.write_bytes(content[:length])
        complete = sum(end < length for end in ends) - 1
        found = find_unfinished(tmp_path)
        assert [work.num_edits for work in found] == ([complete] if complete else [])


def test_sessions_have_files_of_their_own(tmp_path: Path):
    sessions = [session_in(tmp_path) for _ in range(3)]
    for number, session in enumerate(sessions):
        for _ in range(number + 1):
            session.apply(shift(1.0))
    assert find_unfinished(tmp_path) == []
    sessions[1].close()
    (work,) = find_unfinished(tmp_path)
    assert work.num_edits == 2
    sessions[0].close()
    assert [work.num_edits for work in find_unfinished(tmp_path)] == [2, 1]


def test_work_is_taken_up_once(tmp_path: Path):
    left_behind(tmp_path, shift(1.0))
    (work,) = find_unfinished(tmp_path)
    session = restored(work, BASE)
    assert find_unfinished(tmp_path) == []
    with pytest.raises(RecipeError, match="open in another session"):
        restored(work, BASE)
    with pytest.raises(RecipeError, match="open in another session"):
        work.discard()
    session.close(discard=True)
    with pytest.raises(RecipeError, match="is gone"):
        restored(work, BASE)


def test_an_exchange_keeps_both_journals(tmp_path: Path):
    """(D3): each session goes on in its own."""
    session, heard = session_in(tmp_path), []
    session.apply(shift(9.0))
    left_behind(tmp_path, shift(1.0), shift(2.0))
    (work,) = find_unfinished(tmp_path)
    session.add_listener(lambda _, after: heard.append(after.position))
    other = restored(work, BASE)
    session.exchange(other)
    assert heard == [2]
    assert session.scenario.agents.position_m[0, NOW, 0] == 3
    session.undo()
    other.apply(shift(1.0))
    session.close()
    other.close()
    assert sorted(one.num_edits for one in find_unfinished(tmp_path)) == [1, 2]


def test_name_tags_and_note_are_kept(tmp_path: Path):
    """(D6): also such as were given before the first edit."""
    session = session_in(tmp_path)
    session.describe(Variant(name="early"))
    assert not list(tmp_path.iterdir())
    session.apply(shift(1.0))
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert work.variant == Variant(name="early")
    again = restored(work)
    again.describe(Variant(name="late", tags=("a", "b"), note="x\ny"))
    again.close()
    (work,) = find_unfinished(tmp_path)
    assert restored(work).variant == Variant(name="late", tags=("a", "b"), note="x\ny")
    assert work.num_edits == 1


def test_another_base_is_refused(tmp_path: Path):
    left_behind(tmp_path, shift(1.0))
    (work,) = find_unfinished(tmp_path)
    with pytest.raises(RecipeError, match="belongs to scenario two-lane-road"):
        restored(work, replace(BASE, scenario_id="other"))
    assert find_unfinished(tmp_path) == [work]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ({"do": "commit", "time_s": 1, "selection": [], "command": "Fly"}, "Line 3 of"),
        ({"do": "go", "time_s": 1, "position": 9}, "Line 3 of the journal: There is"),
        ({"do": "go", "time_s": 1, "position": -9}, "Line 3 of the journal: There is"),
        (
            {
                "do": "commit",
                "time_s": 1,
                "selection": ["ghost"],
                "command": "DeleteAgents",
                "agent_ids": ["ghost"],
            },
            "Line 3 of the journal: There is no agent 'ghost' here; expected one of 100, 101, 102",
        ),
    ],
)
def test_a_line_that_does_not_apply_is_named(tmp_path: Path, line, message):
    path = left_behind(tmp_path, shift(1.0))
    with path.open("a") as file:
        file.write(json.dumps(line) + "\n")
    (work,) = find_unfinished(tmp_path)
    session = restored(work, BASE)
    assert message in session.lost_edits
    assert session.scenario.agents.position_m[0, NOW, 0] == 1
    assert path.with_suffix(".damaged").exists()


def test_without_any_edit_that_applies_the_journal_stays(tmp_path: Path):
    path = left_behind(tmp_path, shift(1.0))
    path.write_text(path.read_text().replace('"100"', '"ghost"'))
    (work,) = find_unfinished(tmp_path)
    with pytest.raises(RecipeError, match="Line 2 of the journal"):
        restored(work, BASE)
    assert find_unfinished(tmp_path) == [work], "its lock is let go"


@pytest.mark.parametrize("lost", [b"\xff\x00 torn", b'{"do": "commit", "time_s": 1}'])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_what_stands_around_a_damaged_line_comes_back(tmp_path: Path, lost, number):
    """One bad line in the middle stopped the restore of all other edits."""
    session = session_in(tmp_path)
    for dx in (1.0, 10.0, 100.0, 1000.0):
        session.apply(shift(dx))
    session.jump_to(3)
    session.apply(shift(2000.0))
    session.close()
    (work,) = find_unfinished(tmp_path)
    lines = work.path.read_bytes().splitlines(keepends=True)
    lines[number] = lost + b"\n"
    work.path.write_bytes(b"".join(lines))
    (work,) = find_unfinished(tmp_path)
    assert work.num_edits == 3
    told: list[str] = []
    came_back = 2111.0 - 10.0 ** (number - 1)
    for _ in range(2):
        (work,) = find_unfinished(tmp_path)
        again = restored(work, BASE)
        told.append(again.lost_edits)
        assert again.scenario.agents.position_m[0, NOW, 0] == came_back
        assert again.state.position == 3
        again.undo()
        again.redo()
        again.close()
    assert f"Line {number + 1} of the journal" in told[0]
    assert not told[1], "the journal that was written anew is whole"
    (damaged,) = tmp_path.glob("*.damaged")
    assert damaged.read_bytes() == b"".join(lines)


def test_a_journal_of_noise_is_no_journal(tmp_path: Path):
    path = left_behind(tmp_path, shift(1.0))
    path.write_bytes(path.read_bytes() + b"noise\n" * 2000)
    assert find_unfinished(tmp_path) == []


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}\n",
        b"junk\njunk\n",
        b'{"format": "pd-editor journal", "version": 2}\n',
        b'{"format": "pd-editor journal", "version": 1, "time_s": 1}\n',
    ],
)
def test_foreign_files_are_passed_over_and_logged(tmp_path: Path, content, caplog):
    left_behind(tmp_path, shift(1.0))
    (tmp_path / "foreign.journal").write_bytes(content)
    with caplog.at_level(logging.WARNING):
        assert len(find_unfinished(tmp_path)) == 1
    assert "foreign.journal" in caplog.text


@pytest.mark.parametrize(
    "name",
    ["../evil", "a/b", "", "..", "a\\b", "a\0b", "new\nline", "\ud800", "x" * 300],
)
def test_base_files_of_any_name_are_kept_in_their_folder(tmp_path: Path, name: str):
    """(Reliability 5): such names broke the journal, and edits were not kept."""
    session = session_in(tmp_path, base_files={f"{name}.zip": b"1", "map.json": b"2"})
    session.apply(shift(1.0))
    assert session.journal_problem is None
    session.close()
    (work,) = find_unfinished(tmp_path)
    kept = {path.suffix: path.read_bytes() for path in work.base_files}
    assert kept == {".zip": b"1", ".json": b"2"}
    assert {path.parent.suffix for path in work.base_files} == {".base"}


def test_a_disk_that_fails_is_tried_again_and_nothing_is_lost(tmp_path: Path, caplog):
    """(Reliability 6): the journal gave up for good, with a traceback."""
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    session = EditorSession(BASE, journal=Journal(blocked / "folder"))
    _opened.append(session)
    session.apply(shift(1.0))
    session.apply(shift(1.0))
    assert session.state.position == 2
    assert session.journal_problem is not None
    assert session.journal_problem.startswith("Edits are not kept on disk: Not a dir")
    assert len(caplog.records) == 1
    assert caplog.records[0].exc_info is None
    session.retry_journal()
    assert session.journal_problem is not None
    blocked.unlink()
    session.retry_journal()
    assert session.journal_problem is None
    session.apply(shift(4.0))
    session.close()
    (work,) = find_unfinished(blocked / "folder")
    assert restored(work).scenario.agents.position_m[0, NOW, 0] == 6


def test_a_full_disk_leaves_whole_lines_and_the_rest_follows(tmp_path, monkeypatch):
    """(Reliability 6): a line that was cut off must not spoil those after it."""
    session = session_in(tmp_path)
    session.apply(shift(1.0))
    path = session.journal_path
    assert path is not None

    def torn(file, size, content):
        file.seek(size)
        file.write(content[:10])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(journal_file, "_write_at", torn)
        session.apply(shift(2.0))
        assert session.journal_problem == (
            "Edits are not kept on disk: No space left on device."
        )
    session.apply(shift(4.0))
    assert session.journal_problem is None
    session.close()
    (work,) = find_unfinished(tmp_path)
    assert restored(work).scenario.agents.position_m[0, NOW, 0] == 7


def test_a_journal_that_was_deleted_is_written_again(tmp_path: Path):
    """(Reliability 6): a file may also come into the place of its folder."""
    folder = tmp_path / "journals"
    session = session_in(folder, base_files={"map.json": b"{}"})
    session.apply(shift(1.0))
    shutil.rmtree(folder)
    folder.write_text("in the way")
    session.apply(shift(2.0))
    assert session.journal_problem is not None
    folder.unlink()
    session.apply(shift(4.0))
    assert session.journal_problem is None
    session.close()
    (work,) = find_unfinished(folder)
    assert [path.name for path in work.base_files] == ["map.json"]
    assert restored(work).scenario.agents.position_m[0, NOW, 0] == 7


def test_names_that_states_were_written_under_are_restored(tmp_path: Path):
    session = session_in(tmp_path)
    session.describe(Variant(name="slow"))
    for name, dx in (("slow", 1.0), ("slow-2", 2.0)):
        session.apply(shift(dx))
        session.mark_exported(ExportMark(name=name))
    session.apply(shift(3.0))
    assert session.recipe().result_id == "slow"
    session.undo()
    session.close()
    (work,) = find_unfinished(tmp_path)
    again = restored(work)
    assert again.name == again.recipe().result_id == "slow-2"
    again.undo()
    assert again.name == "slow"
    again.redo()
    assert again.recipe().variant == Variant(name="slow-2")
    # So is that such a name was taken back.
    again.take_name_back()
    again.close()
    (work,) = find_unfinished(tmp_path)
    assert restored(work).name == "slow"
