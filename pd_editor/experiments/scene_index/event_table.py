"""The columns of an index, compared as a whole: an event is a row of the flattened lists.

Arrow and NumPy are there anyway, and need no copy of the index in a database.
"""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Int

from pd_editor.analysis.manoeuvres import FACTS
from pd_editor.experiments.scene_index.index_file import SCHEMA

COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class EventTable:
    """Columns of S scenes, and of their E events in one sequence."""

    table: pa.Table
    event: dict[str, pa.Array]
    scene: Int[np.ndarray, "E"]

    @classmethod
    def of(cls, table: pa.Table) -> "EventTable":
        """Columns of an index."""
        lists = table.column("events").combine_chunks()
        flat = lists.flatten()
        return cls(
            table=table,
            event={one.name: flat.field(one.name) for one in flat.type},
            scene=lists.value_parent_indices().to_numpy(),
        )

    @cached_property
    def facts(self) -> Mapping[str, type[float] | type[str]]:
        """Facts of scenes by name: those of every index, and those told beside it."""
        told = self.table.schema.names[len(SCHEMA) :]
        kinds = {one: self.table.schema.field(one).type for one in told}
        return {
            **FACTS,
            **{
                name: str if one == pa.string() else float
                for name, one in kinds.items()
            },
        }

    @property
    def is_read(self) -> Bool[np.ndarray, "S"]:
        """Scenes of which the content is known."""
        return np.asarray(self.table.column("stamp").to_numpy() != "", bool)

    def having(self, fact: str, sign: str, value: float | str) -> Bool[np.ndarray, "S"]:
        """Scenes with a fact that compares so."""
        column = self.table.column(fact)
        if isinstance(value, float):
            own = column.to_numpy()
            return np.asarray(COMPARISONS[sign](own, value), bool) & ~np.isnan(own)
        return _is_in(column.combine_chunks(), (str(value),)) == (sign == "=")

    def events(
        self, kinds: tuple[str, ...], by: str, towards: str
    ) -> Bool[np.ndarray, "E"]:
        """Events of some kinds between kinds of agents; empty ones are any."""
        mask = _is_in(self.event["kind"], kinds)
        for column, kind in (("agent_kind", by), ("other_kind", towards)):
            mask &= _is_in(self.event[column], (kind,)) if kind else True
        return mask

    def valued(self, sign: str, number: float) -> Bool[np.ndarray, "E"]:
        """Events with a value that compares so."""
        value = self.event["value"].to_numpy(zero_copy_only=False)
        return np.asarray(COMPARISONS[sign](value, number)) & ~np.isnan(value)

    def with_any(self, events: Bool[np.ndarray, "E"]) -> Bool[np.ndarray, "S"]:
        """Scenes with any of some events."""
        return np.bincount(self.scene[events], minlength=len(self.table)) > 0


def _is_in(column: pa.Array, words: tuple[str, ...]) -> Bool[np.ndarray, "N"]:
    """Which texts are among some words, which are in small letters."""
    coded = column.dictionary_encode()
    texts = coded.dictionary.to_pylist()
    codes = [code for code, one in enumerate(texts) if (one or "").lower() in words]
    return np.isin(coded.indices.to_numpy(), codes)
