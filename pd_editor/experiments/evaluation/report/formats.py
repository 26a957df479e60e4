"""Formats of a report: Markdown, and one self-contained HTML page."""

import base64
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from pd_editor.base.markdown import markdown_table
from pd_editor.experiments.evaluation.report.figures import Figure
from pd_editor.experiments.evaluation.report.sections import FIGURES_TITLE, Report

if TYPE_CHECKING:
    from markupsafe import Markup

_TEMPLATE: Final = "report.html.jinja"
_MARKS: Final = (
    (re.compile(r"\*\*(.+?)\*\*"), r"<b>\1</b>"),
    (re.compile(r"\*(\w+)\*"), r"<i>\1</i>"),
    (re.compile(r"`(.+?)`"), r"<code>\1</code>"),
    (re.compile(r"\[(\S+), (\S+)\]"), r"[\1,&nbsp;\2]"),  # Of an interval.
)


def markdown_of(report: Report) -> str:
    """The text of a Markdown file."""
    parts = [f"# {report.title}"]
    for section in report.shown_sections:
        parts += [f"## {section.title}", *section.paragraphs]
        for table in section.tables:
            parts += [f"### {table.title}", markdown_table(table.header, table.rows)]
            parts += [table.note] * bool(table.note)
    return "\n\n".join(parts) + "\n"


def html_of(report: Report, figures: Sequence[Figure]) -> str:
    """The text of an HTML file."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("pd_editor.experiments.evaluation.report", "."),
        autoescape=True,
        trim_blocks=True,
    )
    environment.filters |= {
        "marked": _marked,
        "base64": lambda data: base64.b64encode(data).decode(),
    }
    return environment.get_template(_TEMPLATE).render(
        report=report, figures=figures, figures_title=FIGURES_TITLE
    )


def _marked(text: str) -> "Markup":
    """Escaped, with the marks of Markdown as tags."""
    from markupsafe import Markup, escape

    page = str(escape(text))
    for pattern, tag in _MARKS:
        page = pattern.sub(tag, page)
    return Markup(page)
