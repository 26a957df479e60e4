"""Tables of a report, with text in cells, and its figures as SVG."""

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pd_editor.analysis.metrics.values import METRICS
from pd_editor.experiments.evaluation.evaluation_task import PLAIN, RoadCondition
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.scene_rows import METRIC_COLUMNS
from pd_editor.experiments.evaluation.summary import FAR_FROM_LANE, PERTURBED, Summary
from pd_editor.experiments.report import NONE, Figure, ReportTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
            cells.insert(of_median, summary.median_final.cell((m, w, g), "m"))
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
            found = [(summary.statistics[name], unit_of(name)) for name in COMPARED]
            yield (
                method,
                # Not all have all metrics: pedestrians have no lane.
                str(max(one.num_pairs[m, w, g] for one, _ in found)),
                *(
                    one.difference.cell((m, w, g), unit, signed=True)
                    for one, unit in found
                ),
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
        shown, unit = summary.median_final, "m"
        title = "median of lateral_deviation_final, m"
    else:
        shown, unit = summary.statistics[name].mean, unit_of(name)
        title = named(name)
    return ReportTable(
        title=f"{group.capitalize()}, by road: {title}",
        header=("method", *summary.roads),
        rows=tuple(
            (
                method,
                *(shown.cell((m, w, g), unit, with_interval=False) for w in roads),
            )
            for m, method in enumerate(summary.methods)
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


def unit_of(name: str) -> str:
    """Unit of a metric or of a metric derived from it."""
    return "share" if name == FAR_FROM_LANE else METRICS[name].unit


def named(name: str) -> str:
    """Name of a metric with its unit, marked if it is the paper's."""
    mark = " *paper*" if name in METRICS and METRICS[name].source == "paper" else ""
    return f"{name}, {_shown_unit(unit_of(name))}{mark}"


def _shown_unit(unit: str) -> str:
    return "%" if unit == "share" else unit


SHOWN: Final = (
    "lateral_deviation_final",
    FAR_FROM_LANE,
    "new_overlap",
    "path_length",
    "ade",
    "end_spread",
)
PLACING_SHOWN: Final = (
    "init_overlap",
    "init_off_road_4m",
    "speed",
    "lateral_deviation_final",
    "new_overlap",
    "path_length",
)
"""Metrics of the figures where initial states are sampled."""
COLORS: Final = ("#333333", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
"""Palette of Okabe and Ito, which colour-blind readers can distinguish."""
_GROUP: Final = "movers on their way"
FIGURE_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",  # Text stays text.
    "svg.hashsalt": "pd-editor",  # Equal figures, equal bytes.
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def figures_of(
    summary: Summary, conditions: Sequence[RoadCondition], shown: Sequence[str] = SHOWN
) -> tuple[Figure, ...]:
    """Figures that the road conditions allow, with a panel for each shown metric."""
    if not summary.num_agents[:, :, summary.groups.index(_GROUP)].any():
        return ()
    figures = [
        Figure(
            data=_intervals_svg(summary, shown),
            caption=f"{_GROUP.capitalize()}: means with intervals. Filled: plain roads; "
            "hollow: perturbed roads.",
        )
    ]
    kinds = dict.fromkeys(one.kind for one in conditions if not one.is_plain)
    by_kind = {
        kind: sorted(
            (one for one in conditions if one.kind == kind or one.is_plain),
            key=lambda one: one.power,
        )
        for kind in kinds
    }
    by_kind = {kind: roads for kind, roads in by_kind.items() if len(roads) > 2}
    if by_kind:
        figures.append(
            Figure(
                data=_powers_svg(summary, by_kind),
                caption=f"{_GROUP.capitalize()}: median final lateral deviation, m, by "
                "power of the bend; 0 is the plain road.",
            )
        )
    return tuple(figures)


def _intervals_svg(summary: Summary, shown: Sequence[str]) -> bytes:
    """Panels by metric, with a row for each method."""
    panels = Panels(len(shown), 0.7 + 0.3 * len(summary.methods))
    rows = np.arange(len(summary.methods))
    roads = [road for road in (PLAIN, PERTURBED) if road in summary.roads]
    for axes, name in zip(panels.axes, shown, strict=True):
        mean, scale = summary.statistics[name].mean, 1.0
        if unit_of(name) == "share":
            scale = 100.0
        for number, road in enumerate(roads):
            at = (rows, summary.roads.index(road), summary.groups.index(_GROUP))
            value, low, high = (
                scale * part[at] for part in (mean.value, mean.low, mean.high)
            )
            for row in rows[np.isfinite(value)]:
                color = COLORS[row % len(COLORS)]
                y = row + 0.14 * (2 * number - 1) * (len(roads) > 1)
                axes.plot([low[row], high[row]], [y, y], color=color)
                fill = color if road == PLAIN else "white"
                axes.plot(
                    value[row],
                    y,
                    "o",
                    color=color,
                    markerfacecolor=fill,
                    ms=5,
                    clip_on=False,
                )
        axes.set_title(named(name).replace(" *paper*", ""), loc="left", weight="bold")
        axes.set_yticks(rows, summary.methods)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlim(left=0)
        axes.grid(axis="x", color="#eeeeee")
    return panels.svg()


def _powers_svg(summary: Summary, by_kind: dict[str, list[RoadCondition]]) -> bytes:
    """Panels by kind of warp, with a line for each method."""
    panels = Panels(len(by_kind), 2.4)
    median = summary.median_final.value[:, :, summary.groups.index(_GROUP)]
    for axes, (kind, roads) in zip(panels.axes, by_kind.items(), strict=True):
        columns = [summary.roads.index(one.label) for one in roads]
        for row, method in enumerate(summary.methods):
            axes.plot(
                [one.power for one in roads],
                median[row, columns],
                marker=".",
                color=COLORS[row % len(COLORS)],
                label=method,
            )
        axes.set_title(kind, loc="left", weight="bold")
        axes.set_ylim(0, 1.05 * max(float(np.nanmax(median, initial=0)), 0.01))
        axes.grid(color="#eeeeee")
    panels.legend()
    return panels.svg()


class Panels:
    """Panels of equal size side by side, rendered without a display."""

    def __init__(
        self, count: int, height: float, columns: int = 3, *, shares_y: bool = False
    ) -> None:
        """Make the panels; those that share their heights are as high as the highest."""
        from matplotlib import rc_context
        from matplotlib.figure import Figure as Canvas
        from matplotlib.layout_engine import ConstrainedLayoutEngine

        columns = min(count, columns)
        rows = -(-count // columns)
        with rc_context(FIGURE_STYLE):
            self._canvas = Canvas(
                (3.8 * columns, height * rows),
                layout=ConstrainedLayoutEngine(h_pad=0.1, w_pad=0.1),
            )
            self.axes: list[Axes] = []
            for index in range(count):
                first = self.axes[0] if shares_y and self.axes else None
                added = self._canvas.add_subplot(rows, columns, index + 1, sharey=first)
                if first is not None:
                    added.label_outer()
                self.axes.append(added)

    def legend(self) -> None:
        """Add a legend beside the panels."""
        lines, names = self.axes[0].get_legend_handles_labels()
        self._canvas.legend(lines, names, loc="outside right upper", frameon=False)

    def svg(self) -> bytes:
        """Render the panels as SVG."""
        from matplotlib import rc_context

        sink = io.BytesIO()
        with rc_context(FIGURE_STYLE):
            self._canvas.savefig(sink, format="svg", metadata={"Date": None})
        return sink.getvalue()
