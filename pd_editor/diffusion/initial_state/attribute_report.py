"""Whether wishes about agents that were placed came true, in words."""

from collections.abc import Sequence

import numpy as np

from pd_editor.diffusion.initial_state.attributes import TraitWishes
from pd_editor.diffusion.initial_state.state_encoding import STANDING_SPEED_MPS
from pd_editor.metrics.map_points import map_points, nearest_points
from pd_editor.metrics.off_lane import OFF_LANE_M
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario


def trait_notes(
    placed: Sequence[tuple[Scenario, tuple[str, ...]]], wishes: TraitWishes
) -> tuple[str, ...]:
    """A sentence for each wish about the agents placed in some samples.

    None where nothing was wished or nobody placed.
    """
    count = sum(len(ids) for _, ids in placed)
    notes: list[str] = []
    if count and wishes.moving_share is not None:
        moving = sum(_num_moving(*one) for one in placed)
        notes.append(
            f"{moving} of {count} placed agents move ({moving / count:.0%}; "
            f"{wishes.moving_share:.0%} were asked for)."
        )
    if count and wishes.only_on_road:
        off = sum(_num_off_road(*one) for one in placed)
        notes.append(
            f"{off or 'None'} of {count} placed agents came to be off the road "
            f"(over {OFF_LANE_M:g} m from every centre line)."
        )
    return tuple(notes)


def _num_moving(scenario: Scenario, ids: tuple[str, ...]) -> int:
    agents = scenario.agents
    velocity = agents.velocity_mps[agents.rows(ids), scenario.current_step]
    return int((np.linalg.norm(velocity, axis=-1) >= STANDING_SPEED_MPS).sum())


def _num_off_road(scenario: Scenario, ids: tuple[str, ...]) -> int:
    agents = scenario.agents
    rows = agents.rows(ids)
    rows = rows[agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]]
    points_m = map_points(scenario.road_map).center_m
    position_m = agents.position_m[rows, scenario.current_step]
    return int((nearest_points(position_m, points_m)[1] > OFF_LANE_M).sum())
