"""Figures for papers: moments of a scene to scale, as vectors or pixels."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import ExportError
from pd_editor.scene.palette import LIGHT, Rgb, parts_of_one
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.top_view import (
    FOCAL,
    RIM_POINTS,
    TRAIL_S,
    Frame,
    TopView,
    middle_of,
    roles_shown,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

RADIUS_M: Final = 40.0
_POINTS_PER_MM: Final = 72 / 25.4
_GAP_MM, _EDGE_MM, _TEXT_MM, _LEGEND_MM, _LINE_MM = 2.0, 1.7, 4.5, 6.0, 3.8
_SIGN_MM, _BAR_TEXT_MM = 8.0, 15.0
"""Room of a sign of the legend, and of the words of the scale's bar."""
_WIDE: Final = 1.6
"""Width of a single moment in heights; several moments are squares."""
AHEAD: Final = f"Trajectory ahead ({TRAIL_S:g} s)"
_BAR_STEPS_M: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_STYLE: Final[dict[Any, Any]] = {
    # Type 42 fonts in PDF and outlines in SVG are what journals accept.
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "pd-editor",
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "axes.titlesize": 7.0,
}
_LEAST_MM, _MOST_MM = 20.0, 1000.0
_LEAST_RADIUS_M, _MOST_RADIUS_M = 2.0, 2000.0


@dataclass(frozen=True, kw_only=True)
class FigureLook:
    """What a figure shows, and how wide it is."""

    at_s: tuple[float, ...] = (0.0,)
    """Moments, in seconds after the current step, side by side."""
    follow: str = ""
    """Agent in the middle of each moment; empty: the place of the focal agent at t = 0."""
    radius_m: float = RADIUS_M
    """Half of the shown height."""
    width_mm: float = 180.0
    compares: bool = False
    """Whether the scene before its road was warped stands above it."""
    has_names: bool = False
    """Whether agents' ids are written beside them."""


def figure(scenario: Scenario, ending: str, look: FigureLook = FigureLook()) -> bytes:
    """Draw moments of a scene as PDF, SVG or PNG, equal bytes for equal scenes.

    Raises:
        ExportError: a moment, an agent or a size that cannot be drawn.
    """
    from matplotlib import rc_context

    scenes = {"": scenario}
    if look.compares:
        scenes = {"Original, ": _original(scenario), "Warped, ": scenario}
    steps = [_step_at(scenario, at_s) for at_s in look.at_s]
    check_view(scenario, look.follow, look.radius_m)
    if not steps or not _LEAST_MM <= look.width_mm <= _MOST_MM:
        raise ExportError(
            f"A figure needs a moment and a width of {_LEAST_MM:g} to {_MOST_MM:g} mm, "
            f"not {look.width_mm:g}."
        )
    subject = "Subject" if ending == "pdf" else "Description"
    about: dict[str, Any] = {subject: scenario.provenance.attribution or ""}
    if ending != "png":
        about["CreationDate" if ending == "pdf" else "Date"] = None
    sink = io.BytesIO()
    with rc_context(_STYLE):
        _sheet(scenes, steps, look).savefig(sink, format=ending, metadata=about)
    return sink.getvalue()


def _sheet(
    scenes: Mapping[str, Scenario], steps: Sequence[int], look: FigureLook
) -> "Canvas":
    """Scenes below each other, their moments side by side, a legend at the end."""
    from matplotlib.figure import Figure as Canvas

    wide_mm = (look.width_mm + _GAP_MM) / len(steps) - _GAP_MM
    high_mm = wide_mm / (_WIDE if len(steps) == 1 else 1.0)
    mm_per_m = high_mm / (2 * look.radius_m)
    half_m = look.radius_m * np.array([wide_mm / high_mm, 1.0])
    views = {
        title: TopView(scenario, mm_per_m * _POINTS_PER_MM)
        for title, scenario in scenes.items()
    }
    moments = [
        (f"{title}t = {at_s:g} s", view, _frame(view, half_m, look.follow, step), step)
        for title, view in views.items()
        for step, at_s in zip(steps, look.at_s, strict=True)
    ]
    seen: dict[str, Rgb] = {}
    for _, view, frame, step in moments:
        rows = _inside(view.scenario, frame, step)
        seen |= roles_shown(view.scenario, view.palette, rows)
    bar_m = max(
        one for one in _BAR_STEPS_M if one == 1 or one * mm_per_m < look.width_mm / 5
    )
    bar_mm = bar_m * mm_per_m
    num_columns, num_lines = _columns(
        [*seen, AHEAD], look.width_mm - bar_mm - _BAR_TEXT_MM
    )
    row_mm = high_mm + _TEXT_MM
    foot_mm = _LEGEND_MM + (num_lines - 1) * _LINE_MM
    size_mm = np.array([look.width_mm, row_mm * len(scenes) + foot_mm])
    sheet = Canvas(tuple(size_mm / 25.4), dpi=300)
    for index, (title, view, frame, step) in enumerate(moments):
        row, column = divmod(index, len(steps))
        low_mm = size_mm[1] - (row + 1) * row_mm
        begin = np.array([column * (wide_mm + _GAP_MM), low_mm]) / size_mm
        axes = sheet.add_axes((*begin, *np.array([wide_mm, high_mm]) / size_mm))
        axes.set_title(title, loc="left", pad=3, x=_EDGE_MM / wide_mm)
        _draw(axes, view, frame, step, has_names=look.has_names)
    _add_bar(sheet, bar_m, bar_mm / size_mm[0], foot_mm / 2 / size_mm[1])
    _add_legend(sheet, seen, num_columns)
    return sheet


def _frame(
    view: TopView, half_m: Float[np.ndarray, "2"], follow: str, step: int
) -> Frame:
    """An agent in the middle, or the focal agent at t = 0 and little beyond the map."""
    if follow:
        return Frame(middle_m=middle_of(view.scenario, follow, step), half_m=half_m)
    place = middle_of(view.scenario, view.scenario.focal_id)
    return Frame(middle_m=place, half_m=half_m).onto(view.ground(place))


def _inside(scenario: Scenario, frame: Frame, step: int) -> list[int]:
    """Rows of the agents in a frame."""
    offset = np.abs(scenario.agents.position_m[:, step] - frame.middle_m)
    there = scenario.agents.is_valid[:, step] & (offset <= frame.half_m).all(axis=1)
    return np.flatnonzero(there).tolist()


def check_view(scenario: Scenario, follow: str, radius_m: float) -> None:
    """Raise if there is no such agent to follow, or nothing to be seen.

    Raises:
        ExportError: there is not.
    """
    if follow and follow not in scenario.agents.row_of:
        raise ExportError(f"{scenario.scenario_id} has no agent {follow[:40]!r}.")
    if not _LEAST_RADIUS_M <= radius_m <= _MOST_RADIUS_M:
        raise ExportError(
            f"The radius of a picture is {_LEAST_RADIUS_M:g} to {_MOST_RADIUS_M:g} m, "
            f"not {radius_m:g}."
        )


def _step_at(scenario: Scenario, at_s: float) -> int:
    axis = scenario.time_axis
    first, last = (
        axis.step_s * (n - axis.current_step) for n in (0, scenario.last_step)
    )
    if not first <= at_s <= last:
        raise ExportError(
            f"{scenario.scenario_id} has no moment {at_s:g} s; its time is "
            f"{first:.1f} to {last:.1f} s."
        )
    return axis.current_step + round(at_s / axis.step_s)


def _original(scenario: Scenario) -> Scenario:
    """The scene before its road was warped."""
    applied = scenario.applied_warp
    if applied is None:
        why = "expected the recipe.json of a scene whose road it warps"
        if scenario.is_warped:
            why = "its files have the warped road alone; pd-editor render reads its recipe"
        raise ExportError(
            f"{scenario.scenario_id} has no original to compare with; {why}."
        )
    return replace(
        scenario,
        road_map=applied.original_road_map,
        agents=applied.original_agents,
        applied_warp=None,
    )


def _draw(
    axes: "Axes", view: TopView, frame: Frame, step: int, *, has_names: bool
) -> None:
    """Draw a moment."""
    frame.show_in(axes)
    agents = view.scenario.agents
    drawn = [*view.road(frame), *view.traffic(step)]
    for order, artist in enumerate(drawn):
        artist.set_zorder(order)
        axes.add_artist(artist)
        artist.set_clip_path(axes.patch)
    for row in _inside(view.scenario, frame, step) if has_names else ():
        axes.annotate(
            agents.ids[row],
            agents.position_m[row, step] + (0.0, agents.radius_m[row]),
            ha="center",
            va="bottom",
            fontsize=5,
            zorder=len(drawn),
        )


def _columns(labels: Sequence[str], room_mm: float) -> tuple[int, int]:
    """Columns and lines of a legend of some width."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=_STYLE["font.size"])
    wide_mm = [
        text_to_path.get_text_width_height_descent(one, font, False)[0] / _POINTS_PER_MM
        + _SIGN_MM
        for one in labels
    ]
    for count in range(len(labels), 1, -1):
        columns = np.array_split(wide_mm, count)
        if sum(one.max() for one in columns) <= room_mm:
            return count, max(map(len, columns))
    return 1, len(labels)


def _add_bar(sheet: "Canvas", bar_m: int, wide: float, high: float) -> None:
    """A bar of the scale at the lower right; ``wide`` and ``high`` are shares."""
    from matplotlib.lines import Line2D

    edge = _EDGE_MM / 25.4 / sheet.get_figwidth()
    ends = 1 - edge - wide, 1 - edge
    sheet.add_artist(
        Line2D(ends, (high, high), color="black", linewidth=1.5, solid_capstyle="butt")
    )
    sheet.text(ends[0] - edge / 2, high, f"{bar_m} m", ha="right", va="center")


def _add_legend(sheet: "Canvas", seen: Mapping[str, Rgb], num_columns: int) -> None:
    """Colours of agents and of the lines ahead of them, at the lower left."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if not seen:
        return
    signs: list[Patch | Line2D] = [
        Patch(
            facecolor=parts_of_one(color),
            edgecolor=parts_of_one(LIGHT.glass if name == FOCAL else color),
            linewidth=RIM_POINTS,
            label=name,
        )
        for name, color in seen.items()
    ]
    ahead = parts_of_one(LIGHT.past)
    signs.append(Line2D((), (), color=ahead, alpha=0.6, linewidth=1.5, label=AHEAD))
    sheet.legend(
        handles=signs,
        loc="lower left",
        bbox_to_anchor=(0, 0),
        ncols=num_columns,
        frameon=False,
        handlelength=1.2,
        handleheight=0.6,
        columnspacing=1.2,
        borderaxespad=0.3,
    )
