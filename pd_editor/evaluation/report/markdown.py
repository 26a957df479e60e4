"""A report as Markdown."""

from pd_editor.evaluation.report.sections import Report
from pd_editor.evaluation.report.tables import ReportTable


def markdown_of(report: Report) -> str:
    """The text of a Markdown file."""
    parts = [f"# {report.title}"]
    for section in report.sections:
        if not section.paragraphs and not section.tables:
            continue
        parts += [f"## {section.title}", *section.paragraphs]
        for table in section.tables:
            parts += [f"### {table.title}", _table(table)]
            parts += [table.note] * bool(table.note)
    return "\n\n".join(parts) + "\n"


def _table(table: ReportTable) -> str:
    lines = [table.header, ("---",) * len(table.header), *table.rows]
    return "\n".join(f"| {' | '.join(map(_escaped, line))} |" for line in lines)


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
