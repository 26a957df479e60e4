"""Samples vehicle types: sizes, speeds, driver behaviour, offset within the lane."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import Final

import numpy as np

from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions
from pd_editor.scene.agent_kind import AgentKind


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

ACCEL_SPREAD: Final = 0.5
"""Standard deviation of the logarithm of drivers' accelerations."""

DECEL_SPREAD: Final = 0.3
"""Standard deviation of the logarithm of drivers' decelerations."""

ACCEL_OVER_SPEED: Final = (
    (0.0, 1.45), (3.0, 1.6), (6.0, 1.2), (10.0, 1.0), (14.0, 0.75), (20.0, 0.5),
    (40.0, 0.3),
)  # fmt: skip
"""Factor of the acceleration at a speed in m/s."""

PEDESTRIAN_SIZE_M: Final = (0.65, 0.7)


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
    harsh = float(np.clip(random.normal(0.0, DECEL_SPREAD), -0.5, 0.5))
    decel = model.decel_mps2 * np.exp(harsh)
    pace = float(np.clip(random.normal(0.0, ACCEL_SPREAD), -0.8, 0.8))
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
        float(np.clip(random.normal(mean, 0.08), 0.45, 1.0))
        for mean in PEDESTRIAN_SIZE_M
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
