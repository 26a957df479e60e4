"""Reference lines and cubic profiles of OpenDRIVE roads."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.scene.formats.xml_file import Place
from pd_editor.scene.scene_limits import MAX_LINES_M

_FINE_M: Final = 0.02
"""Step in which the length of cubic curves is measured."""
_GAUSS: Final = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, eq=False)
class Cubics:
    """Pieces a + b d + c d^2 + e d^3, each from its start on; 0 before the first one."""

    start: Float[np.ndarray, "N"]
    factors: Float[np.ndarray, "N 4"]

    @classmethod
    def of(cls, places: Sequence[Place], name: str) -> "Cubics":
        """Read pieces, whose starts are the attribute of a name."""
        rows = sorted(
            (
                (one.number(name), *(one.number(key) for key in "abcd"))
                for one in places
            ),
            key=lambda row: row[0],
        )
        table = np.array(rows, float).reshape(-1, 5)
        return cls(table[:, 0], table[:, 1:])

    def at(self, s: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K"]:
        """Values at some places."""
        if not len(self.start):
            return np.zeros(len(s))
        row = np.clip(np.searchsorted(self.start, s + 1e-9, "right") - 1, 0, None)
        along = np.maximum(s - self.start[row], 0.0)
        a, b, c, d = self.factors[row].T
        value = a + along * (b + along * (c + along * d))
        return np.where(s < self.start[0] - 1e-6, 0.0, value)


@dataclass(frozen=True, eq=False)
class _Piece(ABC):
    """A geometry of the plan view."""

    start: float
    length: float
    x: float
    y: float
    heading: float

    @abstractmethod
    def local(self, along: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 3"]:
        """x, y and heading in the frame of its first point."""

    def at(self, along: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 3"]:
        """x, y and heading in the frame of the file."""
        u, v, turn = self.local(np.clip(along, 0.0, self.length)).T
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        return np.stack(
            [
                self.x + cos * u - sin * v,
                self.y + sin * u + cos * v,
                self.heading + turn,
            ],
            axis=-1,
        )


@dataclass(frozen=True, eq=False)
class Clothoid(_Piece):
    """Line, arc or spiral: the curvature is linear in the length."""

    first: float
    last: float

    def local(self, along: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 3"]:
        """x, y and heading in the frame of its first point."""
        growth = (self.last - self.first) / self.length

        def turn(s: np.ndarray) -> np.ndarray:
            return s * (self.first + s * growth / 2)

        # Gauss's rule on short steps is exact to rounding.
        count = max(int(np.ceil(self.length / 2.0)), 1)
        ends = np.linspace(0.0, self.length, count + 1)
        known = _integral(turn, ends[:-1], np.diff(ends))
        before = np.concatenate([np.zeros((1, 2)), np.cumsum(known, axis=0)])
        row = np.clip(np.searchsorted(ends, along, "right") - 1, 0, count - 1)
        rest = _integral(turn, ends[row], along - ends[row])
        return np.column_stack([before[row] + rest, turn(along)])


@dataclass(frozen=True, eq=False)
class _ParametricCubic(_Piece):
    """u and v as cubic polynomials of a parameter from 0 to ``most``."""

    u: tuple[float, float, float, float]
    v: tuple[float, float, float, float]
    most: float
    by_length: bool = False
    """Whether the parameter grows so that the length does evenly."""

    def local(self, along: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 3"]:
        parameter = along / self.length * self.most
        if self.by_length:
            fine = np.linspace(0.0, self.most, max(int(self.most / _FINE_M), 8) + 1)
            speed = np.hypot(_slope(self.u, fine), _slope(self.v, fine))
            way = np.concatenate(
                [[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))]
            )
            parameter = np.interp(along, way, fine)
        u, v = _value(self.u, parameter), _value(self.v, parameter)
        turn = np.arctan2(_slope(self.v, parameter), _slope(self.u, parameter))
        return np.stack([u, v, turn], axis=-1)


@dataclass(frozen=True, eq=False)
class ReferenceLine:
    """The reference line of a road."""

    pieces: Sequence[_Piece]
    height: Cubics
    starts_m: Float[np.ndarray, "P"]
    gap_m: float
    """Length of the longest part of the road that no piece has."""

    @classmethod
    def of(cls, plan: Place, profile: Any, length_m: float) -> "ReferenceLine":
        """Read a plan view and an elevation profile, if there is one, of a road.

        Raises:
            FormatError: a geometry is missing, or of an unknown shape.
        """
        pieces = [_piece(one) for one in plan.children("geometry")]
        if not pieces:
            raise plan.error("has no geometry.")
        rises = (
            [] if profile is None else Place(plan.path, profile).children("elevation")
        )
        pieces.sort(key=lambda one: one.start)
        starts = np.array([one.start for one in pieces])
        ends = starts + [one.length for one in pieces]
        gap_m = float((np.append(starts, length_m) - np.append(0.0, ends)).max())
        return cls(pieces, Cubics.of(rises, "s"), starts, gap_m)

    def at(self, s: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K 4"]:
        """x, y, heading and elevation at some places."""
        row: Int[np.ndarray, "K"] = np.clip(
            np.searchsorted(self.starts_m, s + 1e-9, "right") - 1, 0, None
        )
        found = np.zeros((len(s), 4))
        order = np.argsort(row, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(row[order])) + 1):
            piece = self.pieces[int(row[mine[0]])]
            found[mine, :3] = piece.at(s[mine] - piece.start)
        found[:, 3] = self.height.at(s)
        return found


def _piece(place: Place) -> _Piece:
    length = place.number("length")
    given: Any = {
        "start": place.number("s"),
        "length": max(length, 1e-9),
        "x": place.number("x"),
        "y": place.number("y"),
        "heading": place.number("hdg"),
    }
    if not 0 <= length <= MAX_LINES_M:
        raise place.error(
            f"is {length:g} m long; expected 0 or more, and at most {MAX_LINES_M:g}."
        )
    for shape in place.element:
        one = Place(place.path, shape)
        match shape.tag:
            case "line":
                return Clothoid(**given, first=0.0, last=0.0)
            case "arc":
                curvature = one.number("curvature")
                return Clothoid(**given, first=curvature, last=curvature)
            case "spiral":
                first, last = one.number("curvStart"), one.number("curvEnd")
                return Clothoid(**given, first=first, last=last)
            case "poly3":
                a, b, c, d = (one.number(key) for key in "abcd")
                return _ParametricCubic(
                    **given,
                    u=(0.0, 1.0, 0.0, 0.0),
                    v=(a, b, c, d),
                    most=given["length"],
                    by_length=True,
                )
            case "paramPoly3":
                u, v = (
                    tuple(one.number(f"{key}{axis}") for key in "abcd") for axis in "UV"
                )
                told = one.get("pRange").lower()
                # Without it, it is the one by which the line has its length.
                gaps = [abs(_length(u, v, most) - length) for most in (length, 1.0)]
                is_length = told == "arclength" or (not told and gaps[0] < gaps[1])
                return _ParametricCubic(
                    **given,
                    u=(u[0], u[1], u[2], u[3]),
                    v=(v[0], v[1], v[2], v[3]),
                    most=given["length"] if is_length else 1.0,
                )
    raise place.error(
        "has no known shape; expected line, arc, spiral, poly3 or paramPoly3."
    )


def _integral(
    turn: Any, start: Float[np.ndarray, "K"], length: Float[np.ndarray, "K"]
) -> Float[np.ndarray, "K 2"]:
    """Way along a curve of some heading, on each of some short intervals."""
    places, weights = _GAUSS
    s = start[:, None] + length[:, None] * (places + 1) / 2
    heading = turn(s)
    share = weights / 2 * length[:, None]
    return np.stack(
        [(share * np.cos(heading)).sum(axis=1), (share * np.sin(heading)).sum(axis=1)],
        axis=-1,
    )


def _value(factors: Sequence[float], p: np.ndarray) -> np.ndarray:
    a, b, c, d = factors
    return a + p * (b + p * (c + p * d))


def _length(u: Sequence[float], v: Sequence[float], most: float) -> float:
    """Length of a parametric curve up to a parameter."""
    share = np.linspace(0.0, most, 64)
    speed = np.hypot(_slope(u, share), _slope(v, share))
    return float(most * speed.mean())


def _slope(factors: Sequence[float], p: np.ndarray) -> np.ndarray:
    _, b, c, d = factors
    return b + p * (2 * c + p * 3 * d)
