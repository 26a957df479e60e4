"""The road panel: bend the road ahead of an anchor, live."""

import contextlib
from collections.abc import Callable
from typing import Any, Final, Literal

import numpy as np
import viser

from pd_editor.editor.commands import SetRoadWarp
from pd_editor.errors import EditError
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.perturbation.anchor import pose_of_anchor
from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION, summarise
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    MAX_POWER,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.interaction.anchor_gizmo import AnchorGizmo
from pd_editor.viewer.state.desk import Desk, set_property, set_value

Anchor = Literal["Focal agent", "Ego", "Selected agent", "Pose on the map"]
ANCHORS: Final[tuple[Anchor, ...]] = (
    "Focal agent",
    "Ego",
    "Selected agent",
    "Pose on the map",
)
_TITLE: Final[dict[WarpKind, str]] = {
    "smooth-turn": "Bend",
    "double-turn": "S-bend",
    "ripple-road": "Waves",
}
_LENGTH_TITLE: Final[dict[WarpKind, str]] = {
    "smooth-turn": "Turn length (m)",
    "double-turn": "Turn distance (m)",
    "ripple-road": "Wave length (m)",
}
DEFAULT_BORDER_M: Final = 5.0
DEFAULT_EXPONENT: Final = 3.0


class RoadPanel:
    """Sliders of a warp; what they show is the scenario's warp, never their own."""

    def __init__(self, desk: Desk, on_ghost: Callable[[bool], None]) -> None:
        """Build it into the current tab."""
        self._desk = desk
        gui = desk.client.gui
        self._anchor = gui.add_dropdown(
            "Anchor", ANCHORS, hint="Everything ahead of this pose moves."
        )
        self._anchor_taken = self._anchor.value
        self._own_pose: RigidMotion | None = None
        self._power: dict[WarpKind, Any] = {}
        self._length: dict[WarpKind, Any] = {}
        for kind in WARP_KINDS:
            self._power[kind] = gui.add_slider(
                _TITLE[kind], min=-MAX_POWER, max=MAX_POWER, step=0.1, initial_value=0.0
            )
        self._readout = gui.add_markdown("")
        self._slows = gui.add_checkbox(
            "Slow agents to the friction limit",
            False,
            hint="Futures are re-timed along their own curve.",
        )
        ghost = gui.add_checkbox("Show the original road", True)
        self._reset = gui.add_button(
            "Reset road", icon=viser.Icon.ARROW_BACK_UP, color="gray", disabled=True
        )
        with gui.add_folder("Shape", expand_by_default=False):
            for kind in WARP_KINDS:
                self._length[kind] = gui.add_slider(
                    _LENGTH_TITLE[kind],
                    min=5.0,
                    max=150.0,
                    step=1.0,
                    initial_value=DEFAULT_LENGTH_M[kind],
                )
            self._border = gui.add_slider(
                "Border (m)",
                min=0.0,
                max=100.0,
                step=1.0,
                initial_value=DEFAULT_BORDER_M,
            )
            self._exponent = gui.add_slider(
                "Exponent", min=2.0, max=6.0, step=0.5, initial_value=DEFAULT_EXPONENT
            )
            self._friction = gui.add_slider(
                "Friction coefficient",
                min=0.1,
                max=1.2,
                step=0.05,
                initial_value=DRY_ROAD_FRICTION,
            )
        self._gizmo = AnchorGizmo(desk, self._gizmo_moved)
        self._base = desk.session.base
        self._listen(ghost, on_ghost)

    def _listen(self, ghost: Any, on_ghost: Callable[[bool], None]) -> None:
        desk = self._desk
        sliders = [*self._power.values(), *self._length.values()]
        for handle in [*sliders, self._border, self._exponent]:
            desk.on_change(handle, lambda _value: self._changed(), merge_key="warp")
        for handle in (self._slows, self._friction):
            desk.on_change(
                handle, lambda _value: self._friction_changed(), merge_key="friction"
            )
        desk.on_change(self._anchor, lambda _value: self._anchor_changed())
        desk.on_change(ghost, on_ghost)
        desk.on_click(self._reset, self.reset)

    def reset(self) -> None:
        """Take the warp back; the original road returns exactly, inputs as at first."""
        self._desk.commit_gesture()
        for kind in WARP_KINDS:
            set_value(self._length[kind], DEFAULT_LENGTH_M[kind])
        set_value(self._border, DEFAULT_BORDER_M)
        set_value(self._exponent, DEFAULT_EXPONENT)
        set_value(self._friction, DRY_ROAD_FRICTION)
        set_value(self._slows, False)
        self._desk.apply(SetRoadWarp(warp=None, friction_coefficient=None))

    def show(self, scenario: Scenario) -> None:
        """Show the warp of a scenario."""
        if self._desk.gesture != "warp":
            self._show_values(scenario)
        self._show_anchor(scenario)
        self._show_gizmo(scenario)
        set_property(self._reset, "disabled", scenario.applied_warp is None)
        self._show_readout(scenario)

    def _show_values(self, scenario: Scenario) -> None:
        applied = scenario.applied_warp
        terms = {} if applied is None else {t.kind: t for t in applied.warp.terms}
        for kind in WARP_KINDS:
            set_value(self._power[kind], terms[kind].power if kind in terms else 0.0)
            if kind in terms:
                set_value(self._length[kind], terms[kind].length_m)
                set_value(self._border, terms[kind].border_m)
                set_value(self._exponent, terms[kind].exponent)
        if applied is not None:
            limited = applied.friction_coefficient
            set_value(self._slows, limited is not None)
            if limited is not None:
                set_value(self._friction, limited)

    def _show_readout(self, scenario: Scenario) -> None:
        applied = scenario.applied_warp
        if applied is None:
            text = "The road is as recorded. Move a slider to bend it."
        else:
            mu = self._friction.value
            summary = summarise(applied.warp, friction_coefficient=mu)
            text = (
                f"Curvature up to **{summary.max_curvature_per_m:.3f} /m** "
                f"(radius {summary.min_radius_m:.1f} m)  \n"
                f"Friction-limited speed **{summary.speed_limit_mps:.1f} m/s** "
                f"({summary.speed_limit_mps * 3.6:.0f} km/h) at mu = {mu:.2f}"
            )
        set_property(self._readout, "content", text)

    def _warp(self, anchor: RigidMotion) -> RoadWarp | None:
        terms = tuple(
            WarpTerm(
                kind=kind,
                power=float(self._power[kind].value),
                length_m=float(self._length[kind].value),
                border_m=float(self._border.value),
                exponent=float(self._exponent.value),
            )
            for kind in WARP_KINDS
            if self._power[kind].value != 0
        )
        return RoadWarp(anchor=anchor, terms=terms) if terms else None

    def _command(self, anchor: RigidMotion) -> SetRoadWarp:
        self._own_pose = anchor
        warp = self._warp(anchor)
        friction = float(self._friction.value) if self._slows.value else None
        return SetRoadWarp(
            warp=warp, friction_coefficient=None if warp is None else friction
        )

    def _changed(self) -> None:
        scenario = self._desk.session.scenario
        applied = scenario.applied_warp
        anchor = applied.warp.anchor if applied is not None else self._anchor_pose()
        self._desk.preview("warp", self._command(anchor))

    def _friction_changed(self) -> None:
        applied = self._desk.session.scenario.applied_warp
        if applied is not None:
            self._desk.preview("warp", self._command(applied.warp.anchor))
            self._show_readout(self._desk.session.scenario)

    def _anchor_changed(self) -> None:
        try:
            pose = self._anchor_pose()
        except EditError:
            set_value(self._anchor, self._anchor_taken)
            raise
        self._anchor_taken = self._anchor.value
        if self._anchor.value != "Pose on the map":
            self._gizmo.remove()
        if self._anchor.value == "Pose on the map":
            self._gizmo.place(pose)
        if self._desk.session.scenario.applied_warp is not None:
            self._desk.apply(self._command(pose))

    def _anchor_pose(self) -> RigidMotion:
        """Pose that the warp bends ahead of, on the original road."""
        scenario, choice = self._desk.session.scenario, self._anchor.value
        if choice == "Pose on the map":
            return self._gizmo.pose or _starting_pose(scenario)
        if choice == "Selected agent":
            selection = self._desk.session.selection
            if not selection:
                raise EditError("Select the agent that the road should bend ahead of.")
            return pose_of_anchor(scenario, selection[0])
        return pose_of_anchor(scenario, "ego" if choice == "Ego" else "focal")

    def _gizmo_moved(self, phase: str) -> None:
        pose = self._gizmo.pose
        if pose is None or self._desk.session.scenario.applied_warp is None:
            return
        command = self._command(pose)
        if command.warp is not None:
            self._desk.preview("anchor", command, has_end=True)
        if phase == "end":
            self._desk.commit_gesture()

    def _show_anchor(self, scenario: Scenario) -> None:
        """After undo, redo or a reload, choose the anchor that is in force."""
        applied = scenario.applied_warp
        if applied is None or applied.warp.anchor == self._own_pose:
            return
        self._own_pose = applied.warp.anchor
        choice: Anchor = "Pose on the map"
        named: tuple[tuple[Anchor, str], ...] = (
            ("Focal agent", "focal"),
            ("Ego", "ego"),
        )
        for title, name in named:
            with contextlib.suppress(EditError):
                if pose_of_anchor(scenario, name) == self._own_pose:
                    choice = title
                    break
        set_value(self._anchor, choice)
        self._anchor_taken = choice
        if choice == "Pose on the map":
            self._gizmo.place(self._own_pose)
        else:
            self._gizmo.remove()

    def _show_gizmo(self, scenario: Scenario) -> None:
        """Keep the gizmo at the anchor in force, or in the scene that was opened."""
        is_other_base = self._desk.session.base is not self._base
        self._base = self._desk.session.base
        pose, applied = self._gizmo.pose, scenario.applied_warp
        if pose is None or self._desk.gesture == "anchor":
            return
        if applied is not None and applied.warp.anchor != pose:
            self._gizmo.place(applied.warp.anchor)
        elif applied is None and is_other_base:
            self._gizmo.place(_starting_pose(scenario))


def _starting_pose(scenario: Scenario) -> RigidMotion:
    """Where an anchor starts to be dragged: in force, at the focal agent, anywhere."""
    if scenario.applied_warp is not None:
        return scenario.applied_warp.warp.anchor
    try:
        return pose_of_anchor(scenario, "focal")
    except EditError:
        x, y = np.concatenate(scenario.road_map.polylines)[:, :2].mean(axis=0)
        return RigidMotion(x_m=float(x), y_m=float(y), rotation_rad=0.0)
