"""Workspace of a browser tab, which is kept for the next connection."""

import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import ExportError, InputError, RecipeError
from pd_editor.base.installed_files import ALL_DEMOS, DEMO_PREFIX, demo_names
from pd_editor.base.plain_text import number_of
from pd_editor.base.regular_file import user_path
from pd_editor.editor.commands import BeginAt, Command, ContinueScene
from pd_editor.editor.library.library import Library, LibraryCard, card_of, take_in
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import (
    RECIPE_NAME,
    cut_when_read,
    export_into,
    exported_files,
    has_same_content,
    lanes_of_file,
    made_by,
    open_base,
    open_part,
    open_scenario,
    recipe_of_export,
    scenario_and_recipe,
    scenes_in_upload,
    with_original,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import UnfinishedWork
from pd_editor.editor.variant import (
    ExportMark,
    Variant,
    free_name,
    name_from_text,
    short_id,
)
from pd_editor.experiments.scene_index.query import FoundScene
from pd_editor.scene.base_reference import MapWindow, SceneCut
from pd_editor.scene.bundle import zip_folders
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.dataset import (
    EVERY,
    CardFilter,
    DatasetIndex,
    ScenarioCard,
)
from pd_editor.scene.policy import DrivenPlans
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import FUTURE_S, is_long
from pd_editor.viewer.state.guided_runs import GuidedRuns
from pd_editor.viewer.state.index_run import IndexRun
from pd_editor.viewer.state.playback import Playback
from pd_editor.viewer.state.session_shelf import KeptWork, SessionShelf, is_same_base
from pd_editor.viewer.state.study_run import StudyRun
from pd_editor.viewer.state.view_memory import StartView, ViewMemory

STUDIES_NAME: Final = "studies"


class DatasetSearch:
    """A search through a dataset, done in steps."""

    def __init__(
        self,
        dataset: DatasetIndex,
        wanted: CardFilter,
        found: Mapping[Path, FoundScene] | None = None,
    ) -> None:
        """Start at the first folder; ``found`` is what a query of the index found."""
        self._dataset = dataset
        self.wanted = wanted
        self.found = found or {}
        self.cards: list[ScenarioCard] = []
        self.num_seen = 0
        self.is_complete = False

    def go_on(self) -> None:
        """Search some more folders."""
        # Duration of a search between two messages or frames.
        end = time.monotonic() + 0.008
        while not self.is_complete and time.monotonic() < end:
            # Number of scenes read between two looks at the clock; files may take a
            # second.
            step = self._dataset.search(self.wanted, self.num_seen, 1)
            self.cards += step.cards
            self.num_seen = step.next_start
            self.is_complete = step.is_complete

    def cities(self) -> tuple[str, ...]:
        """Cities found so far."""
        return self._dataset.cities()

    def splits(self) -> tuple[str, ...]:
        """Splits found so far."""
        return self._dataset.splits()

    def failures(self) -> tuple[str, ...]:
        """Why scenes could not be read so far."""
        return self._dataset.failures()


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedEdits:
    """Edits of an opened export, with the source of their base."""

    recipe: Recipe
    source: str


@dataclass(frozen=True, kw_only=True, eq=False)
class UploadedZip:
    """The last upload with several scenarios."""

    name: str
    size_bytes: int
    scenes: Mapping[str, Callable[[], Mapping[str, bytes]]]
    """What gives the files of each, by their names."""
    ticked: set[str] = field(default_factory=set)
    """Names of those that are selected."""


class Workspace:
    """An editing session with playhead, dataset, library and exports."""

    def __init__(
        self,
        scenario: Scenario,
        *,
        dataset: DatasetIndex | None,
        index_run: IndexRun | None = None,
        shelf: SessionShelf,
        is_local: bool = True,
        obeying: Collection[str] = (),
    ) -> None:
        """Open a scenario; what is left for another one goes to the visitor's shelf.

        ``obeying`` are the names of the generators that take guidance.
        """
        root = None if dataset is None else dataset.root
        self.folders = ServerFolders(
            is_local=is_local, state=shelf.folder, dataset_root=root
        )
        self.shelf, self.library = shelf, shelf.library
        self.tell: Callable[[str, str], object] = lambda _title, _body: None
        """Shows a title and a sentence to the user; set by the connected tab."""
        self._given: dict[str, Scenario] = {}
        """Exported or saved states by their names."""
        self.ticked: set[str] = set()
        """Scenarios that are selected in the library."""
        self.driven_plans: list[tuple[Command, DrivenPlans]] = []
        """What policies planned in roll-outs, with the edits that applied these."""
        self.removed: tuple[str, ...] = ()
        """Scenarios that were removed from the library, and can be put back."""
        self.uploaded_zip: UploadedZip | None = None
        self.continuation: OpenedEdits | None = None
        """Edits that can be continued, if the open scenario is an export of the editor."""
        self.session = EditorSession(scenario, journal=shelf.new_journal())
        self.playback = Playback()
        self.playback.open(scenario.time_axis)
        self.playback.limit(scenario.first_step, scenario.last_step)
        self.is_new = True
        """Whether no page has shown it yet."""
        self.is_dark = False
        self.view = ViewMemory()
        self.study = StudyRun()
        self.drive_settings: dict[str, Any] = {}
        """Values of the generation panel's inputs, for the page that comes next."""
        self.has_lost_run = False
        """Whether a generation was cancelled because its page had gone."""
        self.guided_runs = GuidedRuns(obeying)
        self.dataset, self.index_run = dataset, index_run
        self.start = StartView(source="demos" if dataset is None else "dataset")
        self.cut = SceneCut()
        """What is used of each recording that is opened."""
        self._opened: tuple[Scenario, Path] | None = None
        """Base of the scenario that was opened from the dataset last, and its folder."""
        self._reached: tuple[Scenario, Path] | None = None
        """What was open when one of the dataset was asked for last, and that one's folder."""
        self._asked = self.cut
        self._open_again: Callable[[SceneCut], None] = lambda _cut: None
        """Opens another part of what was opened, or was to be opened, last."""
        self._uploaded: tuple[Scenario, Mapping[str, bytes]] | None = None
        """Base of the scenario that was uploaded last, and its files."""
        self.search = None if dataset is None else DatasetSearch(dataset, EVERY)

    def open_reference(self, reference: str, cut: SceneCut | None = None) -> None:
        """Open a demo or a scenario folder, or a part of it.

        Raises:
            InputError: it cannot be read; what was open stays open.
            LargeSceneError: it is too large or long; a part of it can be opened.
        """
        self._asked = self.cut if cut is None else cut
        self._open_again = partial(self.open_reference, reference)
        scenario = open_part(reference, self._asked)
        self._open(scenario)
        self._offer(recipe_of_export(Path(scenario.provenance.source)))

    def open_upload(
        self, files: Mapping[str, bytes], cut: SceneCut | None = None
    ) -> None:
        """Open uploaded files; their bytes are kept beside the journal.

        Raises:
            InputError: they cannot be read; what was open stays open.
            LargeSceneError: it is too large or long; a part of it can be opened.
        """
        self._asked = self.cut if cut is None else cut
        self._open_again = partial(self.open_upload, files)
        scenario, recipe = _from_upload(files, self._asked)
        self._uploaded = scenario, files
        self._open(scenario, files)
        self._offer(recipe)

    def open_window(self, window: MapWindow) -> None:
        """Open a part of the map of what was opened, or was to be opened, last.

        Raises:
            InputError: it cannot be read, or has no lane there.
        """
        self._open_again(replace(self._asked, window=window))

    def open_moment(self, current_s: float, until_s: float) -> None:
        """Open some time of what was opened, or was to be opened, last.

        Raises:
            InputError: it cannot be read, or is shorter.
        """
        cut = replace(self._asked, current_s=current_s, until_s=until_s)
        self._open_again(cut)

    @property
    def can_cut(self) -> bool:
        """Whether the open recording is longer than models sample, or was cut to that."""
        is_cut = self._cut_of_base.until_s == FUTURE_S
        return (is_cut or is_long(self.session.base)) and self.can_open_again

    @property
    def can_open_again(self) -> bool:
        """Whether the files of the open scene are at hand."""
        return bool(self.session.base.provenance.source or self._files_of_base)

    @property
    def _files_of_base(self) -> Mapping[str, bytes] | None:
        """Files of the open scene, if it was uploaded last."""
        if self._uploaded and is_same_base(self._uploaded[0], self.session.base):
            return self._uploaded[1]
        return None

    @property
    def _cut_of_base(self) -> SceneCut:
        return self.session.base.provenance.cut or SceneCut()

    def lanes_of_file(self) -> tuple[Lane, ...]:
        """All lanes of the file of the open scene, a part of which can be opened then.

        Raises:
            InputError: it cannot be read any more.
        """
        files, source = self._files_of_base, self.session.base.provenance.source
        self._asked = self._cut_of_base
        if files is not None:
            self._open_again = partial(self.open_upload, files)
            return lanes_of_file(lambda: scenario_and_recipe(files)[0])
        self._open_again = partial(self.open_reference, source)
        return lanes_of_file(lambda: open_scenario(source))

    def open_cut(self) -> None:
        """Open a long recording again, cut to what models sample; or a cut one whole.

        So are those that are opened later.

        Raises:
            InputError: it cannot be read any more.
        """
        base = self.session.base
        until_s = FUTURE_S if is_long(base) else None
        self.cut = replace(self.cut, until_s=until_s)
        cut = replace(self._cut_of_base, until_s=until_s)
        if (files := self._files_of_base) is not None:
            self.open_upload(files, cut)
        else:
            self.open_reference(base.provenance.source, cut)

    def open_edits(self, content: bytes) -> None:
        """Open the base of a recipe, with the recipe's edits as its history.

        Raises:
            RecipeError: this is no recipe, or an edit does not apply.
            InputError: the base is not available, or is open with edits of its own.
        """
        recipe = Recipe.from_text(content)
        opened, source = self.session.base, self._base_source(recipe)
        is_open = opened.scenario_id == recipe.base.scenario_id
        if is_open and self.session.entries:
            raise InputError(
                f"{short_id(opened.scenario_id)} is open with edits of its own; export "
                "them, take them back in the History tab, and upload the file again."
            )
        if source is None and not is_open:
            raise InputError(
                f"The edits are of scenario {recipe.base.scenario_id}, which is not "
                "here; open that scenario, and upload the file again."
            )
        base = opened if source is None else open_base(recipe.base, source)
        self.session.commit_gesture()
        session = EditorSession.from_recipe(
            recipe, base, journal=self.shelf.new_journal()
        )
        self.continuation = None
        self._exchange(session)

    def _offer(self, recipe: Recipe | None) -> None:
        """Describe an opened export as its recipe does, and offer to continue its edits."""
        self.continuation, base = None, self.session.base
        is_of_base = recipe is not None and recipe.result_id == base.scenario_id
        if recipe is None or not is_of_base or self.session.entries:
            return
        if self.session.variant == Variant():
            self.session.describe(recipe.variant.of_result())
        source = self._base_source(recipe)
        if source is not None and base.provenance.base is not None:
            self.continuation = OpenedEdits(recipe=recipe, source=source)

    def _base_source(self, recipe: Recipe) -> str | None:
        """Source of a recipe's base; None if it is not available."""
        source = recipe.base.source
        if source.removeprefix(DEMO_PREFIX) in demo_names():
            return source
        if self.folders.is_local and source and os.path.exists(source):
            return source
        for card in () if self.search is None else self.search.cards:
            if card.scenario_id == recipe.base.scenario_id:
                return str(card.folder)
        return None

    def with_original(self) -> Scenario:
        """The current scenario, with what an export that was opened was before its warp.

        Raises:
            ExportError: it is not known.
        """
        scenario, files = self.session.scenario, self._files_of_base
        if scenario.applied_warp is not None or not scenario.is_warped:
            return scenario
        place = Path(scenario.provenance.source)
        recipe = scenario_and_recipe(files)[1] if files else recipe_of_export(place)
        source = None if recipe is None else self._base_source(recipe)
        if source is None:
            raise ExportError(
                f"{self.session.name} has no original to compare with; the scene that it"
                " was made from is not here."
            )
        return with_original(scenario, recipe, source)

    def continue_export(self) -> None:
        """Replay the edits of the open export as a history of its base.

        Raises:
            InputError: the base cannot be opened.
            RecipeError: the base has changed, or an edit does not apply.
        """
        offered, self.continuation = self.continuation, None
        if offered is None:
            return
        exported, card = self.session.base, self._opened_card()
        base = open_base(offered.recipe.base, offered.source)
        session = EditorSession.from_recipe(
            offered.recipe, base, journal=self.shelf.new_journal()
        )
        is_same = has_same_content(session.scenario, exported)
        self._exchange(session)
        if is_same or exported.provenance.file_format:
            # What other formats cannot say differs.
            # One of the library is its entry.
            saved_at = None if card is None else card.saved_at
            name = offered.recipe.result_id
            self.session.mark_exported(ExportMark(name=name, saved_at=saved_at))
        else:
            self.tell(
                "The result differs from the export",
                "The edits were replayed on the base, and lead to other tracks or roads "
                "than the exported files hold.",
            )

    def _open(
        self, scenario: Scenario, base_files: Mapping[str, bytes] | None = None
    ) -> None:
        """Open a scenario or resume its session; the open session is shelved."""
        self.session.commit_gesture()
        if self.session.entries and is_same_base(scenario, self.session.base):
            self.tell(
                f"{short_id(scenario.scenario_id)} is open already",
                f"It has {number_of(self.session.state.position, 'edit')}; go back in the History "
                "tab to begin anew.",
            )
            return
        kept = self.shelf.take(scenario) or EditorSession(
            scenario, journal=self.shelf.new_journal(), base_files=base_files
        )
        self._exchange(kept)

    def _exchange(self, taken: EditorSession) -> None:
        """Switch to a session; the open one is shelved."""
        self.guided_runs.read_again(taken.all_entries)
        self.session.exchange(taken)
        left = taken
        # States that were read from a journal keep their names.
        self._given |= {mark.name: kept for kept, mark in self.session.exports}
        if left.entries:
            name = short_id(left.base.scenario_id)
            count = left.state.position
            self.tell(
                f"{number_of(count, 'edit')} of {name} {'is' if count == 1 else 'are'} kept",
                "Open it again to continue.",
            )
        self.shelf.put(left)
        if self.session.entries:
            self.tell(
                f"Back to {short_id(self.session.base.scenario_id)}",
                f"It goes on with its {number_of(self.session.state.position, 'edit')}."
                + self.session.lost_edits,
            )

    @property
    def plans_in_force(self) -> DrivenPlans:
        """What policies planned in the roll-out that is shown, if it was made here."""
        for command in reversed(self.session.commands_in_force):
            if isinstance(command, BeginAt | ContinueScene):
                made = (plans for one, plans in self.driven_plans if one is command)
                return next(made, {})
        return {}

    @property
    def is_exported(self) -> bool:
        """Whether the current state was exported, or is in the library."""
        return self.shelf.is_finished(self.session)

    def search_for(
        self, wanted: CardFilter, found: Mapping[Path, FoundScene] | None = None
    ) -> None:
        """Start another search through the dataset."""
        if self.dataset is not None:
            self.search = DatasetSearch(self.dataset, wanted, found)

    def search_on(self) -> bool:
        """Continue the search for a short time; returns whether it made progress."""
        if self.search is None or self.search.is_complete:
            return False
        self.search.go_on()
        return True

    def open_from_dataset(self, card: ScenarioCard) -> None:
        """Open a scenario that the search has found.

        Raises:
            InputError: it cannot be read; what was open stays open.
            LargeSceneError: it is too large or long; a part of it can be opened.
        """
        # One that is refused is passed as well by whoever goes on to the next.
        self._reached = self.session.base, card.folder
        self.open_reference(str(card.folder))
        self._opened = self.session.base, card.folder

    @property
    def dataset_folder(self) -> Path | None:
        """Folder of the open scenario as the dataset lists it; None if it is elsewhere."""
        base = self.session.base
        if self._opened is not None and self._opened[0] is base:
            return self._opened[1]
        source = Path(base.provenance.source)
        root = None if self.dataset is None else self.dataset.root
        if root is None or root.resolve() not in source.parents:
            return None
        return root / source.relative_to(root.resolve())

    def open_neighbour(self, direction: int) -> None:
        """Open the next (+1) or previous (-1) scenario under the filter.

        Raises:
            InputError: there is none.
        """
        if self.dataset is None or self.search is None:
            raise InputError("Start the editor with --data DIR to browse a dataset.")
        base, folder = self._reached or (None, None)
        if base is not self.session.base:
            folder = self.dataset_folder
        if folder is not None:
            step = self.dataset.after if direction > 0 else self.dataset.before
            card = step(folder, self.search.wanted)
        else:
            # The open scenario is not in the dataset: start at the beginning.
            card = next(iter(self.search.cards), None)
        if card is None:
            raise InputError("There is no further scenario under this filter.")
        self.open_from_dataset(card)

    def exported_zip(self, format_name: str = ARGOVERSE2.name) -> tuple[str, bytes]:
        """Name and bytes of a zip with the scenario and its recipe.

        Its id is unique in this workspace.
        """
        recipe = self._named_recipe(self._is_given)
        files = exported_files(
            self.session.scenario, recipe, self.session.base, format_name
        )
        self._exported_as(recipe.result_id)
        return f"{recipe.result_id}.zip", zip_folders({recipe.result_id: files})

    def recipe_text(self) -> tuple[str, bytes]:
        """Name and bytes of the edits alone."""
        self.session.commit_gesture()
        recipe = self.session.recipe()
        return f"{recipe.result_id}.recipe.json", recipe.to_text().encode()

    def earlier_export(self, out: Path) -> float | None:
        """Time of an earlier export of the present name to a folder; None without one."""
        try:
            return (out / self.session.name / RECIPE_NAME).stat().st_mtime
        except (OSError, ValueError):
            return None

    def free_name_in(self, out: Path) -> str:
        """The name that a new export gets in a folder."""
        return self._named_recipe(lambda name: os.path.exists(out / name)).result_id

    def export_into(
        self, out: Path, *, replaces: bool = False, format_name: str = ARGOVERSE2.name
    ) -> Path:
        """Write the scenario and its recipe as a folder in ``out``.

        Unless ``replaces``, it is a new one, named ``-2`` where the name is taken.

        Raises:
            ExportError: it cannot be written there.
        """
        recipe = self._named_recipe(
            lambda name: not replaces and os.path.exists(out / name)
        )
        session = self.session
        folder = export_into(
            out,
            session.scenario,
            recipe,
            base=session.base,
            overwrite=replaces,
            format_name=format_name,
        )
        self._exported_as(recipe.result_id)
        return folder

    def _exported_as(self, name: str) -> None:
        self._given[name] = self.session.scenario
        self.session.mark_exported(ExportMark(name=name))

    def save(self) -> LibraryCard:
        """Add the current state to the library; one that is there is described anew.

        Raises:
            ExportError: the state cannot be written.
        """
        self.session.commit_gesture()
        former, session = self.saved_card(), self.session
        if former is not None and former == self._opened_card():
            # Its files and recipe stay.
            said = {"tags": session.variant.tags, "note": session.variant.note}
            self.library.describe([former.name], lambda one: replace(one, **said))
            return former
        recipe = self._recipe_to_save(former)
        card = card_of(session.scenario, session.base, recipe)
        if former is not None:
            card = replace(card, saved_at=former.saved_at, author=former.author)
        self.library.add(
            card,
            exported_files(session.scenario, recipe, session.base),
            thumbnail(session.scenario),
            replaces=None if former is None else former.name,
        )
        self._given[card.name] = session.scenario
        self.session.mark_exported(ExportMark(name=card.name, saved_at=card.saved_at))
        if former is not None and former.name in self.ticked:
            self.ticked.add(card.name)
        return card

    def take_in(self, reference: str) -> str:
        """Add a scene to the library as it is; returns its name, or none if it is there.

        Raises:
            InputError: it cannot be read.
            ExportError: it cannot be written.
        """
        scenario = open_part(reference, self.cut)
        return take_in(self.library, EditorSession(scenario), reference)

    def is_saved(self) -> bool:
        """Whether the library holds the current state, with what is said of it."""
        former = self.saved_card()
        if former is None:
            return False
        said, row = self._recipe_to_save(former), former.row
        about = said.variant
        return (said.result_id, about.tags, about.note, set(about.ignored)) == (
            former.name,
            row.tags,
            row.note,
            set(row.ignored),
        )

    def saved_card(self) -> LibraryCard | None:
        """Entry of the current state in the library; None if it is not there."""
        for mark in self.session.exports_of_state:
            if entry := self.library.marked(mark):
                return entry
        return self._opened_card()

    def _opened_card(self) -> LibraryCard | None:
        """Entry of the library that is open as it is, under its name."""
        session, root = self.session, os.path.realpath(self.library.root)
        place = Path(os.path.realpath(session.base.provenance.source))
        is_it = session.scenario is session.base and session.name == place.name
        return (
            self.library.card(place.name)
            if is_it and place.parent == Path(root)
            else None
        )

    def _recipe_to_save(self, former: LibraryCard | None) -> Recipe:
        """Recipe with a name that is unused, or that the former entry of the state has."""
        kept = "" if former is None else former.name
        return self._named_recipe(
            lambda name: (
                name != kept and (self.library.has(name) or self._is_given(name))
            )
        )

    def _is_given(self, name: str) -> bool:
        """Whether another state was exported under the name."""
        given = self._given.get(name)
        if given is None:
            return self.library.has(name)
        return given is not self.session.scenario

    def _named_recipe(self, is_taken: Callable[[str], bool]) -> Recipe:
        """Recipe of the current state, with an unused name."""
        self.session.commit_gesture()
        recipe = self.session.recipe()
        if not is_taken(recipe.result_id):
            return recipe
        name = free_name(name_from_text(recipe.result_id), is_taken)
        is_proposed = not self.session.variant.name
        variant = replace(recipe.variant, name=name, is_proposed=is_proposed)
        return replace(recipe, variant=variant)

    def resume(self, work: KeptWork) -> None:
        """Resume unfinished work; the open session is shelved.

        Raises:
            InputError: its base scenario does not exist any more.
            RecipeError: the journal cannot be replayed, or is open elsewhere.
        """
        place = work.place
        if isinstance(place, UnfinishedWork):
            place = self.shelf.restored(place, base_of(place))
        elif not self.shelf.claim(place):
            raise RecipeError("This work is open in another tab by now.")
        self._exchange(place)

    def retry_journals(self) -> None:
        """Write edits to disk that could not be written before, if any."""
        self.session.retry_journal()
        self.shelf.retry_journals()

    def close(self) -> None:
        """Close the workspace; edits that were not exported stay in their journals."""
        self.study.cancel()
        self.session.commit_gesture()
        self.session.close(discard=self.is_exported)


def base_of(work: UnfinishedWork) -> Scenario:
    """Open the base of unfinished work.

    Raises:
        InputError: it does not exist any more, or cannot be read.
    """
    if not work.base_files:
        return open_base(work.base)
    try:
        files = {path.name: path.read_bytes() for path in work.base_files}
    except OSError as error:
        raise InputError(
            f"The uploaded files of {work.scenario_id} are gone."
        ) from error
    return _from_upload(files, work.base.cut or SceneCut())[0]


def zip_of_several(files: Mapping[str, bytes]) -> UploadedZip | None:
    """What the start page lists of an upload of several scenarios; None: it has not many.

    Raises:
        ArchiveError: unsafe, or no readable zip.
    """
    scenes = scenes_in_upload(files)
    if not scenes:
        return None
    size = sum(map(len, files.values()))
    return UploadedZip(name=next(iter(files)), size_bytes=size, scenes=scenes)


def take_in_upload(
    library: Library,
    files: Mapping[str, bytes],
    cut: SceneCut,
    tags: Sequence[str] = (),
) -> str:
    """Take the scene in an upload into a library; raises and returns as ``take_in``."""
    scenario, recipe = _from_upload(files, cut)
    return take_in(library, EditorSession(scenario), made_by_recipe=recipe, tags=tags)


def _from_upload(
    files: Mapping[str, bytes], cut: SceneCut
) -> tuple[Scenario, Recipe | None]:
    """The scenario in an upload, cut, and the recipe that made it if it is an export."""
    recipe: Recipe | None = None

    def read() -> Scenario:
        nonlocal recipe
        scenario, recipe = scenario_and_recipe(files)
        return scenario if recipe is None else made_by(scenario, recipe)

    return cut_when_read(read, cut), recipe


@dataclass(frozen=True, kw_only=True)
class ServerFolders:
    """Folders that a page may name: any, or only what the server offers to others."""

    is_local: bool
    """Whether only browsers of this machine can reach the editor."""
    state: Path
    """Folder of the editor's own files."""
    dataset_root: Path | None
    """Root of the dataset that the server offers."""

    def named(self, text: str) -> Path:
        """Any folder, to read or to write.

        Raises:
            InputError: the editor listens to other machines, or this is no path.
        """
        if not self.is_local:
            raise InputError(
                "Folders of the server's machine are closed while the editor listens "
                "to other machines (--host); upload and download instead."
            )
        return user_path(text)

    def scenes(self, text: str) -> Path:
        """A folder with scenarios; for other machines the demos or the dataset.

        Raises:
            InputError: it is none of these, or no path.
        """
        if self.is_local:
            return self.named(text)
        if self.dataset_root is not None and text == str(self.dataset_root):
            return self.dataset_root
        name = text.removeprefix(DEMO_PREFIX)
        if name not in (ALL_DEMOS, *demo_names()):
            dataset = f", or {self.dataset_root}" if self.dataset_root else ""
            raise InputError(
                "Other folders of the server's machine are closed while the editor "
                f"listens to other machines (--host); enter {ALL_DEMOS}, the name of a "
                f"demo{dataset}."
            )
        # A folder of this name in the server's working folder is not meant.
        return Path(f"{DEMO_PREFIX}{name}")

    def results(self, text: str) -> Path:
        """A folder for results; for other machines one of this name among the editor's files.

        Raises:
            InputError: this is no path, or no name.
        """
        # The server's folder is not the user's: name it as a whole.
        if self.is_local:
            return Path(os.path.realpath(self.named(text)))
        name = name_from_text(text)
        if not name:
            raise InputError("Name the results with letters or digits.")
        return Path(os.path.realpath(self.state)) / STUDIES_NAME / name
