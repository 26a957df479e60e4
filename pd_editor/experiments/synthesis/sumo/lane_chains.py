"""Chains of SUMO lanes, which join short junction lanes to others, and their centre lines."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from jaxtyping import Float

from pd_editor.scene.formats.sumo_net import SumoLane, SumoNet
from pd_editor.scene.geometry.angles import left_of
from pd_editor.scene.geometry.polyline import arc_length, resample, without_repeats
from pd_editor.scene.geometry.wide_line import WideLine, wide_line, with_end_normals
from pd_editor.scene.road_map import LaneKind


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneChain:
    """Consecutive SUMO lanes without a branch."""

    lanes: tuple[SumoLane, ...]
    main: SumoLane
    """The road's lane in the chain, or the longest lane within a junction."""
    is_intersection: bool

    @property
    def kind(self) -> LaneKind:
        """Kind of the chain's lanes."""
        assert self.main.kind is not None
        return self.main.kind


@dataclass(frozen=True, kw_only=True, eq=False)
class LaneChains:
    """All lanes for traffic, each in one chain."""

    chains: tuple[LaneChain, ...]
    chain_of: Mapping[str, int]
    """Index of the chain of each SUMO lane id."""
    next_of: Mapping[int, tuple[int, ...]]


def lane_chains(net: SumoNet) -> LaneChains:
    """Join the lanes of a net to chains, in the order of the file."""
    driven = {key: lane for key, lane in net.lanes.items() if lane.kind is not None}
    links = [link for link in net.links if link[0] in driven and link[1] in driven]
    after: dict[str, list[str]] = {key: [] for key in driven}
    before: dict[str, list[str]] = {key: [] for key in driven}
    for start, end in links:
        after[start].append(end)
        before[end].append(start)
    crossing = net.crossed_junctions
    joined = _joins(driven, after, before, crossing)
    has_front = set(joined.values())
    chains = []
    for key in driven:
        if key in has_front:
            continue
        keys = [key]
        while keys[-1] in joined:
            keys.append(joined[keys[-1]])
        chains.append(_chain([driven[k] for k in keys], crossing))
    chain_of = {
        lane.sumo_id: number
        for number, chain in enumerate(chains)
        for lane in chain.lanes
    }
    next_of = {
        number: tuple(chain_of[key] for key in after[chain.lanes[-1].sumo_id])
        for number, chain in enumerate(chains)
    }
    return LaneChains(chains=tuple(chains), chain_of=chain_of, next_of=next_of)


def _joins(
    driven: Mapping[str, SumoLane],
    after: Mapping[str, list[str]],
    before: Mapping[str, list[str]],
    crossing: set[str],
) -> dict[str, str]:
    """Next lane in the same chain, by lane."""
    joined: dict[str, str] = {}
    taken: set[str] = set()

    def join(first: str, second: str) -> None:
        if first not in joined and second not in taken:
            joined[first] = second
            taken.add(second)

    for key, lane in driven.items():
        if not lane.is_internal or not before[key] or not after[key]:
            continue
        front, back = before[key][0], after[key][0]
        if lane.junction in crossing:
            if driven[front].is_internal and len(after[front]) == 1:
                join(front, key)
        elif len(before[back]) == 1:
            join(key, back)
        elif len(after[front]) == 1:
            join(front, key)
    return joined


def _chain(lanes: list[SumoLane], crossing: set[str]) -> LaneChain:
    roads = [lane for lane in lanes if not lane.is_internal]
    main = roads[0] if roads else max(lanes, key=lambda lane: len(lane.shape_m))
    return LaneChain(
        lanes=tuple(lanes),
        main=main,
        is_intersection=not roads and main.junction in crossing,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
    """Start or end of a road's lane."""

    point_m: Float[np.ndarray, "2"]
    normal: Float[np.ndarray, "2"]
    width_m: float


def chain_lines(chains: LaneChains) -> list[WideLine]:
    """Centre line of each chain; junction lanes join the roads' lanes exactly."""
    front = {after: n for n, following in chains.next_of.items() for after in following}
    lines = []
    for number, chain in enumerate(chains.chains):
        before, after = front.get(number), chains.next_of[number]
        start = None if before is None else chains.chains[before].lanes[-1]
        end = chains.chains[after[0]].lanes[0] if after else None
        lines.append(_line(chain, start, end))
    return lines


def _line(
    chain: LaneChain, before: SumoLane | None, after: SumoLane | None
) -> WideLine:
    lanes = chain.lanes
    first = _joint(before, -1) if lanes[0].is_internal else None
    last = _joint(after, 0) if lanes[-1].is_internal else None
    points, widths = [], []
    at = 0
    for is_internal, group in groupby(lanes, key=lambda lane: lane.is_internal):
        run = tuple(group)
        if is_internal:
            start = first if at == 0 else _joint(lanes[at - 1], -1)
            at += len(run)
            end = last if at == len(lanes) else _joint(lanes[at], 0)
            line, width = _junction_run(run, start, end)
            points.append(line)
            widths.append(width)
        else:
            at += len(run)
            points += [lane.shape_m for lane in run]
            widths += [np.full(len(lane.shape_m), lane.width_m) for lane in run]
    return with_end_normals(
        wide_line(np.concatenate(points), np.concatenate(widths)),
        None if first is None else first.normal,
        None if last is None else last.normal,
    )


def _joint(lane: SumoLane | None, row: int) -> _Joint | None:
    """Start (row 0) or end (row -1) of a road's lane."""
    if lane is None or lane.is_internal:
        return None
    points = without_repeats(lane.shape_m, 1e-3)
    ahead = points[1] - points[0] if row == 0 else points[-1] - points[-2]
    ahead = ahead / np.linalg.norm(ahead)
    return _Joint(
        point_m=points[row],
        normal=left_of(ahead),
        width_m=lane.width_m,
    )


def _junction_run(
    run: tuple[SumoLane, ...], start: _Joint | None, end: _Joint | None
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N"]]:
    """Points and widths through a junction, between two roads' lanes."""
    points = without_repeats(np.concatenate([lane.shape_m for lane in run]), 1e-3)
    if len(points) > 1:
        length = float(arc_length(points)[-1])
        # Points of lines through junctions are a metre apart.
        points = resample(points, max(int(np.ceil(length)) + 1, 5))
    along = arc_length(points)
    fraction = (along / max(float(along[-1]), 1e-6))[:, None]
    # Offsets are eased in and out, so that lines join the roads' lanes without a kink.
    eased = fraction**2 * (3.0 - 2.0 * fraction)
    for joint, row, weight in ((start, 0, 1.0 - eased), (end, -1, eased)):
        if joint is not None:
            step = joint.point_m - points[row]
            # Larger lateral steps between lanes are kept: SUMO's cyclists turn at a
            # lane's edge.
            if np.linalg.norm(step) < 3.0:
                points = points + weight * step
    ends = [joint.width_m for joint in (start, end) if joint is not None]
    ends = ends or [run[0].width_m]
    width = ends[0] + fraction[:, 0] * (ends[-1] - ends[0])
    return points, width
