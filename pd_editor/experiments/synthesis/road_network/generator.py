"""Generator of procedural road networks of several families."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final
from zlib import crc32

import numpy as np

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.road_network.plain_xml import PlainNetwork, convert
from pd_editor.experiments.synthesis.road_network.ramps import (
    generate_merge,
    generate_slip_lanes,
)
from pd_editor.experiments.synthesis.road_network.residential import (
    generate_dead_ends,
    generate_winding_street,
)
from pd_editor.experiments.synthesis.road_network.roundabout import (
    generate_roundabout,
)
from pd_editor.experiments.synthesis.road_network.street_plans import (
    generate_arterial,
    generate_downtown,
    generate_grid,
    generate_t_junctions,
    generate_town,
)
from pd_editor.experiments.synthesis.sumo.map_conversion import net_road_map
from pd_editor.experiments.synthesis.sumo.parking_bays import (
    BAY_SHARE,
    with_wide_kerb_lanes,
)
from pd_editor.scene.formats.sumo_net import read_sumo_net

_GENERATE: Final[dict[str, Callable[[np.random.Generator], PlainNetwork]]] = {
    "grid": generate_grid,
    "downtown": generate_downtown,
    "town": generate_town,
    "arterial": generate_arterial,
    "t-junctions": generate_t_junctions,
    "roundabout": generate_roundabout,
    "merge": generate_merge,
    "slip-lanes": generate_slip_lanes,
    "winding-street": generate_winding_street,
    "dead-ends": generate_dead_ends,
}
FAMILIES: Final[tuple[str, ...]] = tuple(_GENERATE)
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
"""Share of each family in a dataset, chosen to match the straightness, lane density and
junction density of Argoverse 2's maps."""


def generate_network(
    family: str, seed: int, folder: Path, *, bay_share: float = BAY_SHARE
) -> Network:
    """Generate a network of a family; equal arguments give equal road maps.

    ``bay_share`` of the street sides have a parking bay.

    Raises:
        SynthesisError: SUMO is missing, refused the network, the family is unknown,
            or the folder cannot be written.
    """
    if family not in _GENERATE:
        raise SynthesisError(
            f"There is no family of roads '{family}'; "
            f"expected one of {', '.join(FAMILIES)}."
        )
    random = np.random.default_rng([seed, crc32(family.encode())])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        net_file = convert(_GENERATE[family](random), folder)
    except OSError as error:
        raise SynthesisError(
            f"{folder}: expected a folder that can be written ({error})."
        ) from error
    net = read_sumo_net(net_file)
    mapped = net_road_map(with_wide_kerb_lanes(net, random), random, bay_share)
    return Network(
        name=f"{family}-{seed:05d}",
        family=family,
        folder=folder,
        net_file=net_file,
        road_map=mapped.road_map,
        lane_of_sumo=mapped.lane_of_sumo,
        has_signals=net.has_signals,
        parking_strips_m=net.parking_strips_m,
        parking_bays=mapped.parking_bays,
    )
