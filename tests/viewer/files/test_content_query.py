"""Conditions that buttons add to a query."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from pd_editor.experiments.scene_index.index_file import SCHEMA, SceneIndex
from pd_editor.experiments.scene_index.query import find_scenes
from pd_editor.viewer.files.start_page import COMMON, toggled

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
