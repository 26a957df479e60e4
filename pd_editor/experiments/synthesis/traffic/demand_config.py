"""Parameters of synthetic traffic."""

from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True, kw_only=True)
class ParkingOptions:
    """Amount of parked vehicles."""

    kerb_share: float = 0.25
    """Share of street sides without a bay along which vehicles park."""
    fullness: tuple[float, float] = (0.3, 0.97)
    """Range of the occupied share of such a side."""
    driveways_per_km: float = 1.6
    """Vehicles in driveways, across the street or at an angle, per km of side."""
    lots_per_km: float = 0.06
    """Small parking lots off the road, per km of side."""


@dataclass(frozen=True, kw_only=True)
class DemandOptions:
    """Amount and composition of traffic, and how its drivers and signals behave."""

    flow_per_lane: float = 450.0
    """Vehicles per hour and lane at a typical entry of the network."""
    flow_spread: float = 0.6
    """Log-normal spread of the flows of entries."""
    turn_cost_s: float = 40.0
    """Detour that a driver accepts to save a turn."""
    turn_aversion: float = 2.4
    """Decay rate of a destination's probability with each turn towards it."""
    halting_share: float = 0.08
    """Share of vehicles that stop at the kerb for a while."""
    pedestrians_per_km: float = 5.0
    """Pedestrians per km of sidewalk at any time, mean over networks."""
    pedestrian_spread: float = 1.0
    """Log-normal spread between networks: many have hardly any pedestrians."""
    standing_share: float = 0.5
    """Share of pedestrians on sidewalks that stand for a while before they walk. In recordings
    45 % stand at a time (``train``), with this share 35 to 45 % of the simulated ones."""
    standing_s: tuple[float, float] = (20.0, 240.0)
    """Range of that time."""
    shares: dict[str, float] = field(
        default_factory=lambda: {
            "car": 0.555, "suv": 0.282, "van": 0.07, "truck": 0.035, "bus": 0.025,
            "motorcycle": 0.005, "bicycle": 0.015,
        }
    )  # fmt: skip
    """Share of each model of ``vehicle_types``."""
    parking: ParkingOptions = ParkingOptions()
    speed_factor: tuple[float, float] = (1.03, 0.12)
    """Mean and spread of desired speeds over the limit, SUMO's ``speedFactor``."""
    speed_factor_range: tuple[float, float] = (0.7, 1.3)
    """Least and largest of them; what is sampled beyond is clipped."""
    green_share: tuple[float, float] = (0.7, 1.2)
    """Range of the factor of netconvert's green times, which give cycles of 90 s."""


MAP_DEMAND: Final = DemandOptions(
    flow_per_lane=650.0,
    turn_aversion=4.0,
    pedestrians_per_km=4.5,
    parking=ParkingOptions(kerb_share=0.5, fullness=(0.5, 0.98)),
)
"""Traffic on maps of Argoverse 2, which are cropped so tightly around busy places that
every side street is an entry with little traffic."""
