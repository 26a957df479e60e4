"""The samples of one run as a table: on the shell, and as a file beside the exports."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.analysis.findings.check import SceneCheck
from pd_editor.analysis.findings.sample_ranking import (
    Ranking,
    SampleNumbers,
    numbers_of,
    ranked,
    spread_pick,
    with_fullness,
)
from pd_editor.base.errors import ExportError
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.scenario import Scenario

COLUMNS: Final = (
    "rank",
    "sample",
    "agents",
    "problems",
    "notices",
    "realism",
    "collisions",
    "off_road",
    "lateral_m",
    "moving",
    "speed_mps",
    "ttc_s",
    "picked",
)


@dataclass(frozen=True, kw_only=True)
class SampleTable:
    """Numbers of all samples in the order of a ranking, and which of them are picked."""

    numbers: tuple[SampleNumbers, ...]
    order: tuple[int, ...]
    """Indices of the samples, the best one first."""
    picked: tuple[int, ...]

    @classmethod
    def of(
        cls,
        scenarios: Iterable[tuple[Scenario, SceneCheck]],
        samples: Sequence[TrafficSample],
        ranking: Ranking,
        pick: int | None,
    ) -> "SampleTable":
        """Rank samples, given the scenarios with each of them and their findings.

        ``pick`` None picks all of them.
        """
        numbers = with_fullness(
            numbers_of(scenario, one.ids, check)
            for (scenario, check), one in zip(scenarios, samples, strict=True)
        )
        order = ranked(numbers, ranking)
        count = len(samples) if pick is None else pick
        return cls(
            numbers=numbers,
            order=order,
            picked=spread_pick(samples, count, first=order[0]),
        )

    def lines(self, names: Sequence[str]) -> tuple[str, ...]:
        """The table for people, one line per sample."""
        rows = [COLUMNS, *self._rows(names)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return tuple(
            "  ".join(
                cell.rjust(width) for cell, width in zip(row, widths, strict=True)
            )
            for row in rows
        )

    def write(self, path: Path, names: Sequence[str]) -> None:
        """Write the table as CSV.

        Raises:
            ExportError: the file cannot be written.
        """
        try:
            with path.open("w", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerows(
                    [COLUMNS, *self._rows(names)]
                )
        except OSError as error:
            raise ExportError(f"{path} cannot be written: {error.strerror}.") from error

    def _rows(self, names: Sequence[str]) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for rank, index in enumerate(self.order, start=1):
            one = self.numbers[index]
            time = one.time_to_collision_s
            rows.append(
                (
                    str(rank),
                    names[index],
                    str(one.num_agents),
                    str(one.num_problems),
                    str(one.num_notices),
                    f"{one.realism:.0f}",
                    str(one.num_hits),
                    f"{one.off_road_share:.3f}",
                    f"{one.lateral_deviation_m:.2f}",
                    f"{one.moving_share:.2f}",
                    f"{one.mean_speed_mps:.1f}",
                    "" if time is None else f"{time:.1f}",
                    "yes" if index in self.picked else "no",
                )
            )
        return rows
