"""Compares the samples of one run: numbers of each, rankings, and a diverse choice."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from operator import truediv
from typing import Final, Literal, get_args

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.finding import Finding
from pd_editor.analysis.metrics.lanes import lane_deviation
from pd_editor.analysis.metrics.motion import kinematics
from pd_editor.analysis.metrics.road import departures
from pd_editor.analysis.metrics.safety import safety_values
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS
from pd_editor.scene.traffic_sample import TrafficSample

Ranking = Literal["realism", "collisions", "off-road", "interaction", "movement"]
RANKINGS: Final[tuple[Ranking, ...]] = get_args(Ranking)
RANKING_WORDS: Final[dict[Ranking, str]] = {
    "realism": "Most realistic",
    "collisions": "Fewest collisions",
    "off-road": "Least off-road",
    "interaction": "Closest interaction",
    "movement": "Most movement",
}
LEAST_MOVING_SHARE: Final = 0.35
"""A quarter of the recordings of ``train`` have fewer agents that are under way."""
USUAL: Final = {
    "colliding_share": 0.029,
    "off_road_share": 0.050,
    "deviation_m": 2.57,
    "harsh_share": 0.055,
    "standstill": 0.085,
}
"""Means of the 35 recordings of ``train``, the last one of the share by which fewer are
under way than the least; with all of them, realism is 50."""
_FEWEST_JUDGED: Final = 8
"""How many of fewer agents are under way says nothing."""
MOST_APART_M: Final = 30.0
"""Larger distances between two samples of an agent count as this one: it went elsewhere,
or is in one of both samples only."""


@dataclass(frozen=True, kw_only=True)
class SampleNumbers:
    """Numbers of one sample, about its generated agents."""

    num_agents: int
    num_collisions: int
    """Agents whose boxes come to overlap others; at the current step they did not."""
    off_road_share: float
    """Share of the time of moving vehicles and cyclists with the centre off the road."""
    lateral_deviation_m: float
    """Mean distance of moving agents to the nearest reachable centre line."""
    moving_share: float
    """Share of agents that are under way at any time."""
    mean_speed_mps: float
    """Of these agents."""
    time_to_collision_s: float | None
    """Shortest one of any agent; None: no agents are on a collision course."""
    harsh_share: float
    """Share of time beyond comfortable acceleration, jerk or yaw rate."""
    fullness: float = 1.0
    """Number of agents over the median of the samples of the run, at most 1."""
    num_problems: int = 0
    """Problems that edits and the sample cause; and what of them:"""
    num_notices: int = 0
    num_hits: int = 0
    """Collisions of two agents."""
    num_off_road: int = 0
    """Agents that are, or come, off the road."""

    def counted(self, findings: Collection[Finding]) -> "SampleNumbers":
        """These numbers with the counts of what edits and the sample cause."""
        kinds = [one.kind for one in findings if one.is_problem]
        return replace(
            self,
            num_problems=len(kinds),
            num_notices=len(findings) - len(kinds),
            num_hits=sum(kind in ("collision", "later-collision") for kind in kinds),
            num_off_road=sum(kind in ("off-road", "later-off-road") for kind in kinds),
        )

    @property
    def is_hollow(self) -> bool:
        """Whether most agents stand or are left out, which therefore have no faults."""
        stands = self.moving_share < LEAST_MOVING_SHARE / 2
        return self.fullness < 0.5 or (self.num_agents >= _FEWEST_JUDGED and stands)

    @property
    def realism(self) -> float:
        """From 0 to 100: how near collisions, road, lanes and motion are to usual.

        Agents that stand or are left out have no faults; so standstill counts as one,
        and a sample with fewer agents than others in proportion to their number.
        """
        agents = max(self.num_agents, 1)
        standstill = max(0.0, 1.0 - self.moving_share / LEAST_MOVING_SHARE)
        found = (
            self.num_collisions / agents,
            self.off_road_share,
            self.lateral_deviation_m,
            self.harsh_share,
            standstill * (agents >= _FEWEST_JUDGED),
        )
        excess = sum(map(truediv, found, USUAL.values()))
        return 100.0 * self.fullness / (1.0 + excess / 5)


def with_fullness(numbers: Iterable[SampleNumbers]) -> tuple[SampleNumbers, ...]:
    """Numbers of all samples of a run, compared with its usual number of agents."""
    found = list(numbers)
    usual = float(np.median([one.num_agents for one in found])) if found else 0.0
    return tuple(
        replace(one, fullness=min(1.0, one.num_agents / max(usual, 1.0)))
        for one in found
    )


def numbers_of(
    scenario: Scenario, agent_ids: Iterable[str], check: SceneCheck
) -> SampleNumbers:
    """Numbers of a scenario to which a sample of some agents was applied.

    ``check`` has the findings of the scenario.
    """
    there = scenario.agents.row_of
    view = recorded_traffic(scenario, [name for name in agent_ids if name in there])
    agents, now = view.agents, scenario.current_step
    valid, speed = agents.is_valid, agents.speed_mps()
    moves = np.any(valid & (speed >= MOVING_MPS), axis=1)
    follows = agents.kind_mask(LANE_FOLLOWER_KINDS) & moves
    tracks = scenario.agents.taken(scenario.agents.rows(agents.ids))
    off = departures(scenario, tracks).is_off_road[:, now:]
    colliding = {
        name
        for one in check.all
        if one.kind == "later-collision"
        for name in one.agent_ids
    }
    deviation = lane_deviation(view).values()["lateral_deviation_mean"]
    lateral = deviation.value[deviation.is_valid & moves]
    times = safety_values(view)["time_to_collision"].valid()
    motion = kinematics(view)
    harsh = motion.is_uncomfortable()[motion.is_valid]
    return SampleNumbers(
        num_agents=len(agents),
        num_collisions=len(colliding.intersection(agents.ids)),
        off_road_share=_mean(off[valid & follows[:, None]]),
        lateral_deviation_m=_mean(lateral),
        moving_share=_mean(moves),
        mean_speed_mps=_mean(speed[moves][valid[moves]]),
        time_to_collision_s=float(times.min()) if len(times) else None,
        harsh_share=_mean(harsh),
    ).counted(check.new)


def ranked(
    numbers: Sequence[SampleNumbers], ranking: Ranking = "realism"
) -> tuple[int, ...]:
    """Indices of the samples, the best one first.

    What the ranking names counts first, as cards tell it; then the number of problems,
    that of notices, and ``realism``. Samples without agents, such as of a region in which
    none fits, are last; the most realistic ones are not those that stand.
    """

    def key(index: int) -> tuple[float, ...]:
        one = numbers[index]
        time = one.time_to_collision_s
        first: dict[Ranking, tuple[float, ...]] = {
            "realism": (one.is_hollow,),
            "collisions": (one.num_hits,),
            "off-road": (one.num_off_road, one.off_road_share),
            "interaction": (np.inf if time is None else time,),
            "movement": (-one.moving_share * one.mean_speed_mps,),
        }
        problems = one.num_problems, one.num_notices
        return not one.num_agents, *first[ranking], *problems, -one.realism, index

    return tuple(sorted(range(len(numbers)), key=key))


def spread_pick(
    samples: Sequence[TrafficSample], count: int, first: int = 0
) -> tuple[int, ...]:
    """Indices of the most diverse samples: each is the farthest from those before it.

    All are picked if there are fewer than ``count``.
    """
    if not samples:
        return ()
    apart = distances_m(samples)
    picked = [first]
    while len(picked) < min(count, len(samples)):
        nearest = apart[:, picked].min(axis=1)
        nearest[picked] = -1.0
        picked.append(int(nearest.argmax()))
    return tuple(picked)


def distances_m(samples: Sequence[TrafficSample]) -> Float[np.ndarray, "S S"]:
    """Mean distance between the agents of each two samples, over all steps.

    Agents are matched by id; one that only one sample has is ``MOST_APART_M`` away.
    """
    ids = list(dict.fromkeys(name for one in samples for name in one.ids))
    row = {name: index for index, name in enumerate(ids)}
    steps = max((one.position_m.shape[1] for one in samples), default=0)
    place = np.full((len(samples), len(ids), steps, 2), np.nan, np.float32)
    for index, one in enumerate(samples):
        place[index, [row[name] for name in one.ids]] = one.position_m
    apart = np.zeros((len(samples), len(samples)))
    for index in range(len(samples)):
        gap = np.linalg.norm(place - place[index], axis=-1)
        in_neither = np.isnan(place[..., 0]) & np.isnan(place[index, ..., 0])
        gap = np.minimum(np.where(np.isnan(gap), MOST_APART_M, gap), MOST_APART_M)
        counts = (~in_neither).sum(axis=(1, 2))
        apart[index] = np.where(in_neither, 0.0, gap).sum(axis=(1, 2)) / np.maximum(
            counts, 1
        )
    return apart


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if np.size(values) else 0.0
