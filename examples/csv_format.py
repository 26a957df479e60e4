"""A format of one's own in a few lines: lanes and tracks as CSV files of one folder.

``lanes.csv`` has points ``lane, x_m, y_m`` in the order of driving; ``tracks.csv``, if it
is there, states ``agent, time_s, x_m, y_m, heading_rad`` of cars. A package names FORMAT
in its entry points, and then whatever opens scenes takes such folders:

[project.entry-points."pd_editor.formats"]
csv-folder = "examples.csv_format:FORMAT"
"""

import csv
from itertools import groupby
from pathlib import Path

import numpy as np

from pd_editor.base.errors import FormatError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import FileScene, FileTrack
from pd_editor.scene.formats.recorded_map import CenterLane, lanes_of
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.scenario import Scenario


def tables(path: Path) -> dict[str, np.ndarray]:
    """Rows of each lane or agent, by its name; nothing if there is no such file."""
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    parts = groupby(rows, key=lambda row: row[0])
    return {name: np.array([one[1:] for one in some], float) for name, some in parts}


def read(path: Path) -> Scenario:
    """Read a folder; lanes lead on where they end, and are 3.5 m wide."""
    try:
        lanes, tracks = tables(path / "lanes.csv"), tables(path / "tracks.csv")
        states = {name: table.T for name, table in tracks.items()}
        return FileScene(
            path=path,
            name=path.name,
            lanes=lanes_of([CenterLane(key=k, line=line) for k, line in lanes.items()]),
            tracks=tuple(
                FileTrack(track_id=name, kind=AgentKind.VEHICLE, size_m=None, time_s=t,
                          position_m=np.stack([x, y], axis=-1), heading_rad=heading)
                for name, (t, x, y, heading) in states.items()
            ),
        ).scenario((path / "lanes.csv").read_bytes())  # fmt: skip
    except (ValueError, OSError) as error:
        raise FormatError(f"{path}: cannot be read ({error}).") from error


FORMAT = SceneFormat(
    name="csv-folder",
    title="CSV folder",
    endings=(),
    recognises=lambda path: (path / "lanes.csv").is_file(),
    read=read,
)
