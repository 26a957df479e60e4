"""Commands that add, delete and describe agents."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import (
    Command,
    StateCommand,
    agents_in_words,
    names_after,
)
from pd_editor.editor.commands.edit_limits import (
    check_new_id,
    check_number_of_agents,
    check_position,
    check_positions,
    check_size,
    present_rows,
    rows_of,
)
from pd_editor.scene.agent_kind import (
    DEFAULT_SIZE_M,
    Activity,
    AgentCategory,
    AgentKind,
    stands,
)
from pd_editor.scene.roles.focal_agent import with_focal_category
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import MOVING_MPS


@dataclass(frozen=True, kw_only=True)
class SetAgentKind(Command):
    """Set the kind of agents; unknown sizes become the default of the kind."""

    agent_ids: tuple[str, ...]
    kind: AgentKind

    @property
    def label(self) -> str:
        """Label with the kind."""
        kind = self.kind.in_words
        return f"Change {agents_in_words(self.agent_ids)} to {kind}{names_after(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with new kinds and default sizes."""
        agents = scenario.agents
        rows = rows_of(scenario, self.agent_ids)
        if all(agents.kinds[row] is self.kind for row in rows):
            return scenario
        kinds = list(agents.kinds)
        for row in rows:
            kinds[row] = self.kind
        guessed = rows[~agents.has_known_size[rows]]
        changed = agents.with_rows(guessed, size_m=np.array(DEFAULT_SIZE_M[self.kind]))
        return scenario.with_agents(replace(changed, kinds=tuple(kinds)))


@dataclass(frozen=True, kw_only=True)
class SetAgentSize(Command):
    """Set length, width or both of agents; their sizes then count as known."""

    agent_ids: tuple[str, ...]
    length_m: float | None
    """Length; None keeps that of each agent."""
    width_m: float | None

    def __post_init__(self) -> None:
        given = [side for side in (self.length_m, self.width_m) if side is not None]
        if not given:
            raise EditError("Give a length, a width or both.")
        check_size(given[0], given[-1])

    @property
    def label(self) -> str:
        """Label with the size."""
        if self.width_m is None:
            size = f"{self.length_m:.1f} m length"
        elif self.length_m is None:
            size = f"{self.width_m:.1f} m width"
        else:
            size = f"{self.length_m:.1f} x {self.width_m:.1f} m"
        return f"Resize {agents_in_words(self.agent_ids)} to {size}{names_after(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with new sizes."""
        agents = scenario.agents
        rows = rows_of(scenario, self.agent_ids)
        size = agents.size_m[rows]
        for column, side in enumerate((self.length_m, self.width_m)):
            if side is not None:
                size[:, column] = side
        if agents.has_known_size[rows].all() and (agents.size_m[rows] == size).all():
            return scenario
        return scenario.with_agents(
            agents.with_rows(rows, size_m=size, has_known_size=np.array(True))
        )


@dataclass(frozen=True, kw_only=True)
class SetAgentActivity(Command):
    """Set whether stationary agents are parked or waiting, as conditions of the model.

    Moving agents are always driving, so those in the list do not change.
    """

    agent_ids: tuple[str, ...]
    activity: Activity

    @property
    def label(self) -> str:
        """Label with the activity."""
        return (
            f"Activity of {agents_in_words(self.agent_ids)}: {self.activity.in_words}"
            f"{names_after(self.agent_ids)}"
        )

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with new activities.

        Raises:
            EditError: the activity is possible at the speed of none of the agents.
        """
        agents = scenario.agents
        rows = present_rows(scenario, self.agent_ids)
        is_standing = stands(agents.speed_mps()[rows, scenario.current_step])
        suits = is_standing != (self.activity is Activity.DRIVING)
        if not suits.any():
            subject = agents_in_words(self.agent_ids)
            raise EditError(
                f"{subject[:1].upper()}{subject[1:]} cannot be {self.activity.in_words} at"
                f" {agents.speed_mps()[rows, scenario.current_step].max():.1f} m/s:"
                f" what is slower than {MOVING_MPS:g} m/s is parked or waiting,"
                " the rest is moving."
            )
        if (agents.activity[rows[suits]] == self.activity).all():
            return scenario
        activity = np.full(int(suits.sum()), self.activity)
        return scenario.with_agents(agents.with_rows(rows[suits], activity=activity))


@dataclass(frozen=True, kw_only=True)
class DuplicateAgents(StateCommand):
    """Copy agents with their whole tracks, shifted; copies are unscored tracks."""

    agent_ids: tuple[str, ...]
    new_ids: tuple[str, ...]
    dx_m: float = 0.0
    dy_m: float = 0.0

    def __post_init__(self) -> None:
        check_position(self.dx_m, self.dy_m)
        if len(self.agent_ids) != len(self.new_ids):
            raise EditError(
                f"{len(self.agent_ids)} agents to copy need as many new ids,"
                f" not {len(self.new_ids)}."
            )
        for ids in (self.agent_ids, self.new_ids):
            if len(set(ids)) != len(ids):
                raise EditError(
                    "Each agent may be copied once, under an id of its own."
                )

    @property
    def label(self) -> str:
        """Label with the name or number of the originals."""
        return (
            f"Duplicate {agents_in_words(self.agent_ids)}{names_after(self.agent_ids)}"
        )

    @property
    def selects(self) -> tuple[str, ...]:
        """Select the copies."""
        return self.new_ids

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the copies appended."""
        rows = present_rows(scenario, self.agent_ids)
        for new_id in self.new_ids:
            check_new_id(scenario, new_id)
        check_number_of_agents(len(scenario.agents) + len(rows))
        copies = scenario.agents.taken(rows)
        shifted = copies.position_m + np.array([self.dx_m, self.dy_m])
        check_positions(shifted[:, scenario.current_step])
        copies = replace(
            copies,
            ids=self.new_ids,
            categories=(AgentCategory.UNSCORED,) * len(copies),
            position_m=np.where(copies.is_valid[..., None], shifted, 0.0),
        )
        return scenario.with_agents(scenario.agents.joined(copies))


@dataclass(frozen=True, kw_only=True)
class DeleteAgents(Command):
    """Delete agents, including those without a state at the current step."""

    agent_ids: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label with the name or number of the agents."""
        return f"Delete {agents_in_words(self.agent_ids)}{names_after(self.agent_ids)}"

    @property
    def selects(self) -> tuple[str, ...]:
        """Select no agent."""
        return ()

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario without the agents."""
        rows = rows_of(scenario, self.agent_ids)
        if scenario.focal_id in self.agent_ids:
            raise EditError(
                f"Agent {scenario.focal_id} is the focal agent and cannot be deleted;"
                " choose another focal agent first."
            )
        names = tuple(scenario.agents.ids[row] for row in rows)
        left = scenario.without_agents(names)
        if EGO_ID in names:
            note = f"The ego vehicle ({EGO_ID}) was removed."
            left = left.with_agents(left.agents, note)
        return left


@dataclass(frozen=True, kw_only=True)
class RemoveAllAgents(Command):
    """Delete all agents; the next agents that are added include a focal agent."""

    @property
    def label(self) -> str:
        """Label of the command."""
        return "Remove all agents"

    @property
    def selects(self) -> tuple[str, ...]:
        """Select no agent."""
        return ()

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario without any agent."""
        return scenario.without_agents(scenario.agents.ids)


@dataclass(frozen=True, kw_only=True)
class SetFocalAgent(Command):
    """Set the focal agent; the former one becomes a scored track."""

    agent_id: str

    @property
    def label(self) -> str:
        """Label with the agent's id."""
        return f"Make agent {self.agent_id} focal"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with another focal agent."""
        present_rows(scenario, (self.agent_id,))
        agents = scenario.agents
        if scenario.focal_id == self.agent_id:
            return scenario
        return replace(
            scenario,
            agents=with_focal_category(agents, self.agent_id),
            focal_id=self.agent_id,
        )


def new_agent_id(scenario: Scenario, prefix: str = "placed") -> str:
    """First unused id of ``prefix-1``, ``prefix-2``, ..."""
    return new_agent_ids(scenario, 1, prefix)[0]


def new_agent_ids(
    scenario: Scenario, count: int, prefix: str = "placed"
) -> tuple[str, ...]:
    """First ``count`` unused ids of ``prefix-1``, ``prefix-2``, ...

    Ids of deleted agents are not reused, so that an id identifies one agent in the
    whole history.
    """
    numbered = (f"{prefix}-{number}" for number in itertools.count(1))
    free = (name for name in numbered if not scenario.has_ever_had(name))
    return tuple(itertools.islice(free, count))
