"""The query line of the dataset panel, without a browser."""

import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pd_editor
from pd_editor.base.installed_files import demo_folder
from pd_editor.experiments.scene_index.find import find_scenes
from pd_editor.experiments.scene_index.index_file import SCHEMA, SceneIndex
from pd_editor.viewer.files.content_query import COMMON, toggled
from tests.viewer.fake_browser import connected_tab, running_app, until

EMPTY = SceneIndex(folder=Path("/"), table=SCHEMA.empty_table())
conditions = st.sampled_from([*COMMON, "density > 20", 'city = "palo alto"'])
queries = st.lists(conditions, max_size=4, unique=True).flatmap(
    lambda parts: st.sampled_from([" and ", " AND ", " or "]).map(
        lambda word: word.join(parts)
    )
)


@given(queries, conditions, st.sampled_from(["", " and", " or ", " and and"]))
def test_buttons_make_queries(query: str, condition: str, end: str):
    """What was begun by hand may end anywhere between two conditions."""
    longer = toggled(query + (end if query else ""), condition)
    if longer:
        assert find_scenes(EMPTY, longer) == ()
    if condition not in query:
        assert longer.endswith(condition)
        assert toggled(longer, condition).strip("()") == " and ".join(
            query.replace(" AND ", " and ").split(" and ")
        )


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in ("crosswalk", "roundabout", "winding-street"):
        shutil.copytree(demo_folder(name), tmp_path / "scenes" / f"<b>{name}")
    pd_editor.index(tmp_path / "scenes", workers=1)
    return tmp_path / "scenes"


def test_the_line_filters_with_the_others_and_names_a_wrong_word(root, tmp_path):
    with (
        running_app(tmp_path / "library", "merge", data_root=root) as app,
        connected_tab(app) as tab,
    ):
        workspace, inputs = tab.tab.workspace, tab.inputs()
        (line,), (text,) = inputs["Contains"], inputs["Id contains"]
        note = tab.elements.dataset.query.note
        until(lambda: len(workspace.index_run.index.table) == 3)

        def left() -> list[str]:
            until(lambda: workspace.search.is_complete)
            tab.run(tab.elements.dataset.show)
            return [one.scenario_id for one in workspace.search.cards]

        tab.enter(line, "following or turn > 500")
        until(lambda: len(workspace.search.found) == 2)
        both = left()
        shown = {one.folder for one in workspace.search.cards}
        assert shown == set(workspace.search.found)
        tab.enter(line, "folowing")
        until(lambda: note.text.endswith("not known; the nearest is following."))
        assert left() == both
        tab.enter(line, "junction = roundabout")
        until(lambda: left() == ["roundabout"])
        tab.enter(text, "crosswalk")
        until(lambda: left() == [])
