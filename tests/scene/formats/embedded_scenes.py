"""What the player's page carries, decoded as the page decodes it."""

import base64
import json
import zlib
from html.parser import HTMLParser
from typing import Any

import numpy as np

from pd_editor.scene.formats.player import SCALE, TURN_SCALE


class Page(HTMLParser):
    """Elements of a page, and the texts in them."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = [("", {})]
        self.texts: dict[str, str] = {}
        self.feed(page.decode())

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        tag, attributes = self.elements[-1]
        key = attributes.get("id") or tag
        self.texts[key] = self.texts.get(key, "") + data


def scenes_in(page: bytes) -> list[dict[str, Any]]:
    entries = json.loads(Page(page).texts["scenes"])
    texts = [zlib.decompress(base64.b64decode(one["data"])) for one in entries]
    return [json.loads(text) for text in texts]


def line_of(changes: list[int]) -> np.ndarray:
    return np.cumsum(np.array(changes).reshape(-1, 2), axis=0) / SCALE


def tracks_of(agent: dict[str, Any], num_steps: int) -> tuple[np.ndarray, np.ndarray]:
    """X, y, heading and speed at each step, and whether it is there."""
    values, there = np.zeros((num_steps, 4)), np.zeros(num_steps, bool)
    for first, *columns in agent["runs"]:
        steps = slice(first, first + len(columns[0]))
        assert not there[steps].any()
        there[steps] = True
        scales = [SCALE, SCALE, TURN_SCALE, SCALE]
        values[steps] = np.cumsum(np.array(columns), axis=1).T / scales
    return values, there
