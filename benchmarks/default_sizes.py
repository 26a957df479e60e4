"""Median box sizes per kind of agent, from the true boxes of AV2 sensor logs.

Reads ``sensor_logs/*/annotations*.feather`` under PD_EDITOR_AV2.

Annotators give an object whose length they cannot see a standard box: half of all
regular vehicles are exactly 4.03 m long. A length that several tracks of a category
share to a tenth of a millimetre was not measured, so such tracks are left out; the
median with them is printed beside it. Each track counts once, however long it is seen.
"""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.feather as feather

from pd_editor.scene.agent_kind import DEFAULT_SIZE_M, AgentKind

KIND_OF_CATEGORY = {
    "REGULAR_VEHICLE": AgentKind.VEHICLE,
    "LARGE_VEHICLE": AgentKind.VEHICLE,
    "BOX_TRUCK": AgentKind.VEHICLE,
    "TRUCK": AgentKind.VEHICLE,
    "TRUCK_CAB": AgentKind.VEHICLE,
    "VEHICULAR_TRAILER": AgentKind.VEHICLE,
    "BUS": AgentKind.BUS,
    "SCHOOL_BUS": AgentKind.BUS,
    "ARTICULATED_BUS": AgentKind.BUS,
    "MOTORCYCLIST": AgentKind.MOTORCYCLIST,
    "BICYCLIST": AgentKind.CYCLIST,
    "PEDESTRIAN": AgentKind.PEDESTRIAN,
    "OFFICIAL_SIGNALER": AgentKind.PEDESTRIAN,
    "BICYCLE": AgentKind.RIDERLESS_BICYCLE,
    "CONSTRUCTION_CONE": AgentKind.CONSTRUCTION,
    "CONSTRUCTION_BARREL": AgentKind.CONSTRUCTION,
    "BOLLARD": AgentKind.STATIC,
    "SIGN": AgentKind.STATIC,
    "STOP_SIGN": AgentKind.STATIC,
}
"""Left out: motorcycles (all of them parked, and the kind means a rider on one),
strollers, wheeled devices, animals, and the recording vehicle, which is one car."""
SHARED_BY = 3
"""So many tracks of a category with the same length: it is a standard box."""
LEAST_TRACKS = 5


def tracks_by_kind(root: Path) -> tuple[dict[AgentKind, list[tuple]], Counter]:
    """Tracks (length, width, was measured) of each kind, and unmapped ones counted."""
    sizes: dict[tuple[str, str, str], tuple[float, float]] = {}
    for path in sorted((root / "sensor_logs").glob("*/annotations*.feather")):
        names = ["track_uuid", "category", "length_m", "width_m"]
        columns = [
            column.to_pylist() for column in feather.read_table(path, names).columns
        ]
        for uuid, category, length, width in zip(*columns, strict=True):
            sizes[path.parent.name, uuid, category] = (length, width)
    shared = Counter((key[2], round(size[0], 4)) for key, size in sizes.items())
    found: dict[AgentKind, list[tuple]] = {kind: [] for kind in AgentKind}
    unmapped: Counter = Counter()
    for (_, _, category), (length, width) in sizes.items():
        kind = KIND_OF_CATEGORY.get(category)
        if kind is None:
            unmapped[category] += 1
            continue
        is_measured = shared[category, round(length, 4)] < SHARED_BY
        found[kind].append((length, width, is_measured))
    return found, unmapped


def main() -> None:
    found, unmapped = tracks_by_kind(Path(os.environ["PD_EDITOR_AV2"]))
    print("kind                tracks  median (m)   measured  median (m)   default (m)")
    for kind, tracks in found.items():
        table = np.array(tracks, float).reshape(-1, 3)
        measured = table[table[:, 2] == 1]
        line = f"{kind.value:18s}"
        for rows in (table, measured):
            middle = "-"
            if len(rows):
                middle = "{:.2f} x {:.2f}".format(*np.median(rows[:, :2], axis=0))
            line += f"  {len(rows):6d}  {middle:12s}"
        length, width = DEFAULT_SIZE_M[kind]
        kept = "  kept, too few tracks" if len(measured) < LEAST_TRACKS else ""
        print(f"{line}  {length:.1f} x {width:.1f}{kept}")
    print("not mapped:", ", ".join(f"{k} {n}" for k, n in sorted(unmapped.items())))


if __name__ == "__main__":
    main()
