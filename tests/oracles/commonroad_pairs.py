"""Pairs of boxes that collide, by CommonRoad; runs in an environment of its own.

Reads JSON from standard input: a list of scenes, each a list of steps, each a list of
boxes ``[x_m, y_m, heading_rad, length_m, width_m]``. Writes, in the same nesting, the
pairs ``[i, j]`` of boxes of one step that have a common point, ``i < j``.
"""

import json
import sys

from commonroad_dc.pycrcc import RectOBB


def colliding_pairs(boxes: list[list[float]]) -> list[list[int]]:
    """Pairs of boxes of one step, by the exact test of two rectangles."""
    rectangles = [
        RectOBB(length / 2, width / 2, heading, x, y)
        for x, y, heading, length, width in boxes
    ]
    return [
        [i, j]
        for i, one in enumerate(rectangles)
        for j, other in enumerate(rectangles[i + 1 :], i + 1)
        if one.collide(other)
    ]


if __name__ == "__main__":
    scenes = json.load(sys.stdin)
    json.dump(
        [[colliding_pairs(boxes) for boxes in scene] for scene in scenes], sys.stdout
    )
