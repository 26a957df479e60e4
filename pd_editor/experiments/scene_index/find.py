"""Finds the scenes that a query describes, and the events in them that it asks for."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from pd_editor.analysis.manoeuvres import SceneEvent
from pd_editor.experiments.scene_index.event_table import EventTable
from pd_editor.experiments.scene_index.index_file import SceneIndex
from pd_editor.experiments.scene_index.query import answer

_SHOWN = ("kind", "agent_id", "other_id", "begin_s", "end_s", "value")


@dataclass(frozen=True, kw_only=True)
class FoundScene:
    """A scene that a query describes."""

    path: str
    scenario_id: str
    facts: dict[str, float | str]
    events: tuple[SceneEvent, ...]
    """Events that the query asked for, in the order in which they begin."""


def find_places(index: SceneIndex, query: str) -> set[str]:
    """Places of the scenes of an index that a query describes; raises as ``find_scenes``."""
    rows = np.flatnonzero(answer(query, EventTable.of(index.table)).scenes)
    paths = index.table.column("path").take(pa.array(rows)).to_pylist()
    return set(map(index.place_of, paths))


def find_scenes(index: str | Path | SceneIndex, query: str) -> tuple[FoundScene, ...]:
    """Scenes of an index that a query describes, in its order.

    Raises:
        InputError: the index cannot be read, or the query not understood.
    """
    if not isinstance(index, SceneIndex):
        index = SceneIndex.read(index)
    columns = EventTable.of(index.table)
    found = answer(query, columns)
    rows = np.flatnonzero(found.scenes)
    shown = np.flatnonzero(found.events & found.scenes[columns.scene])
    events: dict[int, list[SceneEvent]] = {row: [] for row in rows.tolist()}
    values = [columns.event[name].take(pa.array(shown)).to_pylist() for name in _SHOWN]
    for row, *told in zip(columns.scene[shown].tolist(), *values, strict=True):
        events[row].append(SceneEvent(**dict(zip(_SHOWN, told, strict=True))))
    head = index.table.select(["path", "scenario_id", *columns.facts]).take(
        pa.array(rows)
    )
    return tuple(
        FoundScene(
            path=index.place_of(one.pop("path")),
            scenario_id=one.pop("scenario_id"),
            facts={name: fact for name, fact in one.items() if fact is not None},
            events=tuple(sorted(events[row], key=lambda event: event.begin_s)),
        )
        for row, one in zip(rows.tolist(), head.to_pylist(), strict=True)
    )
