"""What commonroad-io reads in CommonRoad files; runs in an environment of its own.

Reads a list of paths from standard input. Writes for each file ``lanes`` by id, each with
``successors``, ``predecessors``, ``left`` and ``right`` neighbours in the same direction
and its ``center_m``, and ``tracks`` by id, each with ``length_m``, ``width_m`` and the
``states`` ``[step, x_m, y_m, heading_rad, speed_mps]``, and the ``problems``' first states.
"""

import json
import sys

from commonroad.common.file_reader import CommonRoadFileReader


def scene(path: str) -> dict:
    """One file."""
    scenario, problems = CommonRoadFileReader(path).open()
    lanes = {
        one.lanelet_id: {
            "successors": sorted(one.successor),
            "predecessors": sorted(one.predecessor),
            "left": one.adj_left if one.adj_left_same_direction else None,
            "right": one.adj_right if one.adj_right_same_direction else None,
            "center_m": one.center_vertices.tolist(),
        }
        for one in scenario.lanelet_network.lanelets
    }
    tracks = {}
    for one in scenario.obstacles:
        states = [one.initial_state]
        if getattr(one, "prediction", None) is not None:
            states += one.prediction.trajectory.state_list
        tracks[one.obstacle_id] = {
            "length_m": one.obstacle_shape.length,
            "width_m": one.obstacle_shape.width,
            "states": [
                [s.time_step, *s.position.tolist(), s.orientation, s.velocity]
                for s in states
            ],
        }
    first = {
        number: [s.time_step, *s.position.tolist(), s.orientation, s.velocity]
        for number, problem in problems.planning_problem_dict.items()
        for s in [problem.initial_state]
    }
    return {"lanes": lanes, "tracks": tracks, "problems": first}


if __name__ == "__main__":
    json.dump([scene(path) for path in json.load(sys.stdin)], sys.stdout)
