"""The mode in which the road is grabbed and pulled aside."""

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.scene.road_warp import WARP_KINDS, WarpKind
from pd_editor.viewer.overlay.messages import BendingEvent, BendingState
from pd_editor.viewer.road.road_panel import WARP_TITLE, Grip, RoadPanel
from pd_editor.viewer.scene.picking import point_of
from pd_editor.viewer.tab.mode import Mode
from pd_editor.viewer.tab.ui_context import UiContext

_PULL = "pull of the road"


class Bending(Mode):
    """Mode in which the place of the road that is pressed follows the pointer."""

    name = "bending"

    def __init__(self, ui: UiContext, road: RoadPanel) -> None:
        """Make the mode, switched off; the panel's sliders follow what is pulled."""
        super().__init__(ui)
        self._road = road
        self._grip: Grip | None = None
        self.kind: WarpKind = WARP_KINDS[0]
        ui.model.scene_left.subscribe(self.stop)

    def toggle(self) -> None:
        """Begin to pull the road, or end it."""
        self._set_active(not self.is_active)

    def _sentence(self) -> str:
        others = ", ".join(WARP_TITLE.values())
        return (
            f"{WARP_TITLE[self.kind]}: press on the road and pull it aside; keys 1 to "
            f"{len(WARP_KINDS)}: {others}."
        )

    def _show(self) -> None:
        state = BendingState(is_active=self.is_active, num_kinds=len(WARP_KINDS))
        self._overlay.show(state)

    def _heard(self, event: BendingEvent) -> None:
        """Handle a pointer event; late events of another mode are ignored."""
        what, point, post = event.kind, point_of(event.point), self._ui.post
        if what in ("end", "cancel"):
            post(lambda: self._let_go(is_kept=what == "end"))
        elif not self.is_active:
            return
        elif what == "kind":
            if 1 <= event.number <= len(WARP_KINDS):
                self.kind = WARP_KINDS[event.number - 1]
                self._changed()
        elif what == "grab" and point is not None:
            post(lambda: self._grab(point))
        elif what == "pull" and point is not None:
            # Of several that wait the newest alone, and all in their order.
            post(lambda: self._pull(point), _PULL)

    def _grab(self, point_m: np.ndarray) -> None:
        self._ui.commit_gesture()
        self._grip = self._road.grip(self.kind, point_m)

    def _pull(self, point_m: np.ndarray) -> None:
        """Pull the road to a point; after a refusal it is let go, which is told once."""
        if self._grip is None:
            return
        try:
            self._road.pull(self._grip, point_m)
        except PdEditorError:
            self._let_go(is_kept=False)
            raise

    def _let_go(self, *, is_kept: bool) -> None:
        grip, self._grip = self._grip, None
        if grip is not None and is_kept:
            self._ui.end_gesture()
        elif grip is not None:
            self._ui.abort_gesture()
