"""Parameters of synthetic traffic, and types of its road users that are sampled with them."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pd_editor.scene.agent_kind import AgentKind


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


@dataclass(frozen=True, kw_only=True)
class VehicleModel:
    """A model of road users; pairs of numbers are mean and standard deviation."""

    name: str
    kind: AgentKind
    sumo_class: str
    length_m: tuple[float, float]
    width_m: tuple[float, float]
    accel_mps2: float
    """Median acceleration over drivers, at about 10 m/s."""
    decel_mps2: float
    """Median deceleration over drivers."""
    max_speed_mps: float
    lateral_m: float
    """Spread of the lateral offset within the lane between drivers."""


MODELS: Final[tuple[VehicleModel, ...]] = (
    VehicleModel(
        name="car", kind=AgentKind.VEHICLE, sumo_class="passenger",
        length_m=(4.65, 0.3), width_m=(1.88, 0.08), accel_mps2=2.0,
        decel_mps2=2.3, max_speed_mps=40.0, lateral_m=0.42,
    ),
    VehicleModel(
        name="suv", kind=AgentKind.VEHICLE, sumo_class="passenger",
        length_m=(5.0, 0.25), width_m=(2.0, 0.06), accel_mps2=1.95,
        decel_mps2=2.2, max_speed_mps=40.0, lateral_m=0.4,
    ),
    VehicleModel(
        name="van", kind=AgentKind.VEHICLE, sumo_class="delivery",
        length_m=(5.9, 0.5), width_m=(2.05, 0.08), accel_mps2=1.8,
        decel_mps2=2.3, max_speed_mps=36.0, lateral_m=0.35,
    ),
    VehicleModel(
        name="truck", kind=AgentKind.VEHICLE, sumo_class="truck",
        length_m=(8.5, 1.2), width_m=(2.45, 0.08), accel_mps2=1.1,
        decel_mps2=2.0, max_speed_mps=25.0, lateral_m=0.2,
    ),
    VehicleModel(
        name="bus", kind=AgentKind.BUS, sumo_class="bus",
        length_m=(12.0, 0.5), width_m=(2.6, 0.05), accel_mps2=1.1,
        decel_mps2=1.9, max_speed_mps=22.0, lateral_m=0.15,
    ),
    VehicleModel(
        name="motorcycle", kind=AgentKind.MOTORCYCLIST, sumo_class="motorcycle",
        length_m=(2.2, 0.12), width_m=(0.85, 0.06), accel_mps2=2.8,
        decel_mps2=3.2, max_speed_mps=40.0, lateral_m=0.6,
    ),
    VehicleModel(
        name="bicycle", kind=AgentKind.CYCLIST, sumo_class="bicycle",
        length_m=(1.78, 0.06), width_m=(0.65, 0.04), accel_mps2=1.1,
        decel_mps2=2.05, max_speed_mps=5.0, lateral_m=0.3,
    ),
)  # fmt: skip


ACCEL_OVER_SPEED: Final = (
    (0.0, 1.45), (3.0, 1.6), (6.0, 1.2), (10.0, 1.0), (14.0, 0.75), (20.0, 0.5),
    (40.0, 0.3),
)  # fmt: skip
"""Factor of the acceleration at a speed in m/s."""


@dataclass(frozen=True, kw_only=True)
class SampledType:
    """Sampled type of one road user, and its SUMO element."""

    kind: AgentKind
    size_m: tuple[float, float]
    element: ElementTree.Element


def sample_vehicle_type(
    type_id: str,
    model: VehicleModel,
    options: DemandOptions,
    random: np.random.Generator,
) -> SampledType:
    """Sample a vehicle and its driver."""

    def around(pair: tuple[float, float], low: float = 0.7) -> float:
        mean, spread = pair
        value = random.normal(mean, spread)
        return float(np.clip(value, low * mean, mean / low))

    length, width = around(model.length_m, 0.85), around(model.width_m, 0.93)
    lateral = float(np.clip(random.normal(0.0, model.lateral_m), -1.1, 1.1))
    if model.kind is AgentKind.CYCLIST:
        lateral = -1.2 + lateral
    # Standard deviation of the logarithm of drivers' decelerations.
    harsh = float(np.clip(random.normal(0.0, 0.3), -0.5, 0.5))
    decel = model.decel_mps2 * np.exp(harsh)
    # Standard deviation of the logarithm of drivers' accelerations.
    pace = float(np.clip(random.normal(0.0, 0.5), -0.8, 0.8))
    accel = model.accel_mps2 * np.exp(pace)
    attributes = {
        "id": type_id,
        "vClass": model.sumo_class,
        "length": length,
        "width": width,
        "minGap": random.uniform(1.4, 3.2),
        "carFollowModel": "Krauss",
        "sigma": random.uniform(0.05, 0.2),
        "tau": random.uniform(0.9, 1.7),
        "accel": accel,
        "speedTable": " ".join(f"{speed:g}" for speed, _ in ACCEL_OVER_SPEED),
        "desAccelProfile": " ".join(
            f"{accel * share:.3f}" for _, share in ACCEL_OVER_SPEED
        ),
        "decel": decel,
        "emergencyDecel": max(2.5 * decel, 6.5),
        "maxSpeed": around((model.max_speed_mps, 0.12 * model.max_speed_mps)),
        "speedFactor": np.clip(
            random.normal(*options.speed_factor), *options.speed_factor_range
        ),
        "speedDev": 0.0,
        "startupDelay": random.uniform(0.0, 1.2),
        "latAlignment": f"{lateral:.2f}",
        "minGapLat": random.uniform(0.3, 0.6),
        "maxSpeedLat": random.uniform(0.7, 1.2),
        "lcAccelLat": 0.8,
        "lcSpeedGain": random.uniform(0.3, 1.2),
        "lcKeepRight": random.uniform(0.0, 0.4),
        "lcAssertive": random.uniform(0.8, 1.3),
        "jmTimegapMinor": random.uniform(1.0, 2.0),
    }
    return SampledType(
        kind=model.kind,
        size_m=(length, width),
        element=ElementTree.Element("vType", _as_text(attributes)),
    )


def sample_pedestrian_type(type_id: str, random: np.random.Generator) -> SampledType:
    """Sample a pedestrian with a walking speed."""
    size = tuple(
        float(np.clip(random.normal(mean, 0.08), 0.45, 1.0)) for mean in (0.65, 0.7)
    )
    attributes = {
        "id": type_id,
        "vClass": "pedestrian",
        "length": 0.3,
        "width": 0.5,
        "maxSpeed": np.clip(random.normal(1.35, 0.22), 0.7, 2.2),
        "speedFactor": 1.0,
    }
    return SampledType(
        kind=AgentKind.PEDESTRIAN,
        size_m=(size[0], size[1]),
        element=ElementTree.Element("vType", _as_text(attributes)),
    )


def _as_text(attributes: dict[str, object]) -> dict[str, str]:
    return {
        name: value if isinstance(value, str) else f"{value:.3f}"
        for name, value in attributes.items()
    }
