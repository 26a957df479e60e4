"""Looks of single inputs that viser's own options do not reach."""

import html
import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

import viser

from pd_editor.viewer.tab.ui_context import set_property, set_value

LINE_PX: Final = 20
WITH_PAST: Final = "With a made-up past (5 s)"


class PanelStyle:
    """Style rules for inputs of the panel, each named by the id of its element."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add an empty element for the rules to the current container."""
        self._rules: list[str] = []
        self._element = gui.add_html("")

    def as_list(self, buttons: Iterable[viser.GuiButtonHandle]) -> None:
        """Show buttons as the rows of a list, each with a stripe in its colour."""
        self._add(
            buttons,
            "{padding:0 0.6em;font-weight:500;color:var(--mantine-color-text);"
            "background:rgba(128,144,160,0.12);border-radius:2px;"
            "border:0 solid var(--button-bg);border-left-width:4px}",
            ":hover:not([data-disabled]){background:rgba(128,144,160,0.3)}",
            "[data-disabled]{opacity:0.4;background:none}",
            " .mantine-Button-inner{justify-content:flex-start;min-width:0}",
            # Of a long text only what fits counts for the width of the panel.
            "{width:0;min-width:100%}",
            # Mantine trims a block's text to its capitals, which cuts a "g".
            " .mantine-Button-label{display:block;height:auto;text-box:normal;"
            "line-height:1.5;"
            "overflow:hidden;text-overflow:ellipsis;white-space:nowrap}",
        )

    def unfilled(self, sliders: Iterable[viser.GuiSliderHandle[Any]]) -> None:
        """Show a slider whose zero is in its middle as a bare line.

        A fill from the left end would look half switched on at zero.
        """
        self._add(
            sliders,
            " .mantine-Slider-bar{display:none}",
            " .mantine-Slider-mark{border-color:transparent !important;"
            "background:rgb(160,170,180) !important}",
        )

    def _add(self, handles: Iterable[Any], *rules: str) -> None:
        for handle in handles:
            self._rules += [f'[id="{handle._impl.uuid}"]{rule}' for rule in rules]
        self._element.content = f"<style>{''.join(self._rules)}</style>"


class FixedText:
    """Lines of text in a space of constant height, so that elements below do not move.

    One that ``grows`` is as high as its text, up to that height. Texts are never interpreted as HTML. Long texts end in an ellipsis; the tooltip has the
    whole text.
    """

    def __init__(
        self, gui: viser.GuiApi, num_lines: int, *, grows: bool = False
    ) -> None:
        """Reserve room for some lines in the current container."""
        self._num_lines, self._limit = num_lines, "max-height" if grows else "height"
        self.element: Final = gui.add_html("")
        self.text = ""
        self.show()

    def show(self, title: str = "", *lines: str, tooltip: str | None = None) -> None:
        """Show a title in bold and lines under it; either may be empty."""
        shown = [line for line in (title, *lines) if line]
        self.text = "\n".join(shown)
        parts = [html.escape(line) for line in lines if line]
        if title:
            parts.insert(0, f"<b>{html.escape(title)}</b>")
        hint = html.escape(self.text if tooltip is None else tooltip)
        set_property(
            self.element,
            "content",
            f'<div title="{hint}" style="{self._limit}:{self._num_lines * LINE_PX}px;'
            f"overflow:hidden;display:-webkit-box;-webkit-box-orient:vertical;"
            f"-webkit-line-clamp:{self._num_lines};"
            f"margin:0 0.75em 0.5em;font-size:13px;line-height:{LINE_PX}px;"
            f'overflow-wrap:anywhere">{"<br>".join(parts)}</div>',
        )


class KeptSettings:
    """Inputs of a panel by name, and the values that they had when the page closed."""

    def __init__(self, kept: dict[str, Any], inputs: Mapping[str, Any]) -> None:
        """``kept`` belongs to the workspace; it is empty before the first page."""
        self._kept = kept
        self._inputs = inputs

    def restore(self, names: Iterable[str] | None = None) -> None:
        """Give inputs, or those of some names, their former values."""
        for name in self._inputs if names is None else names:
            if name in self._kept:
                set_value(self._inputs[name], self._kept[name])

    def keep(self) -> None:
        """Keep all values, because the page closes."""
        self._kept.update((name, one.value) for name, one in self._inputs.items())


_MARKDOWN = re.compile(r"([\\`*_{}\[\]()#+\-.!|~:@])")


def plain(text: str) -> str:
    """Markdown that shows a text as it is: no HTML, links, pictures or emphasis."""
    return _MARKDOWN.sub(r"\\\1", html.escape(text, quote=False))
