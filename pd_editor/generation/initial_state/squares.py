"""Squares of a scene with the agents to place there, and which of them fit."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.analysis.repair.current_states import counted
from pd_editor.analysis.repair.state_repairs import overlaps_now
from pd_editor.base.errors import GenerationError
from pd_editor.generation.features.map_pieces import (
    CROSSWALK_KIND,
    PIECE_LENGTH_M,
    lane_pieces,
)
from pd_editor.generation.features.scene_features import AGENT_KINDS, scene_center
from pd_editor.generation.initial_state.attributes import AttributeRequest
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.initial_state.pipeline import (
    SquareContent,
    SquarePlacement,
    new_agent_ids,
    new_agent_kinds,
    no_lanes,
    sample_agent_counts,
)
from pd_editor.generation.initial_state.placement_rules import ConflictSearch, KeptPaths
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import GenerationRequest, Region, TrafficSample
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario

_OUTER_DENSITY: Final = 0.56
"""Density of road users beyond the square around the focal agent, relative to that in it:
recordings observe fewer agents further out (11.2 against 19.9 per km, ``train``)."""
_MOST_IN_ORDER: Final = 128
"""Largest number of agents whose squares are sampled one after another. Of more, the
squares of each of four colours are one turn, and are where the agents are."""


@dataclass(frozen=True, kw_only=True)
class Square:
    """Part of a scene in which the network samples agents jointly."""

    region: Region
    lane_m: float
    """Length of the lanes in the square."""
    density: float = 1.0
    """Factor of the usual number of agents."""
    color: int = 0
    """Squares of one colour, 0 to 3, do not touch."""


def squares_of(
    scenario: Scenario,
    region: Region | None,
    further_m: Float[np.ndarray, "N 2"] | None = None,
) -> tuple[Square, ...]:
    """Divide a region, or the road around the focal agent, into squares.

    Squares are at most as large as in training. Those without a lane are left out; the
    one around the focal agent, or the region's centre, comes first. Without a region
    there are more around ``further_m``, which get no new agents.

    Raises:
        GenerationError: there are no lanes; the sentence says where they are.
    """
    if region is not None and region.half_side_m <= POSITION_UNIT_M:
        return (Square(region=region, lane_m=0.0),)
    pieces = lane_pieces(scenario.road_map)
    is_lane = pieces.kind < CROSSWALK_KIND
    points, length = pieces.pose[is_lane, :2], pieces.shape[is_lane, 0]
    if region is None:
        middle, half_side = scene_center(scenario), POSITION_UNIT_M
        # One ring of squares around the central one.
        first, reach = np.zeros(2), 1.5
    else:
        middle = np.array(region.center_m)
        per_side = int(np.ceil(region.half_side_m / POSITION_UNIT_M))
        half_side = region.half_side_m / per_side
        # The centre of an even number of squares is a corner.
        first, reach = np.full(2, 0.5 - per_side % 2 / 2), per_side / 2
    place = (points - middle) / (2 * half_side)
    inside = np.all(np.abs(place) <= reach, axis=1)
    if region is None and further_m is not None:
        others = np.rint((further_m - middle) / (2 * half_side))
        inside |= (np.rint(place)[:, None] == others).all(axis=2).any(axis=1)
    cells, index = np.unique(
        np.rint(place[inside] - first), axis=0, return_inverse=True
    )
    lane_m = np.bincount(index.ravel(), length[inside], len(cells)) * PIECE_LENGTH_M
    if not len(cells):
        raise GenerationError(no_lanes(scenario, middle))
    # Squares with a shorter length of lanes are left out, unless there is only one.
    enough = lane_m >= min(15.0, lane_m.max())
    colors = cells[enough] % 2 @ [1, 2]
    cells, lane_m = cells[enough] + first, lane_m[enough]
    is_far = np.any(np.abs(cells) > reach, axis=1)
    order = np.lexsort([np.abs(cells).sum(axis=1), is_far])
    return tuple(
        Square(
            region=Region(
                center_m=tuple((middle + 2 * half_side * cells[row]).tolist()),
                half_side_m=half_side,
            ),
            lane_m=float(lane_m[row]),
            density=1.0
            if region is not None or not cells[row].any()
            else _OUTER_DENSITY * (not is_far[row]),
            color=int(colors[row]),
        )
        for row in order
    )


def placings_of(
    model: InitialStateDenoiser,
    request: GenerationRequest,
    density: float,
    random: np.random.Generator,
) -> tuple[SquarePlacement, ...]:
    """Assign the agents of a request to squares, in order; empty squares are left out.

    Resampled agents stay in their squares. New agents are distributed by the length of
    lanes, or by the numbers that the model samples, times the density.

    Raises:
        GenerationError: there are no lanes, or the model has no counts of agents.
    """
    further, scenario = None, request.scenario
    resampled_ids = request.resampled_state_ids
    if len(resampled_ids) > _MOST_IN_ORDER:
        rows = scenario.agents.rows(resampled_ids)
        further = scenario.agents.position_m[rows, scenario.current_step]
    squares = squares_of(scenario, request.region, further)
    resampled = _squares_of_resampled(scenario, resampled_ids, squares, random)
    kinds = _kinds_by_square(model, request, density, squares, random)
    ids = new_agent_ids(scenario, sum(map(len, kinds)))
    in_turns = len(resampled_ids) + len(ids) > _MOST_IN_ORDER
    traits = AttributeRequest.of(request)
    placings: list[SquarePlacement] = []
    first = 0
    for index, square in enumerate(squares):
        count = len(kinds[index])
        placings.append(
            SquarePlacement(
                resampled_ids=resampled[index],
                new_ids=ids[first : first + count],
                new_kinds=kinds[index],
                region=square.region,
                traits=traits,
                square=index,
                turn=square.color if in_turns else None,
            )
        )
        first += count
    return tuple(one for one in placings if one.ids)


def _squares_of_resampled(
    scenario: Scenario,
    ids: tuple[str, ...],
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[tuple[str, ...]]:
    """Ids of resampled agents by square: their own, or else one along the lanes."""
    if len(squares) == 1 or not ids:
        return [ids, *[()] * (len(squares) - 1)]
    agents, step = scenario.agents, scenario.current_step
    rows = agents.rows(ids)
    center = np.array([one.region.center_m for one in squares])
    half = np.array([one.region.half_side_m for one in squares])
    offset = agents.position_m[rows, step][:, None] - center
    outside = np.abs(offset).max(axis=2) - half
    found = outside.argmin(axis=1)
    # In the nearest square, agents of other streets would be at the edges of the map.
    is_inside = agents.is_valid[rows, step] & (outside.min(axis=1) <= 0)
    anywhere = _spread(len(ids), squares, random)
    found = np.where(is_inside, found, anywhere)
    return [
        tuple(name for name, place in zip(ids, found, strict=True) if place == index)
        for index in range(len(squares))
    ]


def _kinds_by_square(
    model: InitialStateDenoiser,
    request: GenerationRequest,
    density: float,
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[tuple[AgentKind, ...]]:
    numbers: list[dict[AgentKind, int]] = [{} for _ in squares]
    if request.samples_num_agents:
        numbers = _missing_numbers(model, request, density, squares, random)
    for kind, number in request.num_new_agents.items():
        missing = number - sum(one.get(kind, 0) for one in numbers)
        for index in _spread(max(missing, 0), squares, random):
            numbers[index][kind] = numbers[index].get(kind, 0) + 1
    return [new_agent_kinds(one) for one in numbers]


def _missing_numbers(
    model: InitialStateDenoiser,
    request: GenerationRequest,
    density: float,
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[dict[AgentKind, int]]:
    """Numbers of agents that each square lacks to its sampled total.

    The numbers of the first square are sampled; the other squares have the same density,
    because training squares are not similar to the edge of a map.
    """
    only_on_road = request.only_on_road
    contents = [
        SquareContent.of(request.scenario, one.region, only_on_road=only_on_road)
        for one in squares
        if one.density
    ]
    first = contents[0]
    usual = sample_agent_counts(model, first, random, only_on_road=only_on_road)
    found: list[dict[AgentKind, int]] = []
    # Squares without new agents come last.
    for square, content in zip(squares, contents, strict=False):
        share = density
        if content is not first:
            share *= square.density * content.lane_m / max(first.lane_m, 1.0)
        wanted = {
            kind: number if share == 1 else int(number * share + random.random())
            for kind, number in usual.items()
        }
        found.append(
            {
                kind: max(wanted.get(kind, 0) - int(present), 0)
                for kind, present in zip(AGENT_KINDS, content.num_present, strict=True)
            }
        )
    return [*found, *({} for _ in squares[len(found) :])]


def _spread(
    number: int, squares: Sequence[Square], random: np.random.Generator
) -> Int[np.ndarray, "N"]:
    """Sample squares for some agents, evenly distributed by the length of lanes."""
    if len(squares) == 1 or not number:
        return np.zeros(number, int)
    share = np.cumsum([one.lane_m * one.density for one in squares])
    place = (np.arange(number) + random.random()) / number
    return random.permutation(np.searchsorted(share / share[-1], place))


def limited(
    placings: Sequence[SquarePlacement], most_new: int, random: np.random.Generator
) -> tuple[SquarePlacement, ...]:
    """Placements with at most ``most_new`` new agents, of which any may be left out."""
    number = sum(len(one.new_ids) for one in placings)
    if number <= most_new:
        return tuple(placings)
    stays = np.zeros(number, bool)
    stays[random.permutation(number)[: max(most_new, 0)]] = True
    fewer: list[SquarePlacement] = []
    first = 0
    for one in placings:
        own = np.flatnonzero(stays[first : first + len(one.new_ids)]).tolist()
        first += len(one.new_ids)
        fewer.append(
            replace(
                one,
                new_ids=tuple(one.new_ids[index] for index in own),
                new_kinds=tuple(one.new_kinds[index] for index in own),
            )
        )
    return tuple(one for one in fewer if one.ids)


def num_overlapping(scenario: Scenario, agent_ids: Collection[str]) -> int:
    """Number of some agents whose boxes overlap others at the current step."""
    rows = scenario.agents.rows(agent_ids)
    return len(np.intersect1d(overlaps_now(scenario), rows))


def without_overlapping(
    scenario: Scenario, new_ids: Sequence[str]
) -> tuple[Scenario, tuple[str, ...]]:
    """Remove new agents whose boxes overlap others, most overlaps first.

    Returns:
        The scenario, and the ids of the new agents that stay.
    """
    agents, pairs = scenario.agents, overlaps_now(scenario)
    is_new = np.isin(agents.ids, list(new_ids))
    pairs = pairs[is_new[pairs].any(axis=1)]
    gone: list[int] = []
    while len(pairs):
        number = np.bincount(pairs.ravel(), minlength=len(agents)) * is_new
        row = int(np.flatnonzero(number == number.max())[-1])
        gone.append(row)
        pairs = pairs[(pairs != row).all(axis=1)]
    return without_new(scenario, new_ids, {agents.ids[row] for row in gone})


def without_unfit(
    scenario: Scenario,
    new_ids: Sequence[str],
    admits: Callable[[Scenario, Sequence[str]], Sequence[str]],
    conflicts: ConflictSearch | None,
    kept: KeptPaths,
) -> Scenario:
    """Remove new agents that are not admitted, then those that break a placement rule."""
    stays = admits(scenario, new_ids)
    scenario, _ = without_new(scenario, new_ids, set(new_ids).difference(stays))
    if conflicts is None or not stays:
        return scenario
    gone = conflicts.conflicting(scenario, stays, np.random.default_rng(0), kept)
    return without_new(scenario, stays, gone)[0]


def without_new(
    scenario: Scenario, new_ids: Sequence[str], gone: Collection[str]
) -> tuple[Scenario, tuple[str, ...]]:
    """Remove those of the new agents that are in ``gone``; returns as above."""
    names = tuple(name for name in new_ids if name in gone)
    if not names:
        return scenario, tuple(new_ids)
    # Left-out agents were never in the scenario, so their ids are free.
    kept = replace(scenario.without_agents(names), retired_ids=scenario.retired_ids)
    return kept, tuple(name for name in new_ids if name not in names)


def colliding_with_kept(
    scenario: Scenario,
    sample: TrafficSample,
    placed_ids: Sequence[str],
    new_ids: Collection[str] = (),
) -> tuple[str, ...]:
    """Placed agents, new ones among them, that collide with agents with kept states."""
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(sample.ids)
    if not len(rows):
        return ()
    driven = sample.applied_to(agents, rows, now)
    pairs, _ = first_overlap(driven, np.arange(now, agents.num_steps))
    pairs = pairs[counted(driven, pairs)]
    is_placed = np.isin(agents.ids, list(placed_ids))
    # Whatever enters later at an agent's own place may be that agent, tracked again.
    late, old = LateAgents.of(scenario), rows[~np.isin(sample.ids, list(new_ids))]
    is_kept = ~is_placed
    is_kept[late.continuing(old).row] = False
    both = np.concatenate([pairs, pairs[:, ::-1]])
    hit = both[is_placed[both[:, 0]] & is_kept[both[:, 1]], 0]
    return tuple(agents.ids[row] for row in np.unique(hit))
