"""Figures for papers: moments of a scene to scale, as vectors or pixels."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import ExportError
from pd_editor.scene.palette import Rgb, parts_of_one
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.top_view import Frame, TopView, middle_of, roles_shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

RADIUS_M: Final = 40.0
_POINTS_PER_MM: Final = 72 / 25.4
_GAP_MM, _TEXT_MM, _LEGEND_MM = 2.0, 4.5, 6.0
_WIDE: Final = 1.6
"""Width of a single moment in heights; several moments are squares."""
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
    row_mm = high_mm + _TEXT_MM
    size_mm = np.array([look.width_mm, row_mm * len(scenes) + _LEGEND_MM])
    half_m = look.radius_m * np.array([wide_mm / high_mm, 1.0])
    mm_per_m = high_mm / (2 * look.radius_m)
    sheet = Canvas(tuple(size_mm / 25.4), dpi=300)
    seen: dict[str, Rgb] = {}
    for row, (title, scenario) in enumerate(scenes.items()):
        view = TopView(scenario, mm_per_m * _POINTS_PER_MM)
        low_mm = size_mm[1] - (row + 1) * row_mm
        for column, step in enumerate(steps):
            begin = np.array([column * (wide_mm + _GAP_MM), low_mm]) / size_mm
            axes = sheet.add_axes((*begin, *np.array([wide_mm, high_mm]) / size_mm))
            axes.set_title(f"{title}t = {look.at_s[column]:g} s", loc="left", pad=3)
            agent, at = (
                (look.follow, step) if look.follow else (scenario.focal_id, None)
            )
            frame = Frame(middle_m=middle_of(scenario, agent, at), half_m=half_m)
            seen |= _draw(axes, view, frame, step, has_names=look.has_names)
    _add_legend(sheet, seen, mm_per_m, size_mm)
    return sheet


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
        raise ExportError(
            f"{scenario.scenario_id} has no original to compare with: its road is not "
            "warped by its recipe."
        )
    return replace(
        scenario,
        road_map=applied.original_road_map,
        agents=applied.original_agents,
        applied_warp=None,
    )


def _draw(
    axes: "Axes", view: TopView, frame: Frame, step: int, *, has_names: bool
) -> dict[str, Rgb]:
    """Draw a moment, and tell the roles that are seen and their colours."""
    frame.show_in(axes)
    agents = view.scenario.agents
    drawn = [*view.road(frame), *view.traffic(step)]
    for order, artist in enumerate(drawn):
        artist.set_zorder(order)
        axes.add_artist(artist)
        artist.set_clip_path(axes.patch)
    offset = np.abs(agents.position_m[:, step] - frame.middle_m)
    inside = agents.is_valid[:, step] & (offset <= frame.half_m).all(axis=1)
    rows = np.flatnonzero(inside).tolist()
    for row in rows if has_names else ():
        axes.annotate(
            agents.ids[row],
            agents.position_m[row, step] + (0.0, agents.radius_m[row]),
            ha="center",
            va="bottom",
            fontsize=5,
            zorder=len(drawn),
        )
    return dict(roles_shown(view.scenario, view.palette, rows))


def _add_legend(
    sheet: "Canvas",
    seen: dict[str, Rgb],
    mm_per_m: float,
    size_mm: Float[np.ndarray, "2"],
) -> None:
    """Colours at the lower left, a bar of the scale at the lower right."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    width_mm, height_mm = size_mm.tolist()
    bar_m = max(
        one for one in _BAR_STEPS_M if one == 1 or one * mm_per_m < width_mm / 5
    )
    high = _LEGEND_MM / 2 / height_mm
    ends = 1 - (bar_m * mm_per_m + 1) / width_mm, 1 - 1 / width_mm
    sheet.add_artist(
        Line2D(ends, (high, high), color="black", linewidth=1.5, solid_capstyle="butt")
    )
    sheet.text(ends[0] - 1 / width_mm, high, f"{bar_m} m", ha="right", va="center")
    if seen:
        sheet.legend(
            handles=[
                Patch(color=parts_of_one(color), label=name)
                for name, color in seen.items()
            ],
            loc="lower left",
            bbox_to_anchor=(0, 0),
            ncols=len(seen),
            frameon=False,
            handlelength=1.2,
            handleheight=0.6,
            columnspacing=1.2,
            borderaxespad=0.3,
        )
