"""The view panel: camera, theme, layers."""

from collections.abc import Callable
from typing import Final

import viser

from pd_editor.viewer.meshes.road_mesh import Layer
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.ui_context import UiContext

_LAYER_TITLE: Final[dict[Layer, str]] = {
    "road": "Road surface",
    "lanes": "Lanes",
    "crosswalks": "Crosswalks",
    "markings": "Lane marks",
    "centerlines": "Centre lines",
}


class ViewPanel:
    """Controls of camera, theme and layers."""

    def __init__(
        self,
        ui: UiContext,
        viewpoint: Viewpoint,
        *,
        on_theme: Callable[[bool], None],
        on_layer: Callable[[Layer, bool], None],
        on_ribbons: Callable[[bool], None],
        on_compare: Callable[[bool], None],
    ) -> None:
        """Build it into the current tab."""
        gui = ui.client.gui
        for label, icon, hint, show in (
            ("3-D view", viser.Icon.CUBE, "V switches", viewpoint.show_3d),
            (
                "Top view",
                viser.Icon.MAP,
                "V switches; drag draws a selection box",
                viewpoint.show_top,
            ),
            ("Frame selection", viser.Icon.FOCUS_2, "F", viewpoint.frame_selection),
        ):
            button = gui.add_button(label, icon=icon, color="gray", hint=hint)
            ui.on_click(button, show)
        self._theme = gui.add_checkbox(
            "Dark theme", ui.workspace.is_dark, hint="The browser's until you choose"
        )
        ui.on_change(self._theme, on_theme)
        compare = gui.add_checkbox(
            "Compare with the original", False, hint="Hold O for a short look"
        )
        ui.on_change(compare, on_compare)
        with gui.add_folder("Layers"):
            for layer, title in _LAYER_TITLE.items():
                box = gui.add_checkbox(title, layer != "centerlines")
                ui.on_change(box, lambda value, layer=layer: on_layer(layer, value))
            ribbons = gui.add_checkbox("Past and future", True)
            ui.on_change(ribbons, on_ribbons)

    def show_theme(self, is_dark: bool) -> None:
        """Show a theme that was not chosen here."""
        self._theme.value = is_dark
