"""Averages the weights of trainings that began with the same ones."""

from collections.abc import Sequence
from dataclasses import replace

import torch

from pd_editor.base.errors import ModelError
from pd_editor.generation.checkpoints.model_folder import TrainedStage


def averaged_stage(
    stages: Sequence[TrainedStage], sources: Sequence[object]
) -> TrainedStage:
    """Average the weights of a stage; all else is that of the first.

    The average of trainings that began with the same weights is often better than each
    of them, of others it is useless. The first stage's network is changed.

    Args:
        stages: The same stage of several models.
        sources: Where each comes from, for messages.

    Raises:
        ModelError: the networks or their trajectory bases differ.

    Source: Wortsman et al., Model soups, 2022.
    """
    first = stages[0]
    if len(stages) == 1:
        return first
    tensors = [stage.model.state_dict() for stage in stages]
    weights = dict(first.model.named_parameters())
    for stage, other, source in zip(stages, tensors, sources, strict=True):
        fixed = other.keys() - weights - first.kind.statistics
        if stage.config != first.config or not all(
            torch.equal(other[name], tensors[0][name]) for name in fixed
        ):
            raise ModelError(
                f"{source}: its {first.kind.name} network or trajectory basis differs from "
                f"that of {sources[0]}; expected trainings that began with one model."
            )
    with torch.no_grad():
        for name, one in weights.items():
            one.copy_(torch.stack([other[name] for other in tensors]).mean(dim=0))
    others = [dict(stage.about) for stage in stages[1:]]
    return replace(first, about={**first.about, "averaged_with": others})
