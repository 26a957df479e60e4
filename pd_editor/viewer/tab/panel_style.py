"""Looks of single inputs that viser's own options do not reach."""

import base64
import html
import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import viser

from pd_editor.base.errors import PdEditorError
from pd_editor.editor.library.thumbnail import STANDS
from pd_editor.viewer.tab.ui_context import set_property, set_value

_LOG: Final = logging.getLogger(__name__)
LINE_PX: Final = 20
ROW_PX: Final = 72
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


def _image(picture: str) -> str:
    """SVG as a value of CSS."""
    content = base64.b64encode(picture.encode()).decode()
    return f'url("data:image/svg+xml;base64,{content}")' if picture else "none"


class PictureRows:
    """A list of buttons with a small picture at the left of each, and its text beside it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Begin an empty list in the current container."""
        self._gui = gui
        self.is_closed = False
        """Whether the list is gone, so that no picture is needed any more."""
        self._rules: dict[str, str] = {}
        self._element = gui.add_html("")

    def add(
        self,
        label: str,
        picture: str = "",
        *,
        hint: str = "",
    ) -> viser.GuiButtonHandle:
        """Add a row to the current container; ``picture`` is SVG."""
        row = self._gui.add_button(label, color="gray", hint=hint or None)
        self.draw(row, picture)
        return row

    def draw(self, row: viser.GuiButtonHandle, picture: str) -> None:
        """Show another picture in a row."""
        uuid = row._impl.uuid
        image, moves = (_image(one) for one in (picture, picture.replace(STANDS, "")))
        name = f'[id="{uuid}"]'
        size = f"{ROW_PX * 3 // 2}px {ROW_PX - 2}px"
        place = f"var(--picture) no-repeat left center/{size}"
        self._rules[uuid] = (
            f"{name}{{height:{ROW_PX}px !important;"
            f"padding:0 0.6em 0 {ROW_PX * 3 // 2 + 8}px;"
            "font-weight:500;color:var(--mantine-color-text);border-radius:3px;"
            "border:1px solid rgba(128,144,160,0.4);"
            f"--picture:{image};background:{place},rgba(128,144,160,0.1)}}"
            # viser's own background of a button under the mouse is dark.
            f"{name}:hover:not([data-disabled]){{color:var(--mantine-color-text);"
            f"background:{place},rgba(128,144,160,0.22)}}"
            f"@media (prefers-reduced-motion:no-preference)"
            f"{{{name}:hover{{--picture:{moves}}}}}"
            f"{name} .mantine-Button-inner{{justify-content:flex-start}}"
            f"{name} .mantine-Button-section svg{{width:20px;height:20px}}"
            f"{name} .mantine-Button-label{{display:block;height:auto;text-box:normal;"
            "line-height:1.3;text-align:left;white-space:pre-line;overflow-wrap:anywhere;"
            f"font-weight:400;max-height:{ROW_PX - 4}px;padding-left:8px}}"
            f"{name} .mantine-Button-label::first-line{{font-weight:600}}"
        )
        self._show()

    def draw_later(
        self,
        post: Callable[[Callable[[], None]], object],
        pictures: Sequence[tuple[viser.GuiButtonHandle, Callable[[], str]]],
    ) -> None:
        """Make one picture after another, so that the page goes on meanwhile."""
        if self.is_closed or not pictures:
            return
        (row, make), *others = pictures
        try:
            self.draw(row, make())
        except PdEditorError as error:
            _LOG.info("There is no picture of %s: %s", row.label, error)
        post(lambda: self.draw_later(post, others))

    def _show(self) -> None:
        self._element.content = f"<style>{''.join(self._rules.values())}</style>"


class FixedText:
    """Lines of text in a space of constant height, so that elements below do not move.

    Texts are never interpreted as HTML. Long texts end in an ellipsis; the tooltip has the
    whole text.
    """

    def __init__(self, gui: viser.GuiApi, num_lines: int) -> None:
        """Reserve room for some lines in the current container."""
        self._num_lines = num_lines
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
            f'<div title="{hint}" style="height:{self._num_lines * LINE_PX}px;'
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
