"""Terms on the course of an agent: a path, lanes, a goal point, the drivable area."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.analysis.guidance.guidance_kind import (
    LIMIT_BRAKING_MPS2,
    MAX_BRAKING_MPS2,
)
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath, way_plan
from pd_editor.analysis.guidance.kinds.space import ROAD_STRIDE, StayOnRoad
from pd_editor.analysis.guidance.way_points import Rates, WayPlan, WayPoint
from pd_editor.analysis.metrics.road import is_off_road, way_back_m
from pd_editor.analysis.threats.encounter import Track
from pd_editor.generation.trajectory.guidance.latent_motion import PredictedMotion
from pd_editor.generation.trajectory.guidance.target_motion import (
    Curves,
    TargetMotion,
    braked_in_time,
    distances,
    extended,
    predicted_curves,
    speeds,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    AgentsTerm,
    GuidedAgents,
    ResidualRows,
    TermContext,
    TermMakers,
    row_weights,
    together,
)
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.paths.car_following import ACCELERATION_MPS2
from pd_editor.scene.paths.drawn_path import FollowedPath, lane_line, path_to_follow
from pd_editor.scene.thresholds import FIRM_ACCELERATION_MPS2


@dataclass(frozen=True, kw_only=True, eq=False)
class PathTerm(AgentsTerm):
    """Follows paths that begin at the agents' poses, at the predicted pace.

    Agents with way-points that ask for something go at a pace that meets it. A path that
    leads sideways or backwards is not followed.
    """

    curves: Curves
    length_m: Float[Tensor, "G 1"]
    """Arc length at which each path to follow ends."""
    limit_mps: Float[Tensor, "G M"]
    """Speed limits of the paths, one per node."""
    plans: tuple[WayPlan | None, ...]

    @classmethod
    def of_guided(
        cls, guided: GuidedAgents[FollowPath | FollowLane]
    ) -> "PathTerm | None":
        """Make the term; None if no path of a sampled agent is followed."""
        context = guided.context
        found = [_followed(term, context) for term in guided.values]
        guided = guided.only(np.array([one is not None for one in found]))
        lines = [one for one in found if one is not None]
        if not lines:
            return None
        paths = [one.path for one in lines]
        most = max(one.x_m.shape[1] for one in paths)
        curves = [
            _with_nodes(_even_curves(context.tensor(one.points_m)[None]), most)
            for one in paths
        ]
        limit = [
            np.pad(one.speed_limit_mps[0], (0, most - one.x_m.shape[1]), mode="edge")
            for one in paths
        ]
        length = np.array([one.length_m for one in lines])
        tracks = context.scenario.agents
        ids = [one.agent_id for one in guided.values]
        width = tracks.size_m[tracks.rows(ids), 1].tolist()
        return cls(
            guided=guided,
            curves=Curves(node=torch.cat([one.node for one in curves], dim=1)),
            length_m=context.tensor(length)[:, None],
            limit_mps=context.tensor(np.array(limit)),
            plans=tuple(map(way_plan, guided.values, lines, width)),
        )

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to the points of the paths at the predicted pace."""
        pace = predicted_curves(motion, self.agents).along_m
        speed = speeds(
            pace, motion.velocity_mps[:, self.agents, 0].norm(dim=-1), motion.step_s
        )
        slowed = pace
        for _ in range(2):
            slowed = distances(
                braked_in_time(
                    speed.minimum(self._limits(slowed)),
                    MAX_BRAKING_MPS2,
                    motion.step_s,
                ),
                motion.step_s,
            )
        is_free = torch.tensor([not (one and one.points) for one in self.plans])
        is_free = is_free[:, None].to(pace.device)
        along = slowed if is_free.all() else self._planned(motion, slowed)
        target = TargetMotion.along(self.agents, self.curves, along, motion.step_s)
        is_on_path = along <= self.length_m
        rows = target.rows(
            along_m=self.config.pace_m,
            across_m=self.config.path_m,
            strength=self.guided.weight,
            is_wanted=is_on_path & is_free,
        )
        if is_free.all():
            return rows
        return [
            *rows,
            *target.rows(
                along_m=self.config.speed_mps,
                speed_mps=self.config.speed_mps,
                across_m=self.config.path_m,
                strength=self.guided.weight,
                is_wanted=is_on_path & ~is_free,
            ),
            # A time is one of many steps.
            *target.rows(
                along_m=self.config.goal_m * (10.0 / len(motion.time_s)) ** 0.5,
                across_m=self.config.path_m,
                strength=self.guided.weight,
                is_wanted=is_on_path & self._is_due(motion),
            ),
        ]

    def _is_due(self, motion: PredictedMotion) -> Bool[Tensor, "G T"]:
        """Steps at which agents are asked to be at way-points."""
        times = [
            [one.at_s for one in plan.points if one.at_s is not None] if plan else []
            for plan in self.plans
        ]
        due = torch.zeros(len(times), len(motion.time_s), dtype=torch.bool)
        for row, some in enumerate(times):
            step = torch.tensor(some).div(motion.step_s).round().long()
            due[row, step.clamp_max(due.shape[1] - 1)] = True
        return due.to(motion.time_s.device)

    def _planned(
        self, motion: PredictedMotion, free_m: Float[Tensor, "S G T"]
    ) -> Float[Tensor, "S G T"]:
        """Arc lengths that way-points ask for; those of other agents as given."""
        along, time_s = free_m.clone(), motion.time_s.numpy(force=True)
        for index, plan in enumerate(self.plans):
            if plan is None or not plan.points:
                continue
            rates = self._rates(plan)
            waits = any(one.waits_for is not None for one in plan.points)
            # Who is waited for is predicted anew in each sample.
            count = motion.num_samples if waits else 1
            paces = [
                plan.pace(rates, _passing(plan, motion, sample, self.guided.context))
                for sample in range(count)
            ]
            planned = np.stack([one.along_at(time_s) for one in paces])
            along[:, index] = self.guided.context.tensor(planned)
        return along

    def _rates(self, plan: WayPlan) -> Rates:
        return Rates(
            up=ACCELERATION_MPS2,
            down=LIMIT_BRAKING_MPS2,
            hardest_up=FIRM_ACCELERATION_MPS2,
            hardest_down=MAX_BRAKING_MPS2,
            cruise_mps=plan.cruise_mps(),
        )

    def _limits(self, along_m: Float[Tensor, "S G T"]) -> Float[Tensor, "S G T"]:
        table = self.curves.along_m.expand(len(along_m), -1, -1).contiguous()
        node = torch.searchsorted(table, along_m.contiguous())
        limit = self.limit_mps.expand(len(along_m), -1, -1)
        return limit.gather(-1, node.clamp_max(table.shape[-1] - 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalTerm(AgentsTerm):
    """Reaches points at given times, along the predicted paths or planned ones.

    The path that comes nearest to a goal is retimed with the least change of
    acceleration, and shifted sideways to the goal. Of a goal out of reach, the nearest
    place in reach is aimed at.
    """

    @cached_property
    def _at_s(self) -> Float[Tensor, "G 1"]:
        """Infinite: at the end."""
        at = [np.inf if one.at_s is None else one.at_s for one in self.guided.values]
        return self.guided.context.tensor(np.array(at))[:, None]

    @property
    def _point_m(self) -> Float[Tensor, "G 2"]:
        return self.guided.of_each("point_m")

    def rows(self, motion: PredictedMotion) -> Sequence[ResidualRows]:
        """Residuals to a way to the goal, and to the goal itself at its step."""
        config, time_s = self.config, motion.time_s
        predicted = extended(predicted_curves(motion, self.agents), self.guided)
        num_steps = len(time_s)
        step = (self._at_s / motion.step_s).round().clamp(1, num_steps - 1).long()
        curves, goal_along, goal_left = self._curves(predicted)
        share = time_s / time_s[step]
        early = share.clamp_max(1.0)
        # Least squared acceleration; then at the speed that was reached.
        growth = (3 * early**2 - early**3) / 2 + 1.5 * (share - early)
        goal_along, goal_left, is_reached = self._within_reach(
            goal_along, goal_left, motion, time_s[step[:, 0]]
        )
        pace = predicted.along_m[..., :num_steps]
        gap = goal_along[..., None] - pace.gather(-1, step.expand(*pace.shape[:2], 1))
        along = (pace + gap * growth).clamp_min_(0.0).cummax(dim=-1).values
        target = TargetMotion.along(self.agents, curves, along, motion.step_s)
        done = (along / goal_along[..., None].clamp_min(1.0)).clamp_(0, 1)
        aside = goal_left[..., None] * done**2 * (3 - 2 * done)
        left = torch.stack(
            [-target.direction[..., 1], target.direction[..., 0]], dim=-1
        )
        way = replace(target, position_m=target.position_m + aside[..., None] * left)
        moment = torch.arange(num_steps, device=step.device)
        place = torch.where(
            is_reached[..., None, None], self._point_m[:, None], way.position_m
        )
        # The goal is one of many steps.
        accepted = config.goal_m * (10.0 / num_steps) ** 0.5
        rows = replace(way, position_m=place).rows(
            along_m=accepted,
            across_m=accepted,
            strength=self.guided.weight,
            is_wanted=(moment == step).expand(along.shape),
        )
        if motion.level == 0:
            return rows
        return [
            *rows,
            # The way matters up to the goal.
            *way.rows(
                along_m=config.goal_way_m,
                across_m=config.goal_way_m,
                strength=self.guided.weight,
                is_wanted=(moment <= step).expand(along.shape),
            ),
        ]

    def _within_reach(
        self,
        along_m: Float[Tensor, "S G"],
        left_m: Float[Tensor, "S G"],
        motion: PredictedMotion,
        time_s: Float[Tensor, "G"],
    ) -> tuple[Float[Tensor, "S G"], Float[Tensor, "S G"], Bool[Tensor, "S G"]]:
        """Places of goals, moved to where the agents can be, and whether they stayed."""
        config = self.config
        speed = motion.velocity_mps[:, self.agents, 0].norm(dim=-1)
        most = speed * time_s + FIRM_ACCELERATION_MPS2 * time_s.square() / 2
        braking_s = time_s.minimum(speed / MAX_BRAKING_MPS2)
        least = speed * braking_s - MAX_BRAKING_MPS2 * braking_s.square() / 2
        along = along_m.maximum(least).minimum(most)
        left = left_m.clamp(-2 * config.goal_way_m, 2 * config.goal_way_m)
        stayed = (along - along_m).abs() + (left - left_m).abs() < 0.5
        return along, left, stayed

    def _curves(
        self, predicted: Curves
    ) -> tuple[Curves, Float[Tensor, "S G"], Float[Tensor, "S G"]]:
        """The curve to the goal in each sample, with the goal's place on it."""
        along, left = predicted.nearest(self._point_m)
        planned, planned_along, planned_left = self._planned
        # How much nearer a planned path must come to a goal than the predicted path.
        is_planned = left.abs() > planned_left.abs() + 1.0
        node = torch.where(
            is_planned[..., None, None],
            _with_nodes(planned, predicted.node.shape[-2]).node,
            predicted.node,
        )
        return (
            Curves(node=node),
            torch.where(is_planned, planned_along, along),
            torch.where(is_planned, planned_left, left),
        )

    @cached_property
    def _planned(self) -> tuple[Curves, Float[Tensor, "1 G"], Float[Tensor, "1 G"]]:
        """The planned path of each agent that comes nearest to its goal."""
        points, exists = self.guided.planned
        curves = _even_curves(points)
        along, left = curves.nearest(self._point_m[:, None])
        cost = left.abs() + (-along).clamp_min(0.0)
        best = cost.masked_fill(~exists, torch.inf).argmin(dim=-1)
        agent = torch.arange(len(best), device=best.device)
        chosen = Curves(node=curves.node[agent, best][None])
        return chosen, along[agent, best][None], left[agent, best][None]


def _followed(
    term: FollowPath | FollowLane, context: TermContext
) -> FollowedPath | None:
    """Path of a term; None if it cannot be followed."""
    line = (
        np.array(term.points_m)
        if isinstance(term, FollowPath)
        else lane_line(context.scenario.road_map, term.lane_ids)
    )
    tracks, now = context.scenario.agents, context.scenario.current_step
    row = tracks.row_of.get(term.agent_id)
    if row is None or line is None or len(line) < 2:
        return None
    followed = path_to_follow(
        line,
        tracks.position_m[row, now],
        float(tracks.heading_rad[row, now]),
        float(np.hypot(*tracks.velocity_mps[row, now])),
    )
    return followed if followed.is_drivable else None


def _passing(
    plan: WayPlan, motion: PredictedMotion, sample: int, context: TermContext
) -> Callable[[WayPoint, float], float]:
    """When the agents that are waited for pass in a sample; at once if they are gone."""

    def passed_s(one: WayPoint, place_m: float) -> float:
        index = context.index_of(str(one.waits_for))
        if index is None:
            return 0.0
        other = Track(
            position_m=motion.position_m[sample, index].numpy(force=True),
            heading_rad=motion.heading_rad[sample, index].numpy(force=True),
            velocity_mps=motion.velocity_mps[sample, index].numpy(force=True),
            size_m=motion.size_m[index].numpy(force=True),
        )
        is_there = motion.exists[index].numpy(force=True)
        return plan.passed_s(place_m, other, is_there, motion.step_s)

    return passed_s


def _even_curves(points_m: Float[Tensor, "S G M 2"]) -> Curves:
    step = points_m.diff(dim=-2)
    length = step.norm(dim=-1)
    direction = torch.nn.functional.normalize(step, dim=-1)
    return Curves.of(
        points_m,
        torch.cat([direction[..., :1, :], direction], dim=-2),
        torch.nn.functional.pad(length.cumsum(dim=-1), (1, 0)),
    )


def _with_nodes(curves: Curves, count: int) -> Curves:
    """Curves with so many nodes, more ones on the straight line after the last one."""
    more = count - curves.node.shape[-2]
    if more <= 0:
        return Curves(node=curves.node[..., :count, :])
    further = torch.arange(1, more + 1).to(curves.node)[:, None]
    last = curves.node[..., -1:, :]
    ahead = last[..., 2:4]
    step = torch.cat(
        [ahead, torch.zeros_like(ahead), torch.ones_like(ahead[..., :1])], -1
    )
    return Curves(node=torch.cat([curves.node, last + further * step], dim=-2))


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
        # A box further outside is on another ground, such as a parking lot, and stays
        # there.
        counts = (length > 0) & (length < 8.0)
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


MAKERS: Final[TermMakers] = {
    FollowPath: together(PathTerm.of),
    FollowLane: together(PathTerm.of),
    GoalPoint: together(GoalTerm.of),
    StayOnRoad: together(RoadTerm.of),
}
