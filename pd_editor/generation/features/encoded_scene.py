"""Training features of one window, with encoded trajectories and candidates."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.generation.features.scene_features import SceneFeatures
from pd_editor.generation.features.scene_fields import (
    CANDIDATE_FIELDS,
    LATENT_SIZE,
    SCENE_FIELDS,
    SceneTokens,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedScene(SceneTokens):
    """Tokens of a scene, with trajectories and C candidates as D numbers each, their latents.

    Valid candidates come first in each row.
    """

    candidates: Float[np.ndarray, "A C D"]
    """Zero where ``has_candidate`` is false."""
    has_candidate: Bool[np.ndarray, "A C"]
    future: Float[np.ndarray, "A D"]
    """Zero where ``has_future`` is false."""
    has_future: Bool[np.ndarray, "A"]

    def with_agents(self, count: int, **known: np.ndarray) -> "PackedScene":
        """Append agents of which only some fields are known, by their names."""
        changed = {}
        for field in (*SCENE_FIELDS, *CANDIDATE_FIELDS):
            if field.axis == "agent":
                old = getattr(self, field.name)
                new = np.full((count, *old.shape[1:]), field.fill, old.dtype)
                new[:] = known.get(field.name, new)
                changed[field.name] = np.concatenate([old, new])
        return replace(self, **changed)

    def only_agents(self, rows: Int[np.ndarray, "K"]) -> "PackedScene":
        """Keep some agents only; the nearest tokens and agents of each become unset."""
        changed = {}
        for field in (*SCENE_FIELDS, *CANDIDATE_FIELDS):
            if field.axis == "agent":
                values = getattr(self, field.name)[rows]
                if field.name in _NEAREST:
                    values = np.full_like(values, field.fill)
                changed[field.name] = values
        return replace(self, **changed)


_NEAREST: Final = ("near_pieces", "near_boundary", "near_agents")

Encoder = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Encoder of trajectories [.. H 2] at speeds; see ``TrajectoryBasis.encode``."""


def packed(features: SceneFeatures, encode: Encoder) -> PackedScene:
    """Encode the candidates and trajectories of a scene."""
    speed = features.agent_speed
    has_candidate, has_future = features.has_candidate, features.has_future
    candidates = np.zeros((*has_candidate.shape, LATENT_SIZE), np.float32)
    agent, slot = np.nonzero(has_candidate)
    candidates[agent, slot] = encode(features.candidate_m[agent, slot], speed[agent])
    future = np.zeros((len(speed), LATENT_SIZE), np.float32)
    future[has_future] = encode(features.future_m[has_future], speed[has_future])
    return PackedScene(
        **{one.name: getattr(features, one.name) for one in fields(SceneTokens)},
        candidates=candidates,
        has_candidate=has_candidate,
        future=future,
        has_future=has_future,
    )
