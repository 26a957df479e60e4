"""A check of written files with Argoverse's own loaders."""

from pathlib import Path

from pd_editor.base.errors import ExportError
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.file_names import MAP_PREFIX, TRACKS_PREFIX


def check_with_official_loaders(folder: Path) -> frozenset[str]:
    """Load a scenario folder with the package ``av2``.

    Returns the ids of the tracks that have a state at the last observed step: loaders of
    predictors keep these.

    Raises:
        ExportError: the folder lacks a file, av2 refuses one, or there is not exactly
            one focal track, of category 3.
    """
    from av2.datasets.motion_forecasting.scenario_serialization import (
        load_argoverse_scenario_parquet,
    )
    from av2.map.map_api import ArgoverseStaticMap

    tracks = sorted(folder.glob(f"{TRACKS_PREFIX}*.parquet"))
    maps = sorted(folder.glob(f"{MAP_PREFIX}*.json"))
    if len(tracks) != 1 or len(maps) != 1:
        raise ExportError(
            f"{folder}: found {len(tracks)} track files and {len(maps)} maps; "
            "expected one of each."
        )
    try:
        scenario = load_argoverse_scenario_parquet(tracks[0])
        road_map = ArgoverseStaticMap.from_json(maps[0])
        num_lanes = len(road_map.get_scenario_lane_segments())
    # The loaders document no errors, so whatever they raise is their refusal.
    except Exception as error:
        raise ExportError(
            f"{folder}: av2's own loader refused it ({type(error).__name__}: {error})."
        ) from error
    if not scenario.tracks or not num_lanes:
        raise ExportError(f"{folder}: av2's own loader found no tracks or no lanes.")
    focal = [
        track.track_id
        for track in scenario.tracks
        if track.category.value == AgentCategory.FOCAL
    ]
    if focal != [scenario.focal_track_id]:
        raise ExportError(
            f"{folder}: focal_track_id is {scenario.focal_track_id!r}, and tracks of"
            f" category 3 are {', '.join(map(repr, focal)) or 'none'}; expected exactly"
            " one track of category 3, the focal one."
        )
    seen = {
        track.track_id: max(
            (one.timestep for one in track.object_states if one.observed), default=-1
        )
        for track in scenario.tracks
    }
    last = max(seen.values())
    return frozenset(name for name, step in seen.items() if step == last >= 0)
