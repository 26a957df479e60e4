"""Looks of single inputs that viser's own options do not reach."""

from collections.abc import Iterable
from typing import Any

import viser


class PanelStyle:
    """Style rules for inputs of the panel, each named by the id of its element."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add an empty element for the rules to the current container."""
        self._rules: list[str] = []
        self._element = gui.add_html("")

    def align_left(self, buttons: Iterable[viser.GuiButtonHandle]) -> None:
        """Begin the texts of buttons at their left edge, as in a list."""
        self._add(
            buttons,
            "{padding:0 0.6em;font-weight:500}",
            " .mantine-Button-inner{justify-content:flex-start}",
        )

    def unfilled(self, sliders: Iterable[viser.GuiSliderHandle[Any]]) -> None:
        """Show a slider whose zero is in its middle as a bare line.

        A fill from the left end would look half switched on at zero.
        """
        self._add(sliders, " .mantine-Slider-bar{display:none}")

    def _add(self, handles: Iterable[Any], *rules: str) -> None:
        for handle in handles:
            self._rules += [f'[id="{handle._impl.uuid}"]{rule}' for rule in rules]
        self._element.content = f"<style>{''.join(self._rules)}</style>"
