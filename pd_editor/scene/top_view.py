"""Road and traffic seen from above, drawn to scale by matplotlib."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, UInt8

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.palette import LIGHT, Palette, Rgb, agent_color, parts_of_one
from pd_editor.scene.road_layers import DASH_M, GAP_M, RoadLayer, road_layers
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

DPI: Final = 100
"""Pixels of a picture per inch, of which a point is the 72nd part."""
FOCAL: Final = "Focal agent"
"""Its name in legends."""
TRAIL_S: Final = 3.0
"""How far the line ahead of an agent goes."""
RIM_POINTS: Final = 0.8
"""Width of the rim of the focal agent."""
_ARROW_M: Final = (1.4, 0.45)
"""Length and half of the width of a lane's arrow."""
_LEAST_POINTS: Final = 0.3
_GLASS: Final = np.array([[0.26, 0.42], [0.13, 0.34], [0.13, -0.34], [0.26, -0.42]])
"""Corners of a windscreen, in lengths and widths of a box."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """The part of the ground that a picture shows."""

    middle_m: Float[np.ndarray, "2"]
    half_m: Float[np.ndarray, "2"]
    """Half of its width and height."""

    def show_in(self, axes: "Axes") -> None:
        """Let axes show just this, without a border."""
        low, high = self.middle_m - self.half_m, self.middle_m + self.half_m
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_axis_off()

    def onto(self, ground: "Frame") -> "Frame":
        """The frame moved as little as lets it show no more beyond the ground than it must."""
        room = np.maximum(ground.half_m - self.half_m, 0.0)
        low, high = ground.middle_m - room, ground.middle_m + room
        return replace(self, middle_m=np.clip(self.middle_m, low, high))

    def holds(self, line: Float[np.ndarray, "_ D"]) -> bool:
        """Whether the box about a line touches it."""
        gap = np.maximum(
            line[:, :2].min(0) - self.middle_m, self.middle_m - line[:, :2].max(0)
        )
        return bool((gap <= self.half_m).all())


@dataclass(frozen=True, eq=False)
class TopView:
    """Draws a scenario with so many typographic points for a metre."""

    scenario: Scenario
    points_per_m: float
    palette: Palette = LIGHT

    @cached_property
    def _layers(self) -> list[RoadLayer]:
        return list(road_layers(self.scenario.road_map))

    def ground(self, place_m: Float[np.ndarray, "2"]) -> Frame:
        """All of the road, and a place that need not be on it."""
        lines = [one[:, :2] for layer in self._layers for one in layer.lines]
        points = np.concatenate([place_m[None], *lines])
        low, high = points.min(axis=0), points.max(axis=0)
        return Frame(middle_m=(low + high) / 2, half_m=(high - low) / 2)

    def road(self, frame: Frame) -> Iterator["Artist"]:
        """What is seen of the road in a frame, from the ground up."""
        from matplotlib.collections import LineCollection, PolyCollection

        for layer in self._layers:
            color = parts_of_one(getattr(self.palette, layer.color_name))
            lines = [
                one[:, :2] for one in layer.lines if len(one) > 1 and frame.holds(one)
            ]
            if layer.is_arrow:
                yield PolyCollection(list(_arrows(lines)), facecolors=color)
            elif layer.width_m is None:
                yield PolyCollection(lines, facecolors=color)
            else:
                width = max(layer.width_m * self.points_per_m, _LEAST_POINTS)
                # Matplotlib counts dashes in widths of their line.
                unit_m = width / self.points_per_m
                begin, dash = (
                    (DASH_M + GAP_M / 2) / unit_m,
                    (DASH_M / unit_m, GAP_M / unit_m),
                )
                dashes = (begin, dash) if layer.is_dashed else "-"
                yield LineCollection(
                    lines,
                    colors=color,
                    linewidths=width,
                    linestyles=[dashes],
                    capstyle="butt",
                )

    def traffic(self, step: float, *, trail_s: float = TRAIL_S) -> Iterator["Artist"]:
        """Stop lines, trajectories ahead and agents at a step, also between two steps."""
        from matplotlib.collections import LineCollection, PolyCollection

        scenario, agents = self.scenario, self.scenario.agents
        now = int(step)
        if scenario.signals:
            states = [
                SignalState(one.states[now])
                for one in scenario.signals
                for _ in one.lane_ids
            ]
            yield LineCollection(
                list(scenario.stop_lines_m()),
                colors=[parts_of_one(self.palette.signals[one]) for one in states],
                linewidths=max(0.4 * self.points_per_m, 1.0),
            )
        rows, boxes = _between(agents, step)
        colors = [
            parts_of_one(agent_color(scenario, self.palette, row)) for row in rows
        ]
        last = now + 1 + round(trail_s / scenario.time_axis.step_s)
        ahead = [
            np.concatenate(
                [boxes.position_m[n, None], _way(agents, row, now + 1, last)]
            )
            for n, row in enumerate(rows)
        ]
        yield LineCollection(
            ahead,
            colors=colors,
            linewidths=max(0.3 * self.points_per_m, 0.7),
            alpha=0.45,
            capstyle="round",
        )
        corners = list(boxes.corners_m())
        focal = agents.row_of.get(scenario.focal_id)
        yield PolyCollection(  # A rim, so that the focal agent is told without colours.
            [one for row, one in zip(rows, corners, strict=True) if row == focal],
            edgecolors=parts_of_one(self.palette.glass),
            linewidths=2 * RIM_POINTS,
        )
        yield PolyCollection(corners, facecolors=colors)
        is_long = boxes.size_m[:, 0] > 1.5 * boxes.size_m[:, 1]
        long = boxes[np.flatnonzero(is_long)]
        yield PolyCollection(
            list(_glass(long)), facecolors=parts_of_one(self.palette.glass), alpha=0.75
        )

    def line(self, line_m: Float[np.ndarray, "N 2"]) -> "Artist":
        """A line above the road: where an agent is to go."""
        from matplotlib.lines import Line2D

        color, width = parts_of_one(self.palette.plan), 0.25 * self.points_per_m
        return Line2D(*line_m.T, color=color, linewidth=max(width, 0.8))


def pixels(
    artists: Iterable["Artist"], frame: Frame, size_px: tuple[int, int], ground: Rgb
) -> UInt8[np.ndarray, "H W 4"]:
    """Draw artists from the ground up into a picture of a width and a height."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = size_px
    sheet = Figure((width / DPI, height / DPI), dpi=DPI, facecolor=parts_of_one(ground))
    canvas, axes = FigureCanvasAgg(sheet), sheet.add_axes((0, 0, 1, 1))
    frame.show_in(axes)
    for order, artist in enumerate(artists):
        artist.set_zorder(order)
        axes.add_artist(artist)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def roles_shown(
    scenario: Scenario, palette: Palette, rows: Sequence[int]
) -> Mapping[str, Rgb]:
    """Names and colours of the roles and kinds of some agents, for a legend."""
    names = {scenario.focal_id: FOCAL, EGO_ID: "Ego"}
    agents = scenario.agents
    found = {
        names.get(agents.ids[row], agents.kinds[row].label): agent_color(
            scenario, palette, row
        )
        for row in rows
    }
    order = [*names.values(), *(kind.label for kind in AgentKind)]
    return dict(sorted(found.items(), key=lambda one: order.index(one[0])))


def middle_of(
    scenario: Scenario, agent_id: str, step: float | None = None
) -> Float[np.ndarray, "2"]:
    """Where an agent is at a step, or at the nearest at which it is there.

    Without such an agent the middle of all agents, and without any the road's point
    nearest to its middle.
    """
    agents = scenario.agents
    step = scenario.current_step if step is None else step
    row = agents.row_of.get(agent_id)
    if row is not None and agents.is_valid[row].any():
        there = np.flatnonzero(agents.is_valid[row])
        place = agents.position_m[row, there]
        return np.array([np.interp(step, there, one) for one in place.T])
    rows = np.flatnonzero(agents.is_valid[:, int(step)])
    if len(rows):
        return np.median(agents.position_m[rows, int(step)], axis=0)
    return _middle_of_road(scenario.road_map)


def _middle_of_road(road_map: RoadMap) -> Float[np.ndarray, "2"]:
    lines = [one.centerline_m[:, :2] for one in road_map.lanes]
    if not lines:
        return np.zeros(2)
    points = np.concatenate(lines)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    # Between the roads of a large map there may be none to see.
    way = shapely.shortest_line(shapely.MultiLineString(lines), shapely.Point(middle))
    return np.array(way.coords[0])


def _between(agents: AgentTracks, step: float) -> tuple[list[int], Boxes]:
    """Rows of the agents that are there, and their boxes, moved on to the next step."""
    now, part = int(step), step % 1
    later = min(now + 1, agents.num_steps - 1)
    rows = np.flatnonzero(agents.is_valid[:, now])
    share = np.where(agents.is_valid[rows, later], part, 0.0)
    one, other = agents.at(rows, now), agents.at(rows, later)
    turn = wrap_angle(other.heading_rad - one.heading_rad)
    moved = share[:, None] * (other.position_m - one.position_m)
    boxes = Boxes(
        position_m=one.position_m + moved,
        heading_rad=one.heading_rad + share * turn,
        size_m=one.size_m,
    )
    return rows.tolist(), boxes


def _way(
    agents: AgentTracks, row: int, first: int, last: int
) -> Float[np.ndarray, "N 2"]:
    """Positions of a row from a step on, up to the first gap."""
    there: Bool[np.ndarray, "S"] = agents.is_valid[row, first:last]
    count = len(there) if there.all() else int(there.argmin())
    return agents.position_m[row, first : first + count]


def _glass(boxes: Boxes) -> Float[np.ndarray, "N 4 2"]:
    """Windscreens, by which one sees which way boxes head."""
    cos, sin = np.cos(boxes.heading_rad), np.sin(boxes.heading_rad)
    turn = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
    return boxes.position_m[:, None] + (_GLASS * boxes.size_m[:, None]) @ turn


def _arrows(lines: Iterable[np.ndarray]) -> Iterator[Float[np.ndarray, "3 2"]]:
    """Small arrows along the middles of lines."""
    length, half = _ARROW_M
    for line in lines:
        tail, tip = line[len(line) // 2 - 1], line[len(line) // 2]
        along = (tip - tail) / max(float(np.linalg.norm(tip - tail)), 1e-9)
        side = half * np.array([-along[1], along[0]])
        yield np.stack([tip - length * along - side, tip, tip - length * along + side])
