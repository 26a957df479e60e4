"""Presses on the picture, in the order in which the user made them."""

from collections.abc import Mapping, Sequence
from typing import Any

from pd_editor.viewer.overlay.messages import OrderState
from pd_editor.viewer.overlay.overlay import Overlay


class PressOrder:
    """Answers the page when a button or key that may arm a mode has been processed.

    A press on the picture that the user makes meanwhile waits in the page, so that it is
    the mode's even over a slow connection.
    """

    def __init__(
        self, overlay: Overlay, *, keys: Sequence[str], labels: Sequence[str]
    ) -> None:
        """Tell the page which keys, and which buttons of the panel, may arm a mode."""
        self._overlay = overlay
        self._arming = tuple(keys), tuple(labels)
        overlay.on("order", self._heard)
        self._answer(0)

    def _heard(self, event: Mapping[str, Any]) -> None:
        number = event.get("number")
        if isinstance(number, int):
            self._answer(number)

    def _answer(self, number: int) -> None:
        keys, labels = self._arming
        self._overlay.show(OrderState(keys=keys, labels=labels, answered=number))
