"""Writer of the format of ``csv_format.py``.

Columns of ``lanes.csv``: lane, width_m, lanes that follow, x_m, y_m; of ``tracks.csv``:
agent, kind, time_s (0 at the current step), x_m, y_m, heading_rad.
"""

import csv
import io
from collections.abc import Iterable

import numpy as np

from pd_editor.scene.formats.scene_format import WrittenScene
from pd_editor.scene.scenario import Scenario


def table(*rows: Iterable[object]) -> bytes:
    """Rows as a CSV file."""
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue().encode()


def write(scenario: Scenario) -> WrittenScene:
    """Make the files of a scene; the file's frame is that of the city."""
    origin, agents = scenario.origin_city_m, scenario.agents
    times = scenario.time_axis.times_s()
    lanes, tracks = [], []
    for lane in scenario.road_map.lanes:
        width = np.hypot(*(lane.left_m[0] - lane.right_m[0]))
        after = " ".join(map(str, lane.successors))
        for x, y in lane.centerline_m + origin:
            lanes.append((lane.lane_id, width, after, x, y))
    for row, name in enumerate(agents.ids):
        kind = agents.kinds[row].value
        for step in np.flatnonzero(agents.is_valid[row]):
            x, y = agents.position_m[row, step] + origin
            heading = agents.heading_rad[row, step]
            tracks.append((name, kind, times[step], x, y, heading))
    return WrittenScene(
        files={
            "lanes.csv": table(("lane", "width_m", "next", "x_m", "y_m"), *lanes),
            "tracks.csv": table(
                ("agent", "kind", "time_s", "x_m", "y_m", "heading_rad"), *tracks
            ),
        },
        losses=("Sizes of agents, crosswalks, neighbours and markings of lanes.",),
    )
