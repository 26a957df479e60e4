"""Reader of SUMO's floating-car data.

SUMO's position is the centre of the front bumper, its angle clockwise from north.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow
import pyarrow.parquet
from jaxtyping import Float, Int

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.formats.sumo_net import heading_of_sumo

_COLUMNS: Final = ("x", "y", "angle")


@dataclass(frozen=True, kw_only=True, eq=False)
class RawTracks:
    """States of A road users, one user after another, each in order of time."""

    names: tuple[str, ...]
    """SUMO's ids, sorted."""
    agent: Int[np.ndarray, "P"]
    """Index into ``names`` of each row."""
    step: Int[np.ndarray, "P"]
    """Steps since the beginning of the simulation."""
    front_m: Float[np.ndarray, "P 2"]
    """SUMO's position: the centre of the front bumper."""
    heading_rad: Float[np.ndarray, "P"]
    type_of: Mapping[str, str] = field(default_factory=dict)
    """SUMO's type of each road user, where the files tell."""

    def shifted(self, steps: int) -> "RawTracks":
        """States from a step on, which becomes step 0."""
        kept = self.step >= steps
        return replace(
            self,
            agent=self.agent[kept],
            step=self.step[kept] - steps,
            front_m=self.front_m[kept],
            heading_rad=self.heading_rad[kept],
        )


def read_raw_tracks(paths: tuple[Path, ...], step_s: float) -> RawTracks:
    """Read SUMO's floating-car data in Parquet, of vehicles, then of persons.

    Persons in vehicles, which are where their vehicle is, are left out.

    Raises:
        SynthesisError: a file is missing or lacks a column.
    """
    names: list[np.ndarray] = []
    values: list[np.ndarray] = []
    type_of: dict[str, str] = {}
    places = np.zeros(0, np.int64)
    for path in paths:
        if not os.path.exists(path):
            continue
        try:
            table = pyarrow.parquet.read_table(path)
        except (OSError, pyarrow.ArrowInvalid) as error:
            raise SynthesisError(
                f"{path} is not SUMO's floating-car data in Parquet ({error})."
            ) from error
        if table.num_columns < 2:
            # Without any road user, SUMO writes the time only.
            continue
        columns = {name.split("_", 1)[1]: table[name] for name in table.column_names}
        if missing := {"id", "time", *_COLUMNS} - columns.keys():
            raise SynthesisError(f"{path} lacks the column {sorted(missing)[0]!r}.")
        there = columns["id"].is_valid().to_numpy()
        coded = columns["id"].combine_chunks().dictionary_encode()
        code = coded.indices.fill_null(0).to_numpy()[there]
        name = np.array(coded.dictionary.to_pylist(), dtype=object)[code]
        if "type" in columns:
            first = np.unique(code, return_index=True)[1]
            kinds = columns["type"].to_numpy()[there][first]
            type_of |= zip(name[first], kinds, strict=True)
        kept = [columns[key].to_numpy()[there] for key in ("time", *_COLUMNS)]
        rows = np.column_stack(kept).astype(float)
        place = np.rint(100.0 * rows[:, :3]).astype(np.int64) @ (
            1 << np.array([44, 22, 0])
        )
        alone = ~np.isin(place, places)
        names.append(name[alone])
        values.append(rows[alone])
        places = place
    if not values or sum(len(part) for part in values) == 0:
        return _no_tracks()
    numbers = np.concatenate(values)
    unique, agent = np.unique(np.concatenate(names).astype(str), return_inverse=True)
    step = np.rint(numbers[:, 0] / step_s).astype(int)
    order = np.lexsort((step, agent))
    return RawTracks(
        names=tuple(unique.tolist()),
        agent=agent[order],
        step=step[order],
        front_m=numbers[order, 1:3],
        heading_rad=heading_of_sumo(numbers[order, 3]),
        type_of=type_of,
    )


def _no_tracks() -> RawTracks:
    none = np.zeros(0, int)
    return RawTracks(
        names=(), agent=none, step=none,
        front_m=np.zeros((0, 2)), heading_rad=np.zeros(0),
    )  # fmt: skip
