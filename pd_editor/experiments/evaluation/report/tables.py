"""Tables of a report, with text in cells."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from pd_editor.analysis.metrics.values import METRICS
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.road_condition import PLAIN
from pd_editor.experiments.evaluation.scene_rows import METRIC_COLUMNS
from pd_editor.experiments.evaluation.summary import FAR_FROM_LANE, PERTURBED, Summary
from pd_editor.experiments.report import NONE, ReportTable

HEADLINES: Final = (
    ("lateral_deviation_final", "final lateral deviation, m"),
    (FAR_FROM_LANE, "ends > 2 m off, %"),
    ("new_overlap", "new collisions, %"),
    ("path_length", "path length, m"),
    ("ade", "ADE, m"),
    ("fde", "FDE, m"),
    ("missed", "missed, %"),
    ("min_ade", "minADE, m"),
    ("end_spread", "end spread, m"),
    ("off_road_4m", "off-road 4 m, %"),
    ("off_drivable_steps", "SOR, %"),
    ("off_drivable", "HOR, %"),
)
"""Headline metrics. Lateral deviation alone is low for agents that stay on any lane, so
it is shown beside others."""
PLACING_HEADLINES: Final = (
    ("init_collision_2m", "collision 2 m, %"),
    ("init_overlap", "boxes overlap, %"),
    ("init_five_circles", "five circles meet, %"),
    ("init_off_road_4m", "placed off-road 4 m, %"),
    ("init_off_drivable", "off drivable, %"),
    ("askew_to_lane", "askew to lane, %"),
    ("askew_to_neighbour", "askew to neighbour, %"),
    ("nearest_edge", "to a centre line, m"),
    ("standing", "standing, %"),
    ("speed", "speed, m/s"),
    *(
        (name, title)
        for name, title in HEADLINES
        if name not in ("ade", "fde", "missed", "min_ade", "end_spread")
    ),
)
"""Headline metrics where initial states are sampled, without errors against the log."""
COMPARED: Final = (
    "lateral_deviation_final",
    FAR_FROM_LANE,
    "new_overlap",
    "path_length",
    "off_road_4m",
    "off_drivable_steps",
    "wrong_way",
    "uncomfortable",
    "impossible",
)
"""Metrics that the log has values of, in which methods are compared with it."""
BY_ROAD: Final = (
    "lateral_deviation_final",
    "new_overlap",
    "path_length",
    "ade",
    "end_spread",
)
MEDIAN: Final = "median"


def headline_tables(
    summary: Summary, headlines: Sequence[tuple[str, str]]
) -> list[ReportTable]:
    """Headline metrics on original and on warped roads, one table per group."""
    of_median = 1 + [name for name, _ in headlines].index("lateral_deviation_final")
    titles = [title for _, title in headlines]
    titles.insert(of_median, "its median, m")

    def rows(w: int, g: int) -> Iterator[tuple[str, ...]]:
        for m, method in enumerate(summary.methods):
            cells = [
                summary.statistics[name].mean.cell((m, w, g), unit_of(name))
                for name, _ in headlines
            ]
            cells.insert(of_median, _number(summary.median_final_m[m, w, g]))
            counts = f"{summary.num_agents[m, w, g]} / {summary.num_scenes[m, w, g]}"
            if summary.num_agents[:, w, g].any():
                yield (method, counts, *cells)

    return _main_tables(summary, "", ("method", "agents / scenes", *titles), rows)


def difference_tables(summary: Summary) -> list[ReportTable]:
    """Differences between methods and the log on the same agents, one table per group."""

    def rows(w: int, g: int) -> Iterator[tuple[str, ...]]:
        for m, method in enumerate(summary.methods):
            if method == GROUND_TRUTH or not summary.num_agents[m, w, g]:
                continue
            differences = [
                (summary.statistics[name].difference, unit_of(name))
                for name in COMPARED
            ]
            yield (
                method,
                str(summary.statistics[COMPARED[0]].num_pairs[m, w, g]),
                *(one.cell((m, w, g), unit, signed=True) for one, unit in differences),
            )

    header = ("method", "pairs", *map(named, COMPARED))
    return _main_tables(summary, ": minus the log", header, rows)


def complete_tables(summary: Summary) -> list[ReportTable]:
    """All metrics of all methods on original and warped roads, one table per group."""

    def rows(w: int, g: int) -> Iterator[tuple[str, ...]]:
        for name in (*METRIC_COLUMNS, FAR_FROM_LANE):
            mean, unit = summary.statistics[name].mean, unit_of(name)
            cells = [mean.cell((m, w, g), unit) for m in range(len(summary.methods))]
            if set(cells) != {NONE}:
                yield (named(name), *cells)

    return _main_tables(summary, ": all metrics", ("metric", *summary.methods), rows)


def _main_tables(
    summary: Summary,
    what: str,
    header: tuple[str, ...],
    rows: Callable[[int, int], Iterable[tuple[str, ...]]],
) -> list[ReportTable]:
    """A table for each group on plain and on perturbed roads, where it has ``rows``.

    ``rows`` takes the places of the road and of the group.
    """
    return [
        ReportTable(
            title=f"{group.capitalize()}, {words} roads{what}",
            header=header,
            rows=found,
        )
        for g, group in enumerate(summary.groups)
        for road, words in ((PLAIN, "plain"), (PERTURBED, "perturbed"))
        if road in summary.roads
        if (found := tuple(rows(summary.roads.index(road), g)))
    ]


def road_tables(summary: Summary) -> list[ReportTable]:
    """Results by road condition, one table per group of related metrics."""
    if PERTURBED not in summary.roads:
        return []
    return [
        _road_table(summary, group, name)
        for group in ("movers", "movers on their way")
        for name in (MEDIAN, *BY_ROAD)
    ]


def _road_table(summary: Summary, group: str, name: str) -> ReportTable:
    g, roads = summary.groups.index(group), range(len(summary.roads))
    if name == MEDIAN:
        texts = [
            [_number(summary.median_final_m[m, w, g]) for w in roads]
            for m in range(len(summary.methods))
        ]
    else:
        mean, unit = summary.statistics[name].mean, unit_of(name)
        texts = [
            [mean.cell((m, w, g), unit, with_interval=False) for w in roads]
            for m in range(len(summary.methods))
        ]
    title = "median of lateral_deviation_final, m" if name == MEDIAN else named(name)
    return ReportTable(
        title=f"{group.capitalize()}, by road: {title}",
        header=("method", *summary.roads),
        rows=tuple(
            (method, *row) for method, row in zip(summary.methods, texts, strict=True)
        ),
    )


def definition_table() -> ReportTable:
    """Definitions and sources of all metrics."""
    rows = [
        (
            metric.name,
            metric.source,
            _shown_unit(metric.unit),
            metric.better,
            metric.definition,
        )
        for metric in METRICS.values()
        if metric.name in METRIC_COLUMNS
    ]
    words = "Share of agents whose final lateral deviation exceeds 2 m."
    rows.append((FAR_FROM_LANE, "ours", "%", "lower", words))
    return ReportTable(
        title="Definitions",
        header=("metric", "source", "unit", "better", "definition"),
        rows=tuple(rows),
    )


def _number(value: float) -> str:
    return NONE if np.isnan(value) else f"{value:.2f}"


def unit_of(name: str) -> str:
    """Unit of a metric or of a metric derived from it."""
    return "share" if name == FAR_FROM_LANE else METRICS[name].unit


def named(name: str) -> str:
    """Name of a metric with its unit, marked if it is the paper's."""
    mark = " *paper*" if name in METRICS and METRICS[name].source == "paper" else ""
    return f"{name}, {_shown_unit(unit_of(name))}{mark}"


def _shown_unit(unit: str) -> str:
    return "%" if unit == "share" else unit
