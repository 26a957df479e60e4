"""All metrics by name, and values of one with a validity mask."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Float

Source = Literal["paper", "ours", "WOSAC", "Scenario Dreamer"]
Better = Literal["lower", "higher", "as recorded"]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """Name, unit and meaning of a metric."""

    name: str
    unit: str
    """"share" is a number in 0..1; for a single agent it is true or false."""
    source: Source
    """"paper": as Path Diffuser's code computes it, faults included; "WOSAC": after Waymo's
    sim agents challenge."""
    better: Better
    definition: str


def _metrics() -> dict[str, Metric]:
    table = Path(__file__).with_name("metric_table.csv")
    with table.open(encoding="utf-8", newline="") as file:
        rows: list[dict[str, Any]] = list(csv.DictReader(file))
    return {row["name"]: Metric(**row) for row in rows}


METRICS: Final[Mapping[str, Metric]] = _metrics()
"""All metrics of agents by name, read from ``metric_table.csv``; distances of
distributions are computed from them."""


_Values = TypeVar("_Values", bound="MaskedValues")


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskedValues:
    """Values with a row for each agent, lane or scene."""

    value: Float[np.ndarray, "*shape"]
    is_valid: Bool[np.ndarray, "*shape"]

    def __len__(self) -> int:
        return len(self.value)

    def valid(self) -> Float[np.ndarray, "N"]:
        """Valid values, flattened."""
        return self.value[self.is_valid]

    def taken(self: _Values, rows: np.ndarray) -> _Values:
        """Select rows by indices or a mask."""
        return replace(self, value=self.value[rows], is_valid=self.is_valid[rows])

    def has_value(self) -> Bool[np.ndarray, "A"]:
        """Which rows have a valid value."""
        return np.any(self.is_valid.reshape(len(self), -1), axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class MetricValues(MaskedValues):
    """Values per agent [A], per agent and step [A S], or several per agent [A N].

    Where ``is_valid`` is false the metric is undefined and the value is 0.
    """

    name: str
    """Key of ``METRICS``."""

    def __post_init__(self) -> None:
        assert self.name in METRICS, self.name
        assert self.value.shape == self.is_valid.shape
        assert np.isfinite(self.value).all(), self.name
        assert not self.value[~self.is_valid].any(), self.name

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return METRICS[self.name].unit


def measured(
    name: str,
    value: Float[np.ndarray, "*shape"] | Bool[np.ndarray, "*shape"],
    is_valid: Bool[np.ndarray, "*shape"],
) -> MetricValues:
    """Values of a metric; the input may hold anything where it is not valid."""
    return MetricValues(
        name=name,
        value=np.where(is_valid, np.asarray(value, float), 0.0),
        is_valid=np.asarray(is_valid, bool),
    )


def by_name(*values: MetricValues) -> dict[str, MetricValues]:
    """Values of metrics by their names."""
    return {one.name: one for one in values}


def mean_over_steps(
    name: str,
    value: Float[np.ndarray, "A S"] | Bool[np.ndarray, "A S"],
    is_valid: Bool[np.ndarray, "A S"],
) -> MetricValues:
    """Each agent's mean over its valid steps."""
    count = is_valid.sum(axis=1)
    total = np.where(is_valid, np.asarray(value, float), 0.0).sum(axis=1)
    return measured(name, total / np.maximum(count, 1), count > 0)


def any_step(
    name: str, value: Bool[np.ndarray, "A S"], is_valid: Bool[np.ndarray, "A S"]
) -> MetricValues:
    """Whether a condition holds for each agent at any valid step."""
    return measured(name, np.any(value & is_valid, axis=1), np.any(is_valid, axis=1))
