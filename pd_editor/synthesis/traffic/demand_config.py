"""The knobs of synthetic traffic."""

from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True, kw_only=True)
class ParkingOptions:
    """How much stands beside the road."""

    kerb_share: float = 0.22
    """Share of street sides along which vehicles park."""
    fullness: tuple[float, float] = (0.3, 0.97)
    """About the share of such a side that is taken, drawn between these."""
    angled_share: float = 0.12
    """Share of street sides with places at an angle to the lane."""
    driveways_per_km: float = 1.6
    """Vehicles in driveways, across the street or at an angle, per km of side."""
    lots_per_km: float = 0.06
    """Small parking lots off the road, per km of side."""


@dataclass(frozen=True, kw_only=True)
class DemandOptions:
    """Who is on the road, and how many."""

    flow_per_lane: float = 500.0
    """Vehicles an hour and lane that enter at a typical entry of the network."""
    flow_spread: float = 0.6
    """Spread of the flows of entries, as that of a log-normal law."""
    turn_cost_s: float = 40.0
    """Detour that a driver accepts to save a turn."""
    turn_aversion: float = 2.4
    """How much rarer destinations become with every turn towards them."""
    halting_share: float = 0.08
    """Share of vehicles that halt at the kerb for a while on their way."""
    pedestrians_per_km: float = 5.0
    """Pedestrians at any time on a km of sidewalk, at the mean over networks."""
    pedestrian_spread: float = 1.0
    """Spread between networks, as that of a log-normal law: many have hardly any."""
    shares: dict[str, float] = field(
        default_factory=lambda: {
            "car": 0.555, "suv": 0.282, "van": 0.07, "truck": 0.035, "bus": 0.025,
            "motorcycle": 0.005, "bicycle": 0.015,
        }
    )  # fmt: skip
    """Share of each model of ``vehicle_types`` in the traffic."""
    parking: ParkingOptions = ParkingOptions()


MAP_DEMAND: Final = DemandOptions(
    flow_per_lane=650.0,
    turn_aversion=4.0,
    pedestrians_per_km=4.5,
    parking=ParkingOptions(kerb_share=0.45, fullness=(0.5, 0.98)),
)
"""Traffic on maps of Argoverse 2. They were cut out around busy places, and so tightly
that every side street is an entry, from which few would turn."""
