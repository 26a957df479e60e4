"""Python side of the elements over the picture, and the one line there that names the mode."""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final

import msgspec
import numpy as np
import viser
from viser import _messages

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.viewer.overlay.messages import (
    EVENTS,
    STATES,
    BannerEvent,
    BannerState,
    Message,
    PageEvent,
)

_LOG = logging.getLogger(__name__)
MAX_EVENT_CHARACTERS: Final = 65_536

_ELEMENTS: Final = {state: element for element, state in STATES.items()}
Handler = Callable[[Any], None]
"""Takes the messages of an element, each as what ``EVENTS`` says."""


class _Sent(msgspec.Struct, frozen=True):
    element: str
    event: msgspec.Raw


class Overlay:
    """Shows elements over one tab's picture, and receives their events.

    viser has no elements over its picture, so a script adds them to the page: it is sent
    by the message that viser uses for Plotly, and answers through a hidden input. viser's
    client is not changed. All actions of elements are also available by keys or in the
    panel, so that a page without the script stays usable.
    """

    def __init__(
        self, client: viser.ClientHandle, post: Callable[[Callable[[], None]], None]
    ) -> None:
        """Start the script in the tab's page; ``post`` runs events on the worker."""
        self._client = client
        self._handlers: dict[str, Handler] = {}
        self._shown: dict[str, str] = {}
        self.is_ready = False
        self.on_ready: Callable[[], None] = lambda: None
        """Called when the page has begun to draw."""
        self._answers = client.gui.add_text("overlay", "", visible=False)

        @self._answers.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                text = str(event.target.value)
                post(lambda: self._heard(text))

        uuid = self._answers._impl.uuid
        self._run(f"{page_script()}\nstart({json.dumps(uuid)});")
        self.on("page", self._page_said)

    def show(self, state: Message) -> None:
        """Send an element's state unless the page shows it already.

        An element replaces what it showed before as a whole.
        """
        element = _ELEMENTS[type(state)]
        # Numbers of NumPy, too, of which msgspec knows nothing.
        values = msgspec.to_builtins(state, enc_hook=np.generic.item)
        text = json.dumps(values, separators=(",", ":"), allow_nan=False)
        if self._shown.get(element) != text:
            self._shown[element] = text
            self._run(f"pdOverlay.update({json.dumps(element)}, {text});")

    def on(self, element: str, handler: Handler) -> None:
        """Call ``handler`` on the session's worker with each event of an element."""
        self._handlers[element] = handler

    def _run(self, source: str) -> None:
        self._client.gui._websock_interface.queue_message(
            _messages.RunJavascriptMessage(source=source)
        )

    def _heard(self, text: str) -> None:
        """Dispatch an event; invalid events are dropped."""
        if len(text) > MAX_EVENT_CHARACTERS:
            return
        try:
            sent = msgspec.json.decode(text, type=_Sent)
            handler = self._handlers[sent.element]
            event = msgspec.json.decode(sent.event, type=EVENTS[sent.element])
        except (msgspec.DecodeError, UnicodeError, KeyError, RecursionError):
            _LOG.info("The page sent an event that no element sends.")
            return
        handler(event)

    def _page_said(self, event: PageEvent) -> None:
        if event.kind == "ready":
            self.is_ready = True
            self.on_ready()
        else:
            _LOG.warning("viser's page lacks what the editor needs: %s", event.names)


@cache
def page_script() -> str:
    """The script that starts all elements, but for the address of their answers."""
    folder = files("pd_editor.viewer.overlay")
    script, style = (
        folder.joinpath(name).read_text("utf-8") for name in ("page.js", "page.css")
    )
    icons = {name: kind.icon for name, kind in KINDS.items()}
    given = f"{json.dumps(icons)}, {json.dumps(style)}"
    return f"{script}\nconst start = (uuid) => pdOverlay.start(uuid, {given});"


MODE: Final = 20
"""Priority of a mode that takes clicks: placing, measuring."""
OFFER: Final = 10
"""Priority of something shown that can be clicked, such as candidates."""
STATE: Final = 0
"""Priority of states, such as the time of the picture."""


@dataclass(frozen=True, kw_only=True)
class _Claim:
    text: str
    buttons: Mapping[str, Callable[[], None]]
    priority: int


class Banner:
    """Shows the text of the owner with the highest priority."""

    def __init__(self, overlay: Overlay) -> None:
        """Show nothing yet."""
        self._overlay = overlay
        self._claims: dict[str, _Claim] = {}
        overlay.on("banner", self._heard)
        self._draw()

    @property
    def text(self) -> str | None:
        """Text of the banner; None while it is hidden."""
        owner = self._shown_owner()
        return None if owner is None else self._claims[owner].text

    def show(
        self,
        owner: str,
        text: str,
        *,
        buttons: Mapping[str, Callable[[], None]] | None = None,
        priority: int = MODE,
    ) -> None:
        """Show a sentence until ``hide``; replaces the owner's earlier one.

        Buttons may follow, with actions on the session's worker. The text with the
        highest priority is shown, the latest of equals.
        """
        former = self._claims.get(owner)
        if former is None or former.priority != priority:
            self._claims.pop(owner, None)
        self._claims[owner] = _Claim(
            text=text, buttons=buttons or {}, priority=priority
        )
        self._draw()

    def hide(self, owner: str) -> None:
        """Remove the owner's text."""
        if self._claims.pop(owner, None) is not None:
            self._draw()

    def _shown_owner(self) -> str | None:
        owners = reversed(self._claims)
        return max(owners, key=lambda name: self._claims[name].priority, default=None)

    def _draw(self) -> None:
        owner = self._shown_owner()
        if owner is None:
            self._overlay.show(BannerState())
            return
        claim = self._claims[owner]
        buttons = tuple(claim.buttons)
        self._overlay.show(BannerState(owner=owner, text=claim.text, buttons=buttons))

    def _heard(self, event: BannerEvent) -> None:
        """Run the action of an owner's button."""
        claim = self._claims.get(event.owner or "")
        press = None if claim is None else claim.buttons.get(event.button)
        if press is not None:
            press()
