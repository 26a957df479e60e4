"""Terms on the drivable area."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch

from pd_editor.analysis.guidance.kinds.space import ROAD_STRIDE, StayOnRoad
from pd_editor.analysis.metrics.road import is_off_road, way_back_m
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    AgentsTerm,
    GuidedAgents,
    ResidualRows,
    TermMakers,
    row_weights,
    together,
)
from pd_editor.scene.geometry.oriented_box import box_corners

_FURTHEST_M: Final = 8.0
"""A box further outside is on another ground, such as a parking lot, and stays there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RoadTerm(AgentsTerm):
    """Moves boxes that would leave the road back by their worst corner."""

    @classmethod
    def of_guided(cls, guided: GuidedAgents[StayOnRoad]) -> "RoadTerm | None":
        """Make the term of agents that are on the road now; None if there is none."""
        context = guided.context
        tracks, now = context.scenario.agents, context.scenario.current_step
        rows = tracks.rows(context.ids[one] for one in guided.index.tolist())
        corners = box_corners(
            tracks.position_m[rows, now],
            tracks.heading_rad[rows, now],
            tracks.size_m[rows],
        )
        on_road = np.asarray(~is_off_road(context.scenario, corners).any(axis=-1))
        return cls(guided=guided.only(on_road)) if on_road.any() else None

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals of the boxes with a corner outside."""
        context = self.guided.context
        config, scenario = context.config, context.scenario
        position = motion.position_m[:, self.agents]
        tested = position[:, :, ::ROAD_STRIDE].double().cpu().numpy()
        heading = (
            motion.heading_rad[:, self.agents, ::ROAD_STRIDE].double().cpu().numpy()
        )
        size = motion.size_m[self.agents].double().cpu().numpy()
        corners = box_corners(
            tested, heading, np.broadcast_to(size[:, None], tested.shape)
        )
        shift = way_back_m(scenario, corners, heading)
        if not shift.any():
            return ()
        distance = np.linalg.norm(shift, axis=-1)
        worst = distance.argmax(axis=-1)[..., None]
        length = np.take_along_axis(distance, worst, axis=-1)[..., 0]
        direction = np.take_along_axis(shift, worst[..., None], axis=-2)[..., 0, :]
        direction /= np.maximum(length, 1e-9)[..., None]
        counts = (length > 0) & (length < _FURTHEST_M)
        wide = torch.zeros_like(position)
        wide[:, :, ::ROAD_STRIDE] = context.tensor(direction)
        asked = torch.zeros_like(position[..., 0])
        asked[:, :, ::ROAD_STRIDE] = context.tensor(length + config.goal_m)
        wanted = torch.zeros_like(asked, dtype=torch.bool)
        wanted[:, :, ::ROAD_STRIDE] = torch.from_numpy(counts).to(wanted.device)
        weight = row_weights(config.goal_m, self.guided.weight * ROAD_STRIDE, asked)
        return [
            ResidualRows(
                agents=self.agents,
                order=0,
                direction=wide,
                target=(wide * position).sum(-1) + asked,
                weight=torch.where(wanted, weight, 0.0),
            )
        ]


MAKERS: Final[TermMakers] = {StayOnRoad: together(RoadTerm.of)}
