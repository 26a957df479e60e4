"""Takes scenes as they are into a library."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pd_editor.base.errors import FolderInUseError
from pd_editor.editor.library.library import Library, card_of
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import (
    exported_files,
    made_by,
    recipe_of_export,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import fit_name, free_name
from pd_editor.scene.scenario import Scenario


def take_in(
    library: Library,
    session: EditorSession,
    reference: str = "",
    *,
    made_by_recipe: Recipe | None = None,
    tags: Sequence[str] = (),
    note: str = "",
    author: str = "",
) -> str:
    """Take what a session shows into a library; returns its name, or none if it is there.

    An export that was opened by a ``reference``, or with the recipe it was
    ``made_by_recipe``, keeps its recipe, whether or not its base is at hand. A name that
    is taken gets a number.

    Raises:
        ExportError: the files cannot be written.
    """
    scenario, base = session.scenario, session.base
    judge: Scenario | None = base
    recipe = replace(session.recipe(), created_at="")
    own = made_by_recipe
    if reference and not session.entries:
        own = recipe_of_export(Path(reference))
    if own is not None and own.result_id == scenario.scenario_id:
        is_file = bool(reference) and Path(reference).is_file()
        scenario = base = made_by(scenario, own) if is_file else scenario
        recipe, judge = own, None
    about = recipe.variant.tagged(tuple(tags), (), recipe.variant.note or note)
    wanted, tried = fit_name(recipe.result_id), set[str]()
    while True:
        name = free_name(wanted, tried.__contains__)
        recipe = replace(recipe, variant=replace(about, name=name))
        files = exported_files(scenario, recipe, judge)
        if library.holds(name, files):
            return ""
        try:
            card = card_of(scenario, base, recipe, author)
            library.add(card, files, thumbnail(scenario))
        except FolderInUseError:
            tried.add(name)
        else:
            return name
