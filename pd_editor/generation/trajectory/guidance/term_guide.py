"""Guide of trajectories by terms: one Gauss-Newton step per denoising step.

Residuals are linear in the ten latents of an agent, so their sum of squares is a 10 x 10
quadratic form per agent. Together with a prior that keeps the latents near the network's
prediction, (z - z0)^2 / spread^2, its minimum is found by one batched Cholesky
decomposition. The prior makes strength comparable: how far a latent may move is told in
standard deviations of recorded trajectories, for all agents alike.

The last prediction is the network's own. Terms that are closed (goals, stop lines,
limits of speed) are then met by a few more such steps with a spread of their own, which
is the smallest change of the result, in latents, that meets them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions
from pd_editor.generation.core.sampler import sampling_mode
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.inputs import NUM_ALONG
from pd_editor.generation.trajectory.guidance import (
    interaction_terms,
    path_terms,
    speed_terms,
)
from pd_editor.generation.trajectory.guidance.interaction_terms import AvoidTerm
from pd_editor.generation.trajectory.guidance.latent_motion import LatentMotion
from pd_editor.generation.trajectory.guidance.trajectory_term import (
    ResidualRows,
    TermContext,
    TermGuidance,
    TermMakers,
    TrajectoryTerm,
)
from pd_editor.scene.guidance_terms import GuidanceTerm


@dataclass(frozen=True, kw_only=True, eq=False)
class TermGuide:
    """Guides the A agents of one scene by the terms of a run."""

    motion: LatentMotion
    terms: tuple[TrajectoryTerm, ...]
    config: TermGuidance = field(default_factory=TermGuidance)
    last_level: float = 0.0
    """Noise level of the last denoising step."""

    def __call__(
        self, clean: Float[Tensor, "S 1 A 10"], level: float
    ) -> Float[Tensor, "S 1 A 10"]:
        """Move predicted clean latents to what the terms ask for."""
        if level <= self.last_level:
            return clean
        spread = self.config.spread + self.config.spread_of_noise * level
        terms = [term for term in self.terms if not is_light(term)]
        return self._moved(clean[:, 0], level, spread, terms)[:, None]

    def closed(
        self,
        latent: Float[Tensor, "S 1 A 10"],
        keep: Callable[[Tensor], Tensor] | None = None,
    ) -> Float[Tensor, "S 1 A 10"]:
        """Project results to the terms that are closed.

        ``keep`` moves latents to those of locked beginnings, after each projection.
        """
        terms = [term for term in self.terms if term.is_closed]
        if not terms:
            return latent
        rounds = self.config.num_closings
        if any(isinstance(term, AvoidTerm) and not term.is_light for term in terms):
            rounds *= 3
        spread = 2 * self.config.spread
        with sampling_mode(latent[..., 0].numel()):
            # Each projection starts from the last one, so what is met stays as it is.
            for _ in range(rounds):
                found = self._moved(latent[:, 0], 0.0, spread, terms)
                latent = found[:, None] if keep is None else keep(found[:, None])
        return latent

    def _moved(
        self,
        latent: Float[Tensor, "S A 10"],
        level: float,
        spread: float,
        terms: Iterable[TrajectoryTerm],
    ) -> Float[Tensor, "S A 10"]:
        """Take a step towards the minimum; the prior keeps it near the present latents."""
        predicted = self.motion.predicted(latent, level)
        rows = [one for term in terms for one in term.rows(predicted)]
        agents = [one.agents for one in rows if len(one.agents)]
        if not agents:
            return latent
        guided = torch.unique(torch.cat(agents))
        normal, slope = self._normal_equations(latent, rows)
        normal, slope = normal[:, guided], slope[:, guided]
        normal.diagonal(dim1=-2, dim2=-1).add_(spread**-2)
        factor, _ = torch.linalg.cholesky_ex(normal)
        step = torch.cholesky_solve(slope[..., None], factor)[..., 0]
        return latent.index_add(1, guided, step, alpha=-1)

    def _normal_equations(
        self, latent: Float[Tensor, "S A 10"], rows: Sequence[ResidualRows]
    ) -> tuple[Float[Tensor, "S A 10 10"], Float[Tensor, "S A 10"]]:
        """Matrix and gradient of half the sum of squared residuals, per agent."""
        normal = latent.new_zeros(*latent.shape[:2], LATENT_SIZE, LATENT_SIZE)
        slope = torch.zeros_like(latent)
        for order in sorted({one.order for one in rows}):
            some = [one for one in rows if one.order == order and len(one.agents)]
            if some:
                self._add(normal, slope, latent, _merged(some))
        return normal, slope

    def _add(
        self,
        normal: Float[Tensor, "S A 10 10"],
        slope: Float[Tensor, "S A 10"],
        latent: Float[Tensor, "S A 10"],
        rows: ResidualRows,
    ) -> None:
        """Add rows of one order."""
        table, agents, order = self.motion, rows.agents, rows.order
        forward = table.forward[agents][:, None]
        left = torch.stack([-forward[..., 1], forward[..., 0]], dim=-1)
        ahead = (rows.direction * forward).sum(-1)
        aside = (rows.direction * left).sum(-1)
        matrix, shares = table.matrix[order], latent[:, agents]
        x = shares[..., :NUM_ALONG] @ matrix[:NUM_ALONG]
        x = x + table.offset_m[agents, order]
        y = shares[..., NUM_ALONG:] @ matrix[NUM_ALONG:]
        gap = ahead * x + aside * y - rows.target
        if order == 0:
            origin = table.origin_m[agents][:, None]
            gap = gap + (rows.direction * origin).sum(-1)
        square = rows.weight.square()
        pull = square * gap
        part = torch.cat(
            [
                (pull * ahead) @ matrix[:NUM_ALONG].mT,
                (pull * aside) @ matrix[NUM_ALONG:].mT,
            ],
            dim=-1,
        )
        slope.index_add_(1, agents, part)
        factors = torch.cat(
            [square * ahead * ahead, square * ahead * aside, square * aside * aside],
            dim=-1,
        )
        block = factors @ table.products[order]
        normal.index_add_(1, agents, block.unflatten(-1, (LATENT_SIZE, LATENT_SIZE)))


def is_light(term: TrajectoryTerm) -> bool:
    """Whether a term counts in the projections of the result alone."""
    return isinstance(term, AvoidTerm) and term.is_light


def _merged(rows: Sequence[ResidualRows]) -> ResidualRows:
    """Rows of one order as one."""
    if len(rows) == 1:
        return rows[0]
    return ResidualRows(
        agents=torch.cat([one.agents for one in rows]),
        order=rows[0].order,
        direction=torch.cat([one.direction for one in rows], dim=1),
        target=torch.cat([one.target for one in rows], dim=1),
        weight=torch.cat([one.weight for one in rows], dim=1),
    )


TERM_MAKERS: Final[TermMakers] = {
    **path_terms.MAKERS,
    **speed_terms.MAKERS,
    **interaction_terms.MAKERS,
}
"""Maker of each kind of value; threats are planned (``threat_run``)."""


def trajectory_terms(
    terms: Sequence[GuidanceTerm], context: TermContext, *, avoids: bool = False
) -> tuple[TrajectoryTerm, ...]:
    """Terms of a run, without those that are off or of weight zero.

    With ``avoids``, agents that are led somewhere avoid collisions as far as they can.
    """
    active = [term for term in terms if term.is_in_force]
    made: list[TrajectoryTerm] = []
    for kind, make in TERM_MAKERS.items():
        values = [term for term in active if type(term) is kind]
        made += make(values, context) if values else []
    if avoids:
        made += _avoidance_of_led(active, context)
    return tuple(made)


def _avoidance_of_led(
    active: Sequence[GuidanceTerm], context: TermContext
) -> Sequence[TrajectoryTerm]:
    """A light term of agents that are led somewhere, unless they take part in a threat."""
    led = {name for one in active if KINDS[one.kind].leads for name in one.guided_ids}
    for one in active:
        if isinstance(one, Threaten):
            led -= set(one.named_ids)
    weight = context.config.led_weight
    if not led or not weight:
        return []
    value = AvoidCollisions(agent_ids=tuple(sorted(led)), weight=weight)
    term = interaction_terms.AvoidTerm.of(value, context, is_light=True)
    return [] if term is None else [term]
