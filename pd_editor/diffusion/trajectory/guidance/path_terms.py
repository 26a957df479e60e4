"""Terms on the course of an agent: a path, lanes, a goal point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.diffusion.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.diffusion.trajectory.guidance.target_motion import (
    Curves,
    TargetMotion,
    braked_in_time,
    distances,
    extended,
    predicted_curves,
    speeds,
)
from pd_editor.diffusion.trajectory.guidance.trajectory_term import (
    ResidualRows,
    TermContext,
)
from pd_editor.paths.drawn_path import lane_line, path_to_follow
from pd_editor.paths.driving_paths import DrivingPaths
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.guidance_terms import FollowLane, FollowPath, GoalPoint

_PREFERENCE_M: Final = 1.0
"""How much nearer a planned path must come to a goal than the predicted path."""
_SAME_GOAL_M: Final = 0.5
_ROUNDS: Final = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class PathTerm:
    """Follows a path that begins at the agent's pose, at the predicted pace.

    A path that leads sideways or backwards is not followed.
    """

    context: TermContext
    agents: Int[Tensor, "1"]
    curves: Curves
    length_m: float
    """Arc length at which the path to follow ends."""
    limit_mps: Float[Tensor, "M"]
    """Speed limits of the path's curves, one per node."""
    weight: float
    is_closed: bool = True

    @classmethod
    def of_path(cls, term: FollowPath, context: TermContext) -> "PathTerm | None":
        """Make the term of a drawn path; None if the agent is not sampled."""
        return cls._of_line(term, np.array(term.points_m), context)

    @classmethod
    def of_lanes(cls, term: FollowLane, context: TermContext) -> "PathTerm | None":
        """Make the term of lanes; None if the agent is not sampled."""
        line = lane_line(context.scenario.road_map, term.lane_ids)
        return None if line is None else cls._of_line(term, line, context)

    @classmethod
    def _of_line(
        cls,
        term: FollowPath | FollowLane,
        line_m: Float[np.ndarray, "N 2"],
        context: TermContext,
    ) -> "PathTerm | None":
        agents = context.guided((term.agent_id,), ROAD_USER_KINDS)
        if not len(agents) or len(line_m) < 2:
            return None
        tracks, now = context.scenario.agents, context.scenario.current_step
        row = tracks.row_of[term.agent_id]
        followed = path_to_follow(
            line_m,
            tracks.position_m[row, now],
            float(tracks.heading_rad[row, now]),
            float(np.hypot(*tracks.velocity_mps[row, now])),
        )
        if not followed.is_drivable:
            return None
        return cls(
            context=context,
            agents=agents,
            curves=curves_of(followed.path, context),
            length_m=followed.length_m,
            limit_mps=context.tensor(followed.path.speed_limit_mps[0]),
            weight=term.weight,
        )

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to the points of the path at the predicted pace."""
        config = self.context.config
        pace = predicted_curves(motion, self.agents).along_m
        speed = speeds(
            pace, motion.velocity_mps[:, self.agents, 0].norm(dim=-1), motion.step_s
        )
        slowed = pace
        for _ in range(_ROUNDS):
            slowed = distances(
                braked_in_time(
                    speed.minimum(self._limits(slowed)),
                    config.max_braking_mps2,
                    motion.step_s,
                ),
                motion.step_s,
            )
        target = TargetMotion.along(self.agents, self.curves, slowed, motion.step_s)
        return target.rows(
            along_m=config.pace_m,
            across_m=config.path_m,
            strength=self.weight,
            is_wanted=slowed <= self.length_m,
        )

    def _limits(self, along_m: Float[Tensor, "S G T"]) -> Float[Tensor, "S G T"]:
        node = torch.searchsorted(self.curves.along_m[0, 0], along_m.contiguous())
        return self.limit_mps[node.clamp_max(len(self.limit_mps) - 1)]


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalTerm:
    """Reaches a point at a step, along the predicted path or a planned one.

    The path that comes nearest to the goal is retimed with the least change of
    acceleration, and shifted sideways to the goal. Of a goal out of reach, the nearest
    place in reach is aimed at.
    """

    context: TermContext
    agents: Int[Tensor, "1"]
    point_m: Float[Tensor, "2"]
    at_s: float | None
    weight: float
    is_closed: bool = True

    @classmethod
    def of(cls, term: GoalPoint, context: TermContext) -> "GoalTerm | None":
        """Make the term; None if the agent is not sampled."""
        agents = context.guided((term.agent_id,), ROAD_USER_KINDS)
        if not len(agents):
            return None
        return cls(
            context=context,
            agents=agents,
            point_m=context.tensor(np.array(term.point_m)),
            at_s=term.at_s,
            weight=term.weight,
        )

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to a way to the goal, and to the goal itself at its step."""
        config = self.context.config
        predicted = extended(
            predicted_curves(motion, self.agents), self.context, self.agents
        )
        num_steps = len(motion.time_s)
        step = num_steps - 1
        if self.at_s is not None:
            step = min(max(round(self.at_s / motion.step_s), 1), step)
        curves, goal_along, goal_left = self._curves(predicted)
        pace = predicted.along_m[..., :num_steps]
        share = motion.time_s / motion.time_s[step]
        early = share.clamp_max(1.0)
        # Least squared acceleration; then at the speed that was reached.
        growth = (3 * early**2 - early**3) / 2 + 1.5 * (share - early)
        goal_along, goal_left, is_reached = self._within_reach(
            goal_along, goal_left, motion, step
        )
        gap = goal_along[..., None] - pace[..., step, None]
        along = (pace + gap * growth).clamp_min(0.0).cummax(dim=-1).values
        target = TargetMotion.along(self.agents, curves, along, motion.step_s)
        done = (along / goal_along[..., None].clamp_min(1.0)).clamp(0, 1)
        aside = goal_left[..., None] * done**2 * (3 - 2 * done)
        left = torch.stack(
            [-target.direction[..., 1], target.direction[..., 0]], dim=-1
        )
        way = replace(target, position_m=target.position_m + aside[..., None] * left)
        is_goal = torch.arange(num_steps, device=along.device) == step
        nearest = way.position_m[..., step, None, :]
        place = torch.where(is_reached[..., None, None], self.point_m, nearest)
        goal = replace(way, position_m=place.expand_as(way.position_m))
        # The way matters up to the goal; at the goal it is one of many steps.
        every = motion.time_s <= motion.time_s[step]
        accepted = config.goal_m * (10.0 / num_steps) ** 0.5
        return [
            *way.rows(
                along_m=config.goal_way_m,
                across_m=config.goal_way_m,
                strength=self.weight if motion.level > 0 else 0.0,
                is_wanted=every.expand(along.shape),
            ),
            *goal.rows(
                along_m=accepted,
                across_m=accepted,
                strength=self.weight,
                is_wanted=is_goal.expand(along.shape),
            ),
        ]

    def _within_reach(
        self,
        along_m: Float[Tensor, "S 1"],
        left_m: Float[Tensor, "S 1"],
        motion: PredictedMotion,
        step: int,
    ) -> tuple[Float[Tensor, "S 1"], Float[Tensor, "S 1"], Bool[Tensor, "S 1"]]:
        """Place of the goal, moved to where the agent can be, and whether it stayed."""
        config, time_s = self.context.config, motion.time_s[step]
        speed = motion.velocity_mps[:, self.agents, 0].norm(dim=-1)
        most = speed * time_s + config.max_acceleration_mps2 * time_s.square() / 2
        braking_s = time_s.minimum(speed / config.max_braking_mps2)
        least = speed * braking_s - config.max_braking_mps2 * braking_s.square() / 2
        along = along_m.maximum(least).minimum(most)
        left = left_m.clamp(-config.goal_aside_m, config.goal_aside_m)
        stayed = (along - along_m).abs() + (left - left_m).abs() < _SAME_GOAL_M
        return along, left, stayed

    def _curves(
        self, predicted: Curves
    ) -> tuple[Curves, Float[Tensor, "S 1"], Float[Tensor, "S 1"]]:
        """The curve to the goal in each sample, with the goal's place on it."""
        along, left = predicted.nearest(self.point_m)
        planned, planned_along, planned_left = self._planned
        is_planned = left.abs() > planned_left.abs() + _PREFERENCE_M
        count = predicted.along_m.shape[-1]
        wide = _padded(planned, count)
        nodes = is_planned[..., None]
        return (
            Curves(
                points_m=torch.where(
                    nodes[..., None], wide.points_m, predicted.points_m
                ),
                along_m=torch.where(nodes, wide.along_m, predicted.along_m),
                direction=torch.where(
                    nodes[..., None], wide.direction, predicted.direction
                ),
            ),
            torch.where(is_planned, planned_along, along),
            torch.where(is_planned, planned_left, left),
        )

    @cached_property
    def _planned(self) -> tuple[Curves, Float[Tensor, "1 1"], Float[Tensor, "1 1"]]:
        """The planned path that comes nearest to the goal, and the goal's place on it."""
        points, exists = self.context.planned(self.agents)
        points, exists = points[0], exists[0]
        curves = _even_curves(points[None])
        along, left = curves.nearest(self.point_m)
        cost = left.abs() + (-along).clamp_min(0.0)
        best = cost[0].masked_fill(~exists, torch.inf).argmin()
        chosen = Curves(
            points_m=curves.points_m[:, best, None],
            along_m=curves.along_m[:, best, None],
            direction=curves.direction[:, best, None],
        )
        return chosen, along[:, best, None], left[:, best, None]


def curves_of(path: DrivingPaths, context: TermContext) -> Curves:
    """Driving paths as curves of one sample."""
    points = np.stack([path.x_m, path.y_m], axis=-1)
    return _even_curves(context.tensor(points)[None])


def _even_curves(points_m: Float[Tensor, "1 G M 2"]) -> Curves:
    step = points_m.diff(dim=-2)
    length = step.norm(dim=-1)
    direction = torch.nn.functional.normalize(step, dim=-1)
    return Curves(
        points_m=points_m,
        along_m=torch.nn.functional.pad(length.cumsum(dim=-1), (1, 0)),
        direction=torch.cat([direction[..., :1, :], direction], dim=-2),
    )


def _padded(curves: Curves, count: int) -> Curves:
    """Curves with more nodes, on the straight line after the last one."""
    more = count - curves.along_m.shape[-1]
    if more <= 0:
        return Curves(
            points_m=curves.points_m[..., :count, :],
            along_m=curves.along_m[..., :count],
            direction=curves.direction[..., :count, :],
        )
    further = torch.arange(1, more + 1).to(curves.along_m)
    last = curves.direction[..., -1:, :]
    points = curves.points_m[..., -1:, :] + further[:, None] * last
    return Curves(
        points_m=torch.cat([curves.points_m, points], dim=-2),
        along_m=torch.cat([curves.along_m, curves.along_m[..., -1:] + further], dim=-1),
        direction=torch.cat([curves.direction, last.expand_as(points)], dim=-2),
    )
