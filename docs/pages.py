"""Pages of the documentation that lie elsewhere in the repository, at their own paths."""

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from pd_editor.analysis.metrics.values import METRICS
from pd_editor.base.plain_text import markdown_table
from pd_editor.experiments.training.settings import STAGES, fields_table

ROOT = Path(__file__).parents[1]
PAGES = (
    "README.md",
    "GLOSSARY.md",
    "CONTRIBUTING.md",
    "ROADMAP.md",
    "CHANGELOG.md",
    "docs/*.md",
    "reproduction/*.md",
    "reproduction/*.csv",
    "docs/pictures/*",
    "models/*/*.md",
    "models/*/*.png",
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages, so that links among them hold as they do in the repository."""
    for pattern in PAGES:
        for path in sorted(ROOT.glob(pattern)):
            place = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, place, abs_src_path=str(path)))
    files.append(File.generated(config, "metrics.md", content=metrics_page()))
    files.append(File.generated(config, "fields.md", content=fields_page()))
    return files


def fields_page() -> str:
    """The tables of the fields of a variant."""
    words = (
        "What a file for `pd-editor train --config` or `make variants` can set, and "
        "`--set`; defaults are those of the preset `default`."
    )
    tables = "\n\n".join(
        f"## Stage {stage}\n\n{fields_table(stage)}" for stage in STAGES
    )
    return f"# Fields of a variant\n\n{words}\n\n{tables}\n"


def metrics_page() -> str:
    """The table of metrics."""
    header = ("metric", "unit", "source", "better", "definition")
    rows = [
        (f"`{one.name}`", one.unit, one.source, one.better, one.definition)
        for one in METRICS.values()
    ]
    words = "What `pd-editor evaluate` measures; shares are in 0..1, and per cent in reports."
    return f"# Metrics\n\n{words}\n\n{markdown_table(header, rows)}\n"
