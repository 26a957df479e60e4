"""Lanes of OpenDRIVE files by pyxodr; runs in an environment of its own.

Reads JSON from standard input: paths. Writes for each file its lanes by name (road,
section, lane), each with its ``kind``, its ``center_m`` in the direction of traffic, and
the lanes ``after`` it. Of links that only the next road tells, pyxodr has none.
"""

import json
import sys

import numpy as np
from pyxodr_omega_prime.road_objects.network import RoadNetwork

STEP_M = 0.1


def lanes(path: str) -> dict[str, dict]:
    """The answer for a file."""
    return {
        f"{road.id} {number} {lane.id}": {
            "kind": lane.type,
            "center_m": np.asarray(lane.traffic_flow_line)[:, :2].tolist(),
            "after": [
                f"{one.road_id} {one.lane_section_id} {one.id}"
                for one in lane.traffic_flow_successors
            ],
        }
        for road in RoadNetwork(path, resolution=STEP_M).get_roads()
        for number, section in enumerate(road.lane_sections)
        for lane in section.lanes
    }


if __name__ == "__main__":
    json.dump([lanes(path) for path in json.load(sys.stdin)], sys.stdout)
