"""Equality of scenarios down to the last bit."""

from dataclasses import fields

import numpy as np

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import Scenario


def same_tracks(one: AgentTracks, other: AgentTracks) -> bool:
    """Whether all fields are equal, arrays in dtype, shape and every value."""
    for field in fields(one):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, np.ndarray):
            if mine.dtype != theirs.dtype or not np.array_equal(mine, theirs):
                return False
        elif mine != theirs:
            return False
    return True


def same_scenario(one: Scenario, other: Scenario) -> bool:
    """Whether agents, road points, focal agent, guidance and provenance are equal."""
    lines = zip(one.road_map.polylines, other.road_map.polylines, strict=True)
    return (
        same_tracks(one.agents, other.agents)
        and all(np.array_equal(mine, theirs) for mine, theirs in lines)
        and one.focal_id == other.focal_id
        and one.guidance == other.guidance
        and one.locks == other.locks
        and one.provenance == other.provenance
        and (one.applied_warp is None) == (other.applied_warp is None)
    )
