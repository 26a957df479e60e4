"""An overlay without a page: what it shows is kept, and events are made up."""

import json
from typing import Any

from pd_editor.viewer.overlay.overlay import Overlay


class FakePage(Overlay):
    """Takes states and events as the page's overlay does."""

    def __init__(self) -> None:
        self._handlers, self._shown = {}, {}
        self.num_sent = 0

    def _run(self, source: str) -> None:
        self.num_sent += 1

    @property
    def shown(self) -> dict[str, Any]:
        """The newest state of each element, as JSON has it."""
        return {element: json.loads(text) for element, text in self._shown.items()}

    def send(self, element: str, event: Any) -> None:
        """Let the page tell something."""
        self._heard(json.dumps({"element": element, "event": event}))
