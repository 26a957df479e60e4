"""Tasks of an evaluation: what is generated, for which agents, on which roads."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.lanes import OFF_LANE_M
from pd_editor.analysis.metrics.road import map_points, nearest_points
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.base.errors import GenerationError, InputError
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentCategory, AgentKind
from pd_editor.scene.generation import GenerationRequest, Region
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor, warp_scenario
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    MAX_POWER,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

StatesChoice = Literal["recorded", "sampled"]
AgentsChoice = Literal["all", "paper"]

SAMPLED_HALF_SIDE_M: Final = 62.0
"""Half the side of the square around the focal agent in which states are sampled."""


@dataclass(frozen=True, kw_only=True)
class EvaluationTask:
    """Whether initial states are recorded or sampled, and which agents are evaluated."""

    states: StatesChoice = "recorded"
    """With ``recorded``, agents keep their states and trajectories are generated. With
    ``sampled``, initial states are sampled as well: as many agents of each kind as the log
    has in the square."""
    agents: AgentsChoice = "all"
    """With ``paper``, only agents that the paper's code evaluates at this stage."""

    @property
    def samples_states(self) -> bool:
        """Whether initial states are sampled."""
        return self.states == "sampled"

    def request(
        self, recorded: Scenario, scenario: Scenario, *, num_samples: int, seed: int
    ) -> GenerationRequest:
        """Request that every method gets.

        The recorded scene determines the evaluated agents; ``scenario`` is the same
        scene under the road condition.

        Raises:
            GenerationError: no road user is left.
        """
        if self.samples_states or self.agents == "paper":
            rows = self._rows(recorded)
            scenario = replace(scenario, agents=scenario.agents.taken(rows))
        ids = drivable_agent_ids(scenario)
        request = GenerationRequest(
            scenario=scenario, agent_ids=ids, num_samples=num_samples, seed=seed
        )
        if not self.samples_states:
            return request
        x, y = scene_center(recorded).tolist()
        return replace(
            request,
            resampled_state_ids=ids,
            region=Region(center_m=(x, y), half_side_m=SAMPLED_HALF_SIDE_M),
            # Agents that pass the paper's filter are on the road.
            only_on_road=self.agents == "paper",
        )

    def _rows(self, recorded: Scenario) -> Int[np.ndarray, "A"]:
        view = recorded_traffic(recorded)
        wanted = np.ones(len(view), bool)
        if self.agents == "paper":
            keeps = (
                paper_init_agents if self.samples_states else paper_trajectory_agents
            )
            wanted &= keeps(view)
        if self.samples_states:
            offset = view.agents.position_m[:, 0] - scene_center(recorded)
            wanted &= (np.abs(offset) <= SAMPLED_HALF_SIDE_M).all(axis=1)
        if not wanted.any():
            raise GenerationError(
                "None of the requested agents exists at the current step."
            )
        ids = [name for name, keep in zip(view.agents.ids, wanted, strict=True) if keep]
        return recorded.agents.rows(ids)


DRIVING: Final = EvaluationTask()
"""Task with all agents and their recorded states."""


def paper_init_agents(view: TrafficView) -> Bool[np.ndarray, "A"]:
    """Agents of the first stage: vehicles that exist at the current and the last step.

    They must also be "in lane" at the current step: within 2 m of a boundary point or
    4 m of a centre point. This lowers the paper's off-road rate of recordings.
    """
    agents = view.agents
    evaluated = np.array([kind is AgentKind.VEHICLE for kind in agents.kinds], bool)
    evaluated &= agents.is_valid[:, 0] & agents.is_valid[:, -1]
    points = map_points(view.scenario.road_map)
    in_lane = np.zeros(len(view), bool)
    for targets, reach in (
        (points.boundary_m, 2.0),
        (points.center_m, OFF_LANE_M),
    ):
        if len(targets):
            distance = nearest_points(agents.position_m[:, 0], targets)[1]
            in_lane |= distance <= reach
    return evaluated & in_lane


def paper_trajectory_agents(view: TrafficView) -> Bool[np.ndarray, "A"]:
    """Agents of the second stage: scored or focal motor vehicles at both ends."""
    recorded = view.scenario.agents
    category = dict(zip(recorded.ids, recorded.categories, strict=True))
    return np.array(
        [
            kind in MOTOR_VEHICLE_KINDS
            and category.get(agent_id, AgentCategory.FRAGMENT) >= AgentCategory.SCORED
            for agent_id, kind in zip(view.agents.ids, view.agents.kinds, strict=True)
        ],
        bool,
    ) & (view.agents.is_valid[:, 0] & view.agents.is_valid[:, -1])


PLAIN: Final = "none"
ALL_POWERS: Final = (3.0, 6.0, 9.0)
DEFAULT_ANCHOR: Final = "focal"
ANCHORS: Final = (DEFAULT_ANCHOR, "ego")


@dataclass(frozen=True, kw_only=True)
class RoadCondition:
    """A road as recorded, or warped by a sum of warps ahead of an anchor."""

    terms: tuple[tuple[WarpKind, float], ...] = ()
    """Kinds and powers of the warps; none: the road as recorded."""
    anchor: str = DEFAULT_ANCHOR
    """One of ``ANCHORS``."""

    @property
    def label(self) -> str:
        """Label of the condition, as on the shell: ``smooth-turn:3+ripple-road:-2@ego``."""
        if self.is_plain:
            return PLAIN
        at = "" if self.anchor == DEFAULT_ANCHOR else f"@{self.anchor}"
        return _sum_of(self.terms) + at

    @property
    def kind(self) -> str:
        """Kind of the warp; the whole label of a sum or of another anchor."""
        is_single = len(self.terms) == 1 and self.anchor == DEFAULT_ANCHOR
        return self.terms[0][0] if is_single else self.label

    @property
    def family(self) -> str:
        """What conditions of other powers share with this one, besides the anchor."""
        if self.is_plain:
            return PLAIN
        if len(self.terms) == 1:
            return self.terms[0][0]
        return _sum_of(self.terms)

    @property
    def power(self) -> float:
        """Power of the strongest warp, with its sign; 0 for the original road."""
        return max((power for _, power in self.terms), key=abs, default=0.0)

    @property
    def is_plain(self) -> bool:
        """Whether the road is the original one."""
        return not self.terms

    def warp_of(self, scenario: Scenario) -> RoadWarp:
        """The warp of a scenario's original road.

        Raises:
            EditError: the anchor is not in the scenario at its current step.
        """
        return RoadWarp(
            anchor=pose_of_anchor(scenario, self.anchor),
            terms=tuple(
                WarpTerm(kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind])
                for kind, power in self.terms
            ),
        )

    def applied_to(
        self, scenario: Scenario, friction_coefficient: float | None = DRY_ROAD_FRICTION
    ) -> Scenario:
        """Apply the condition to a scenario: map, states and recorded trajectories.

        As in Scene-Attack, agents are slowed to the friction limit of a dry road, so that
        recorded trajectories stay drivable.

        Raises:
            EditError: the anchor is not in the scenario at its current step.
        """
        if self.is_plain:
            return scenario
        return warp_scenario(
            scenario, self.warp_of(scenario), friction_coefficient=friction_coefficient
        )


def _sum_of(terms: tuple[tuple[WarpKind, float], ...]) -> str:
    return "+".join(f"{kind}:{power:g}" for kind, power in terms)


ALL_CONDITIONS: Final = (
    RoadCondition(),
    *(RoadCondition(terms=((k, p),)) for k in WARP_KINDS for p in ALL_POWERS),
)
"""The original road, and Scene-Attack's three kinds of warps at three powers."""


def road_conditions(texts: Iterable[str]) -> tuple[RoadCondition, ...]:
    """Parse conditions from the shell: ``none``, ``smooth-turn:3``, ``all``.

    Raises:
        InputError: a text is not a condition.
    """
    found: dict[RoadCondition, None] = {}
    for text in texts:
        if text == "all":
            found |= dict.fromkeys(ALL_CONDITIONS)
        else:
            found[_parsed(text)] = None
    if not found:
        raise InputError(
            "No road condition was given; expected none, all, or KIND:POWER."
        )
    return tuple(found)


def _parsed(text: str) -> RoadCondition:
    if text == PLAIN:
        return RoadCondition()
    sum_text, at, anchor = text.partition("@")
    terms = [_term(part) for part in re.split(r"\+(?=[a-z])", sum_text)]
    known = [term for term in terms if term is not None]
    _check_kinds(text, sum_text)
    kinds = {kind for kind, _ in known}
    anchor = anchor if at else DEFAULT_ANCHOR
    if len(known) < len(terms) or len(kinds) < len(terms) or anchor not in ANCHORS:
        raise InputError(
            f"Warp {text[:60]!r} is not known; expected none, all, KIND:POWER with a kind "
            f"among {', '.join(WARP_KINDS)} and a power in -10..10 other than 0, or a sum "
            "such as smooth-turn:3+ripple-road:-2; @ego at its end warps ahead of the ego "
            "vehicle instead of the focal agent."
        )
    return RoadCondition(terms=tuple(known), anchor=anchor)


def _check_kinds(text: str, sum_text: str) -> None:
    """Raise for a kind that is spelt nearly like one."""
    for name in re.findall(r"[a-z][a-z-]+", sum_text):
        told = nearest_or_all(name, WARP_KINDS)
        if name not in WARP_KINDS and told.startswith("the nearest"):
            raise InputError(
                f"Warp {text[:60]!r} is not known; {told}, such as {WARP_KINDS[0]}:3."
            )


def _term(text: str) -> tuple[WarpKind, float] | None:
    """Kind and power; None if the text is neither."""
    name, _, power = text.partition(":")
    try:
        value = float(power)
    except ValueError:
        return None
    for kind in WARP_KINDS:
        if kind == name and 0 < abs(value) <= MAX_POWER:
            return kind, value
    return None
