"""Sessions per scenario, and unfinished work."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError, RecipeError
from pd_editor.editor.commands import TransformAgents, traffic_command
from pd_editor.editor.recipe import Recipe, is_recipe
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import find_unfinished
from pd_editor.editor.variant import Variant
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.bundle import write_files
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.viewer.state import session_shelf
from pd_editor.viewer.state.finding_watch import FindingWatch
from pd_editor.viewer.state.session_shelf import MAX_LIVE, SessionShelf
from pd_editor.viewer.state.workspace import Workspace
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import DriftGenerator
from tests.scene.test_time_cut import long_recording

IDS = tuple(f"scene-{number}" for number in range(MAX_LIVE + 3))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in IDS:
        scenario = replace(two_agents_that_pass(), scenario_id=name)
        write_files(scenario_files(scenario), tmp_path / name, forbidden=None)
    return tmp_path


@pytest.fixture
def workspace(root: Path):
    made = Workspace(
        open_scenario(root / IDS[0]), dataset=None, shelf=SessionShelf(root)
    )
    yield made
    close(made)


def close(workspace: Workspace) -> None:
    workspace.close()
    workspace.shelf.close()


def shift(workspace: Workspace, dx: float) -> None:
    session = workspace.session
    session.apply(TransformAgents(agent_ids=(session.scenario.focal_id,), dx_m=dx))


def position(workspace: Workspace) -> float:
    return float(
        workspace.session.scenario.agents.position_m[
            0, workspace.session.scenario.current_step, 0
        ]
    )


def test_every_scenario_goes_on_with_its_own_edits(workspace: Workspace, root: Path):
    """(D3): also such as were let go from memory."""
    told: list[str] = []
    workspace.tell = lambda title, _body: told.append(title)
    for number, name in enumerate(IDS):
        workspace.open_reference(str(root / name))
        shift(workspace, number + 1.0)
        shift(workspace, 10.0)
        workspace.session.undo()
    assert told[0] == "1 edit of scene-0 is kept"
    live = workspace.shelf.live
    assert len(live) == MAX_LIVE
    listed = workspace.shelf.unfinished()
    assert {work.scenario_id for work in listed} == set(IDS[:-1])
    for number, name in enumerate(IDS):
        workspace.open_reference(str(root / name))
        session = workspace.session
        assert session.base.scenario_id == name
        assert (session.state.position, len(session.entries)) == (1, 2)
        session.undo()
        start = position(workspace)
        session.jump_to(2)
        assert position(workspace) == pytest.approx(start + number + 11.0)
        session.undo()


def test_opening_what_is_open_changes_nothing(workspace: Workspace, root: Path):
    shift(workspace, 1.0)
    edited = workspace.session.scenario
    told: list[str] = []
    workspace.tell = lambda title, _body: told.append(title)
    workspace.open_reference(str(root / IDS[0]))
    assert workspace.session.scenario is edited
    assert told == ["scene-0 is open already"]


def test_unfinished_work_is_resumed_and_discarded(workspace: Workspace, root: Path):
    """(D3): at any time, from memory and from disk alike."""
    for name in IDS:
        workspace.open_reference(str(root / name))
        shift(workspace, 1.0)
    listed = workspace.shelf.unfinished()
    assert [work.num_edits for work in listed] == [1] * (len(IDS) - 1)
    for work in listed:
        if work.scenario_id in (IDS[0], IDS[-2]):
            workspace.resume(work)
            assert workspace.session.base.scenario_id == work.scenario_id
            assert workspace.session.state.position == 1
    for work in workspace.shelf.unfinished():
        workspace.shelf.discard(work)
    assert workspace.shelf.unfinished() == []
    close(workspace)
    (left,) = find_unfinished(root / "journals")
    assert left.scenario_id == IDS[0]


def test_what_was_exported_is_not_unfinished(workspace: Workspace, root: Path):
    shift(workspace, 1.0)
    workspace.exported_zip()
    workspace.open_reference(str(root / IDS[1]))
    assert workspace.shelf.unfinished() == []
    workspace.open_reference(str(root / IDS[0]))
    assert workspace.session.state.position == 1
    shift(workspace, 2.0)
    workspace.open_reference(str(root / IDS[1]))
    assert len(workspace.shelf.unfinished()) == 1


def test_a_state_that_was_taken_out_of_the_library_is_unfinished(
    workspace: Workspace, root: Path
):
    """A star keeps a state only as long as the library holds it."""
    shift(workspace, 1.0)
    saved = workspace.save()
    workspace.open_reference(str(root / IDS[1]))
    shift(workspace, 1.0)
    both_ways = workspace.save()
    workspace.exported_zip()
    assert workspace.shelf.unfinished() == []
    workspace.library.remove(saved.name)
    workspace.library.remove(both_ways.name)
    listed = workspace.shelf.unfinished()
    assert [work.scenario_id for work in listed] == [IDS[0]]
    close(workspace)
    left = find_unfinished(root / "journals")
    assert [work.scenario_id for work in left] == [IDS[0]]


@pytest.mark.parametrize("way", ["exported", "saved"])
def test_exported_work_goes_on_after_it_fell_out_of_memory(
    workspace: Workspace, root: Path, way: str
):
    """It opened without its edits once four more scenarios had been edited."""
    shift(workspace, 3.0)
    edited = position(workspace)
    if way == "exported":
        workspace.exported_zip()
    else:
        saved = workspace.save()
    for name in IDS[1:]:
        workspace.open_reference(str(root / name))
        shift(workspace, 1.0)
    assert len(workspace.shelf.live) == MAX_LIVE
    assert IDS[0] not in {w.scenario_id for w in workspace.shelf.unfinished()}
    workspace.open_reference(str(root / IDS[0]))
    assert position(workspace) == pytest.approx(edited)
    assert len(workspace.session.entries) == 1
    workspace.session.undo()
    workspace.session.redo()
    # It is known as exported, and under its name.
    workspace.open_reference(str(root / IDS[1]))
    assert IDS[0] not in {w.scenario_id for w in workspace.shelf.unfinished()}
    for name in IDS[2:]:
        workspace.open_reference(str(root / name))
        shift(workspace, 1.0)
    if way == "saved":
        assert len(workspace.library.cards()) == 1
        workspace.library.remove(saved.name)
        listed = {w.scenario_id for w in workspace.shelf.unfinished()}
        assert IDS[0] in listed
        close(workspace)
        assert IDS[0] in {w.scenario_id for w in find_unfinished(root / "journals")}
    else:
        close(workspace)
        left = {w.scenario_id for w in find_unfinished(root / "journals")}
        assert IDS[0] not in left


def test_a_session_that_is_nowhere_on_disk_stays_in_memory(
    workspace: Workspace, root: Path
):
    """(Reliability 6): letting it go would lose its edits."""
    (root / "journals").write_text("in the way")
    for name in IDS:
        workspace.open_reference(str(root / name))
        shift(workspace, 1.0)
    assert len(workspace.shelf.live) == len(IDS) - 1
    (root / "journals").unlink()
    workspace.retry_journals()
    assert workspace.session.journal_problem is None
    for name in IDS:
        workspace.open_reference(str(root / name))
        assert len(workspace.session.entries) == 1
    assert len(workspace.shelf.live) == MAX_LIVE


def test_downloaded_edits_are_opened_as_a_history(workspace: Workspace, root: Path):
    shift(workspace, 3.0)
    shift(workspace, 4.0)
    moved = position(workspace)
    name, content = workspace.recipe_text()
    assert name.endswith(".recipe.json")
    assert is_recipe(content)
    assert not is_recipe(scenario_files(workspace.session.base).popitem()[1])
    # Its own edits are not given up for those of the file.
    with pytest.raises(InputError, match="with edits of its own"):
        workspace.open_edits(content)
    workspace.open_reference(str(root / IDS[1]))
    before = position(workspace)
    workspace.open_edits(content)
    assert len(workspace.session.entries) == 2
    assert position(workspace) == moved
    workspace.session.undo()
    assert position(workspace) == moved - 4.0
    assert position(workspace) != before


@pytest.mark.parametrize("typed", ["", "mine"])
def test_a_number_that_made_a_name_unique_does_not_stay(
    workspace: Workspace, root: Path, typed: str
):
    """Of a name that was proposed; one that the user typed stays as it was written."""
    shift(workspace, 1.0)
    workspace.session.describe(Variant(name=typed))
    first = workspace.export_into(root / "out")
    second = workspace.export_into(root / "out")
    assert second.name == f"{first.name}-2"
    workspace.session.undo()
    workspace.open_reference(str(second))
    workspace.continue_export()
    shift(workspace, 2.0)
    proposed = "scene-0-2-edits"
    assert workspace.session.name == ("mine-2" if typed else proposed)


def test_edits_of_a_scenario_that_is_not_here_name_it(workspace: Workspace, root: Path):
    shift(workspace, 3.0)
    _, content = workspace.recipe_text()
    gone = content.replace(str(root / IDS[0]).encode(), b"/nowhere")
    assert gone != content
    workspace.open_reference(str(root / IDS[1]))
    with pytest.raises(InputError, match="open that scenario, and upload"):
        workspace.open_edits(gone)
    assert workspace.session.base.scenario_id == IDS[1]
    with pytest.raises(RecipeError):
        workspace.open_edits(b'{"format": "pd-editor recipe", "version": 99}')


def test_next_reaches_every_folder_whatever_the_ids(tmp_path: Path):
    """An original beside its copy and a subset; a file's name may differ from its id."""
    root = tmp_path / "data"
    for split, names in (("edited", "ac"), ("val", "ab")):
        for name in names:
            scenario = replace(two_agents_that_pass(), scenario_id=name)
            files = scenario_files(scenario)
            write_files(files, root / split / name, forbidden=None)
    files = {key.replace("_b.", "_other."): data for key, data in files.items()}
    write_files(files, root / "val" / "last", forbidden=None)
    index = DatasetIndex(root)
    (root / "linked").symlink_to(root / "edited")
    made = Workspace(
        open_scenario("roundabout"), dataset=index, shelf=SessionShelf(tmp_path)
    )
    while made.search_on():
        pass
    assert made.search is not None
    folders = [card.folder for card in made.search.cards]
    assert len(folders) == 7
    walked = []
    for _ in folders:
        made.open_neighbour(1)
        walked.append(made.dataset_folder)
    assert walked == folders
    with pytest.raises(InputError, match="no further scenario"):
        made.open_neighbour(1)
    for card in made.search.cards:
        made.open_from_dataset(card)
        assert made.session.base.provenance.source == str(card.folder.resolve())
        assert made.dataset_folder == card.folder
    for _ in folders[1:]:
        made.open_neighbour(-1)
    assert made.dataset_folder == folders[0]
    made.open_reference(str(folders[-1]))
    assert made.dataset_folder == folders[-1]
    close(made)


def run_of(root: Path, shelf: SessionShelf | None = None, name: str = IDS[0]):
    """A tab, of another process unless it shares a shelf."""
    return Workspace(
        open_scenario(root / name), dataset=None, shelf=shelf or SessionShelf(root)
    )


def kill(workspace: Workspace) -> None:
    """Release journals as the system does when a process is killed."""
    for session in (workspace.session, *workspace.shelf.live):
        session.close()


@pytest.mark.parametrize("way", ["exported", "saved", "edited since", "undone"])
def test_exported_work_stays_exported_after_a_kill(root: Path, way: str):
    """Sessions that had been exported came back as unfinished."""
    first = run_of(root)
    shift(first, 1.0)
    if way == "saved":
        saved = first.save()
    else:
        first.exported_zip()
    if way == "edited since":
        shift(first, 1.0)
    if way == "undone":
        first.session.undo()
        first.session.redo()
    kill(first)
    second = run_of(root, name=IDS[1])
    left = [work.scenario_id for work in second.shelf.unfinished()]
    assert left == ([IDS[0]] if way == "edited since" else [])
    if way == "saved":
        second.library.remove(saved.name)
        assert [work.scenario_id for work in second.shelf.unfinished()] == [IDS[0]]
        second.open_reference(str(root / IDS[0]))
        second.library.put_back(saved.name)
        assert second.is_saved(), "its entry is known again"
    close(second)


def test_another_branch_at_an_exported_position_is_unfinished(root: Path):
    first = run_of(root)
    shift(first, 1.0)
    first.exported_zip()
    first.session.undo()
    shift(first, 2.0)
    kill(first)
    second = run_of(root, name=IDS[1])
    assert [work.num_edits for work in second.shelf.unfinished()] == [1]
    close(second)


def test_old_exported_journals_of_a_killed_process_are_removed(
    root: Path, monkeypatch: pytest.MonkeyPatch
):
    first = run_of(root)
    for name in IDS[:2]:
        first.open_reference(str(root / name))
        shift(first, 1.0)
    first.exported_zip()
    kill(first)
    assert len(find_unfinished(root / "journals")) == 2
    SessionShelf(root)
    assert len(find_unfinished(root / "journals")) == 2
    monkeypatch.setattr(session_shelf, "KEPT_S", -1.0)
    SessionShelf(root)
    (left,) = find_unfinished(root / "journals")
    assert left.scenario_id == IDS[0]


def test_opening_a_scenario_after_a_restart_resumes_its_edits(root: Path):
    """It opened without its edits and without a word."""
    first = run_of(root)
    shift(first, 3.0)
    edited = position(first)
    kill(first)
    second = run_of(root, name=IDS[1])
    told: list[str] = []
    second.tell = lambda title, body: told.append(f"{title}. {body}")
    second.open_reference(str(root / IDS[0]))
    assert position(second) == pytest.approx(edited)
    assert told == ["Back to scene-0. It goes on with its 1 edit."]
    second.session.undo()
    assert second.session.can_redo
    close(second)


def test_all_tabs_of_a_visitor_see_the_same_unfinished_work(root: Path):
    """One tab counted 4, another one 11."""
    shelf = SessionShelf(root)
    one, other = run_of(root, shelf), run_of(root, shelf, IDS[-1])
    before = shelf.stamp()
    for name in IDS[:3]:
        one.open_reference(str(root / name))
        shift(one, 1.0)
    assert shelf.stamp() != before
    assert len(one.shelf.unfinished()) == len(other.shelf.unfinished()) == 2
    (newest, _) = other.shelf.unfinished()
    other.resume(newest)
    assert other.session.base.scenario_id == IDS[1]
    with pytest.raises(RecipeError, match="open in another tab"):
        one.resume(newest)
    assert len(shelf.unfinished()) == 1
    one.close()
    other.close()
    shelf.close()
    assert len(find_unfinished(root / "journals")) == 3


def test_long_recordings_are_opened_cut_and_go_on_after_a_restart(root: Path):
    """``edit --until 6``: what is opened, and opened again, is cut alike."""
    write_files(scenario_files(long_recording()), root / "long", forbidden=None)
    first = run_of(root)
    first.cut = SceneCut(until_s=6.0)
    first.open_reference(str(root / "long"))
    axis = first.session.base.time_axis
    assert axis.num_future_steps == 60
    shift(first, 1.0)
    kill(first)
    second = run_of(root)
    (work,) = second.shelf.unfinished()
    second.resume(work)
    assert second.session.base.time_axis == axis
    assert len(second.session.entries) == 1
    close(second)


def overlap_ignored(workspace: Workspace) -> int:
    """Let two agents overlap, and ignore one of the problems; how many are left."""
    if not workspace.session.entries:
        workspace.session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    watch = FindingWatch(workspace)
    watch.whole()
    watch.ignore(watch.new[0], True)
    assert watch.ignored
    return len(watch.new)


def test_a_problem_that_is_ignored_after_the_star_is_no_longer_counted(
    workspace: Workspace,
):
    """The state counted as saved already, and the table kept the old number."""
    workspace.session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    former = workspace.save()
    left = overlap_ignored(workspace)
    assert not workspace.is_saved()
    entry = workspace.save()
    assert workspace.is_saved()
    assert entry.row.num_problems == left == former.row.num_problems - 1


@pytest.mark.parametrize("way", ["as it is", "continued"])
def test_what_is_ignored_and_said_comes_back_with_an_export(workspace: Workspace, way):
    """Problems that were ignored came back, without tags and note in one of the ways."""
    left = overlap_ignored(workspace)
    session = workspace.session
    session.describe(replace(session.variant, tags=("cut-in",), note="near"))
    name, content = workspace.exported_zip()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = {Path(one).name: archive.read(one) for one in archive.namelist()}
    workspace.open_upload(files)
    if way == "continued":
        workspace.continue_export()
    about = workspace.session.variant
    assert (about.tags, about.note) == (("cut-in",), "near")
    assert workspace.session.name == name.removesuffix(".zip")
    watch = FindingWatch(workspace)
    watch.whole()
    assert (len(watch.new), len(watch.ignored)) == (left, 1)


def test_a_recipe_without_ignored_problems_is_opened():
    text = EditorSession(two_agents_that_pass()).recipe().to_text()
    assert "ignored" not in text
    assert Recipe.from_text(text).variant.ignored == ()


def test_what_is_ignored_of_one_sample_counts_in_another(workspace: Workspace):
    """The cards of other samples, in which the agent drives elsewhere, lost it as well."""
    session = workspace.session
    session.apply(TransformAgents(agent_ids=("101",), dy_m=-3.5))
    before = session.scenario
    watch = FindingWatch(workspace)
    seen = []
    for seed in (0, 1):
        request = GenerationRequest(scenario=before, agent_ids=("100",), seed=seed)
        traffic = run_to_end(DriftGenerator().generate(request))
        session.apply(traffic_command(request, traffic))
        watch.whole()
        seen.append({one.key for one in watch.new})
        if seed == 0:
            for one in watch.new:
                watch.ignore(one, True)
            assert not watch.new
    assert seen[0] & seen[1]
    session.undo()
    watch.whole()
    assert not watch.new
