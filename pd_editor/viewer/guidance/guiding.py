"""The mode in which a guidance term is drawn on the road or an agent is picked for it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import EditError, PdEditorError
from pd_editor.editor.commands import AddGuidance, ChangeGuidance
from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M, ROAD_USER_KINDS
from pd_editor.scene.guidance_terms import (
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    StopAtLine,
    Threaten,
    YieldTo,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.guidance.drawn_terms import (
    goal_term,
    lane_term,
    path_term,
    stop_term,
)
from pd_editor.viewer.guidance.term_marks import lanes_line_m
from pd_editor.viewer.interaction.picking import PointerRay, agent_under, point_of
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.overlay.banner import MODE, Banner
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.state.ui_context import UiContext

MAX_DRAWN_POINTS: Final = 2_000
ONE_AGENT: Final = "Select one agent first; its guidance is drawn on the road."


@dataclass(frozen=True, kw_only=True)
class Tool:
    """One kind of term that is drawn or picked on the picture."""

    title: str
    banner: str
    """What to do, after the agent's name."""
    gesture: str
    """What the page does: "click" the road, "draw" a line, or "pick" an agent."""


TOOLS: Final[Mapping[str, Tool]] = {
    GoalPoint.kind: Tool(
        title="Goal", banner="click where it should drive to.", gesture="click"
    ),
    FollowPath.kind: Tool(
        title="Path",
        banner="click its points and double click the last, or drag along the path.",
        gesture="draw",
    ),
    FollowLane.kind: Tool(
        title="Lanes", banner="click the lane that it should reach.", gesture="click"
    ),
    StopAtLine.kind: Tool(
        title="Stop line",
        banner="click the lane where it should stop.",
        gesture="click",
    ),
    YieldTo.kind: Tool(
        title="Yield to", banner="click the agent that passes first.", gesture="pick"
    ),
    Threaten.kind: Tool(
        title="Threaten", banner="click the agent that it threatens.", gesture="pick"
    ),
}


class Guiding:
    """Mode for one term of one agent; it ends with the term, or with Escape."""

    def __init__(
        self,
        ui: UiContext,
        overlay: Overlay,
        banner: Banner,
        poses: Callable[[], AgentPoses | None],
    ) -> None:
        """Make the mode, switched off; an agent is picked among the drawn poses."""
        self._ui = ui
        self._overlay = overlay
        self._banner = banner
        self._poses = poses
        self._listeners: list[Callable[[], None]] = []
        self._ghost: dict[str, Any] = {}
        self.tool: str | None = None
        """Kind of the term that is drawn; None while the mode is off."""
        self.agent_id = ""
        self.on_term: Callable[[int], None] = lambda _index: None
        """Called with the index of a term that was drawn."""
        overlay.on("guiding", self._heard)

    @property
    def is_active(self) -> bool:
        """Whether presses on the picture draw a term."""
        return self.tool is not None

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` when the mode begins or ends."""
        self._listeners.append(listener)

    def toggle(self, kind: str) -> None:
        """Begin to draw a term of the selected agent, or stop.

        Raises:
            EditError: not one agent is selected, or it cannot be guided.
        """
        if self.tool == kind:
            self.stop()
            return
        agent_id = one_guided(self._ui.session.scenario, self._ui.session.selection)
        self._ui.commit_gesture()
        self._ui.show_current_step()
        self.tool, self.agent_id, self._ghost = kind, agent_id, {}
        self._changed()

    def stop(self) -> None:
        """End the mode, if it is active; nothing else changes."""
        if self.is_active:
            self.tool, self._ghost = None, {}
            self._changed()

    def follow(self) -> None:
        """End the mode if its agent is gone, after an undo for example."""
        if self.is_active and self.agent_id not in self._ui.session.scenario.agents.ids:
            self.stop()

    def drive_to(self, agent_id: str, point_m: np.ndarray) -> None:
        """Set an agent's goal at a point.

        Raises:
            EditError: the point is off the map.
        """
        self._put(goal_term(self._ui.session.scenario, agent_id, point_m))

    def stop_at(self, agent_id: str, point_m: np.ndarray) -> None:
        """Set an agent's stop line across the lane at a point.

        Raises:
            EditError: no lane is near.
        """
        self._put(stop_term(self._ui.session.scenario, agent_id, point_m))

    def follow_path(self, agent_id: str, points_m: np.ndarray) -> None:
        """Let an agent follow a path.

        Raises:
            EditError: the path is too short, or leaves the map.
        """
        self._put(path_term(self._ui.session.scenario, agent_id, points_m))

    def pair(self, kind: str, agent_id: str, other_id: str) -> None:
        """Let an agent yield to another one, or threaten it."""
        pair = YieldTo if kind == YieldTo.kind else Threaten
        self._put(pair(agent_id=agent_id, other_id=other_id))

    def pick(self, agent_id: str) -> bool:
        """Take an agent that was chosen elsewhere than in the picture, such as in a list.

        False if the mode asks for none.
        """
        kind = self.tool
        if kind is None or TOOLS[kind].gesture != "pick":
            return False
        self._finish(lambda: self._pair_with(agent_id))
        return True

    def _pair_with(self, other_id: str) -> GuidanceTerm:
        if other_id == self.agent_id:
            raise EditError(f"That is {other_id} itself; choose another agent.")
        pair = YieldTo if self.tool == YieldTo.kind else Threaten
        return pair(agent_id=self.agent_id, other_id=other_id)

    def _put(self, term: GuidanceTerm) -> None:
        """Add a term, or replace the agent's term of the same kind."""
        guidance = self._ui.session.scenario.guidance
        index = replaced_index(guidance, term)
        if index is None:
            self._ui.apply(AddGuidance(term=term))
            index = len(guidance)
        else:
            self._ui.apply(
                ChangeGuidance(index=index, term=like(term, guidance[index]))
            )
        self.on_term(index)

    def _changed(self) -> None:
        if self.tool is not None:
            agents = self._ui.session.scenario.agents
            kind = agents.kinds[agents.row_of[self.agent_id]].in_words
            tool = TOOLS[self.tool]
            self._banner.show(
                "guiding",
                f"{tool.title}: {kind} {self.agent_id}: {tool.banner}",
                button="Cancel (Esc)",
                on_press=self.stop,
                priority=MODE,
            )
        else:
            self._banner.hide("guiding")
        self._show()
        for listener in self._listeners:
            listener()

    def _show(self) -> None:
        """Send the mode and what the pointer would do."""
        if self.tool is None:
            self._overlay.show("guiding", {"isActive": False})
            return
        agents = self._ui.session.scenario.agents
        row, step = agents.row_of[self.agent_id], agents.num_steps - 1
        step = min(step, self._ui.session.scenario.current_step)
        height = DEFAULT_HEIGHT_M[agents.kinds[row]] / 2
        self._overlay.show(
            "guiding",
            {
                "isActive": True,
                "kind": self.tool,
                "gesture": TOOLS[self.tool].gesture,
                "from": [*np.round(agents.position_m[row, step], 2).tolist(), height],
                "ghost": self._ghost,
            },
        )

    def _heard(self, event: Mapping[str, Any]) -> None:
        """Handle a pointer event; late events of another mode are ignored."""
        if self.tool is None or event.get("tool") != self.tool:
            return
        what, ray = event.get("kind"), PointerRay.of_event(event)
        if what == "point" and ray is not None:
            self._ghost = self._ghost_at(ray)
            self._show()
        elif what == "click" and ray is not None:
            self._finish(lambda: self._clicked(ray))
        elif what == "drawn":
            points = _points(event.get("points"))
            self._finish(
                lambda: path_term(self._ui.session.scenario, self.agent_id, points)
            )

    def _finish(self, make: Callable[[], GuidanceTerm]) -> None:
        """Put the term and end the mode; a refused one leaves the mode on."""
        assert self.tool is not None
        title = TOOLS[self.tool].title
        try:
            self._put(make())
        except PdEditorError as error:
            self._ui.notify(f"{title}: not set", str(error), "error")
            return
        self.stop()

    def _clicked(self, ray: PointerRay) -> GuidanceTerm:
        """The term of a click."""
        scenario, point = self._ui.session.scenario, ray.ground_m
        if self.tool in (YieldTo.kind, Threaten.kind):
            other = self._picked(ray)
            if other is None:
                raise EditError("No other agent is there; click one.")
            return self._pair_with(other)
        if point is None:
            raise EditError("That is the sky; click the road.")
        make = {
            GoalPoint.kind: goal_term,
            FollowLane.kind: lane_term,
            StopAtLine.kind: stop_term,
        }[str(self.tool)]
        return make(scenario, self.agent_id, point)

    def _picked(self, ray: PointerRay) -> str | None:
        """The other agent under the pointer."""
        poses, agents = self._poses(), self._ui.session.scenario.agents
        row = None if poses is None else agent_under(agents, poses, ray)
        if row is None or agents.ids[row] == self.agent_id:
            return None
        return agents.ids[row]

    def _ghost_at(self, ray: PointerRay) -> dict[str, Any]:
        """What a click at the pointer would do, for the page."""
        scenario = self._ui.session.scenario
        if TOOLS[str(self.tool)].gesture == "pick" and self._picked(ray) is None:
            return {}
        try:
            term = self._clicked(ray)
        except PdEditorError as error:
            return {"text": str(error), "isBad": True}
        if isinstance(term, YieldTo | Threaten):
            poses = self._poses()
            assert poses is not None
            row = scenario.agents.row_of[term.other_id]
            kind = scenario.agents.kinds[row].in_words
            height = DEFAULT_HEIGHT_M[scenario.agents.kinds[row]] / 2
            to = [*np.round(poses.position_m[row], 2).tolist(), height]
            return {"text": f"{kind} {term.other_id}", "to": to}
        if isinstance(term, StopAtLine):
            return {"points": [list(point) for point in term.line_m]}
        if isinstance(term, FollowLane):
            line = lanes_line_m(scenario, term.lane_ids)
            return {"points": np.round(line, 2).tolist()}
        return {}


def one_guided(scenario: Scenario, selection: tuple[str, ...]) -> str:
    """Id of the one selected agent.

    Raises:
        EditError: not one is selected, or it is no road user that is there at t = 0.
    """
    if len(selection) != 1:
        raise EditError(ONE_AGENT)
    (agent_id,) = selection
    agents = scenario.agents
    (row,) = agents.rows([agent_id])
    if not agents.is_valid[row, scenario.current_step]:
        raise EditError(f"Agent {agent_id} is not there at t = 0.")
    if agents.kinds[row] not in ROAD_USER_KINDS:
        kind = agents.kinds[row].in_words
        raise EditError(f"Agent {agent_id} is a {kind} object; it cannot be guided.")
    return agent_id


def replaced_index(
    guidance: tuple[GuidanceTerm, ...], term: GuidanceTerm
) -> int | None:
    """Index of the term that a new one replaces: of one kind and the same agents.

    An agent can yield to several others.
    """
    ids = (
        (lambda one: one.named_ids)
        if isinstance(term, YieldTo)
        else (lambda one: one.guided_ids)
    )
    for index, other in enumerate(guidance):
        if other.kind == term.kind and ids(other) == ids(term):
            return index
    return None


def like(term: GuidanceTerm, former: GuidanceTerm) -> GuidanceTerm:
    """A new term with strength, and time of a goal, of the term that it replaces."""
    term = replace(term, weight=former.weight, is_on=True)
    if isinstance(term, GoalPoint) and isinstance(former, GoalPoint):
        return replace(term, at_s=former.at_s)
    if isinstance(term, Threaten) and isinstance(former, Threaten):
        return replace(term, severity=former.severity, approach=former.approach)
    return term


def _points(value: Any) -> np.ndarray:
    """The valid points of a drawn line."""
    if not isinstance(value, list):
        return np.zeros((0, 2))
    found = [point_of(point) for point in value[:MAX_DRAWN_POINTS]]
    points = [point for point in found if point is not None]
    return np.array(points).reshape(-1, 2)
