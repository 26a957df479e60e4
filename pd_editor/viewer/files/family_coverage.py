"""Which values of a family are kept: a line a range, a dot a variant."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pd_editor.editor.varied_numbers import VariedNumber

_WIDTH, _LINE, _EDGE = 300, 34, 8
_COLOR: Final = {
    "without problems": "#2e8b57",
    "with problems": "#e08a00",
    "dropped": "none",
    "failed": "#c62828",
}


@dataclass(frozen=True, kw_only=True)
class MadeVariant:
    """A variant that was made, or could not be."""

    values: Mapping[VariedNumber, float]
    name: str = ""
    """In the library; empty: it could not be made."""
    has_problems: bool = False

    def fate(self, kept: frozenset[str]) -> str:
        """What has become of it, given what the library still has."""
        if not self.name:
            return "failed"
        if self.name not in kept:
            return "dropped"
        return "with problems" if self.has_problems else "without problems"


def coverage(made: Sequence[MadeVariant], kept: frozenset[str]) -> str:
    """A picture of the values that were made, as HTML; empty without any."""
    if not made:
        return ""
    fates = [one.fate(kept) for one in made]
    lines = [
        _line(number, [(one, fate) for one, fate in zip(made, fates, strict=True)], row)
        for row, number in enumerate(made[0].values)
    ]
    legend = " &nbsp; ".join(
        f'<svg width="10" height="10">{_dot(5, 5, fate)}</svg> {fates.count(fate)} {fate}'
        for fate in _COLOR
        if fate in fates
    )
    drawn = (
        f'<svg viewBox="0 0 {_WIDTH} {_LINE * len(lines)}" width="100%" fill="currentColor"'
        f' font-size="12">{"".join(lines)}</svg>'
    )
    return (
        '<div style="margin:0 0.75em 0.5em;font-size:12.5px;line-height:20px">'
        f"{drawn if lines else ''}<div>{legend}</div></div>"
    )


def _line(
    number: VariedNumber, made: Sequence[tuple[MadeVariant, str]], row: int
) -> str:
    """A range with its name and ends, and the values in it."""
    y = row * _LINE + 24
    ends = f"{number.low:g} to {number.high:g}"
    dots = []
    for one, fate in made:
        value = one.values[number]
        share = (value - number.low) / (number.high - number.low or 1)
        told = html.escape(f"{one.name or 'failed'}: {number.name} {value:g}, {fate}")
        x = _EDGE + share * (_WIDTH - 2 * _EDGE)
        dots.append(f"<g>{_dot(x, y, fate)}<title>{told}</title></g>")
    return (
        f'<text x="{_EDGE}" y="{y - 11}">{html.escape(number.name)} {ends}</text>'
        f'<path d="M{_EDGE} {y}H{_WIDTH - _EDGE}" stroke="currentColor" opacity="0.4"/>'
        + "".join(dots)
    )


def _dot(x: float, y: float, fate: str) -> str:
    color = _COLOR[fate]
    edge = "currentColor" if color == "none" else color
    fill = color if color != "none" else "var(--mantine-color-body)"
    return f'<circle cx="{x:.1f}" cy="{y}" r="4" fill="{fill}" stroke="{edge}"/>'
