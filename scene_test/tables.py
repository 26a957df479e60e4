"""Scenes as plain tables: tracks, lanes and drivable areas."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import shapely

from scene_test.classifier import SceneTest, Surroundings, scene_test
from scene_test.features import FEATURES, Road, Vehicles, vehicle_features


def compare_folders(recorded: str | Path, sampled: str | Path) -> SceneTest:
    """Distinguish the vehicles of two folders of scenes, named alike in both.

    Raises:
        ValueError: a folder has no such scenes, or both have fewer than two.
    """
    found = scene_test(read_folder(recorded), read_folder(sampled))
    if found is None:
        raise ValueError("two scenes with vehicles are needed, some in each folder.")
    return found


def read_folder(folder: str | Path) -> Surroundings:
    """Surroundings of the vehicles at time 0 of all scenes in a folder.

    Raises:
        ValueError: there is no scene, or a table or a column of one is missing.
    """
    tracks = Path(folder).rglob("tracks.*")
    places = sorted(
        {one.parent for one in tracks if one.suffix in (".csv", ".parquet")}
    )
    if not places:
        raise ValueError(f"{folder} has no tracks.parquet or tracks.csv.")
    features = [_features(place) for place in places]
    names = [place.relative_to(folder).as_posix() for place in places]
    return Surroundings(
        features=np.concatenate(features),
        scene=np.repeat(names, [len(one) for one in features]),
    )


def _features(place: Path) -> np.ndarray:
    tracks = _table(
        place, "tracks", "agent kind time_s x_m y_m heading_rad vx_mps vy_mps"
    )
    lanes = _table(place, "lanes", "lane line kind num_successors x_m y_m")
    now = (tracks["time_s"] == 0.0) & (tracks["kind"] == "vehicle")
    x, y, heading, vx, vy = (
        tracks[name][now].astype(float)
        for name in ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps")
    )
    drives = (lanes["line"] == "center") & (lanes["kind"] != "BIKE")
    starts, lines = _runs(lanes, "lane", drives)
    if not now.any() or not lines:
        return np.zeros((0, len(FEATURES)))
    return vehicle_features(
        Vehicles(
            ids=[str(one) for one in tracks["agent"][now]],
            position_m=np.column_stack([x, y]),
            heading_rad=heading,
            speed_mps=np.hypot(vx, vy),
        ),
        Road(
            lines_m=lines,
            num_successors=lanes["num_successors"][drives][starts].tolist(),
            ground=_ground(place, lanes),
        ),
    )


def _ground(place: Path, lanes: dict[str, np.ndarray]) -> shapely.Geometry:
    """Union of the drivable areas; of the lanes where there are none."""
    rings = []
    if list(place.glob("areas.*")):
        areas = _table(place, "areas", "area x_m y_m")
        _, rings = _runs(areas, "area", np.ones(len(areas["area"]), bool))
    if not rings:
        sides = (
            _runs(lanes, "lane", lanes["line"] == side)[1] for side in ("left", "right")
        )
        rings = [
            np.concatenate([left, right[::-1]])
            for left, right in zip(*sides, strict=True)
        ]
    areas = [shapely.Polygon(ring) for ring in rings if len(ring) >= 3]
    ground = shapely.union_all(shapely.make_valid(np.array(areas, object)))
    shapely.prepare(ground)
    return ground


def _runs(
    table: dict[str, np.ndarray], name: str, rows: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Where each run of equal names starts among some rows, and its points."""
    key = table[name][rows]
    points = np.column_stack([table["x_m"][rows], table["y_m"][rows]]).astype(float)
    later = np.flatnonzero(key[1:] != key[:-1]) + 1
    starts = np.array([0, *later], int) if len(key) else np.zeros(0, int)
    return starts, np.split(points, later) if len(key) else []


def _table(place: Path, name: str, columns: str) -> dict[str, np.ndarray]:
    """Columns of a table, as Parquet or else CSV."""
    file = place / f"{name}.parquet"
    try:
        if file.is_file():
            table = pq.read_table(file)
        else:
            file = place / f"{name}.csv"
            kinds = pa_csv.ConvertOptions(column_types={"agent": pa.string()})
            table = pa_csv.read_csv(file, convert_options=kinds)
        return {one: table[one].to_numpy() for one in columns.split()}
    except (KeyError, OSError, ValueError) as error:
        raise ValueError(f"{file} cannot be used: {error}") from error
