"""The paper's claims, and the default against the paper's pair, on our own rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pd_editor.experiments.report import ReportTable
from reproduction.measures import MeasuredValue, RowTable, TableLine
from reproduction.paper_tables import (
    CORRECTED_COMPARISON,
    CORRECTED_REALISM,
    CORRECTED_STATES,
    NONE,
    Column,
    text_of,
)
from reproduction.systems import label_of


@dataclass(frozen=True, kw_only=True)
class Claim:
    """The paper prefers one system to another in one metric, where less is better."""

    words: str
    first: str
    second: str
    column: Column
    plain: bool = True


_OVERLAP: Final = Column(title="boxes overlap, %", metric="init_overlap", is_share=True)
_FINAL: Final = Column(
    title="final lateral deviation, m", metric="lateral_deviation_final"
)
_NEW: Final = Column(title="new collisions, %", metric="new_overlap", is_share=True)
STATE_CLAIMS: Final = (
    Claim(
        words="differential attention and CDB lower collisions",
        first="pd",
        second="mha",
        column=_OVERLAP,
    ),
    Claim(
        words="differential attention alone lowers collisions",
        first="pd_minus_cdb",
        second="mha",
        column=_OVERLAP,
    ),
    Claim(
        words="CDB lowers collisions further",
        first="pd",
        second="pd_minus_cdb",
        column=_OVERLAP,
    ),
)
TRAJECTORY_CLAIMS: Final = tuple(
    Claim(words=words, first="pd", second=second, column=column, plain=plain)
    for plain in (True, False)
    for second, words in (
        ("pd_minus_p", "candidates keep agents on their lanes"),
        ("vd", "candidates and attributes keep agents on their lanes"),
    )
    for column in (_FINAL, _NEW)
)


def claims_table(states: RowTable, everyone: RowTable) -> ReportTable:
    """Each claim, unguided and guided, with the difference and whether it is clear."""
    lines = [
        line
        for rows, claims in ((states, STATE_CLAIMS), (everyone, TRAJECTORY_CLAIMS))
        for claim in claims
        for mode in ("unguided", "guided")
        for line in _told(rows, claim, mode)
    ]
    return ReportTable(
        title="The paper's claims on our rows",
        header=("claim", "metric", "roads", "mode", "systems", "difference", "told"),
        rows=tuple(lines),
        note="Difference of the first system to the second; the interval is of 95 % over "
        "scenes, resampled together, and trainings. A claim holds, or the opposite, only "
        "where the interval leaves out 0.",
    )


def _told(rows: RowTable, claim: Claim, mode: str) -> Sequence[tuple[str, ...]]:
    lines = [one for one in rows.lines if one.mode == mode]
    found = {one.system: one for one in lines}
    if claim.first not in found or claim.second not in found:
        return ()
    apart = _difference(rows, claim, found[claim.first], found[claim.second])
    return (
        (
            claim.words,
            claim.column.title,
            "plain" if claim.plain else "perturbed",
            mode,
            f"{label_of(claim.first)} against {label_of(claim.second)}",
            text_of(apart),
            _verdict(apart),
        ),
    )


def _difference(
    rows: RowTable, claim: Claim, first: TableLine, second: TableLine
) -> MeasuredValue:
    factor = 100 if claim.column.is_share else 1
    apart = rows.difference(claim.column.metric, first, second, plain=claim.plain)
    return MeasuredValue(
        value=factor * apart.value, low=factor * apart.low, high=factor * apart.high
    )


def _verdict(apart: MeasuredValue) -> str:
    if apart.high < 0:
        return "holds"
    return "the opposite" if apart.low > 0 else "open"


def default_table(states: RowTable, everyone: RowTable) -> ReportTable:
    """The default against the paper's pair, on every corrected metric, unguided."""
    lines: list[tuple[str, ...]] = []
    for rows, columns, roads in (
        (states, CORRECTED_STATES, (True,)),
        (everyone, (*CORRECTED_REALISM, *CORRECTED_COMPARISON), (True, False)),
    ):
        for plain in roads:
            for column in columns:
                if column.metric == "end_spread":
                    continue  # Neither more nor less of it is better.
                claim = Claim(
                    words="", first="pd", second="paper", column=column, plain=plain
                )
                for _, title, road, _, _, apart, verdict in _told(
                    rows, claim, "unguided"
                ):
                    words = {"holds": "better", "the opposite": "worse"}
                    lines.append((title, road, apart, words.get(verdict, verdict)))
    return ReportTable(
        title="Default against the paper's pair, equal steps",
        header=("metric", "roads", "difference", "default is"),
        rows=tuple(dict.fromkeys(lines)) or ((NONE,) * 4,),
        note="PD minus PD as in the paper, both unguided, on corrected metrics; less is "
        "better in all of them.",
    )
