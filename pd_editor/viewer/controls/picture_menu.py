"""Context menus of the picture, by the clicked element."""

from dataclasses import dataclass

import numpy as np

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.locks import STATE_LOCK
from pd_editor.scene.paths.suggested_state import suggested_heading
from pd_editor.viewer.controls.tab_elements import TabElements
from pd_editor.viewer.scene.picking import Menu, MenuItem, PointerRay, agent_under
from pd_editor.viewer.tab.ui_context import UiContext


@dataclass(frozen=True, kw_only=True, eq=False)
class PictureMenu:
    """Makes menus of the actions of the tab's elements."""

    ui: UiContext
    tab: TabElements

    def at(self, ray: PointerRay) -> Menu | None:
        """The menu of an agent or of the road; none while clicks mean something else."""
        model = self.ui.model
        poses = model.poses
        if model.mode is not None or poses is None:
            return None
        row = agent_under(self.ui.session.scenario.agents, poses, ray)
        if row is not None:
            return self._of_agent(row)
        point = ray.ground_m
        return None if point is None else self._of_road(point)

    def _of_agent(self, row: int) -> Menu:
        """Acts on the selection if the agent is one of it, else on the agent alone."""
        session, tab = self.ui.session, self.tab
        scenario = session.scenario
        agents, agent_id = scenario.agents, scenario.agents.ids[row]
        former = session.selection
        if agent_id not in former:
            session.select((agent_id,))
        count = len(session.selection)
        is_there = bool(agents.is_valid[row, scenario.current_step])
        kind = agents.kinds[row].in_words
        pose = RigidMotion(
            x_m=float(agents.position_m[row, scenario.current_step, 0]),
            y_m=float(agents.position_m[row, scenario.current_step, 1]),
            rotation_rad=float(agents.heading_rad[row, scenario.current_step]),
        )
        is_one = count == 1
        items = (
            MenuItem("Select all of this kind", self.tab.selecting.same_kind),
            MenuItem(
                "Make focal",
                self.tab.agent.make_focal,
                is_enabled=is_one and agent_id != scenario.focal_id,
            ),
            MenuItem(
                "Possible trajectories",
                self.tab.candidates.toggle_candidates,
                is_enabled=is_one and is_there,
                key="G",
            ),
            MenuItem(
                "Regenerate trajectory"
                if is_one
                else f"Regenerate {count} trajectories",
                lambda: self.ui.model.run_requested.emit(session.selection, False),
                is_enabled=is_there,
            ),
            *(
                self.tab.steering.pair_items(former[0], agent_id)
                if len(former) == 1 and former != (agent_id,) and is_there
                else ()
            ),
            *self.tab.steering.agent_items(is_enabled=is_one and is_there),
            MenuItem(
                "Snap to lane", tab.agent.snap, is_enabled=is_there, key="Shift+L"
            ),
            *self._lock_items(is_there),
            MenuItem(
                "Duplicate", tab.agent.duplicate, is_enabled=is_there, key="Ctrl+D"
            ),
            MenuItem("Delete", self.tab.agent.delete, key="Del"),
            MenuItem(
                "Bend the road from here",
                lambda: self.tab.road.bend_from(pose),
                is_enabled=is_one and is_there,
            ),
        )
        title = f"{kind} {agent_id}" if is_one else f"{count} agents"
        return Menu(title=title, items=items)

    def _lock_items(self, is_there: bool) -> tuple[MenuItem, ...]:
        """Unlock what is locked; else the three locks."""
        session, locks = self.ui.session, self.tab.agent.locks
        if all(name in session.scenario.locks for name in session.selection):
            return (MenuItem("Unlock", locks.toggle, key="Shift+K"),)
        beginning = locks.beginning
        return (
            MenuItem("Lock trajectory", locks.toggle, key="Shift+K"),
            MenuItem("Lock state", lambda: locks.lock(STATE_LOCK), is_enabled=is_there),
            MenuItem(
                f"Lock {beginning.in_words}",
                lambda: locks.lock(beginning),
                is_enabled=is_there,
            ),
        )

    def _of_road(self, point_m: np.ndarray) -> Menu:
        road_map = self.ui.session.scenario.road_map
        pose = RigidMotion(
            x_m=float(point_m[0]),
            y_m=float(point_m[1]),
            rotation_rad=suggested_heading(road_map, point_m, AgentKind.VEHICLE),
        )
        kind = self.tab.placing.kind.in_words
        return Menu(
            title="Road",
            items=(
                *self.tab.steering.road_items(point_m),
                MenuItem(
                    f"Place a {kind} here", lambda: self.tab.placing.place(point_m)
                ),
                MenuItem(
                    "Bend the road from here", lambda: self.tab.road.bend_from(pose)
                ),
                MenuItem(
                    "Measure from here",
                    lambda: self.tab.measure.begin_at(point_m),
                    key="M",
                ),
                MenuItem(
                    "Select all agents", self.tab.selecting.select_all, key="Ctrl+A"
                ),
            ),
        )
