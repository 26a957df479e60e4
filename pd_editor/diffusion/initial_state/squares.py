"""The squares of a scene in which agents are placed, and which agents go where."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.diffusion.initial_state.attributes import AttributeRequest
from pd_editor.diffusion.initial_state.denoiser import InitialStateDenoiser
from pd_editor.diffusion.initial_state.pipeline import (
    Placing,
    SquareContent,
    new_agent_ids,
    new_agent_kinds,
    no_lanes,
    sample_agent_counts,
)
from pd_editor.diffusion.initial_state.state_encoding import POSITION_UNIT_M
from pd_editor.errors import GenerationError
from pd_editor.features.lane_tokens import (
    CROSSWALK_KIND,
    PIECE_LENGTH_M,
    lane_pieces,
)
from pd_editor.features.scene_features import AGENT_KINDS, scene_center
from pd_editor.generation import Region
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario

_OUTER_DENSITY: Final = 0.56
"""Road users for each metre of lane beyond the square around the focal agent, as a share
of those in it: recordings see less further out (11.2 against 19.9 per km, ``train``)."""
_OUTER_CELLS: Final = 1
"""Rings of squares around the one in the middle."""
_LEAST_LANE_M: Final = 15.0
"""A square with less lane than this is left out, unless it is the only one."""


@dataclass(frozen=True, kw_only=True)
class Square:
    """A part of the scene that the network places agents in at once."""

    region: Region
    lane_m: float
    """Length of the lanes in it."""
    density: float = 1.0
    """Share of the usual number of agents."""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Which agents are to be placed in a scene."""

    redrawn_ids: tuple[str, ...] = ()
    num_new_agents: Mapping[AgentKind, int]
    draws_num_agents: bool = False
    """Whether there are to be as many as suit the road, and at least those numbers."""
    density: float = 1.0
    """Share of the numbers of training squares that suits the road."""
    region: Region | None = None
    """None: the mapped road around the focal agent."""
    attributes: AttributeRequest


def squares_of(scenario: Scenario, region: Region | None) -> tuple[Square, ...]:
    """The squares that cover a region, or the road around the focal agent.

    None is larger than the network is trained on. Those without a lane are left out;
    the one around the focal agent, or the region's own middle, comes first.

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
        first, reach = np.zeros(2), _OUTER_CELLS + 0.5
    else:
        middle = np.array(region.center_m)
        per_side = int(np.ceil(region.half_side_m / POSITION_UNIT_M))
        half_side = region.half_side_m / per_side
        # An even number of squares has its middle at a corner.
        first, reach = np.full(2, 0.5 - per_side % 2 / 2), per_side / 2
    place = (points - middle) / (2 * half_side)
    inside = np.all(np.abs(place) <= reach, axis=1)
    cells, index = np.unique(
        np.rint(place[inside] - first), axis=0, return_inverse=True
    )
    lane_m = np.bincount(index.ravel(), length[inside], len(cells)) * PIECE_LENGTH_M
    if not len(cells):
        raise GenerationError(no_lanes(scenario, middle))
    enough = lane_m >= min(_LEAST_LANE_M, lane_m.max())
    cells, lane_m = cells[enough] + first, lane_m[enough]
    order = np.argsort(np.abs(cells).sum(axis=1), kind="stable")
    return tuple(
        Square(
            region=Region(
                center_m=tuple((middle + 2 * half_side * cells[row]).tolist()),
                half_side_m=half_side,
            ),
            lane_m=float(lane_m[row]),
            density=1.0
            if region is not None or not cells[row].any()
            else _OUTER_DENSITY,
        )
        for row in order
    )


def placings_of(
    model: InitialStateDenoiser,
    scenario: Scenario,
    placement: Placement,
    random: np.random.Generator,
) -> tuple[Placing, ...]:
    """What is placed in each square, in this order; squares without agents are left out.

    Agents that get another state stay in the square they are in. The number of new ones
    follows the length of the lanes, or what is usual on such roads.

    Raises:
        GenerationError: there are no lanes, or the model knows no usual numbers.
    """
    squares = squares_of(scenario, placement.region)
    redrawn = _squares_of_resampled(scenario, placement, squares, random)
    kinds = _kinds_by_square(model, scenario, placement, squares, random)
    ids = new_agent_ids(scenario, sum(map(len, kinds)))
    placings: list[Placing] = []
    first = 0
    for index, square in enumerate(squares):
        count = len(kinds[index])
        placings.append(
            Placing(
                redrawn_ids=redrawn[index],
                new_ids=ids[first : first + count],
                new_kinds=kinds[index],
                region=square.region,
                traits=placement.attributes,
                square=index,
            )
        )
        first += count
    return tuple(one for one in placings if one.ids)


def _squares_of_resampled(
    scenario: Scenario,
    placement: Placement,
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[tuple[str, ...]]:
    """Ids by square: where each agent is, else anywhere along the lanes."""
    ids = placement.redrawn_ids
    if len(squares) == 1 or not ids:
        return [ids, *[()] * (len(squares) - 1)]
    agents, step = scenario.agents, scenario.current_step
    rows = agents.rows(ids)
    center = np.array([one.region.center_m for one in squares])
    half = np.array([one.region.half_side_m for one in squares])
    offset = agents.position_m[rows, step][:, None] - center
    outside = np.abs(offset).max(axis=2) - half
    found = outside.argmin(axis=1)
    # In the nearest square, those of other streets would crowd the edges of the map.
    is_inside = agents.is_valid[rows, step] & (outside.min(axis=1) <= 0)
    anywhere = _spread(len(ids), squares, random)
    found = np.where(is_inside, found, anywhere)
    return [
        tuple(name for name, place in zip(ids, found, strict=True) if place == index)
        for index in range(len(squares))
    ]


def _kinds_by_square(
    model: InitialStateDenoiser,
    scenario: Scenario,
    placement: Placement,
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[tuple[AgentKind, ...]]:
    """Kinds of the new agents of each square."""
    numbers: list[dict[AgentKind, int]] = [{} for _ in squares]
    if placement.draws_num_agents:
        numbers = _missing_numbers(model, scenario, placement, squares, random)
    for kind, number in placement.num_new_agents.items():
        missing = number - sum(one.get(kind, 0) for one in numbers)
        for index in _spread(max(missing, 0), squares, random):
            numbers[index][kind] = numbers[index].get(kind, 0) + 1
    return [new_agent_kinds(one) for one in numbers]


def _missing_numbers(
    model: InitialStateDenoiser,
    scenario: Scenario,
    placement: Placement,
    squares: Sequence[Square],
    random: np.random.Generator,
) -> list[dict[AgentKind, int]]:
    """Agents that each square lacks of what suits its road.

    The traffic of the first square is sampled; that of the others is as dense. At the
    edge of a map no square of training is alike.
    """
    only_on_road = placement.attributes.only_on_road
    contents = [
        SquareContent.of(scenario, one.region, only_on_road=only_on_road)
        for one in squares
    ]
    first = contents[0]
    usual = sample_agent_counts(model, first, random, only_on_road=only_on_road)
    found: list[dict[AgentKind, int]] = []
    for square, content in zip(squares, contents, strict=True):
        share = placement.density
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
    return found


def _spread(
    number: int, squares: Sequence[Square], random: np.random.Generator
) -> Int[np.ndarray, "N"]:
    """Squares for some agents, as evenly along the lanes as can be, in any order."""
    if len(squares) == 1 or not number:
        return np.zeros(number, int)
    share = np.cumsum([one.lane_m * one.density for one in squares])
    place = (np.arange(number) + random.random()) / number
    return random.permutation(np.searchsorted(share / share[-1], place))
