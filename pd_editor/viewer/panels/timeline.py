"""The timeline: play, scrub, speed, loop."""

from typing import Any

from pd_editor.viewer.state.desk import Desk, set_property, set_value
from pd_editor.viewer.state.playback import Playback


class TimelinePanel:
    """A floating panel under the picture."""

    def __init__(self, desk: Desk, playback: Playback) -> None:
        """Build it."""
        self._playback = playback
        gui = desk.client.gui
        panel = gui.add_panel()
        with panel.add_tab("Timeline"):
            self._buttons = gui.add_button_group("", self._labels())
            self._scrubber = gui.add_slider(
                "Time (s)", min=-5.0, max=5.9, step=0.1, initial_value=0.0
            )
        panel.float(x=24.0, y=-24.0, width=430.0)
        self._fit_axis()

        @self._buttons.on_click
        async def _(event: Any) -> None:
            label = event.target.value
            desk.post(lambda: self._pressed(label))

        desk.on_change(self._scrubber, self._scrubbed, merge_key="scrub")

    def toggle_play(self) -> None:
        """Play or pause."""
        if self._playback.is_playing:
            self._playback.pause()
        else:
            self._playback.play()
        self.show()

    def show(self) -> None:
        """Show the playhead and the buttons as they are."""
        if self._playback.axis != self._shown_axis:
            self._fit_axis()
        labels = self._labels()
        if tuple(self._buttons.options) != labels:
            self._buttons.options = labels
        axis = self._playback.axis
        time_s = round((self._playback.step - axis.current_step) * axis.step_s, 1)
        set_value(self._scrubber, time_s)

    def _fit_axis(self) -> None:
        axis = self._playback.axis
        self._shown_axis = axis
        low = -axis.current_step * axis.step_s
        set_property(self._scrubber, "min", round(low, 1))
        set_property(self._scrubber, "max", round(low + axis.duration_s, 1))

    def _labels(self) -> tuple[str, ...]:
        playback = self._playback
        return (
            "Pause" if playback.is_playing else "Play",
            "Now",
            f"{playback.speed:g}x",
            "Loop on" if playback.loops else "Loop off",
        )

    def _pressed(self, label: str) -> None:
        if label in ("Play", "Pause"):
            self.toggle_play()
        elif label == "Now":
            self._playback.pause()
            self._playback.seek(float(self._playback.axis.current_step))
        elif label.startswith("Loop"):
            self._playback.loops = not self._playback.loops
        else:
            self._playback.next_speed()
        self.show()

    def _scrubbed(self, time_s: float) -> None:
        axis = self._playback.axis
        self._playback.pause()
        self._playback.seek(axis.current_step + time_s / axis.step_s)
        self.show()
