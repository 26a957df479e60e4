"""What the training records of weights tell, in a module without torch."""

from collections.abc import Mapping
from typing import Any, Final

USUAL_WARP_SHARE: Final = 0.3
"""Share of warped roads in trainings before it was recorded."""


def warp_share(record: Mapping[str, Any]) -> float:
    """Share of warped roads in a training, without those before it."""
    return float(record.get("augmentation", {}).get("warp_share", USUAL_WARP_SHARE))


def saw_warps(record: Mapping[str, Any]) -> bool:
    """Whether weights were ever trained on warped roads: in this training or before it.

    A record of an earlier version does not tell what the weights saw that it began with;
    they count as having seen warped roads.
    """
    found = record.get("saw_warps")
    if found is None:
        found = warp_share(record) > 0 or bool(record.get("start"))
    return bool(found) or any(map(saw_warps, record.get("averaged_with", ())))
