"""Initial-state weights of model folders in format version 1, for today's network.

There, the embedding of a relation had a second linear layer, the norm of differential
attention had weights of its own, and each sine stood before its own cosine. All changes
are exact.
"""

from collections.abc import Mapping
from typing import Final

import torch
from torch import Tensor

from pd_editor.diffusion.core.attention import initial_lambda
from pd_editor.diffusion.initial_state.network.denoiser import InitialStateConfig
from pd_editor.diffusion.initial_state.network.features import (
    NUM_AGENT_FEATURES,
    NUM_PIECE_FEATURES,
    NUM_POSITION_FEATURES,
)
from pd_editor.diffusion.initial_state.network.state_encoding import NUM_MOTION_PARTS

_KEPT: Final = (
    "kind_token.",
    "given_token",
    "moves_token.",
    "on_road_token.",
    "level_token.",
    "counted",
    "norm.",
)
_NUM_RELATION_WAVES: Final = NUM_AGENT_FEATURES - 8
_NUM_LENGTHS: Final = 5


def upgraded_tensors(
    old: Mapping[str, Tensor], config: InitialStateConfig
) -> dict[str, Tensor]:
    """Tensors for today's network that computes the same.

    Raises:
        KeyError: a tensor is missing.
        RuntimeError: a shape does not fit the configuration.
    """
    old = {name: one.double() for name, one in old.items()}
    new = {name: one for name, one in old.items() if name.startswith(_KEPT)}
    new |= _inputs(old)
    new |= _relations(old, config)
    outputs = ("to_own_frame", "to_scene_frame", "by_pieces.from_token")
    for part in ("weight", "bias"):
        new[f"output.{part}"] = torch.cat([old[f"{one}.{part}"] for one in outputs])
        new[f"lane_anchored_head.propose.{part}"] = old[f"by_pieces.vote.{part}"]
    for index in range(config.num_layers):
        prefix = f"layers.{index}."
        own = {
            name.removeprefix(prefix): one
            for name, one in old.items()
            if name.startswith(prefix)
        }
        layer = _layer(own, old, config, index)
        new |= {prefix + name: one for name, one in layer.items()}
    return {name: one.float() for name, one in new.items()}


def _inputs(old: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The first layers, with position features in today's order."""
    position = _wave_order(NUM_POSITION_FEATURES)
    first = old["piece_token.0.weight"]
    num_others = first.shape[1] - NUM_POSITION_FEATURES
    order = [*range(num_others), *(num_others + one for one in position)]
    of_state = [
        *range(NUM_MOTION_PARTS),
        *(NUM_MOTION_PARTS + one for one in position),
    ]
    return {
        "map_token.0.weight": first[:, order],
        "map_token.0.bias": old["piece_token.0.bias"],
        "map_token.2.weight": old["piece_token.2.weight"],
        "map_token.2.bias": old["piece_token.2.bias"],
        "state_in.weight": old["state_token.weight"][:, of_state],
        "state_in.bias": old["state_token.bias"],
        "agent_in.weight": old["agent_facts.weight"],
        "agent_in.bias": old["agent_facts.bias"],
    }


def _relations(
    old: Mapping[str, Tensor], config: InitialStateConfig
) -> dict[str, Tensor]:
    """Embeddings of relations without their second layer, and the lane-anchored head."""
    pair, near = old["pair_relation.0.weight"], old["piece_relation.0.weight"]
    head, width = old["by_pieces.from_piece.weight"], config.relation_width
    head_features = head[:, :NUM_PIECE_FEATURES]
    head_tokens, head_edges = head[:, NUM_PIECE_FEATURES:].split(
        [head.shape[1] - NUM_PIECE_FEATURES - width, width], dim=1
    )
    order = _piece_order()
    return {
        "pair_in.weight": pair[:, _agent_order()],
        "pair_sizes_in.weight": pair[:, NUM_AGENT_FEATURES:],
        "pair_sizes_in.bias": old["pair_relation.0.bias"],
        "near_in.weight": near[:, order],
        "near_token_in.weight": torch.cat([near[:, NUM_PIECE_FEATURES:], head_tokens]),
        "near_token_in.bias": torch.cat(
            [
                old["piece_relation.0.bias"],
                head_edges @ old["piece_relation.2.bias"],
            ]
        ),
        "lane_anchored_head.from_relation.weight": torch.cat(
            [head_features[:, order], head_edges @ old["piece_relation.2.weight"]],
            dim=1,
        ),
    }


def _layer(
    layer: Mapping[str, Tensor],
    old: Mapping[str, Tensor],
    config: InitialStateConfig,
    depth: int,
) -> dict[str, Tensor]:
    width, heads = config.width, config.num_heads
    scale = (width // heads) ** -0.5
    result = layer["map_attention.to_output.weight"]
    new = {name: one for name, one in layer.items() if name.startswith("norms.")}
    if config.is_differential:
        factor = layer["map_attention.norm_weight"] * (1 - initial_lambda(depth))
        result = result * factor.repeat(heads)
        new["map_attention.lambda_vectors"] = layer["map_attention.share_vectors"]
    near_queries, near_result, near_bias = _edges(
        layer, "piece_attention", old, "piece_relation", config
    )
    queries, seen, bias = _edges(layer, "agent_attention", old, "pair_relation", config)
    parts = layer["agent_attention.to_token_parts.weight"].split([width, 2 * width])
    values = layer["agent_attention.from_values.weight"]
    return new | {
        "map_attention.to_queries.weight": scale
        * layer["map_attention.to_queries.weight"],
        "map_attention.to_keys.weight": layer["map_attention.to_keys.weight"],
        "map_attention.to_values.weight": layer["map_attention.to_values.weight"],
        "map_attention.to_output.weight": result,
        "near_attention.project.weight": near_queries,
        "near_attention.to_output.weight": near_result,
        "near_attention.to_output.bias": near_bias,
        "agent_attention.project.weight": torch.cat(
            [queries, scale * parts[0], parts[1]]
        ),
        "agent_attention.to_output.weight": torch.cat([seen, values], dim=1),
        "agent_attention.to_output.bias": bias,
        "feed_forward.0.weight": layer["think.0.weight"],
        "feed_forward.0.bias": layer["think.0.bias"],
        "feed_forward.2.weight": layer["think.2.weight"],
        "feed_forward.2.bias": layer["think.2.bias"],
    }


def _edges(
    layer: Mapping[str, Tensor],
    attention: str,
    old: Mapping[str, Tensor],
    relation: str,
    config: InitialStateConfig,
) -> tuple[Tensor, Tensor, Tensor]:
    """Queries, results and their bias, for relations without their second layer.

    What its bias adds to logits is the same for all keys, and changes no weight.
    """
    heads = config.num_heads
    weight, bias = old[f"{relation}.2.weight"], old[f"{relation}.2.bias"]
    queries = layer[f"{attention}.to_queries.weight"].unflatten(0, (heads, -1))
    queries = torch.einsum("rs,hrd->hsd", weight, queries)
    result = layer[f"{attention}.to_output.weight"].unflatten(1, (heads, -1))
    return (
        queries.flatten(0, 1) * config.relation_width**-0.5,
        torch.einsum("dhr,rs->dhs", result, weight).flatten(1),
        torch.einsum("dhr,r->d", result, bias),
    )


def _wave_order(number: int) -> list[int]:
    """Old places of the waves: all sines, then all cosines."""
    return [*range(0, number, 2), *range(1, number, 2)]


def _agent_order() -> list[int]:
    return [
        *_wave_order(_NUM_RELATION_WAVES),
        *range(_NUM_RELATION_WAVES, NUM_AGENT_FEATURES),
    ]


def _piece_order() -> list[int]:
    """The offset in one's own frame came last; now it is beside the other offset."""
    order, end = _agent_order(), _NUM_RELATION_WAVES + _NUM_LENGTHS
    return [*order[:end], *range(NUM_AGENT_FEATURES, NUM_PIECE_FEATURES), *order[end:]]
