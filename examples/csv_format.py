"""A format of one's own: folders with ``lanes.csv`` and ``tracks.csv``.

A package names FORMAT in its entry points, and then whatever opens scenes takes such folders:

[project.entry-points."pd_editor.formats"]
csv-folder = "examples.csv_format:FORMAT"
"""

import csv
from pathlib import Path

import numpy as np

from examples.csv_writer import write
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import FileScene, FileTrack
from pd_editor.scene.formats.recorded_map import CenterLane, lanes_of
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.scenario import Scenario


def rows_of(path: Path) -> dict[str, list[list[str]]]:
    """Rows of each lane or agent, whose name is in the first column."""
    found: dict[str, list[list[str]]] = {}
    if not path.exists():  # Maps without agents are scenes, too.
        return found
    for name, *rest in list(csv.reader(path.read_text().splitlines()))[1:]:
        found.setdefault(name, []).append(rest)
    return found


def read(path: Path) -> Scenario:
    """Read a folder; what this raises, users see as one sentence."""
    lanes, tracks = [], []
    for name, rows in rows_of(path / "lanes.csv").items():
        half, after = float(rows[0][0]) / 2, rows[0][1].split()
        line = np.array([row[2:] for row in rows], float)
        lanes.append(
            CenterLane(key=name, line=line, half_width_m=(half, half), successors=after)
        )
    for name, rows in rows_of(path / "tracks.csv").items():
        time, x, y, heading = np.array([row[1:] for row in rows], float).T
        tracks.append(
            FileTrack(
                track_id=name, kind=AgentKind(rows[0][0]), size_m=None, time_s=time,
                position_m=np.stack([x, y], axis=-1), heading_rad=heading,
            )
        )  # fmt: skip
    scene = FileScene(
        path=path, name=path.name, lanes=lanes_of(lanes), tracks=tuple(tracks), current_s=0.0
    )  # fmt: skip
    return scene.scenario(
        b"".join(one.read_bytes() for one in sorted(path.glob("*.csv")))
    )


FORMAT = SceneFormat(
    name="csv-folder", title="CSV folder", endings=(), read=read, write=write,
    recognises=lambda path: (path / "lanes.csv").is_file(),
)  # fmt: skip
