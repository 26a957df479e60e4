"""What is drawn of the boundaries of lanes: each once, and the lines of its marking."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.road_map import LaneMark, RoadMap

MARKING_WIDTH_M: Final = 0.17
EDGE_WIDTH_M: Final = 0.08
DASH_M: Final = 3.0
GAP_M: Final = 6.0
"""Between dashes; lines begin with half of it."""
DOUBLE_LINE_OFFSET_M: Final = 0.17


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkedLines:
    """Lines on the ground that look alike."""

    color_name: str
    """A field of ``palette.Palette``."""
    width_m: float
    is_dashed: bool
    lines: Lines


def marked_lines(road_map: RoadMap, spacing_m: float) -> Iterator[MarkedLines]:
    """Boundaries of lanes as drawn, with points at most ``spacing_m`` apart.

    Of unmarked ones those outside intersections.
    """
    found = boundaries(road_map)
    marks = np.array([mark for mark, *_ in found])
    is_inside = np.array([inside for _, inside, _ in found], bool)
    lines = Lines.of([line for *_, line in found]).without_repeats()
    dense = lines.densified(spacing_m)
    for mark in map(LaneMark, np.unique(marks)):
        is_unmarked = mark in (LaneMark.NONE, LaneMark.UNKNOWN)
        alike = (marks == mark) & (lines.count > 1) & ~(is_unmarked & is_inside)
        some = dense.taken(alike)
        if is_unmarked:
            yield MarkedLines(
                color_name="lane_edge",
                width_m=EDGE_WIDTH_M,
                is_dashed=False,
                lines=some,
            )
            continue
        styles = line_styles(mark)
        offset = DOUBLE_LINE_OFFSET_M * (len(styles) - 1)
        for style, side in zip(styles, (offset, -offset), strict=False):
            yield MarkedLines(
                color_name="yellow_marking" if "YELLOW" in mark else "white_marking",
                width_m=MARKING_WIDTH_M,
                is_dashed=style == "dashed",
                lines=some.offset(side) if side else some,
            )


def boundaries(road_map: RoadMap) -> list[tuple[LaneMark, bool, np.ndarray]]:
    """Each boundary once, even if two lanes share it; marked versions take precedence."""
    found = [
        (mark, lane.is_intersection, line)
        for lane in road_map.lanes
        for mark, line in (
            (lane.left_mark, lane.left_m),
            (lane.right_mark, lane.right_m),
        )
    ]
    lines = Lines.of([line for *_, line in found])
    ends = np.round(2 * lines.points_m[lines.ends.T])
    lengths = np.round(lines.length_m)
    seen: dict[tuple, tuple[LaneMark, bool, np.ndarray]] = {}
    keys = zip(map(sorted, ends.tolist()), lengths.tolist(), strict=True)
    for one, ((start, end), length) in zip(found, keys, strict=True):
        key = (*start, *end, length)
        is_marked = one[0] not in (LaneMark.NONE, LaneMark.UNKNOWN)
        if key not in seen or (is_marked and seen[key][0] is LaneMark.NONE):
            seen[key] = one
    return list(seen.values())


def line_styles(mark: LaneMark) -> tuple[str, ...]:
    """Style of each marked line, from left to right."""
    if mark.startswith("DOUBLE_SOLID"):
        return ("solid", "solid")
    if mark.startswith("DOUBLE_DASH"):
        return ("dashed", "dashed")
    if mark.startswith("DASH_SOLID"):
        return ("dashed", "solid")
    if mark.startswith("SOLID_DASH"):
        return ("solid", "dashed")
    return ("dashed",) if mark.startswith("DASHED") else ("solid",)
