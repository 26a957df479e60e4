"""Writer of the two files of an Argoverse 2 scenario folder."""

from pd_editor.base.errors import ExportError
from pd_editor.scene.av2_io.file_names import is_scenario_id, map_name, tracks_name
from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.av2_io.tracks_writer import tracks_bytes
from pd_editor.scene.scenario import Scenario


def scenario_files(scenario: Scenario) -> dict[str, bytes]:
    """Names and contents of a scenario's files: tracks (parquet), then map (JSON).

    Raises:
        ExportError: no agent exists at any step, or the id cannot be a file's name.
    """
    if not scenario.agents.is_valid.any():
        raise ExportError(
            "A scenario without agents cannot be written as Argoverse 2 files; "
            "place at least one."
        )
    scenario_id = scenario.scenario_id
    if not is_scenario_id(scenario_id):
        raise ExportError(
            f"The scenario id {scenario_id[:60]!r} cannot be part of a file's name."
        )
    try:
        map_json = map_bytes(scenario.road_map, scenario.origin_city_m)
    except RecursionError as error:
        raise ExportError(
            f"Scenario {scenario_id}: a field of its map is nested too deeply to write."
        ) from error
    return {
        tracks_name(scenario_id): tracks_bytes(scenario),
        map_name(scenario_id): map_json,
    }
