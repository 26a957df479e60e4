"""Tables I to IV of the paper, from the rows of our own evaluations."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pd_editor.analysis.metrics.distribution_distance import histogram_of
from pd_editor.analysis.metrics.values import Source
from pd_editor.experiments.report import ReportTable
from reproduction.measures import MeasuredValue, RowTable, TableLine
from reproduction.systems import in_table_order, label_of

NONE: Final = "-"
SAW_WARPS: Final = " (saw warped roads)"
STATE_METRICS: Final = (
    ("nearest_distance", "Near. Dist."),
    ("local_density", "Local Density"),
    ("nearest_edge", "Lat. Dev."),
    ("nearest_edge_angle", "Ang. Dev."),
    ("speed", "Speed"),
)
"""Metrics of Table II whose distributions are compared."""
TRAJECTORY_VECTOR: Final = (
    "path_length",
    "lateral_deviation_mean",
    "angular_deviation_mean",
)
"""Metrics of an agent whose joint distribution the column MMD of Table III compares."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Column of a table: a mean over agents."""

    title: str
    metric: str
    is_share: bool = False
    """Whether it is shown in percent."""


COMMON_SENSE: Final = (
    Column(title="Collision Rate, %", metric="init_collision_2m", is_share=True),
    Column(title="Near. Edge, m", metric="nearest_edge"),
    Column(title="Off-Road Rate, %", metric="init_off_road_4m", is_share=True),
)
CORRECTED_STATES: Final = (
    Column(title="boxes overlap, %", metric="init_overlap", is_share=True),
    Column(title="off drivable area, %", metric="init_off_drivable", is_share=True),
)
REALISM: Final = (
    Column(title="actorCR, %", metric="actor_collision_2m", is_share=True),
    Column(title="Off-road Rate, %", metric="off_road_4m_whole_path", is_share=True),
    Column(title="Avg. Lat. Dev., m", metric="lateral_deviation_mean"),
    Column(title="Final Lat. Dev., m", metric="lateral_deviation_final"),
)
CORRECTED_REALISM: Final = (
    Column(title="new collisions, %", metric="new_overlap", is_share=True),
    Column(title="off-road at any step, %", metric="off_road_4m", is_share=True),
    Column(title="SOR, %", metric="off_drivable_steps", is_share=True),
    Column(title="Avg. Lat. Dev., m", metric="lateral_deviation_mean"),
    Column(title="Final Lat. Dev., m", metric="lateral_deviation_final"),
)
COMPARISON: Final = (
    Column(title="MR, %", metric="missed", is_share=True),
    Column(title="FDE, m", metric="fde"),
    Column(title="ADE, m", metric="ade_with_state"),
)
CORRECTED_COMPARISON: Final = (
    Column(title="MR, %", metric="missed", is_share=True),
    Column(title="FDE, m", metric="fde"),
    Column(title="ADE, m", metric="ade"),
    Column(title="minADE, m", metric="min_ade"),
    Column(title="end spread, m", metric="end_spread"),
)
STATE_COLUMNS: Final = tuple(
    dict.fromkeys(
        (
            *dict(STATE_METRICS),
            *(one.metric for one in (*COMMON_SENSE, *CORRECTED_STATES)),
        )
    )
)
"""Columns of the rows behind Table II."""
TRAJECTORY_COLUMNS: Final = tuple(
    dict.fromkeys(
        (
            *TRAJECTORY_VECTOR,
            *(
                one.metric
                for part in (
                    REALISM,
                    CORRECTED_REALISM,
                    COMPARISON,
                    CORRECTED_COMPARISON,
                )
                for one in part
            ),
        )
    )
)
"""Columns of the rows behind Tables III and IV."""
_NO_INTERVAL: Final = "The interval, where there is one, is of 95 % over scenes and trainings, both resampled."


@dataclass(frozen=True, kw_only=True)
class AttentionScores:
    """Variances of attention scores of a system at some noise levels."""

    system: str
    over_map: tuple[float, ...]
    over_agents: tuple[float, ...]
    is_differential: bool
    """Whether attention to the map is differential."""


def attention_table(
    levels: Sequence[float], scores: Sequence[AttentionScores]
) -> ReportTable:
    """Table I: variance of attention scores at noise levels, by kind of attention."""
    lines = []
    for kind in ("map-agent", "agent-agent"):
        for one in scores:
            is_map = kind == "map-agent"
            values = one.over_map if is_map else one.over_agents
            layer = "DIFFT" if is_map and one.is_differential else "MHA"
            lines.append(
                (kind, label_of(one.system), layer, *(f"{v:.2e}" for v in values))
            )
    return ReportTable(
        title="Table I: variance of attention scores",
        header=("attention", "system", "layer", *(f"level {v:g}" for v in levels)),
        rows=tuple(lines),
        note="Mean over queries, heads, layers, scenes and trainings of the variance of the "
        "scores over the keys that a query may see. Level 0 is the least noise (the paper's "
        "step 1), level 1 the most. Agents attend to each other by plain attention in all "
        "systems; the paper's row of differential attention there repeats another one.",
    )


def state_tables(rows: RowTable) -> tuple[ReportTable, ...]:
    """Table II: initial states, in the paper's columns and in corrected ones."""
    metrics = tuple(name for name, _ in STATE_METRICS)

    def distances(source: Source) -> Mapping[str, list[MeasuredValue]]:
        return {
            title: [
                rows.distance(histogram_of(name, source), line) for line in _lines(rows)
            ]
            for name, title in STATE_METRICS
        }

    discrepancy = [rows.discrepancy(metrics, line, plain=True) for line in _lines(rows)]
    own = "Raw: what the network samples. Guided: with guidance and repair."
    return (
        _table(
            "Table II: initial states, as in the paper",
            rows,
            {f"{k} JSD": v for k, v in distances("paper").items()}
            | {"MMD^2": discrepancy}
            | _means(rows, COMMON_SENSE, plain=True),
            f"JSD is the root of the divergence in the paper's bins, which drop what is out "
            f"of range; beside GT, the distance of resampled recordings. {_NO_INTERVAL} "
            f"{own} Constant velocity and lane follower sample no states.",
            _STATE_MODES,
        ),
        _table(
            "Table II, corrected",
            rows,
            {f"{k} JSD": v for k, v in distances("ours").items()}
            | _means(rows, CORRECTED_STATES, plain=True),
            f"JSD in bins that hold all values. Boxes overlap by more than 0.05 m^2. {own}",
            _STATE_MODES,
        ),
    )


def trajectory_tables(
    paper: RowTable,
    everyone: RowTable,
    *,
    plain: bool = True,
    warped: bool,
    saw_warps: Collection[str] = (),
) -> tuple[ReportTable, ...]:
    """Tables III and IV on plain and on warped roads, in both kinds of columns.

    ``paper`` are rows of the paper's agents, ``everyone`` of all. Systems that
    ``saw_warps`` in their training are marked.
    """
    found = []
    for number, title, columns, corrected in (
        ("III", "realism and road compliance", REALISM, CORRECTED_REALISM),
        ("IV", "comparison with the log", COMPARISON, CORRECTED_COMPARISON),
    ):
        for is_plain in (True,) * plain + (False,) * warped:
            roads = "no map perturbation" if is_plain else "map perturbation"
            for rows, name, chosen, note in (
                (paper, "as in the paper", columns, _PAPER_NOTE),
                (everyone, "corrected", corrected, _CORRECTED_NOTE),
            ):
                values = dict(_means(rows, chosen, plain=is_plain))
                if number == "III":
                    values["MMD^2"] = [
                        rows.discrepancy(TRAJECTORY_VECTOR, line, plain=is_plain)
                        for line in _lines(rows)
                    ]
                found.append(
                    _table(
                        f"Table {number}: {title}, {name}, {roads}",
                        rows,
                        values,
                        f"{note} {_NO_INTERVAL}",
                        marked=() if is_plain else saw_warps,
                    )
                )
    return tuple(found)


_PAPER_NOTE: Final = (
    "Agents that the paper's code keeps (scored motor vehicles), its definitions but for the "
    "average lateral deviation, which has none. Guided: pulled to the nearest candidate."
)
_CORRECTED_NOTE: Final = (
    "All motor vehicles of the log. Errors leave out the current step; minADE is over all "
    "samples. No system yields to avoid collisions here."
)
_STATE_MODES: Final = {"": "", "unguided": ", raw", "guided": ", guided"}
_MODES: Final = {"": "", "unguided": ", unguided", "guided": ", guided"}


def _lines(rows: RowTable) -> tuple[TableLine, ...]:
    """Unguided systems in the order of the paper, then guided ones."""
    order = in_table_order(one.system for one in rows.lines)
    place = {name: index for index, name in enumerate(order)}
    return tuple(
        sorted(rows.lines, key=lambda one: (one.mode == "guided", place[one.system]))
    )


def _means(
    rows: RowTable, columns: Sequence[Column], *, plain: bool
) -> dict[str, list[MeasuredValue]]:
    return {
        one.title: [
            _scaled(
                rows.mean(one.metric, line, plain=plain), 100 if one.is_share else 1
            )
            for line in _lines(rows)
        ]
        for one in columns
    }


def _scaled(one: MeasuredValue, factor: float) -> MeasuredValue:
    return MeasuredValue(
        value=factor * one.value, low=factor * one.low, high=factor * one.high
    )


def _table(
    title: str,
    rows: RowTable,
    values: Mapping[str, Sequence[MeasuredValue]],
    note: str,
    modes: Mapping[str, str] = _MODES,
    marked: Collection[str] = (),
) -> ReportTable:
    """One row for each line; lines without any value are left out."""
    lines = _lines(rows)
    shown = [
        index
        for index in range(len(lines))
        if any(math.isfinite(one[index].value) for one in values.values())
    ]
    seeds = {line: len(rows.rows(line, plain=True)) for line in lines}
    return ReportTable(
        title=title,
        header=("system", "trainings", *values),
        rows=tuple(
            (
                label_of(lines[index].system)
                + modes[lines[index].mode]
                + SAW_WARPS * (lines[index].system in marked),
                str(seeds[lines[index]]) if lines[index].mode else NONE,
                *(text_of(one[index]) for one in values.values()),
            )
            for index in shown
        ),
        note=note,
    )


def text_of(one: MeasuredValue) -> str:
    """A value with its interval, in three significant digits."""
    if not math.isfinite(one.value):
        return NONE
    digits = 1 if abs(one.value) >= 10 else 2 if abs(one.value) >= 1 else 3
    if not (math.isfinite(one.low) and math.isfinite(one.high)):
        return f"{one.value:.{digits}f}"
    return f"{one.value:.{digits}f} [{one.low:.{digits}f}, {one.high:.{digits}f}]"
