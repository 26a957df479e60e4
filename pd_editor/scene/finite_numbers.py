"""Check of generated numbers."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import GenerationError


def check_finite(
    field_name: str,
    values: Float[np.ndarray, "A *shape"],
    ids: Sequence[str],
    axes: Sequence[str],
) -> None:
    """Raise for NaN or infinity in an array of agents.

    Args:
        field_name: name of the array.
        values: the array; its first axis is agents.
        ids: ids of the agents.
        axes: names of the axes after the first one that are told.

    Raises:
        GenerationError: names the array, the first agent and the indices.
    """
    if np.isfinite(values).all():
        return
    row, *rest = np.argwhere(~np.isfinite(values))[0].tolist()
    place = "".join(
        f", {name} {index}" for name, index in zip(axes, rest, strict=False)
    )
    whose = ids[row] if row < len(ids) else f"number {row}"
    raise GenerationError(
        f"The generated {field_name} of agent {whose}{place} is "
        f"{values[(row, *rest)]}; expected finite numbers."
    )
