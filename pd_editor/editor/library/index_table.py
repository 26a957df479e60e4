"""CSV table of a collection, with one line per scenario."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from pd_editor.analysis.findings.finding import IgnoredKey
from pd_editor.analysis.findings.scorecard import ROWS
from pd_editor.base.plain_text import csv_file
from pd_editor.editor.commands import ReplaceTraffic
from pd_editor.editor.commands.command import parts_of
from pd_editor.editor.edit_findings import edit_findings, guidance_in_words
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.varied_numbers import values_in_words, varied_values
from pd_editor.scene.scenario import Scenario

INDEX_NAME: Final = "index.csv"
_COLUMNS: Final = (
    "id",
    "name",
    "base_id",
    "parent",
    "values",
    "city",
    "num_edits",
    "edits",
    "seed",
    "generator",
    "num_problems",
    "problems",
    "guidance",
    "tags",
    "note",
)
_FORMULA_STARTS: Final = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True, kw_only=True)
class IndexRow:
    """Row of the table for one scenario."""

    scenario_id: str
    base_id: str
    """Id of the original recording or demo."""
    city: str
    edits: tuple[str, ...] = ()
    """Label of each edit in force."""
    seeds: tuple[int, ...] = ()
    generators: tuple[str, ...] = ()
    problems: Mapping[str, int] = field(default_factory=dict)
    """Number of problems of each kind that edits caused."""
    guidance: tuple[str, ...] = ()
    """What each term of guidance asked and what was achieved."""
    tags: tuple[str, ...] = ()
    note: str = ""
    ignored: tuple[IgnoredKey, ...] = ()
    """Problems that are not counted."""
    parent: str = ""
    """Name of the scenario whose family it is of, or that was opened to be edited."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Numbers that tell it from others of its family, by their names."""

    @property
    def lineage(self) -> str:
        """Of which scenario it is a variant, and by which numbers; empty: of none."""
        values = values_in_words(self.values)
        return f"{values}, variant of {self.parent}" if values else ""

    @property
    def values_told(self) -> str:
        """The numbers for tables, by the names that queries use."""
        return "; ".join(f"{name}={value:.10g}" for name, value in self.values.items())

    @property
    def num_problems(self) -> int:
        """Total number of problems."""
        return sum(self.problems.values())


def index_row(scenario: Scenario, base: Scenario, recipe: Recipe) -> IndexRow:
    """Row of a scenario that a recipe makes from ``base``; ignored ones do not count."""
    ignored = recipe.variant.ignored
    generated = parts_of(recipe.commands, ReplaceTraffic)
    found = edit_findings(scenario, base, recipe.commands).problems
    counts = Counter(one.kind for one in found if one.ignored_key not in ignored)
    return IndexRow(
        scenario_id=recipe.result_id,
        base_id=recipe.base.root.scenario_id,
        city=scenario.city,
        edits=tuple(command.label for command in recipe.commands),
        seeds=tuple(dict.fromkeys(one.seed for one in generated)),
        generators=tuple(dict.fromkeys(one.generator for one in generated)),
        problems=dict(sorted(counts.items())),
        guidance=tuple(guidance_in_words(scenario, recipe.commands)),
        tags=recipe.variant.tags,
        note=recipe.variant.note,
        ignored=ignored,
        parent=recipe.variant.parent or recipe.base.scenario_id,
        values=varied_values(recipe),
    )


def index_csv(
    rows: Iterable[IndexRow], metrics: Mapping[str, Mapping[str, float]] | None = None
) -> bytes:
    """Write the table in UTF-8; cells that a spreadsheet would evaluate are quoted.

    ``metrics`` are values of scorecards by ids: a column each, of those that are known.
    """
    measured = metrics or {}
    known = [one for one in ROWS if any(one in values for values in measured.values())]
    table = [[*_COLUMNS, *known]]
    for row in rows:
        kinds = "; ".join(f"{kind} {count}" for kind, count in row.problems.items())
        cells = (
            row.scenario_id,
            row.scenario_id,
            row.base_id,
            row.parent,
            row.values_told,
            row.city,
            str(len(row.edits)),
            "; ".join(row.edits),
            " ".join(map(str, row.seeds)),
            " ".join(row.generators),
            str(row.num_problems),
            kinds,
            "; ".join(row.guidance),
            "; ".join(row.tags),
            row.note,
        )
        values = measured.get(row.scenario_id, {})
        numbers = [f"{values[one]:.10g}" if one in values else "" for one in known]
        table.append([*map(_harmless, cells), *numbers])
    return csv_file(table, line_end="\r\n")


def _harmless(cell: str) -> str:
    return f"'{cell}" if cell.startswith(_FORMULA_STARTS) else cell
