"""A road network that SUMO drives on, with its Argoverse 2 map."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pd_editor.scene.road_map import RoadMap
from pd_editor.synthesis.road_network.footways import Footways


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """Roads in the frame of the SUMO net, metres."""

    name: str
    family: str
    folder: Path
    """Holds ``net_file`` and what it was made from."""
    net_file: Path
    road_map: RoadMap
    lane_of_sumo: Mapping[str, tuple[int, ...]]
    """Lanes of the map along each SUMO lane, in driving order.

    Junction lanes too. SUMO lanes that nobody drives on (sidewalks, parking strips)
    are missing. Several SUMO lanes may name one lane of the map.
    """
    has_signals: bool
    parking_strips_m: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    """Middle lines of the strips along the kerb where vehicles park, as driven."""
    footways: Footways | None = None
    """Where people walk if SUMO's net has no sidewalks."""
