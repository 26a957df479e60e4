"""States of SUMO's traffic lights during a simulation, as signals of a map's lanes."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import SynthesisError
from pd_editor.scene.formats.file_signal import WORDS
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.signals import Signal, SignalState

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
