"""Procedural road networks of many families, drawn from a seed."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final
from zlib import crc32

import numpy as np

from pd_editor.errors import SynthesisError
from pd_editor.synthesis.road_network.families.arterial import (
    draw_arterial,
    draw_t_junctions,
)
from pd_editor.synthesis.road_network.families.grid import draw_downtown, draw_grid
from pd_editor.synthesis.road_network.families.merge import draw_merge
from pd_editor.synthesis.road_network.families.residential import (
    draw_dead_ends,
    draw_winding_street,
)
from pd_editor.synthesis.road_network.families.roundabout import draw_roundabout
from pd_editor.synthesis.road_network.families.slip_lanes import draw_slip_lanes
from pd_editor.synthesis.road_network.families.town import draw_town
from pd_editor.synthesis.road_network.network import Network
from pd_editor.synthesis.road_network.plain_xml import PlainNetwork, convert
from pd_editor.synthesis.sumo.sumo_net import read_sumo_net
from pd_editor.synthesis.sumo_to_av2.kerb_lanes import with_wide_kerb_lanes
from pd_editor.synthesis.sumo_to_av2.map_conversion import net_road_map

_DRAW: Final[dict[str, Callable[[np.random.Generator], PlainNetwork]]] = {
    "grid": draw_grid,
    "downtown": draw_downtown,
    "town": draw_town,
    "arterial": draw_arterial,
    "t-junctions": draw_t_junctions,
    "roundabout": draw_roundabout,
    "merge": draw_merge,
    "slip-lanes": draw_slip_lanes,
    "winding-street": draw_winding_street,
    "dead-ends": draw_dead_ends,
}
FAMILIES: Final[tuple[str, ...]] = tuple(_DRAW)
FAMILY_SHARES: Final[Mapping[str, float]] = {
    "grid": 0.27,
    "downtown": 0.19,
    "arterial": 0.12,
    "town": 0.14,
    "t-junctions": 0.11,
    "slip-lanes": 0.04,
    "merge": 0.04,
    "roundabout": 0.03,
    "winding-street": 0.04,
    "dead-ends": 0.02,
}
"""How often each family comes in a corpus, to be as straight, dense and full of
junctions as Argoverse 2's maps are."""


def draw_network(family: str, seed: int, folder: Path) -> Network:
    """A network of a family; the same seed makes the same road map.

    Raises:
        SynthesisError: SUMO is missing, refused the network, the family is unknown,
            or the folder cannot be written.
    """
    if family not in _DRAW:
        raise SynthesisError(
            f"There is no family of roads '{family}'; "
            f"expected one of {', '.join(FAMILIES)}."
        )
    random = np.random.default_rng([seed, crc32(family.encode())])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        net_file = convert(_DRAW[family](random), folder)
    except OSError as error:
        raise SynthesisError(
            f"{folder}: expected a folder that can be written ({error})."
        ) from error
    net = read_sumo_net(net_file)
    mapped = net_road_map(with_wide_kerb_lanes(net, random), random)
    return Network(
        name=f"{family}-{seed:05d}",
        family=family,
        folder=folder,
        net_file=net_file,
        road_map=mapped.road_map,
        lane_of_sumo=mapped.lane_of_sumo,
        has_signals=net.has_signals,
        parking_strips_m=tuple(
            lane.shape_m for lane in net.lanes.values() if lane.is_parking
        ),
    )
