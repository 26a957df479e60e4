"""A report as one HTML page that needs nothing else."""

import re
from collections.abc import Sequence
from html import escape
from typing import Final

from pd_editor.evaluation.report.figures import Figure
from pd_editor.evaluation.report.sections import FIGURES_TITLE, Report, Section
from pd_editor.evaluation.report.tables import ReportTable

_STYLE: Final = """
body { font-family: sans-serif; margin: 2em auto; max-width: 90em; color: #222; padding: 0 1em; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; font-size: 0.85em; }
caption { text-align: left; font-weight: bold; padding: 0.3em 0; }
th, td { border-bottom: 1px solid #ddd; padding: 0.25em 0.6em; text-align: left; vertical-align: top; }
th { background: #f4f4f4; position: sticky; top: 0; }
div.wide { overflow-x: auto; }
figure { margin: 1em 0; }
figcaption { font-size: 0.9em; color: #555; }
"""
_BOLD: Final = re.compile(r"\*\*(.+?)\*\*")
_ITALIC: Final = re.compile(r"\*(\w+)\*")


def html_of(report: Report, figures: Sequence[Figure]) -> str:
    """The text of an HTML file."""
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f"<title>{escape(report.title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(report.title)}</h1>",
    ]
    for section in report.sections:
        if not section.paragraphs and not section.tables:
            continue
        parts.append(_section(section))
        if section.title == FIGURES_TITLE:
            parts += [
                f"<figure>{figure.svg}<figcaption>{escape(figure.caption)}</figcaption>"
                "</figure>"
                for figure in figures
            ]
    parts.append("</body></html>\n")
    return "\n".join(parts)


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    parts += [f"<p>{_marked(text)}</p>" for text in section.paragraphs]
    parts += [_table(table) for table in section.tables]
    return "\n".join(parts)


def _table(table: ReportTable) -> str:
    head = "".join(f"<th>{_marked(text)}</th>" for text in table.header)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{_marked(text)}</td>" for text in row) + "</tr>"
        for row in table.rows
    )
    note = f"<p>{_marked(table.note)}</p>" if table.note else ""
    return (
        f'<div class="wide"><table><caption>{escape(table.title)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table></div>{note}"
    )


def _marked(text: str) -> str:
    """Escaped, with the marks of Markdown as tags."""
    bold = _BOLD.sub(r"<b>\1</b>", escape(text))
    return _ITALIC.sub(r"<i>\1</i>", bold)
