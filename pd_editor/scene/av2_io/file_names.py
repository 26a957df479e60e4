"""Names of an Argoverse 2 scenario folder's two files."""

import re
from typing import Final

TRACKS_PREFIX: Final = "scenario_"
MAP_PREFIX: Final = "log_map_archive_"

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")


def is_scenario_id(text: str) -> bool:
    """Whether a text can be a scenario's id, and thus part of file names."""
    return _ID.fullmatch(text) is not None


def is_tracks_name(name: str) -> bool:
    """Whether a file's name is that of a track file."""
    return name.startswith(TRACKS_PREFIX) and name.endswith(".parquet")


def is_map_name(name: str) -> bool:
    """Whether a file's name is that of a vector map."""
    return name.startswith(MAP_PREFIX) and name.endswith(".json")


def tracks_name(scenario_id: str) -> str:
    """Name of a scenario's track file."""
    return f"{TRACKS_PREFIX}{scenario_id}.parquet"


def map_name(scenario_id: str) -> str:
    """Name of a scenario's map file."""
    return f"{MAP_PREFIX}{scenario_id}.json"
