"""Figures of a report as SVG: intervals of the main metrics, and deviation by power."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from pd_editor.evaluation.report.tables import named, unit_of
from pd_editor.evaluation.road_condition import PLAIN, RoadCondition
from pd_editor.evaluation.summary import FAR_FROM_LANE, PERTURBED, Summary

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
"""Where states are drawn."""
COLORS: Final = ("#333333", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
"""Okabe and Ito's, which colour-blind readers can tell apart."""
_LABELS_PX: Final = 130
_PLOT_PX: Final = 230
_ROW_PX: Final = 30
_TOP_PX: Final = 28
_BOTTOM_PX: Final = 24


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture with the words below it."""

    svg: str
    caption: str


def figures_of(
    summary: Summary,
    conditions: Sequence[RoadCondition],
    shown: Sequence[str] = SHOWN,
) -> tuple[Figure, ...]:
    """All figures that the roads allow; a panel for each metric that is shown."""
    group = "movers on their way"
    if not summary.num_agents[:, :, summary.groups.index(group)].any():
        return ()
    panels = "".join(_interval_panel(summary, name, group) for name in shown)
    figures = [
        Figure(
            svg=panels,
            caption=f"{group.capitalize()}: means with intervals. Filled: plain roads; "
            "hollow: perturbed roads.",
        )
    ]
    lines = _power_panels(summary, conditions, group)
    if lines:
        figures.append(
            Figure(
                svg=lines,
                caption=f"{group.capitalize()}: median final lateral deviation, m, by "
                "power of the bend; 0 is the plain road.",
            )
        )
    return tuple(figures)


def _interval_panel(summary: Summary, name: str, group: str) -> str:
    """One metric: a row for each method, a mark for plain and for perturbed roads."""
    g = summary.groups.index(group)
    roads = [road for road in (PLAIN, PERTURBED) if road in summary.roads]
    mean = summary.statistics[name].mean
    scale = 100.0 if unit_of(name) == "share" else 1.0
    chosen = np.ix_([summary.roads.index(road) for road in roads])[0]
    top = scale * np.nanmax(
        [np.nanmax(part[:, chosen, g], initial=0.0) for part in (mean.value, mean.high)]
    )
    axis = _Axis(highest=float(top))
    parts = [_text(0, 16, named(name).replace(" *paper*", ""), bold=True)]
    height = _TOP_PX + _ROW_PX * len(summary.methods)
    parts += axis.ticks_below(height)
    for m, method in enumerate(summary.methods):
        y = _TOP_PX + _ROW_PX * (m + 0.5)
        parts.append(_text(_LABELS_PX - 8, y + 4, method, anchor="end"))
        for number, road in enumerate(roads):
            at = (m, summary.roads.index(road), g)
            value, low, high = (
                scale * float(part[at]) for part in (mean.value, mean.low, mean.high)
            )
            if np.isnan(value):
                continue
            color, row = COLORS[m % len(COLORS)], y - 5 + 10 * number
            if not np.isnan(low):
                parts.append(_line(axis.x(low), row, axis.x(high), row, color))
            fill = color if road == PLAIN else "#ffffff"
            parts.append(
                f'<circle cx="{axis.x(value):.1f}" cy="{row:.1f}" r="3.5" '
                f'fill="{fill}" stroke="{color}" stroke-width="1.5"/>'
            )
    return _svg(height + _BOTTOM_PX, named(name), parts)


def _power_panels(
    summary: Summary, conditions: Sequence[RoadCondition], group: str
) -> str:
    """One panel for each kind of bend with several powers."""
    g = summary.groups.index(group)
    kinds = list(dict.fromkeys(one.kind for one in conditions if not one.is_plain))
    top = float(np.nanmax(summary.median_final_m[:, :, g], initial=0.0))
    panels = []
    for kind in kinds:
        shown = sorted(
            (one for one in conditions if one.kind == kind or one.is_plain),
            key=lambda one: one.power,
        )
        if len(shown) < 3:
            continue
        panels.append(_power_panel(summary, kind, shown, top, g))
    return "".join(panels)


def _power_panel(
    summary: Summary, kind: str, shown: Sequence[RoadCondition], top: float, g: int
) -> str:
    across = _Axis(lowest=shown[0].power, highest=shown[-1].power)
    up = _Axis(highest=top, start_px=190.0, length_px=-160.0)
    parts = [_text(0, 16, kind, bold=True), *across.ticks_below(190)]
    for tick in up.ticks():
        y = up.x(tick)
        parts.append(_line(_LABELS_PX, y, _LABELS_PX + _PLOT_PX, y, "#dddddd"))
        parts.append(_text(_LABELS_PX - 8, y + 4, f"{tick:g}", anchor="end"))
    for m, method in enumerate(summary.methods):
        color = COLORS[m % len(COLORS)]
        heights = [
            summary.median_final_m[m, summary.roads.index(one.label), g]
            for one in shown
        ]
        points = " ".join(
            f"{across.x(one.power):.1f},{up.x(float(height)):.1f}"
            for one, height in zip(shown, heights, strict=True)
            if not np.isnan(height)
        )
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{color}" '
            'stroke-width="2"/>'
        )
        parts.append(_text(0, 40 + 16 * m, method, color=color))
    return _svg(190 + _BOTTOM_PX, kind, parts)


@dataclass(frozen=True, kw_only=True)
class _Axis:
    """Numbers to pixels."""

    highest: float
    lowest: float = 0.0
    start_px: float = float(_LABELS_PX)
    length_px: float = float(_PLOT_PX)

    def x(self, value: float) -> float:
        """Place of a number."""
        span = (self.highest - self.lowest) or 1.0
        return self.start_px + self.length_px * (value - self.lowest) / span

    def ticks(self) -> list[float]:
        """Round numbers, three to seven of them."""
        span = (self.highest - self.lowest) or 1.0
        power = 10.0 ** np.floor(np.log10(span))
        step = next(s * power for s in (0.2, 0.5, 1.0, 2.0) if span / (s * power) <= 6)
        first = np.ceil(self.lowest / step)
        number = int(np.floor(self.highest / step + 1e-9) - first) + 1
        return [float((first + k) * step) for k in range(number)]

    def ticks_below(self, y_px: float) -> list[str]:
        """The axis with its numbers at the bottom of a plot."""
        parts = [
            _line(self.x(self.lowest), y_px, self.x(self.highest), y_px, "#999999")
        ]
        for tick in self.ticks():
            parts.append(_line(self.x(tick), y_px, self.x(tick), y_px + 4, "#999999"))
            parts.append(_text(self.x(tick), y_px + 17, f"{tick:g}", anchor="middle"))
        return parts


def _svg(height_px: float, title: str, parts: Sequence[str]) -> str:
    width = _LABELS_PX + _PLOT_PX + 20
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height_px}" '
        f'viewBox="0 0 {width} {height_px}" role="img" aria-label="{escape(title)}" '
        f'font-family="sans-serif" font-size="11">{"".join(parts)}</svg>'
    )


def _text(
    x_px: float,
    y_px: float,
    text: str,
    *,
    anchor: str = "start",
    color: str = "#222222",
    bold: bool = False,
) -> str:
    weight = ' font-weight="bold"' if bold else ""
    return (
        f'<text x="{x_px:.1f}" y="{y_px:.1f}" text-anchor="{anchor}" fill="{color}"'
        f"{weight}>{escape(text)}</text>"
    )


def _line(x1: float, y1: float, x2: float, y2: float, color: str) -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" '
        f'stroke="{color}" stroke-width="1.5"/>'
    )
