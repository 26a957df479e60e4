from hypothesis import given
from hypothesis import strategies as st

from pd_editor.base.errors import PdEditorError
from pd_editor.base.plain_text import is_plain, one_line

ANY_TEXT = st.text(st.characters(exclude_categories=()), max_size=1500)


@given(ANY_TEXT)
def test_messages_are_one_printable_line_whatever_they_quote(text):
    """Names with line breaks, NUL or lone surrogates never break a line (fault 5)."""
    shown = str(PdEditorError(text))
    assert shown.isprintable()
    assert len(shown) <= 810
    shown.encode()


@given(ANY_TEXT)
def test_a_printable_text_is_shown_as_it_is(text):
    if text.isprintable() and is_plain(text):
        assert one_line(text) == text


def test_what_is_plain():
    for text in (
        "Fahrzeug 5, 漢字",
        "50\u00a0km",
        "右折\u3000",
        "👨\u200d👩",
        "ä" * 255,
    ):
        assert is_plain(text), text
    for text in ("a\nb", "a\0", "\ud800", "x" * 256, "a\x1b[2J", "a\x85b"):
        assert not is_plain(text), text
