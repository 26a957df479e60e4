"""Trajectory weights of model folders in format version 1, as those of today's network.

There, edges had keys and values of their own, the query's scale was a further operation,
and the noise level was part of the first layer's input. All changes are exact.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from pd_editor.diffusion.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.features.encoded_scene import LATENT_SIZE

_RENAMED = {
    "way_points.": "decoder.",
    "agent_in.": "agent_in.",
    "token.": "embed.",
    "edge_in.": "edge_in.",
    "piece_memory.things.": "map_tokens.embed.",
    "piece_memory.nothing": "map_tokens.null_token",
    "piece_memory.keys_values.": "map_tokens.keys_values.",
    "candidate_memory.things.": "candidate_tokens.embed.",
    "candidate_memory.nothing": "candidate_tokens.null_token",
    "candidate_memory.keys_values.": "candidate_tokens.keys_values.",
}
_RENAMED_OF_BLOCK = {
    "norm.": "norm.",
    "way_in.": "interaction_in.",
    "feed_forward.": "feed_forward.",
    "guess.": "output.",
}


def upgraded_tensors(
    old: Mapping[str, Tensor], config: TrajectoryConfig
) -> dict[str, Tensor]:
    """Tensors for today's network that computes the same.

    Raises:
        KeyError: a tensor is missing.
        RuntimeError: a shape does not fit the configuration.
    """
    old = {name: one.double() for name, one in old.items()}
    new = _renamed(old, _RENAMED)
    first, bias = old["noisy_in.weight"], old["noisy_in.bias"]
    new["noisy_in.weight"] = first[:, :LATENT_SIZE]
    new["level_in.weight"] = torch.cat(
        [first[:, LATENT_SIZE:], old["level_bias.weight"]]
    )
    new["level_in.bias"] = torch.cat([bias, old["level_bias.bias"]])
    for index in range(config.num_blocks):
        prefix = f"blocks.{index}."
        own = {
            name.removeprefix(prefix): one
            for name, one in old.items()
            if name.startswith(prefix)
        }
        block = _renamed(own, _RENAMED_OF_BLOCK) | _projections(own, config)
        new |= {prefix + name: one for name, one in block.items()}
    return {name: one.float() for name, one in new.items()}


def _projections(
    block: Mapping[str, Tensor], config: TrajectoryConfig
) -> dict[str, Tensor]:
    """What an edge added to keys and values is taken to the query and to the result."""
    width, heads = config.width, config.num_heads
    scale = (width // heads) ** -0.5
    sizes = [2 * width, width, 2 * width]
    things, near, own = block["queries.weight"].split(sizes)
    things_bias, near_bias, own_bias = block["queries.bias"].split(sizes)
    edge_keys, edge_values = block["edge_out.weight"].split(width)
    edge_keys = edge_keys.unflatten(0, (heads, -1))
    edge_values = edge_values.unflatten(0, (heads, -1))
    edge = torch.einsum("hdf,hdw->hfw", edge_keys, near.unflatten(0, (heads, -1)))
    edge_bias = torch.einsum(
        "hdf,hd->hf", edge_keys, near_bias.unflatten(0, (heads, -1))
    )
    of_things, of_near = block["attended.weight"].split([2 * width, width], dim=1)
    of_edges = torch.einsum(
        "whd,hdf->whf", of_near.unflatten(1, (heads, -1)), edge_values
    )
    return {
        "project.weight": torch.cat(
            [things * scale, near * scale, edge.flatten(0, 1) * scale, own]
        ),
        "project.bias": torch.cat(
            [
                things_bias * scale,
                near_bias * scale,
                edge_bias.flatten() * scale,
                own_bias,
            ]
        ),
        "attended.weight": torch.cat([of_things, of_edges.flatten(1), of_near], dim=1),
        "attended.bias": block["attended.bias"],
    }


def _renamed(old: Mapping[str, Tensor], names: Mapping[str, str]) -> dict[str, Tensor]:
    return {
        after + name.removeprefix(before): one
        for name, one in old.items()
        for before, after in names.items()
        if name.startswith(before)
    }
