"""The road panel: warps the road ahead of an anchor, live."""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import viser
from jaxtyping import Float

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import listed, number_of
from pd_editor.editor.commands import SetRoadWarp, SlowToFrictionLimit
from pd_editor.editor.commands.command import parts_of
from pd_editor.editor.commands.edit_limits import check_anchor
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.paths.suggested_state import suggested_heading
from pd_editor.scene.perturbation.friction import (
    DRY_ROAD_FRICTION,
    SlowedAgent,
    slowed_agents,
    summarise,
)
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    MAX_POWER,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.scenario import EGO_ID, AppliedWarp, Scenario
from pd_editor.viewer.road.anchor import AnchorGizmo, AnchorView
from pd_editor.viewer.scene.picture import Picture
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.panel_style import FixedText, PanelStyle
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

Anchor = Literal["Focal agent", "Ego", "Selected agent", "A point that I drag"]
FOCAL: Final[Anchor] = "Focal agent"
EGO: Final[Anchor] = "Ego"
SELECTED: Final[Anchor] = "Selected agent"
POINT: Final[Anchor] = "A point that I drag"
ANCHORS: Final[tuple[Anchor, ...]] = (FOCAL, EGO, SELECTED, POINT)
WARP_TITLE: Final[dict[WarpKind, str]] = {
    "smooth-turn": "Bend",
    "double-turn": "S-bend",
    "ripple-road": "Waves",
}
_HINT: Final[dict[WarpKind, str]] = {
    "smooth-turn": "Left +, right -. Smooth turn of Scene-Attack.",
    "double-turn": "First left +, first right -. Double turn of Scene-Attack.",
    "ripple-road": "First left +, first right -. Ripple road of Scene-Attack.",
}
_LENGTH_TITLE: Final[dict[WarpKind, str]] = {
    "smooth-turn": "Length of the bend (m)",
    "double-turn": "Length of the S (m)",
    "ripple-road": "Wave length (m)",
}
_POWER_MARKS: Final = ((-MAX_POWER, "right -"), (0.0, "0"), (MAX_POWER, "left +"))
DEFAULT_BORDER_M: Final = 5.0
DEFAULT_EXPONENT: Final = 3.0
MAX_SLOWED_NAMED: Final = 3
LEAST_GAIN_M: Final = 0.3
"""Displacement per power below which a place of the road cannot be pulled."""
_NOT_OWN: Final = object()
"""Different from all warps: inputs must be updated."""


@dataclass(frozen=True, kw_only=True)
class Grip:
    """A place of the road that is held while the pointer pulls it aside."""

    kind: WarpKind
    anchor: RigidMotion
    left_m: float
    """Offset of the place in the anchor's frame when it was grabbed."""
    power: float
    """Power of the kind by then."""
    gain_m: float
    """Displacement of the place per power, in which warps are linear."""

    def power_at(self, point_m: Float[np.ndarray, "2"]) -> float:
        """Power with which the place is beside a point, within the limits."""
        _, left_m = self.anchor.inverse().apply(point_m)
        power = self.power + (float(left_m) - self.left_m) / self.gain_m
        return round(min(max(power, -MAX_POWER), MAX_POWER), 2)


class RoadPanel:
    """Sliders of a warp, which show the scenario's warp.

    Shape sliders may be set while the road is straight; they then apply to the next warp.
    Undo, redo and another scenario update all of them.
    """

    def __init__(
        self,
        ui: UiContext,
        style: PanelStyle,
        picture: Picture,
        viewpoint: Viewpoint,
    ) -> None:
        """Build it into the current tab."""
        self._ui = ui
        self._view = AnchorView(ui.client)
        self._viewpoint = viewpoint
        self._power: dict[WarpKind, Any] = {}
        self._length: dict[WarpKind, Any] = {}
        self._own_pose: RigidMotion | None = None
        self._marks_anchor = False
        """Whether the anchor is marked in the picture of a road that is not bent."""
        self._was_bent = False
        self._own_warp: object = (None, None)
        """Warp and friction coefficient that the inputs show."""
        self._slowed_of: AppliedWarp | None = None
        gui = ui.client.gui
        for kind in WARP_KINDS:
            self._power[kind] = gui.add_slider(
                WARP_TITLE[kind],
                min=-MAX_POWER,
                max=MAX_POWER,
                step=0.1,
                initial_value=0.0,
                marks=_POWER_MARKS,
                hint=_HINT[kind],
            )
        style.unfilled(self._power.values())
        self._readout = FixedText(gui, 2)
        ghost = gui.add_checkbox("Show the original road", True)
        self._reset = gui.add_button(
            "Reset road", icon=viser.Icon.ARROW_BACK_UP, color="gray", disabled=True
        )
        self._build_friction(gui)
        with gui.add_folder("Where it bends", expand_by_default=False):
            self._build_anchor(gui)
        with gui.add_folder("Shape", expand_by_default=False):
            self._build_shape(gui)
        self._gizmo = AnchorGizmo(ui, self._gizmo_moved)
        self._base = ui.session.base
        self._listen()
        ui.on_change(ghost, picture.set_original_road_shown)
        ui.model.shown.subscribe(self.show)

    def _build_friction(self, gui: viser.GuiApi) -> None:
        self._slows = gui.add_checkbox(
            "Slow agents to the friction limit",
            False,
            hint="Re-timed along their own curves. An agent that cannot brake in time "
            "is also slower at t = 0.",
        )
        self._friction = gui.add_slider(
            "Friction",
            min=0.1,
            max=1.2,
            step=0.05,
            initial_value=DRY_ROAD_FRICTION,
            hint="0.7 dry, 0.4 wet, 0.15 ice",
        )
        self._slowed = FixedText(gui, 3, grows=True)

    def _build_anchor(self, gui: viser.GuiApi) -> None:
        self._anchor = gui.add_dropdown(
            "Anchor", ANCHORS, hint="Everything ahead of this pose moves."
        )
        self._anchor_taken = self._anchor.value
        self._missing = FixedText(gui, 2)
        self._anchor_at = gui.add_vector2("Anchor at (m)", (0.0, 0.0), step=0.5)
        self._anchor_heading = gui.add_number("Anchor heading (deg)", 0.0, step=1.0)
        self._anchor_at.precision = self._anchor_heading.precision = 1
        self._frame = gui.add_button(
            "Look at the anchor", icon=viser.Icon.FOCUS_2, color="gray"
        )

    def _build_shape(self, gui: viser.GuiApi) -> None:
        for kind in WARP_KINDS:
            self._length[kind] = gui.add_slider(
                _LENGTH_TITLE[kind],
                min=5.0,
                max=150.0,
                step=1.0,
                initial_value=DEFAULT_LENGTH_M[kind],
            )
        self._border = gui.add_slider(
            "Starts after (m)",
            min=0.0,
            max=100.0,
            step=1.0,
            initial_value=DEFAULT_BORDER_M,
            hint="Distance ahead of the anchor where the road begins to bend.",
        )
        self._exponent = gui.add_slider(
            "Sharpness",
            min=2.0,
            max=6.0,
            step=0.5,
            initial_value=DEFAULT_EXPONENT,
            hint="Exponent of the bends; waves have none.",
        )
        self._reset_shape = gui.add_button("Reset shape", color="gray", disabled=True)

    def _listen(self) -> None:
        ui = self._ui
        sliders = [*self._power.values(), *self._length.values()]
        for handle in [*sliders, self._border, self._exponent]:
            ui.on_change(handle, lambda _value: self._changed(), merge_key="warp")
        for handle in (self._slows, self._friction):
            ui.on_change(
                handle, lambda _value: self._friction_changed(), merge_key="friction"
            )
        for handle in (self._anchor_at, self._anchor_heading):
            ui.on_change(handle, lambda _value: self._pose_typed(), merge_key="pose")
        ui.on_change(
            self._anchor,
            lambda _value: self._anchor_changed(),
            failure="Anchor not changed",
        )
        ui.on_click(self._reset, self.reset)
        ui.on_click(self._reset_shape, self.reset_shape)
        ui.on_click(self._frame, self._look_at_anchor, failure="No anchor to look at")

    def reset(self) -> None:
        """Remove the warp and reset the inputs; the original road is restored exactly."""
        self._ui.commit_gesture()
        self._show_defaults()
        self._own_warp = (None, None)
        self._ui.apply(SetRoadWarp(warp=None, friction_coefficient=None))
        self._show_resets(self._ui.session.scenario)

    def reset_shape(self) -> None:
        """Give lengths, start and sharpness their first values; powers stay."""
        self._ui.commit_gesture()
        self._show_default_shape()
        applied = self._ui.session.scenario.applied_warp
        if applied is not None:
            self._ui.apply(self._command(applied.warp.anchor))
        self._show_resets(self._ui.session.scenario)

    def show(self) -> None:
        """Show the warp of the scenario."""
        scenario, selection = self._ui.session.scenario, self._ui.session.selection
        is_other_base = self._ui.session.base is not self._base
        self._base = self._ui.session.base
        if self._ui.gesture != "warp":
            self._show_values(scenario, is_other_base)
        self._show_anchor(scenario, is_other_base)
        self._show_gizmo(scenario, is_other_base)
        self._show_choices(scenario, selection)
        self._show_pose(scenario)
        self._show_resets(scenario)
        self._show_readout(scenario)
        if not self._ui.session.state.is_previewing:
            self._show_slowed(scenario)

    def _show_values(self, scenario: Scenario, is_other_base: bool) -> None:
        """Set all inputs, unless the warp is the one that this panel set last."""
        applied = scenario.applied_warp
        in_force = (None, None)
        if applied is not None:
            in_force = (applied.warp, applied.friction_coefficient)
        if self._own_warp == in_force and not is_other_base:
            return
        self._own_warp = in_force
        self._show_defaults()
        if applied is None:
            return
        for term in applied.warp.terms:
            set_value(self._power[term.kind], term.power)
            set_value(self._length[term.kind], term.length_m)
            set_value(self._border, term.border_m)
            set_value(self._exponent, term.exponent)
        limited = applied.friction_coefficient
        set_value(self._slows, limited is not None)
        if limited is not None:
            set_value(self._friction, limited)

    def _show_defaults(self) -> None:
        for kind in WARP_KINDS:
            set_value(self._power[kind], 0.0)
        self._show_default_shape()
        set_value(self._friction, DRY_ROAD_FRICTION)
        set_value(self._slows, False)

    def _show_default_shape(self) -> None:
        for handle, default in self._default_shape():
            set_value(handle, default)

    def _default_shape(self) -> list[tuple[Any, float]]:
        lengths = [(self._length[kind], DEFAULT_LENGTH_M[kind]) for kind in WARP_KINDS]
        return [
            *lengths,
            (self._border, DEFAULT_BORDER_M),
            (self._exponent, DEFAULT_EXPONENT),
        ]

    def _show_resets(self, scenario: Scenario) -> None:
        """A reset is offered whenever anything differs from the first values."""
        is_shaped = any(
            handle.value != value for handle, value in self._default_shape()
        )
        is_bent = scenario.applied_warp is not None or any(
            handle.value != 0 for handle in self._power.values()
        )
        has_friction = self._slows.value or self._friction.value != DRY_ROAD_FRICTION
        set_property(
            self._reset, "disabled", not (is_bent or is_shaped or has_friction)
        )
        set_property(self._reset_shape, "disabled", not is_shaped)

    def _show_readout(self, scenario: Scenario) -> None:
        applied = scenario.applied_warp
        if applied is None:
            self._readout.show(
                recorded_road_in_words(self._ui.session.base),
                "Move a slider to bend it.",
            )
            return
        mu = float(self._friction.value)
        summary = summarise(applied.warp, friction_coefficient=mu)
        speed = summary.speed_limit_mps
        self._readout.show(
            "",
            f"Smallest radius of the bend {summary.min_radius_m:.1f} m"
            f" ({summary.max_curvature_per_m:.3f} /m)",
            f"Friction-limited speed {speed:.1f} m/s ({speed * 3.6:.0f} km/h)"
            f" at friction {mu:.2f}",
        )

    def _show_slowed(self, scenario: Scenario) -> None:
        """Show which agents the friction limit has slowed, and by how much."""
        applied = scenario.applied_warp
        if applied is None or applied.friction_coefficient is None:
            self._slowed_of = None
            self._slowed.show("", once_slowed_in_words(self._once_slowed(scenario)))
            return
        if applied is self._slowed_of:
            return
        self._slowed_of = applied
        slowed = slowed_agents(applied, scenario.time_axis)
        self._slowed.show(*slowed_in_words(slowed, most=MAX_SLOWED_NAMED))

    def _once_slowed(self, scenario: Scenario) -> tuple[str, ...]:
        """Agents that were slowed by an edit of its own, not by the road's setting."""
        ids = {
            agent_id
            for part in parts_of(
                self._ui.session.commands_in_force, SlowToFrictionLimit
            )
            for agent_id in part.agent_ids
        }
        return tuple(one for one in scenario.agents.ids if one in ids)

    def _warp(self, anchor: RigidMotion) -> RoadWarp | None:
        terms = tuple(
            self._term(kind, float(self._power[kind].value))
            for kind in WARP_KINDS
            if self._power[kind].value
        )
        return RoadWarp(anchor=anchor, terms=terms) if terms else None

    def _term(self, kind: WarpKind, power: float) -> WarpTerm:
        return WarpTerm(
            kind=kind,
            power=power,
            length_m=float(self._length[kind].value),
            border_m=float(self._border.value),
            exponent=float(self._exponent.value),
        )

    def _command(self, anchor: RigidMotion) -> SetRoadWarp:
        self._own_warp = _NOT_OWN
        warp = self._warp(anchor)
        friction = None
        if self._slows.value and warp is not None:
            friction = float(self._friction.value)
        command = SetRoadWarp(warp=warp, friction_coefficient=friction)
        self._own_pose, self._own_warp = anchor, (warp, friction)
        return command

    def _preview(self, anchor: RigidMotion) -> None:
        """Show the warp of the inputs at an anchor."""
        try:
            self._ui.preview_value("warp", lambda: self._command(anchor))
        except EditError:
            self._own_warp = _NOT_OWN
            raise

    def _changed(self) -> None:
        scenario = self._ui.session.scenario
        applied = scenario.applied_warp
        anchor = applied.warp.anchor if applied is not None else self._anchor_pose()
        self._preview(anchor)
        self._show_resets(self._ui.session.scenario)

    def _friction_changed(self) -> None:
        applied = self._ui.session.scenario.applied_warp
        if applied is not None:
            self._preview(applied.warp.anchor)
            self._show_readout(self._ui.session.scenario)
        self._show_resets(self._ui.session.scenario)

    def bend_from(self, pose: RigidMotion) -> None:
        """Use a pose on the shown road as the anchor of the warp."""
        self._take_point(pose)
        if self._ui.session.scenario.applied_warp is None:
            self._ui.notify(
                "Bend from here", "Pull the road aside (W), or use the tab Road."
            )

    def _take_point(self, pose: RigidMotion) -> None:
        self._offer((*self._anchor.options, POINT))
        set_value(self._anchor, POINT)
        self._take_anchor(POINT, pose)

    def grip(self, kind: WarpKind, point_m: Float[np.ndarray, "2"]) -> Grip:
        """Grab the shown road at a point, to pull it by a warp of a kind.

        A road that is not bent yet bends a little before the point, if the anchor is not.

        Raises:
            EditError: the warp in force hardly moves this place.
        """
        scenario = self._ui.session.scenario
        applied, term = scenario.applied_warp, self._term(kind, 1.0)
        anchor = self._anchor_pose() if applied is None else applied.warp.anchor
        ahead_m, left_m = anchor.inverse().apply(point_m)
        gain_m = float(term.derivative(ahead_m, 0))
        if gain_m < LEAST_GAIN_M and applied is not None:
            raise EditError(
                "The road hardly bends here: pull it farther ahead of the purple mark, "
                "or drag the mark."
            )
        if gain_m < LEAST_GAIN_M:
            heading = suggested_heading(scenario.road_map, point_m, AgentKind.VEHICLE)
            steps_m = np.arange(0.0, term.border_m + 3 * term.length_m)
            gains_m = term.derivative(steps_m, 0)
            # Displacement per power of the place that is pulled, when the road bends
            # before it.
            nearest = int(np.argmax(gains_m >= min(1.0, gains_m.max())))
            back_m = -steps_m[nearest] * np.array([np.cos(heading), np.sin(heading)])
            x, y = (point_m + back_m).tolist()
            anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
            self._take_point(anchor)
            left_m, gain_m = 0.0, float(gains_m[nearest])
        return Grip(
            kind=kind,
            anchor=anchor,
            left_m=float(left_m),
            power=float(self._power[kind].value),
            gain_m=gain_m,
        )

    def pull(self, grip: Grip, point_m: Float[np.ndarray, "2"]) -> None:
        """Show the warp that moves the grabbed place beside a point, until it is let go.

        Raises:
            EditError: the scene does not allow it; what was shown before stays.
        """
        set_value(self._power[grip.kind], grip.power_at(point_m))
        self._pulled("warp", grip.anchor)
        self._show_resets(self._ui.session.scenario)

    def _pulled(self, owner: str, anchor: RigidMotion) -> None:
        """Show the warp of the inputs at an anchor, until the pointer lets go."""
        try:
            command = self._command(anchor)
            if owner == "warp" or command.warp is not None:
                self._ui.preview(owner, command)
        except EditError:
            self._own_warp = _NOT_OWN
            raise

    def _anchor_changed(self) -> None:
        try:
            pose = self._anchor_pose()
        except EditError:
            set_value(self._anchor, self._anchor_taken)
            raise
        self._take_anchor(self._anchor.value, pose)

    def _take_anchor(self, choice: Anchor, pose: RigidMotion) -> None:
        """Use a pose as the anchor of the warp, and mark it in the picture."""
        self._anchor_taken = choice
        self._own_pose, self._marks_anchor = pose, True
        if choice == POINT:
            self._gizmo.place(pose)
        else:
            self._gizmo.remove()
        if self._ui.session.scenario.applied_warp is not None:
            self._ui.apply(self._command(pose))
        self._show_pose(self._ui.session.scenario)

    def _pose_typed(self) -> None:
        x, y = self._anchor_at.value
        heading = self._anchor_heading.value
        if not np.isfinite([x, y, heading]).all():
            return
        pose = RigidMotion(
            x_m=float(x), y_m=float(y), rotation_rad=float(np.radians(heading))
        )
        if self._ui.session.scenario.applied_warp is not None:
            self._preview(pose)
        else:
            check_anchor(pose)
        self._offer((*self._anchor.options, POINT))
        set_value(self._anchor, POINT)
        self._anchor_taken = POINT
        self._own_pose, self._marks_anchor = pose, True
        self._gizmo.place(pose)
        self._show_pose(self._ui.session.scenario)

    def _anchor_pose(self) -> RigidMotion:
        """Pose that the warp bends ahead of, on the original road."""
        scenario, choice = self._ui.session.scenario, self._anchor.value
        if choice == POINT:
            return self._gizmo.pose or self._own_pose or _starting_pose(scenario)
        if choice == SELECTED:
            selection = self._ui.session.selection
            if len(selection) != 1:
                raise EditError(
                    "Select the one agent that the road should bend ahead of."
                )
            return pose_of_anchor(scenario, selection[0])
        return pose_of_anchor(scenario, "ego" if choice == EGO else "focal")

    def _look_at_anchor(self) -> None:
        scenario = self._ui.session.scenario
        applied = scenario.applied_warp
        pose = self._anchor_pose() if applied is None else applied.warp.anchor
        self._viewpoint.frame_pose(pose)

    def _gizmo_moved(self, phase: str) -> None:
        pose = self._gizmo.pose
        if pose is None:
            return
        if self._ui.session.scenario.applied_warp is None:
            self._own_pose, self._marks_anchor = pose, True
            self._show_pose(self._ui.session.scenario)
            return
        try:
            self._pulled("anchor", pose)
        finally:
            if phase == "end":
                self._ui.end_gesture()

    def _show_anchor(self, scenario: Scenario, is_other_base: bool) -> None:
        """After undo, redo or a reload, choose the anchor that is in force."""
        applied = scenario.applied_warp
        if applied is None and (is_other_base or self._was_bent):
            self._marks_anchor = False
        self._was_bent = applied is not None
        if applied is None and is_other_base:
            self._own_pose = None
            first = next(iter(_choices(scenario, ())[0]))
            set_value(self._anchor, first)
            self._anchor_taken = first
        if applied is None:
            return
        shown, anchor = self._anchor.value, applied.warp.anchor
        choice: Anchor = POINT
        named: tuple[tuple[Anchor, str], ...] = ((EGO, "ego"), (FOCAL, "focal"))
        for title, name in sorted(named, key=lambda one: one[0] == shown):
            with contextlib.suppress(EditError):
                if pose_of_anchor(scenario, name) == anchor:
                    choice = title
        # An agent that was moved leaves the anchor behind.
        is_left = shown in (FOCAL, EGO) and choice != shown
        if anchor == self._own_pose and not is_left:
            return
        self._own_pose = anchor
        self._offer((*self._anchor.options, choice))
        set_value(self._anchor, choice)
        self._anchor_taken = choice
        if choice == POINT:
            self._gizmo.place(self._own_pose)
        else:
            self._gizmo.remove()

    def _show_gizmo(self, scenario: Scenario, is_other_base: bool) -> None:
        """Keep the gizmo at the applied anchor; remove it for a newly opened scene."""
        pose, applied = self._gizmo.pose, scenario.applied_warp
        if pose is None or self._ui.gesture == "anchor":
            return
        if applied is not None and applied.warp.anchor != pose:
            self._gizmo.place(applied.warp.anchor)
        elif applied is None and is_other_base:
            self._gizmo.remove()

    def _show_choices(self, scenario: Scenario, selection: tuple[str, ...]) -> None:
        """Offer the available anchors, and explain why others are not available."""
        offered, missing = _choices(scenario, selection)
        if scenario.applied_warp is None and self._anchor.value not in offered:
            set_value(self._anchor, offered[0])
            self._anchor_taken = offered[0]
        self._offer((*offered, self._anchor.value))
        self._missing.show("", f"Not offered: {'; '.join(missing)}." if missing else "")

    def _offer(self, choices: Sequence[str]) -> None:
        """Offer some anchors in their usual order."""
        options: tuple[Anchor, ...] = tuple(one for one in ANCHORS if one in choices)
        if tuple(self._anchor.options) != options:
            self._anchor.options = options

    def _show_pose(self, scenario: Scenario) -> None:
        """Numbers of the anchor, and its mark in the picture."""
        applied = scenario.applied_warp
        try:
            pose = self._anchor_pose() if applied is None else applied.warp.anchor
        except EditError:
            pose = None
        nan = float("nan")
        x, y, heading = (
            (nan, nan, nan)
            if pose is None
            else (pose.x_m, pose.y_m, float(np.degrees(pose.rotation_rad)))
        )
        set_value(self._anchor_at, (round(x, 1), round(y, 1)))
        set_value(self._anchor_heading, round(math.remainder(heading, 360.0), 1))
        is_marked = applied is not None or self._marks_anchor
        self._view.show(
            pose if is_marked else None,
            float(self._border.value) if applied is None else applied.warp.border_m(),
        )


def recorded_road_in_words(base: Scenario) -> str:
    """Describe a road without a warp of this session."""
    if base.provenance.is_bent:
        return "This scenario was exported bent (see its recipe)."
    return "The road is as recorded."


def slowed_in_words(slowed: Sequence[SlowedAgent], *, most: int) -> tuple[str, str]:
    """A title and a sentence about agents that were slowed."""
    if not slowed:
        return "No agent is too fast for it.", ""
    named = [
        f"{agent.agent_id} {agent.before_mps:.1f} to {agent.after_mps:.1f} m/s"
        + (f" at t = {agent.time_s:.1f} s" if agent.time_s else " at t = 0")
        for agent in slowed[:most]
    ]
    if len(slowed) > most:
        named.append(f"{len(slowed) - most} more")
    return f"{number_of(len(slowed), 'agent')} slowed:", "; ".join(named)


def once_slowed_in_words(agent_ids: tuple[str, ...]) -> str:
    """A sentence about the agents that edits have slowed while the setting is off."""
    if not agent_ids:
        return ""
    return f"Off; a repair has slowed {listed(agent_ids, MAX_SLOWED_NAMED)} alone."


def _choices(
    scenario: Scenario, selection: tuple[str, ...]
) -> tuple[list[Anchor], list[str]]:
    """Available anchors, and reasons why others are not available."""
    agents, step = scenario.agents, scenario.current_step

    def is_there(agent_id: str) -> bool:
        row = agents.row_of.get(agent_id)
        return row is not None and bool(agents.is_valid[row, step])

    reasons: dict[Anchor, str | None] = {
        FOCAL: None if is_there(scenario.focal_id) else "focal agent (there is none)",
        EGO: None if is_there(EGO_ID) else "ego (there is none)",
        SELECTED: "selected agent (select one)"
        if len(selection) != 1
        else None
        if is_there(selection[0])
        else "selected agent (not there at t = 0)",
        POINT: None,
    }
    offered: list[Anchor] = [one for one in ANCHORS if reasons[one] is None]
    return offered, [reason for reason in reasons.values() if reason is not None]


def _starting_pose(scenario: Scenario) -> RigidMotion:
    """Initial pose of a dragged anchor: the applied one, the focal agent, or any pose."""
    if scenario.applied_warp is not None:
        return scenario.applied_warp.warp.anchor
    try:
        return pose_of_anchor(scenario, "focal")
    except EditError:
        x, y = np.concatenate(scenario.road_map.polylines)[:, :2].mean(axis=0)
        return RigidMotion(x_m=float(x), y_m=float(y), rotation_rad=0.0)
