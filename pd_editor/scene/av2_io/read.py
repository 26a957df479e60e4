"""Reader of Argoverse 2 scenario folders."""

import hashlib
import os
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import InputError, MapFileError, ScenarioFileError
from pd_editor.base.regular_file import check_path, read_regular
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.file_names import (
    MAP_PREFIX,
    TRACKS_PREFIX,
    is_map_name,
    is_scenario_id,
    is_tracks_name,
    map_name,
)
from pd_editor.scene.av2_io.json_fields import MAX_JSON_BYTES
from pd_editor.scene.av2_io.map_file import read_map, signals_of_map
from pd_editor.scene.av2_io.track_table import MAX_TRACKS_BYTES
from pd_editor.scene.av2_io.tracks_file import agents_named, read_tracks
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Provenance, Scenario
from pd_editor.scene.scene_limits import MAX_GAP_M, road_gap_m

FAR_M: Final = 200.0
"""Agents further than this from the map get a note."""
_CITIES: Final = frozenset(
    {"austin", "dearborn", "miami", "palo-alto", "pittsburgh", "washington-dc"}
)
"""Where Argoverse 2 was recorded; other scenes merely have its format."""
_ATTRIBUTION: Final = "Argoverse 2 by Argo AI, CC BY-NC-SA 4.0."


def read_scenario(folder: Path) -> Scenario:
    """Read the scenario in a folder with one track file and one map.

    Raises:
        InputError: a file is missing, damaged, or does not belong to the other one.
    """
    folder = Path(folder)
    check_path(folder)
    try:
        if not os.path.isdir(folder):
            raise InputError(f"{folder}: there is no such folder.")
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder}: cannot be listed ({error.strerror}).") from error
    tracks = [name for name in names if is_tracks_name(name)]
    maps = [name for name in names if is_map_name(name)]
    if len(tracks) != 1:
        found = "no" if not tracks else str(len(tracks))
        raise ScenarioFileError(
            f"{folder}: found {found} track files; "
            f"expected one named {TRACKS_PREFIX}<id>.parquet."
        )
    scenario_id = tracks[0].removeprefix(TRACKS_PREFIX).removesuffix(".parquet")
    expected = map_name(scenario_id)
    if not maps:
        raise MapFileError(f"{folder}: the map {expected} is missing.")
    if expected not in maps:
        raise MapFileError(
            f"{folder}: the map {maps[0]} belongs to another scenario; "
            f"expected {expected}."
        )
    return read_scenario_bytes(
        read_regular(folder / tracks[0], max_bytes=MAX_TRACKS_BYTES),
        read_regular(folder / expected, max_bytes=MAX_JSON_BYTES),
        name=scenario_id,
        source=os.path.realpath(folder),
    )


def read_scenario_bytes(
    parquet: bytes, map_json: bytes, *, name: str, source: str = ""
) -> Scenario:
    """Read a scenario from the bytes of a track file and a map.

    ``name`` identifies the scenario in errors; ``source`` says how to open it again.

    Raises:
        InputError: a file is damaged or does not belong to the other one.
    """
    tracks_name = f"{TRACKS_PREFIX}{name}.parquet"
    tracks = read_tracks(parquet, tracks_name)
    if not is_scenario_id(tracks.scenario_id):
        raise ScenarioFileError(
            f"{tracks_name}: scenario_id is {tracks.scenario_id[:60]!r}; "
            f"expected up to 128 letters, digits, dots, dashes and underscores."
        )
    origin = tracks.origin_city_m
    file = f"{MAP_PREFIX}{name}.json"
    road_map, signals = signals_of_map(
        read_map(map_json, file, origin), tracks.time_axis.num_steps, file
    )
    far = _far_from_road(road_map, tracks.agents, name)
    digest = hashlib.sha256(parquet)
    digest.update(map_json)
    return Scenario(
        scenario_id=tracks.scenario_id,
        city=tracks.city,
        origin_city_m=origin,
        road_map=road_map,
        agents=tracks.agents,
        time_axis=tracks.time_axis,
        focal_id=tracks.focal_id,
        provenance=Provenance(
            source=source,
            content_sha256=digest.hexdigest(),
            notes=(*tracks.notes, *far),
            attribution=_ATTRIBUTION if tracks.city in _CITIES else None,
        ),
        signals=signals,
        source_fields=tracks.source_fields,
    )


def _far_from_road(
    road_map: RoadMap, agents: AgentTracks, name: str
) -> tuple[str, ...]:
    """Note agents far from the map; raise if the map is far from all tracks."""
    gap = road_gap_m(road_map, agents.position_m[agents.is_valid])
    if gap > MAX_GAP_M:
        raise MapFileError(
            f"{MAP_PREFIX}{name}.json: the map lies {gap / 1000:.1f} km from the "
            "tracks; expected the map of this scenario."
        )
    least, most = road_map.bounds_m
    outside = np.maximum(least - agents.position_m, agents.position_m - most)
    outside = outside.max(axis=-1)
    is_far = np.where(agents.is_valid, outside, 0.0) > FAR_M
    if not is_far.any():
        return ()
    return (
        f"Further than {FAR_M:g} m from the map: {agents_named(agents.ids, is_far)}.",
    )
