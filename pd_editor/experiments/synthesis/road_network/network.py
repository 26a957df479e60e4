"""A road network for SUMO with its Argoverse 2 map."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pd_editor.experiments.synthesis.road_network.footways import Footways
from pd_editor.experiments.synthesis.sumo_to_av2.parking_bays import ParkingBay
from pd_editor.scene.road_map import RoadMap


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """Road network in the frame of the SUMO net, in metres."""

    name: str
    family: str
    folder: Path
    """Folder of ``net_file`` and of the files that it was made from."""
    net_file: Path
    road_map: RoadMap
    lane_of_sumo: Mapping[str, tuple[int, ...]]
    """Lanes of the map along each SUMO lane, in driving order.

    Includes junction lanes but no sidewalks and parking strips. Several SUMO lanes may
    map to the same lane.
    """
    has_signals: bool
    parking_strips_m: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    """Centre lines of the parking strips along the kerb, in driving direction."""
    parking_bays: tuple[ParkingBay, ...] = ()
    footways: Footways | None = None
    """Footways, if SUMO's net has no sidewalks."""
