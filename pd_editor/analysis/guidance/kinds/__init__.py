"""All kinds of guidance terms. To add one: docs/guidance.md, "A kind of your own"."""

from collections.abc import Mapping
from typing import Any, Final

from pd_editor.analysis.guidance.guidance_kind import GuidanceKind
from pd_editor.analysis.guidance.kinds import course, pairs, path, space, speed

KINDS: Final[Mapping[str, GuidanceKind[Any]]] = {
    one.value.kind: one
    for one in (
        course.GOAL,
        path.PATH,
        path.LANES,
        speed.STOP,
        pairs.YIELD,
        pairs.THREAT,
        speed.TARGET,
        speed.LIMIT,
        space.GAP,
        space.AVOID,
        space.ROAD,
        speed.COMFORT,
    )
}
"""Kinds by their names in JSON and on the shell, in the order of their tools."""
