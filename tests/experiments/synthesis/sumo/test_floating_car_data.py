"""SUMO's states as box poses: closed forms, and files that are not its own."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.sumo.simulation_output import read_raw_tracks
from pd_editor.scene.formats.sumo_net import center_of_front, heading_of_sumo


def test_headings_turn_from_clockwise_north_to_counterclockwise_east():
    angle = np.array([0.0, 90.0, 180.0, 270.0, 45.0])
    expected = np.deg2rad([90.0, 0.0, -90.0, 180.0, 45.0])
    assert np.allclose(heading_of_sumo(angle), expected)


def test_centers_lie_half_a_length_behind_the_front_bumper():
    front = np.array([[10.0, 5.0], [10.0, 5.0], [10.0, 5.0]])
    heading = np.array([0.0, np.pi / 2, np.deg2rad(30.0)])
    center = center_of_front(front, heading, np.array([4.0, 12.0, 2.0]))
    expected = [[8.0, 5.0], [10.0, -1.0], [10 - np.cos(np.pi / 6), 4.5]]
    assert np.allclose(center, expected)


def _table(prefix: str, rows: list[tuple]) -> pa.Table:
    time, ids, x, y, angle = zip(*rows, strict=True)
    return pa.table(
        {
            "timestep_time": pa.array(time, pa.float64()),
            f"{prefix}_id": pa.array(ids, pa.string()),
            f"{prefix}_x": pa.array(x, pa.float64()),
            f"{prefix}_y": pa.array(y, pa.float64()),
            f"{prefix}_angle": pa.array(angle, pa.float64()),
        }
    )


def test_rows_are_sorted_by_user_and_time_and_empty_steps_left_out(tmp_path: Path):
    vehicles, persons = tmp_path / "v.parquet", tmp_path / "p.parquet"
    rows = [
        (0.1, "b", 1.0, 2.0, 90.0),
        (0.1, "a", 3.0, 4.0, 0.0),
        (0.2, "b", 1.5, 2.0, 90.0),
        (0.3, None, None, None, None),
    ]
    pq.write_table(_table("vehicle", rows), vehicles)
    pq.write_table(_table("person", [(0.2, "p", 7.0, 8.0, 180.0)]), persons)
    raw = read_raw_tracks((vehicles, persons), 0.1)
    assert raw.names == ("a", "b", "p")
    assert raw.agent.tolist() == [0, 1, 1, 2]
    assert raw.step.tolist() == [1, 1, 2, 2]
    assert raw.front_m.tolist() == [[3, 4], [1, 2], [1.5, 2], [7, 8]]
    later = raw.shifted(2)
    assert later.step.tolist() == [0, 0]
    assert later.agent.tolist() == [1, 2]


def test_no_file_is_no_traffic(tmp_path: Path):
    assert read_raw_tracks((tmp_path / "none.parquet",), 0.1).names == ()


def test_other_files_are_refused(tmp_path: Path):
    path = tmp_path / "v.parquet"
    path.write_text("no parquet")
    with pytest.raises(SynthesisError, match=r"v\.parquet"):
        read_raw_tracks((path,), 0.1)
    pq.write_table(
        _table("vehicle", [(0.1, "a", 1.0, 1.0, 0.0)]).drop(["vehicle_y"]), path
    )
    with pytest.raises(SynthesisError, match="'y'"):
        read_raw_tracks((path,), 0.1)
