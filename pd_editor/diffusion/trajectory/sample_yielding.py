"""Yielding: agents that would still collide slow down on their own paths."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from pd_editor.generation import TrafficSample
from pd_editor.repair import yield_to_others
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario


def with_yielding(
    scenario: Scenario,
    rows: Int[np.ndarray, "G"],
    sample: TrafficSample,
    keep_ids: Collection[str] = (),
    last_ids: Collection[str] = (),
) -> tuple[TrafficSample, tuple[str, ...]]:
    """Slow agents of a sample that would collide later along their own paths.

    ``rows`` are the sample's agents in the scenario; others move as recorded. Late agents
    that continue the track of a sampled one are no obstacles. Current states stay, and
    agents with ``keep_ids`` do not yield, those with ``last_ids`` only if the other one
    cannot. Also returns the ids of the agents that yield.
    """
    now, agents = scenario.current_step, scenario.agents
    driven = agents.with_rows(
        rows,
        position_m=_from_now(agents.position_m, rows, now, sample.position_m),
        heading_rad=_from_now(agents.heading_rad, rows, now, sample.heading_rad),
        velocity_mps=_from_now(agents.velocity_mps, rows, now, sample.velocity_mps),
        is_valid=_from_now(
            agents.is_valid, rows, now, np.ones(sample.heading_rad.shape, bool)
        ),
    )
    late = LateAgents.of(scenario)
    doubles = np.setdiff1d(late.row, late.but_continuing(rows).row)
    if len(doubles):
        driven = driven.with_rows(doubles, is_valid=np.array(False))
    waiting, ids = yield_to_others(
        scenario.with_agents(driven), sample.ids, keep_ids=keep_ids, last_ids=last_ids
    )
    if not ids:
        return sample, ()
    after = waiting.agents
    return replace(
        sample,
        position_m=after.position_m[rows, now:],
        heading_rad=after.heading_rad[rows, now:],
        velocity_mps=after.velocity_mps[rows, now:],
    ), ids


def _from_now(
    recorded: np.ndarray, rows: np.ndarray, now: int, sampled: np.ndarray
) -> np.ndarray:
    return np.concatenate([recorded[rows, :now], sampled], axis=1)
