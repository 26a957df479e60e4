"""Readers of what SUMO writes: floating-car data, and states of traffic lights."""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow
import pyarrow.parquet
from jaxtyping import Float, Int

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.formats.sumo_net import heading_of_sumo
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.signals import Signal, SignalState

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
    names: list[np.ndarray] = [np.zeros(0, object)]
    values: list[np.ndarray] = [np.zeros((0, 1 + len(_COLUMNS)))]
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


STATES_NAME: Final = "states.xml"
_STATE_OF: Final = {
    word: state for state, words in WORDS.items() for word in words if len(word) == 1
}


def state_outputs(light_ids: Iterable[str]) -> Iterable[ElementTree.Element]:
    """Yield the elements of an additional file that make SUMO write ``STATES_NAME``."""
    for light in light_ids:
        yield ElementTree.Element(
            "timedEvent",
            {"type": "SaveTLSSwitchStates", "source": light, "dest": STATES_NAME},
        )


def read_signals(
    states_file: Path,
    net_file: Path,
    road_map: RoadMap,
    lane_of_sumo: Mapping[str, tuple[int, ...]],
    *,
    first_s: float,
    num_steps: int,
    step_s: float,
) -> tuple[Signal, ...]:
    """Signals of the lanes through junctions; those with equal states are one signal.

    Step 0 is at ``first_s`` of the simulation.

    Raises:
        SynthesisError: a file is damaged.
    """
    if not states_file.is_file():
        return ()
    try:
        lanes = _lanes_of_links(ElementTree.parse(net_file), lane_of_sumo)
        switches: dict[str, list[tuple[float, str]]] = {}
        for one in ElementTree.parse(states_file).iter("tlsState"):
            entry = (float(one.attrib["time"]), one.attrib["state"])
            switches.setdefault(one.attrib["id"], []).append(entry)
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise SynthesisError(
            f"SUMO's states of traffic lights cannot be read ({error})."
        ) from error
    now_s = first_s + step_s * np.arange(num_steps) + 1e-3
    found: dict[bytes, list[int]] = {}
    for (light, link), ids in lanes.items():
        if (entries := switches.get(light)) is not None:
            times, letters = zip(*entries, strict=True)
            row = np.searchsorted(np.array(times), now_s, side="right") - 1
            codes = np.array(
                [
                    _STATE_OF.get(one[link : link + 1], SignalState.UNKNOWN)
                    for one in letters
                ],
                np.int8,
            )
            states = np.where(row >= 0, codes[row], np.int8(SignalState.UNKNOWN))
            found.setdefault(states.tobytes(), []).extend(ids)
    taken: set[int] = set()
    signals = []
    for number, (states, ids) in enumerate(found.items()):
        own = [one for one in dict.fromkeys(ids) if one not in taken]
        taken |= set(own)
        if own:
            inside = [road_map.lane_of[one].is_intersection for one in own]
            signals.append(
                Signal(
                    signal_id=f"signal-{number}",
                    lane_ids=tuple(own),
                    stop_share=np.where(inside, 0.0, 1.0),
                    states=np.frombuffer(states, np.int8).copy(),
                )
            )
    return tuple(signals)


def _lanes_of_links(
    net: "ElementTree.ElementTree[ElementTree.Element]",
    lane_of_sumo: Mapping[str, tuple[int, ...]],
) -> dict[tuple[str, int], list[int]]:
    """Lanes of the map that each link of a traffic light controls."""
    found: dict[tuple[str, int], list[int]] = {}
    for one in net.iter("connection"):
        ids = lane_of_sumo.get(one.attrib.get("via", ""), ())
        if "tl" in one.attrib and ids:
            key = one.attrib["tl"], int(one.attrib["linkIndex"])
            found.setdefault(key, []).append(ids[0])
    return found
