import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.viewer.tab.panel_style import plain


@pytest.mark.parametrize(
    "text",
    [
        "<img src=x onerror=alert(1)>",
        "[click](javascript:alert(1))",
        "![pixel](http://evil.example/p.png)",
        "**bold** _it_ `code` # title",
        "http://evil.example",
    ],
)
def test_nothing_in_it_means_anything_to_markdown(text):
    shown = plain(text)
    assert "<" not in shown
    assert not re.search(r"(?<!\\)[\[\]()*_`#!:]", shown)


@given(st.text())
def test_taking_the_escapes_away_gives_the_text_back(text):
    unescaped = re.sub(r"\\(.)", r"\1", plain(text))
    assert (
        unescaped.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
        == text
    )
