"""Samples of a request, and what users are told of them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.base.plain_text import listed
from pd_editor.generation.trajectory.network.decoding import Motion
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, Activity
from pd_editor.scene.generation import (
    AVOIDANCE,
    LANE_GUIDANCE,
    GenerationRequest,
    GuidanceReport,
    TrafficSample,
)

_MOST_NAMED: Final = 6
"""Number of agents that a note lists."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Samples with the slowed agents of each, and notes for the user."""

    samples: tuple[TrafficSample, ...]
    slowed_ids: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]
    measures: tuple[str, ...] = ()
    reports: tuple[GuidanceReport, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence["Sampled"], notes: Sequence[str]) -> "Sampled":
        """All samples of some parts, with other notes."""
        return cls(
            samples=tuple(one for part in parts for one in part.samples),
            slowed_ids=tuple(one for part in parts for one in part.slowed_ids),
            notes=tuple(notes),
            reports=tuple(one for part in parts for one in part.reports),
        )

    def without(self, gone: Collection[str]) -> "Sampled":
        """The same without some agents."""
        return replace(
            self,
            samples=tuple(one.without(gone) for one in self.samples),
            slowed_ids=tuple(
                tuple(name for name in ids if name not in gone)
                for ids in self.slowed_ids
            ),
            reports=tuple(
                one
                if one.unguided is None
                else replace(one, unguided=one.unguided.without(gone))
                for one in self.reports
            ),
        )

    def yielding_notes(self) -> list[str]:
        """Note on the agents that were slowed."""
        count = sum(map(len, self.slowed_ids))
        if not count:
            return []
        agents = "agent" if count == 1 else "agents"
        if len(self.samples) > 1:  # whose agents have the same ids
            return [
                f"{count} {agents} in {len(self.samples)} samples slowed down to avoid "
                "a collision."
            ]
        (names,) = self.slowed_ids
        told = listed(names, _MOST_NAMED)
        return [f"{count} {agents} slowed down to avoid a collision: {told}."]


def samples_of(
    task: TrajectoryTask, rows: Int[np.ndarray, "G"], motion: Motion
) -> tuple[TrafficSample, ...]:
    """Samples of a motion; static objects keep their velocity."""
    agents, axis = task.scenario.agents, task.scenario.time_axis
    now = task.scenario.current_step
    place = {int(row): index for index, row in enumerate(task.features.agent_row)}
    sampled = np.array([place.get(int(row), -1) for row in rows], int)
    time_s = axis.step_s * np.arange(axis.num_future_steps + 1)
    velocity = agents.velocity_mps[rows, now][:, None].repeat(len(time_s), axis=1)
    position = agents.position_m[rows, now][:, None] + velocity * time_s[:, None]
    heading = agents.heading_rad[rows, now][:, None].repeat(len(time_s), axis=1)
    has = sampled >= 0
    known = agents.activity[rows]
    activity = tuple(Activity(int(one)) for one in known) if known.any() else ()
    samples: list[TrafficSample] = []
    for index in range(len(motion.position_m)):
        here = [one.copy() for one in (position, heading, velocity)]
        for table, values in zip(
            here,
            (motion.position_m, motion.heading_rad, motion.velocity_mps),
            strict=True,
        ):
            table[has] = values[index, sampled[has]]
        samples.append(TrafficSample.of(agents.taken(rows), here, activity))
    return tuple(samples)


def request_notes(request: GenerationRequest) -> list[str]:
    """Notes on what of a request the model does not do."""
    known = {LANE_GUIDANCE, AVOIDANCE}
    other = [term.name for term in request.settings if term.name not in known]
    notes = [f"The model takes no guidance {name!r}." for name in other]
    agents = request.scenario.agents
    static_objects = [
        name
        for name in request.agent_ids
        if agents.kinds[agents.row_of[name]] not in ROAD_USER_KINDS
    ]
    if static_objects:
        notes.append(
            f"{', '.join(static_objects)}: no road users, so they keep their velocity."
        )
    return notes


def lane_measures(distance_m: float | None) -> tuple[str, ...]:
    """Sentence on the mean distance of guided agents to their nearest candidates."""
    if distance_m is None:
        return ()
    return (f"Mean distance to the nearest path along lanes: {distance_m:.1f} m.",)


def placement_notes(
    request: GenerationRequest, fits: Sequence[tuple[int, int]], num_crowded: int
) -> list[str]:
    """Notes on placed agents.

    ``fits`` are the numbers of new agents that were placed and asked for in each sample;
    ``num_crowded`` of a sample overlap others.
    """
    notes = _fit_notes(fits)
    if num_crowded and request.refines_states:
        notes.append(
            f"There is no room for {num_crowded} placed agents, which overlap others; "
            "resample fewer, or in a region with more road."
        )
    num_empty = sum(not number for _, number in fits)
    if num_empty and not request.resampled_state_ids:
        notes.append(
            f"No agent was placed in {num_empty} of {len(fits)} samples: there are "
            "as many road users as suit the road."
        )
    return notes


def _fit_notes(fits: Sequence[tuple[int, int]]) -> list[str]:
    """Notes on samples in which fewer new agents fit than were asked for."""
    short = [
        (sample, number, asked)
        for sample, (number, asked) in enumerate(fits, start=1)
        if number < asked
    ]
    notes = [
        (f"Sample {sample}: " if len(fits) > 1 else "")
        + f"{number} of {asked} new agents were placed; no free place was found for "
        f"{asked - number}."
        for sample, number, asked in short[:_MOST_NAMED]
    ]
    if len(short) > _MOST_NAMED:
        notes.append(f"So it is in {len(short) - _MOST_NAMED} more samples.")
    return notes
