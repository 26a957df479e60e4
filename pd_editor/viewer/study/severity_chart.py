"""Chart of severity curves for the panel, as SVG that fits its width."""

import html
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from pd_editor.experiments.studies.severity import SeverityCurve

_COLORS: Final = ("#1c6fd1", "#d1600c")
_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 330, 170, 34, 8, 18
_TICKS: Final = (-9, -6, -3, 0, 3, 6, 9)


def severity_svg(
    curves: Sequence[SeverityCurve], methods: Sequence[str], name: str, title: str
) -> str:
    """Curves of one metric with bands of their 95 % intervals over scenes.

    A method has its colour by its place among ``methods``, whichever curves there are.
    """
    colored = [
        (curve, color)
        for method, color in zip(methods, _COLORS, strict=False)
        for curve in curves
        if curve.method == method
    ]
    scale = 100.0 if "%" in title else 1.0
    known = [
        scale * float(np.nanmax(values, initial=0.0))
        for curve in curves
        for values in (curve.estimates[name].value, curve.estimates[name].high)
    ]
    most = _rounded_up(max(known, default=0.0) or 1.0)
    parts = [_axes(most)]
    for curve, color in colored:
        found = curve.estimates[name]
        low, high = (
            np.where(np.isfinite(bound), bound, found.value)
            for bound in (found.low, found.high)
        )
        band = [
            *_points(curve.power, scale * high, most),
            *_points(curve.power, scale * low, most)[::-1],
        ]
        line = _points(curve.power, scale * found.value, most)
        parts.append(
            f'<polygon fill="{color}" fill-opacity="0.16" points="{" ".join(band)}"/>'
            f'<polyline fill="none" stroke="{color}" stroke-width="1.8" '
            f'points="{" ".join(line)}"/>' + _dots(line, color)
        )
    legend = "&ensp;".join(
        f'<span style="color:{color};font-weight:700">\u2014</span> '
        f"{html.escape(curve.method)}"
        for curve, color in colored
    )
    return (
        '<div style="margin:0 0.75em 0.6em;font-size:12px">'
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" style="display:block;width:100%" '
        f'role="img" aria-label="{html.escape(title)} by power">{"".join(parts)}</svg>'
        f"{legend or 'Power of the warp; no study yet'}</div>"
    )


def _dots(points: list[str], color: str) -> str:
    """Dots at the powers; the curve of a sum has one power beside the plain road."""
    places = (point.split(",") for point in points)
    return "".join(
        f'<circle cx="{x}" cy="{y}" r="2.2" fill="{color}"/>' for x, y in places
    )


def _axes(most: float) -> str:
    parts = []
    for value in (0.0, most / 2, most):
        y = _y(value, most)
        parts.append(
            f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{y:.1f}" y2="{y:.1f}" '
            'stroke="currentColor" stroke-opacity="0.18"/>'
            f'<text x="{_LEFT - 5}" y="{y + 3.5:.1f}" text-anchor="end" font-size="10" '
            f'fill="currentColor" fill-opacity="0.75">{value:g}</text>'
        )
    parts += (
        f'<text x="{_x(power):.1f}" y="{_HEIGHT - 3}" text-anchor="middle" '
        f'font-size="10" fill="currentColor" fill-opacity="0.75">{power}</text>'
        for power in _TICKS
    )
    return "".join(parts)


def _points(power: np.ndarray, value: np.ndarray, most: float) -> list[str]:
    return [
        f"{_x(p):.1f},{_y(v, most):.1f}"
        for p, v in zip(power.tolist(), value.tolist(), strict=True)
        if math.isfinite(v)
    ]


def _x(power: float) -> float:
    return _LEFT + (power + 10) / 20 * (_WIDTH - _LEFT)


def _y(value: float, most: float) -> float:
    return _TOP + (1 - value / most) * (_HEIGHT - _TOP - _BOTTOM)


def _rounded_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value)
