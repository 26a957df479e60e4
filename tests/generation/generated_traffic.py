"""What a model generates for a request, and whether two samples are the same."""

import numpy as np

from pd_editor.generation.path_diffuser import PathDiffuser
from pd_editor.scene.generation import (
    AVOIDANCE,
    GeneratedTraffic,
    GenerationRequest,
    GuidanceSetting,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.scenario import Scenario

SINGLE = GuidanceSetting(name=AVOIDANCE, weight=0.0)
"""Futures stay as drawn."""


def generated(
    diffuser: PathDiffuser, scenario: Scenario, ids: tuple[str, ...], **asked: object
) -> GeneratedTraffic:
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        **asked,  # type: ignore[arg-type]
    )
    return run_to_end(diffuser.generate(request))


def same(one: TrafficSample, two: TrafficSample) -> bool:
    return one.ids == two.ids and all(
        np.array_equal(getattr(one, name), getattr(two, name))
        for name in ("position_m", "heading_rad", "velocity_mps")
    )


def close(one: TrafficSample, two: TrafficSample) -> bool:
    """Whether they are the same apart from rounding, which grows from step to step."""
    return one.ids == two.ids and all(
        np.allclose(getattr(one, name), getattr(two, name), atol=0.02)
        for name in ("position_m", "velocity_mps")
    )
