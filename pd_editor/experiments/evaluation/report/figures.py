"""Figures of a report as SVG: intervals of the main metrics, and deviation by power."""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pd_editor.experiments.evaluation.report.tables import named, unit_of
from pd_editor.experiments.evaluation.road_condition import PLAIN, RoadCondition
from pd_editor.experiments.evaluation.summary import FAR_FROM_LANE, PERTURBED, Summary
from pd_editor.experiments.report import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    median = summary.median_final_m[:, :, summary.groups.index(_GROUP)]
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
