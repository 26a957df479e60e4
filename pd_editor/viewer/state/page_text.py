"""Escapes texts from files for the page's Markdown."""

import html
import re

_MARKDOWN = re.compile(r"([\\`*_{}\[\]()#+\-.!|~:@])")


def plain(text: str) -> str:
    """Markdown that shows a text as it is: no HTML, links, pictures or emphasis."""
    return _MARKDOWN.sub(r"\\\1", html.escape(text, quote=False))
