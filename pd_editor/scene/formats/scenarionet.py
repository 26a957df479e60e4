"""ScenarioNet (MetaDrive) scenario descriptions: recordings of Waymo, nuPlan, nuScenes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from pd_editor.base.errors import FormatError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats.file_scene import (
    NO_HEADINGS,
    FileScene,
    FileTrack,
    usual_now_s,
)
from pd_editor.scene.formats.file_signal import FileSignal
from pd_editor.scene.formats.packed_file import ending_of, stem_of
from pd_editor.scene.formats.plain_pickle import read_plain_pickle
from pd_editor.scene.formats.recorded_map import (
    CenterLane,
    crosswalks_of,
    lane_numbers,
    lanes_of,
    made_of,
    numbers_of,
    points_of,
    read_as,
)
from pd_editor.scene.formats.recording_writers import scenarionet_files
from pd_editor.scene.formats.scene_format import SceneFormat
from pd_editor.scene.geometry.paved_area import valid_area
from pd_editor.scene.road_map import LaneKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

_KINDS: Final = {
    "VEHICLE": AgentKind.VEHICLE,
    "PEDESTRIAN": AgentKind.PEDESTRIAN,
    "CYCLIST": AgentKind.CYCLIST,
    "TRAFFIC_CONE": AgentKind.CONSTRUCTION,
    "TRAFFIC_BARRIER": AgentKind.STATIC,
}
_FINER_KINDS: Final = {"motorcycle": AgentKind.MOTORCYCLIST, "bus": AgentKind.BUS}
"""Parts of the names that data sets give to kinds."""
_LANE_KINDS: Final = {"LANE_BIKE_LANE": LaneKind.BIKE, "LANE_BUS_LANE": LaneKind.BUS}
_SUMMARIES: Final = frozenset({"dataset_summary.pkl", "dataset_mapping.pkl"})


def read(path: Path) -> Scenario:
    """Read a scenario description: tracks with sizes, lanes, crosswalks, signals.

    Lanes get boundaries at the width that the map tells, else 3.5 m apart.

    Raises:
        FormatError: the file is damaged, or names something that would be called.
    """
    found, data = read_plain_pickle(path)
    found = found if isinstance(found, dict) else {}
    tables = {"dynamic_map_states": found.get("dynamic_map_states") or {}}
    tables |= {one: found.get(one) for one in ("metadata", "tracks", "map_features")}
    wrong = [name for name, one in tables.items() if not isinstance(one, dict)]
    if wrong:
        raise FormatError(
            f"{path}: is no scenario description; expected dicts: {', '.join(wrong)}."
        )
    with read_as(path, "scenario description"):
        scene = _scene(path, found)
    return scene.scenario(data)


def _scene(path: Path, found: Mapping[str, Any]) -> FileScene:
    about, features = found["metadata"], found["map_features"]
    time_s = made_of(path, "metadata", _times_s, "ts", found)
    tracks = [
        track
        for name, one in found["tracks"].items()
        if (track := made_of(path, "track", _track, str(name), one, time_s))
    ]
    made = [
        made_of(path, "map feature", _feature, str(key), one)
        for key, one in features.items()
    ]
    lanes = [one for one in made if isinstance(one, CenterLane)]
    areas = {n: one for n, one in enumerate(made, 10**6) if isinstance(one, tuple)}
    numbers = lane_numbers(lanes)
    states = found.get("dynamic_map_states") or {}
    signals = [
        made_of(path, "signal", _signal, str(key), one, numbers, time_s)
        for key, one in states.items()
    ]
    now = made_of(path, "metadata", _now, "current_time_index", about)
    # Whole recordings name no current step, or the first one.
    usual_s = usual_now_s(float(time_s[0]), float(time_s[-1]))
    source = " ".join(str(about.get(name, "")) for name in ("dataset", "map")).strip()
    asked = made_of(path, "metadata", _asked, "tracks_to_predict", about)
    no_heading = any(
        one["state"].get("heading") is None for one in found["tracks"].values()
    )
    return FileScene(
        path=path,
        name=str(found.get("id") or stem_of(path)),
        lanes=made_of(path, "map", lanes_of, lanes),
        crosswalks=crosswalks_of(
            (n, ring) for n, (kind, ring) in areas.items() if kind == "CROSSWALK"
        ),
        more_paved=[
            valid_area(ring)
            for kind, ring in areas.values()
            if kind == "DRIVEWAY" and len(ring) > 2
        ],
        tracks=tuple(tracks),
        signals=tuple(signals),
        current_s=float(time_s[now]) if 0 < now < len(time_s) else usual_s,
        ego_id=str(about.get("sdc_id", "")),
        focal_id=asked,
        city=str(about.get("map") or about.get("dataset") or ""),
        notes=(NO_HEADINGS,) * no_heading,
        attribution=f"Recorded by {source}, under its own licence." if source else "",
    )


def _now(name: str, about: Mapping[str, Any]) -> int:
    return int(about.get(name) or 0)


def _asked(name: str, about: Mapping[str, Any]) -> str:
    return str(next(iter(about.get(name) or ()), ""))


def _times_s(name: str, found: Mapping[str, Any]) -> np.ndarray:
    about = found["metadata"]
    if about.get(name) is None:
        return TimeAxis().step_s * np.arange(int(found["length"]))
    return numbers_of(about, name, 0)


def _track(name: str, found: Mapping[str, Any], time_s: np.ndarray) -> FileTrack | None:
    """A track where it is valid; None if it never is."""
    state = found["state"]
    number = len(time_s)
    position = numbers_of(state, "position", 0, 2)[:, :2]
    if len(position) != number:
        raise FormatError(
            f"its track {name[:40]!r} has {len(position)} positions; expected {number}, "
            "one for each time."
        )
    is_valid = numbers_of(state, "valid", number) > 0
    is_valid &= np.isfinite(position).all(axis=1)
    if not is_valid.any():
        return None
    sizes = [
        float(np.median(numbers_of(state, side, number)[is_valid]))
        if state.get(side) is not None
        else 0.0
        for side in ("length", "width")
    ]
    told = (
        numbers_of(state, "heading", number)[is_valid]
        if state.get("heading") is not None
        else np.full(is_valid.sum(), np.nan)
    )
    finer = str((found.get("metadata") or {}).get("type", "")).lower()
    kind = next(
        (kind for part, kind in _FINER_KINDS.items() if part in finer),
        _KINDS.get(str(found["type"]), AgentKind.UNKNOWN),
    )
    return FileTrack(
        track_id=name,
        kind=kind,
        size_m=(sizes[0], sizes[1]) if min(sizes) > 0 else None,
        time_s=time_s[is_valid],
        position_m=position[is_valid],
        heading_rad=told,
        velocity_mps=numbers_of(state, "velocity", number, 2)[is_valid, :2]
        if state.get("velocity") is not None
        else None,
        longest_gap_s=1.5 * float(np.median(np.diff(time_s))) if number > 1 else 0.0,
    )


def _signal(
    key: str, found: Mapping[str, Any], numbers: Mapping[str, int], time_s: np.ndarray
) -> FileSignal:
    number = numbers.get(str(found.get("lane", key)))
    place = found.get("stop_point")
    stop = None if place is None else np.array(place, float).ravel()[:2]
    return FileSignal(
        signal_id=key,
        stop_m={} if number is None else {number: stop},
        begins_s=time_s.tolist(),
        words=list(found["state"]["object_state"]),
        holds_s=float(np.diff(time_s).max(initial=0.0)),
    )


def _feature(
    key: str, found: Mapping[str, Any]
) -> CenterLane | tuple[str, np.ndarray] | None:
    """A lane, or an area with its kind; None is neither."""
    kind = str(found["type"])
    if kind in ("CROSSWALK", "DRIVEWAY"):
        return kind, points_of(found, "polygon")
    return _lane(key, found) if kind.startswith("LANE_") else None


def _lane(key: str, found: Mapping[str, Any]) -> CenterLane:
    line = points_of(found, "polyline")
    half = None
    if found.get("width") is not None:
        table = numbers_of(found, "width", 0, 2)[:, :2]
        middle = [
            np.median(side[side > 0]) if (side > 0).any() else 0 for side in table.T
        ]
        half = (float(middle[0]), float(middle[1])) if min(middle) > 0 else None
    exits = found.get("exit_lanes")
    return CenterLane(
        key=key,
        line=line,
        kind=_LANE_KINDS.get(str(found["type"]), LaneKind.VEHICLE),
        half_width_m=half,
        polygon=points_of(found, "polygon")
        if found.get("polygon") is not None
        else None,
        successors=None if exits is None else [str(one) for one in exits],
        left_neighbor=_neighbor(found.get("left_neighbor"), -1),
        right_neighbor=_neighbor(found.get("right_neighbor"), 0),
    )


def _neighbor(found: Any, row: int) -> str | None:
    """The first of those that Waymo has along a lane, the next of all that MetaDrive has."""
    found = found or [""]
    is_along = isinstance(found[0], dict)
    return str(found[0]["feature_id"] if is_along else found[row]) or None


def _recognises(path: Path) -> bool:
    return ending_of(path) == ".pkl" and path.name not in _SUMMARIES


SCENARIONET: Final = SceneFormat(
    name="scenarionet",
    title="ScenarioNet",
    endings=(".pkl",),
    recognises=_recognises,
    read=read,
    write=scenarionet_files,
)
