"""One line over the picture that says which mode the editor is in."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pd_editor.viewer.overlay.messages import BannerState
from pd_editor.viewer.overlay.overlay import Overlay

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

    def _heard(self, event: Mapping[str, Any]) -> None:
        """Run the action of an owner's button."""
        claim = self._claims.get(str(event.get("owner")))
        press = None if claim is None else claim.buttons.get(str(event.get("button")))
        if press is not None:
            press()
