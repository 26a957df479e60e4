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
    strip_end_m: float = 2.0
    kerb_end_m: float = 3.0
    """Free space at both ends of a parking strip, and of a kerb."""
    place_m: float = 5.2
    slot_gap_m: tuple[float, float] = (0.5, 1.6)
    """Range of the gap between two places along the kerb."""
    turned_share: float = 0.008
    """Share of the vehicles along a kerb that face oncoming traffic."""
    reversed_share: float = 0.35
    """Share of vehicles that were reversed into perpendicular places."""
    driveway_deg: tuple[float, float, float, float] = (90.0, -90.0, -70.0, 0.0)
    driveway_shares: tuple[float, float, float, float] = (0.3, 0.25, 0.15, 0.3)
    driveway_spread_deg: float = 8.0
    """Angles to the lane of vehicles off the street, and their spread."""
    lot_pitch_m: float = 2.75
    lot_aisle_m: float = 6.5


@dataclass(frozen=True, kw_only=True)
class WalkingOptions:
    """How pedestrians walk on footways and over crosswalks."""

    walk_s: tuple[float, float] = (25.0, 110.0)
    """Range of the walking time of a pedestrian, without stops."""
    pace_mps: tuple[float, float] = (1.35, 0.22)
    aside_m: float = 0.5
    """Standard deviation of the lateral offset from a footway's centre line."""
    max_aside_m: float = 0.9
    crossing_share: float = 0.6
    """Share of the passed crosswalks that pedestrians use."""
    standing_share: float = 0.45
    """Share of pedestrians that stop on their way."""
    standing_s: tuple[float, float] = (10.0, 120.0)
    min_s: float = 5.0
    """Shorter tracks are left out."""
    min_way_m: float = 3.0
    """Least remaining length of a walk after a crossing."""
    before_s: float = 0.5
    after_s: float = 2.0
    """A spot of a crosswalk is free of vehicles for this time before and after its use."""
    clearance_m: float = 0.9
    pace_change_s: float = 0.4
    """Standard deviation of the filter that smooths starts and stops."""


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
    actuated_share: float = 0.5
    """Share of networks with actuated lights, whose green ends without arriving vehicles."""
    cost_noise: float = 0.3
    """Spread of the expected travel time of an edge between drivers."""
    mean_travel_mps: float = 6.0
    """Speed that relates a flow to the number of vehicles at the start."""
    typical_limit_mps: float = 12.0
    flow_power: float = 2.0
    """Exponent of the flow as a function of the speed limit."""
    walk_m: float = 350.0
    """Typical distance between start and destination of pedestrians."""
    walking_mps: float = 1.3
    walking: WalkingOptions = WalkingOptions()
    """Of pedestrians that are sampled after the simulation."""


MAP_DEMAND: Final = DemandOptions(
    flow_per_lane=650.0,
    turn_aversion=4.0,
    pedestrians_per_km=4.5,
    parking=ParkingOptions(kerb_share=0.5, fullness=(0.5, 0.98)),
)
"""Traffic on maps of Argoverse 2, which are cropped so tightly around busy places that
every side street is an entry with little traffic."""
