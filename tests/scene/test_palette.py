from typing import Final

import numpy as np
import pytest

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.palette import DARK, LIGHT, Palette, Rgb
from pd_editor.viewer.meshes.colors import srgb_to_linear

MIN_CONTRAST: Final = 3.0
"""Least contrast of graphics by WCAG 2.2."""


def contrast_ratio(one: Rgb, other: Rgb) -> float:
    """Contrast of two colours from 1 to 21, as WCAG 2.2 defines it."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    pair = srgb_to_linear(np.array([one, other]) / 255.0) @ weights
    return float((pair.max() + 0.05) / (pair.min() + 0.05))


def surfaces(palette: Palette) -> dict[str, tuple[int, int, int]]:
    names = ("road", "lane", "intersection", "bike_lane", "bus_lane")
    return {name: getattr(palette, name) for name in names}


def test_known_contrast_ratios():
    assert contrast_ratio((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)
    # The example of WCAG's own understanding document: #767676 on white.
    assert contrast_ratio((118, 118, 118), (255, 255, 255)) == pytest.approx(
        4.54, abs=0.01
    )


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_every_kind_of_agent_stands_out_from_the_road(palette):
    """Buses were dark blue on dark asphalt (D23)."""
    assert set(palette.kinds) == set(AgentKind)
    shown = {
        **palette.kinds,
        "focal": palette.focal,
        "ego": palette.ego,
        "warning": palette.warning,
        "candidate": palette.candidate,
        **{f"speed {n}": color for n, color in enumerate(palette.candidate_speeds)},
        "ghost": palette.ghost,
    }
    weak = [
        (name, surface)
        for name, color in shown.items()
        for surface, under in surfaces(palette).items()
        if contrast_ratio(color, under) < MIN_CONTRAST
    ]
    assert not weak


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_the_selection_ring_or_its_rim_stands_out(palette):
    for under in surfaces(palette).values():
        assert (
            max(
                contrast_ratio(palette.selection, under),
                contrast_ratio(palette.selection_rim, under),
            )
            >= MIN_CONTRAST
        )
    assert contrast_ratio(palette.selection, palette.selection_rim) >= MIN_CONTRAST
