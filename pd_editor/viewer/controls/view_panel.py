"""The view panel: theme, layers."""

from functools import partial
from typing import Final

import numpy as np
import viser

from pd_editor.viewer.meshes.road_mesh import Layer
from pd_editor.viewer.overlay.messages import ThemeEvent, ThemeState
from pd_editor.viewer.scene.picture import Picture
from pd_editor.viewer.tab.ui_context import UiContext

_LAYER_TITLE: Final[dict[Layer, str]] = {
    "road": "Road surface",
    "lanes": "Lanes",
    "crosswalks": "Crosswalks",
    "markings": "Lane marks",
    "centerlines": "Centre lines",
}


class ViewPanel:
    """Controls of theme and layers."""

    def __init__(self, ui: UiContext, picture: Picture) -> None:
        """Build it into the current tab."""
        self._ui = ui
        gui = ui.client.gui
        self._theme = gui.add_checkbox(
            "Dark theme", ui.workspace.is_dark, hint="The browser's until you choose"
        )
        ui.on_change(self._theme, self._choose_theme)
        ui.overlay.on("theme", self._theme_asked)
        compare = gui.add_checkbox(
            "Compare with the original", False, hint="Hold O for a short look"
        )
        ui.on_change(compare, picture.comparison.keep)
        with gui.add_folder("Layers"):
            for layer, title in _LAYER_TITLE.items():
                box = gui.add_checkbox(title, layer != "centerlines")
                ui.on_change(box, partial(picture.map.set_layer_visible, layer))
            ribbons = gui.add_checkbox("Trajectories", True)
            ui.on_change(ribbons, picture.ribbons.set_visible)

    def _theme_asked(self, event: ThemeEvent) -> None:
        """Take the theme that the page asks for: the browser's, or the one kept there."""
        if event.is_dark != self._ui.workspace.is_dark:
            self._theme.value = event.is_dark
            self._set_theme(event.is_dark)

    def _choose_theme(self, is_dark: bool) -> None:
        self._ui.overlay.show(ThemeState(is_dark=is_dark))
        self._set_theme(is_dark)

    def _set_theme(self, is_dark: bool) -> None:
        self._ui.workspace.is_dark = is_dark
        send_theme(self._ui.client, is_dark=is_dark)
        with self._ui.client.atomic():
            self._ui.model.theme_changed.emit()
            self._ui.model.shown.emit()


def send_theme(client: viser.ClientHandle, *, is_dark: bool) -> None:
    """Let viser's page have a theme."""
    client.gui.configure_theme(
        dark_mode=is_dark, show_logo=False, show_share_button=False
    )


def configure_page(client: viser.ClientHandle, *, is_dark: bool) -> None:
    """Set up viser's page: theme, panel, light."""
    send_theme(client, is_dark=is_dark)
    client.gui.set_panel_label("Path Diffuser Editor")
    client.gui.main_panel.dock_right()
    client.gui.main_panel.set_width(372)
    # No environment map: without a fast GPU the page would prepare it for seconds,
    # with an almost transparent picture meanwhile. Sky and ground replace it.
    client.scene.configure_environment_map(None)
    client.scene.configure_default_lights(enabled=True, cast_shadow=False)
    client.scene.add_light_hemisphere(
        "/sky",
        sky_color=(255, 255, 255),
        ground_color=(150, 150, 150),
        intensity=2.2,
        wxyz=(np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
    )
