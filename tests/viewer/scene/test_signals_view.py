"""Stop lines are sent when a state changes, and only then."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np

from pd_editor.scene.palette import DARK, LIGHT
from pd_editor.scene.signals import SignalState
from pd_editor.viewer.scene.map_view import SignalsView
from tests.builders import two_agents_that_pass
from tests.scene.test_signals import signalled


class Sent:
    """A client's scene that keeps what it was sent."""

    def __init__(self) -> None:
        self.data: list[bytes] = []
        self.scene = self

    def add_glb(self, _name: str, data: bytes, **_options: bool) -> "Sent":
        self.data.append(data)
        return self

    def __setattr__(self, name: str, value: object) -> None:
        if name == "glb_data":
            self.data.append(value)  # pyright: ignore[reportArgumentType]
        else:
            super().__setattr__(name, value)


def test_nothing_is_sent_but_changes():
    client, scene = Sent(), signalled()
    view = SignalsView(client, LIGHT)  # pyright: ignore[reportArgumentType]
    for step in (0, 10.5, 59.9):
        view.show(scene, step)
    assert len(client.data) == 1
    view.show(scene, 60.0)
    assert len(client.data) == 2
    view.set_palette(DARK)
    view.show(scene, 60.0)
    assert len(set(client.data)) == 3
    view.show(replace(scene, signals=()), 60.0)
    view.show(replace(scene, signals=()), 0.0)
    assert len(client.data) == 4


def test_scenes_without_signals_cost_nothing():
    client = MagicMock()
    SignalsView(client, LIGHT).show(two_agents_that_pass(), 3.0)
    assert not client.mock_calls


def test_every_state_has_a_colour_of_its_own():
    for palette in (LIGHT, DARK):
        colors = np.array([palette.signals[one] for one in SignalState])
        gaps = np.abs(colors[:, None] - colors).sum(axis=-1)
        assert gaps[~np.eye(len(colors), dtype=bool)].min() > 60
