"""Reports: sections of text, tables and figures, as Markdown and as one HTML page."""

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pd_editor.base.plain_text import markdown_table
from pd_editor.base.regular_file import write_whole

if TYPE_CHECKING:
    from markupsafe import Markup

REPORT_PAGE: Final = "report.html"
NONE: Final = "-"
"""A cell without a value."""
_MARKS: Final = (
    (re.compile(r"\*\*(.+?)\*\*"), r"<b>\1</b>"),
    (re.compile(r"\*(\w+)\*"), r"<i>\1</i>"),
    (re.compile(r"`(.+?)`"), r"<code>\1</code>"),
    (re.compile(r"\[(\S+), (\S+)\]"), r"[\1,&nbsp;\2]"),  # Of an interval.
)


@dataclass(frozen=True, kw_only=True)
class ReportTable:
    """A table of texts: header and rows."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture with its caption."""

    data: bytes
    caption: str
    media: str = "svg+xml"
    """Type of the data, such as ``png``."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section: heading, paragraphs, tables, and figures that only the page has."""

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Report:
    """A report: all sections in order; those with nothing in them are not shown."""

    title: str
    sections: tuple[Section, ...]

    @property
    def shown_sections(self) -> tuple[Section, ...]:
        """Those with something in them."""
        return tuple(one for one in self.sections if one.paragraphs or one.tables)

    def markdown(self) -> str:
        """The text of a Markdown file."""
        parts = [f"# {self.title}"]
        for section in self.shown_sections:
            parts += [f"## {section.title}", *section.paragraphs]
            for table in section.tables:
                rows = markdown_table(table.header, table.rows)
                parts += [f"### {table.title}", rows, *[table.note] * bool(table.note)]
        return "\n\n".join(parts) + "\n"

    def html(self) -> str:
        """The text of an HTML file."""
        from jinja2 import Environment, PackageLoader

        environment = Environment(
            loader=PackageLoader("pd_editor.experiments", "."),
            autoescape=True,
            trim_blocks=True,
        )
        environment.filters |= {
            "marked": _marked,
            "base64": lambda data: base64.b64encode(data).decode(),
        }
        return environment.get_template("report.html.jinja").render(report=self)

    def write(self, folder: Path, name: str = "report") -> tuple[Path, Path]:
        """Write both files; returns their paths.

        Raises:
            ExportError: one cannot be written.
        """
        text, page = folder / f"{name}.md", folder / f"{name}.html"
        write_whole(text, self.markdown().encode())
        write_whole(page, self.html().encode())
        return text, page


def table_of_first(
    title: str, header: tuple[str, ...], rows: Sequence[tuple[str, ...]], most: int = 30
) -> tuple[ReportTable, ...]:
    """A table of the first rows, and how many more there are; none without any."""
    if not rows:
        return ()
    note = f"And {len(rows) - most} more." if len(rows) > most else ""
    return (
        ReportTable(title=title, header=header, rows=tuple(rows[:most]), note=note),
    )


def command_section(command: str) -> Section:
    """The command that makes the same report."""
    return Section(title="How to repeat it", paragraphs=(f"`{command}`",))


def _marked(text: str) -> "Markup":
    """Escaped, with the marks of Markdown as tags."""
    from markupsafe import Markup, escape

    page = str(escape(text))
    for pattern, tag in _MARKS:
        page = pattern.sub(tag, page)
    return Markup(page)
