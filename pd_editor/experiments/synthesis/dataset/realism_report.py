"""Report of the distances between synthetic and real scenes, with their noise floor."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from pd_editor.analysis.metrics.distribution_distance import noise_floor
from pd_editor.analysis.metrics.values import MaskedValues
from pd_editor.base.errors import InputError
from pd_editor.experiments.report import NONE, Report, ReportTable, Section
from pd_editor.experiments.synthesis.dataset.scene_statistics import (
    QUANTITIES,
    MeasuredScene,
    Quantity,
)
from pd_editor.scene.scenario import Scenario

ALLOWED_RATIO: Final = 1.3
"""Largest accepted ratio of a distance to its noise floor."""
QUANTILES: Final = (10, 50, 90)

_Measured = dict[str, list[MaskedValues]]


@dataclass(frozen=True, kw_only=True)
class RealismRow:
    """Comparison of one quantity."""

    name: str
    unit: str
    distance: float
    """Jensen-Shannon distance (natural logarithm) to the real scenes."""
    noise_floor: float
    """Distance between the real scenes and as many agents resampled from them."""
    other_real: float | None
    """Distance between the real scenes and other real scenes; None without any."""
    synthetic: tuple[float, ...]
    """Quantiles at ``QUANTILES``; for a share only its mean."""
    real: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Ratio of the distance to its noise floor."""
        return self.distance / max(self.noise_floor, 1e-9)

    @property
    def passes(self) -> bool:
        """Whether the ratio is at most ``ALLOWED_RATIO``."""
        return self.ratio <= ALLOWED_RATIO


@dataclass(frozen=True, kw_only=True)
class RealismReport:
    """Comparison of all quantities."""

    rows: tuple[RealismRow, ...]
    num_synthetic: int
    num_real: int
    num_other: int

    def json(self) -> dict[str, Any]:
        """Report as JSON values."""
        return {
            "num_synthetic": self.num_synthetic,
            "num_real": self.num_real,
            "num_other": self.num_other,
            "allowed_ratio": ALLOWED_RATIO,
            "rows": [
                asdict(row) | {"ratio": row.ratio, "passes": row.passes}
                for row in self.rows
            ],
        }

    def _chance(self) -> str:
        if not self.num_other:
            return "."
        chance = np.sqrt(1 + self.num_real / self.num_other)
        return f", which is {chance:.1f} for the other real scenes."

    def report(self) -> Report:
        """Report as text and a table."""
        num_passed = sum(row.passes for row in self.rows)
        scenes = f"{self.num_synthetic} synthetic scenes, {self.num_real} real ones"
        others = f", {self.num_other} other real ones." if self.num_other else "."
        words = (
            scenes + others,
            "Distances are square roots of Jensen-Shannon divergences (natural "
            "logarithm) to the real scenes. The noise floor is that distance for as "
            "many agents of resampled real scenes, mean over resamples. A perfect "
            "generator's ratio tends to 1 as its scenes become many; of n scenes "
            "beside m real ones, chance alone makes it about sqrt(1 + m / n)"
            + self._chance(),
            f"{num_passed} of {len(self.rows)} distances are at most "
            f"{ALLOWED_RATIO:g} times the noise floor.",
        )
        rows = tuple(map(_cells, self.rows))
        table = ReportTable(title="By quantity", header=_header(), rows=rows)
        section = Section(title="Distances", paragraphs=words, tables=(table,))
        return Report(
            title="Synthetic traffic beside real traffic", sections=(section,)
        )


def realism_report(
    synthetic: Iterable[Scenario],
    real: Iterable[Scenario],
    other_real: Iterable[Scenario] = (),
) -> RealismReport:
    """Compare scenes with real ones of equal format and extent, quantity by quantity.

    The distance of ``other_real`` scenes is a reference.

    Raises:
        InputError: there are no synthetic or no real scenes.
    """
    mine, num_mine = _measured(synthetic)
    theirs, num_theirs = _measured(real)
    others, num_others = _measured(other_real)
    for number, side in ((num_mine, "synthetic"), (num_theirs, "real")):
        if not number:
            raise InputError(f"There are no {side} scenes to compare; expected some.")
    rows = [
        _row(
            quantity, mine[quantity.name], theirs[quantity.name], others[quantity.name]
        )
        for quantity in QUANTITIES
        if _num_rows(mine[quantity.name]) and _num_rows(theirs[quantity.name])
    ]
    return RealismReport(
        rows=tuple(rows), num_synthetic=num_mine, num_real=num_theirs, num_other=num_others
    )  # fmt: skip


def _measured(scenarios: Iterable[Scenario]) -> tuple[_Measured, int]:
    found: _Measured = {quantity.name: [] for quantity in QUANTITIES}
    count = 0
    for scenario in scenarios:
        scene = MeasuredScene(scenario=scenario)
        count += 1
        for quantity in QUANTITIES:
            found[quantity.name].append(quantity.measure(scene))
    return found, count


def _num_rows(scenes: Sequence[MaskedValues]) -> int:
    """Number of agents, lanes or scenes with a value."""
    return sum(int(scene.has_value().sum()) for scene in scenes if len(scene))


def _row(
    quantity: Quantity,
    synthetic: Sequence[MaskedValues],
    real: Sequence[MaskedValues],
    other_real: Sequence[MaskedValues],
) -> RealismRow:
    pool, num_rows = _pooled(real), _num_rows(real)

    def distance(scenes: Sequence[MaskedValues]) -> float:
        return quantity.distance(_pooled(scenes), pool)

    return RealismRow(
        name=quantity.name,
        unit=quantity.unit,
        distance=distance(synthetic),
        noise_floor=noise_floor(real, quantity.distance, num_agents=num_rows),
        other_real=distance(other_real) if _num_rows(other_real) else None,
        synthetic=_summary(quantity, _pooled(synthetic)),
        real=_summary(quantity, pool),
    )


def _pooled(scenes: Sequence[MaskedValues]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *(scene.valid() for scene in scenes)])


def _summary(quantity: Quantity, values: np.ndarray) -> tuple[float, ...]:
    if quantity.unit == "share":
        return (float(values.mean()),)
    return tuple(float(value) for value in np.percentile(values, QUANTILES))


def _header() -> tuple[str, ...]:
    names = "/".join(map(str, QUANTILES)) + " %"
    fixed = ("quantity", "unit", "distance", "floor", "ratio", "other real", "")
    return (*fixed, f"synthetic {names}", f"real {names}")


def _cells(row: RealismRow) -> tuple[str, ...]:
    other = NONE
    if row.other_real is not None:
        other = f"{row.other_real / max(row.noise_floor, 1e-9):.2f}"
    return (
        row.name,
        row.unit or "-",
        f"{row.distance:.3f}",
        f"{row.noise_floor:.3f}",
        f"{row.ratio:.2f}",
        other,
        "pass" if row.passes else "above",
        " / ".join(f"{value:.3g}" for value in row.synthetic),
        " / ".join(f"{value:.3g}" for value in row.real),
    )
