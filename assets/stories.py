"""The demos: what each shows, and the window of simulated traffic that shows it."""

from dataclasses import replace
from typing import Final

from assets.story import Story
from pd_editor.experiments.synthesis.traffic.demand_config import (
    DemandOptions,
    ParkingOptions,
)


def _parking(
    kerb_share: float = 0.5, fullness: tuple[float, float] = (0.3, 1.0)
) -> ParkingOptions:
    """Vehicles along the kerb only; driveways and lots lie off the paved ground."""
    return ParkingOptions(
        kerb_share=kerb_share,
        fullness=fullness,
        driveways_per_km=0.0,
        lots_per_km=0.0,
    )


_BRISK: Final = DemandOptions(
    speed_factor=(1.22, 0.12), speed_factor_range=(0.85, 1.4), green_share=(0.35, 0.7)
)
"""Drivers and signals of the traffic in which the windows of the stories were found."""

_MIXED_TOWN: Final = replace(
    _BRISK,
    flow_per_lane=400,
    pedestrians_per_km=14,
    shares={
        "car": 0.5, "suv": 0.25, "van": 0.07, "truck": 0.03, "bus": 0.05,
        "motorcycle": 0.04, "bicycle": 0.05,
    },
    parking=_parking(0.75, (0.5, 1.0)),
)  # fmt: skip
_CROWDED_TOWN: Final = replace(_MIXED_TOWN, flow_per_lane=450, pedestrian_spread=0.0)
_DENSE_DOWNTOWN: Final = replace(
    _BRISK,
    flow_per_lane=700,
    pedestrians_per_km=22,
    pedestrian_spread=0.0,
    shares={
        "car": 0.44, "suv": 0.22, "van": 0.07, "truck": 0.03, "bus": 0.04,
        "motorcycle": 0.02, "bicycle": 0.18,
    },
    parking=_parking(1.0, (0.85, 1.0)),
)  # fmt: skip
_MANY_BUSES: Final = replace(
    _BRISK,
    flow_per_lane=260,
    pedestrians_per_km=10,
    shares={
        "car": 0.5, "suv": 0.25, "van": 0.06, "truck": 0.03, "bus": 0.12,
        "motorcycle": 0.02, "bicycle": 0.02,
    },
    parking=_parking(),
)  # fmt: skip

STORIES: Final[tuple[Story, ...]] = (
    Story(
        name="bus-stop",
        sentence="a bus halts on an arterial road; a car changes lanes to overtake it",
        family="arterial",
        seed=12,
        demand=_MANY_BUSES,
        current_step=154,
        focal_id="suv-0036",
        without=("car-0000",),
        cast_seed=1,
    ),
    Story(
        name="crosswalk",
        sentence="a car waits at a junction while pedestrians walk over the crosswalks before it",
        family="grid",
        seed=33,
        demand=_MIXED_TOWN,
        current_step=364,
        focal_id="car-0012",
        without=("car-0028",),
    ),
    Story(
        name="downtown",
        sentence="a boulevard of many lanes, with parked cars, cyclists, pedestrians and a full side street",
        family="downtown",
        seed=44,
        demand=_DENSE_DOWNTOWN,
        current_step=154,
        focal_id="car-0214",
        without=("truck-0348", "van-0342"),
    ),
    Story(
        name="merge",
        sentence="a car comes down a ramp and joins a divided road on which traffic is dense",
        family="merge",
        seed=41,
        demand=replace(
            _BRISK,
            flow_per_lane=1000,
            flow_spread=0.25,
            pedestrians_per_km=3,
            parking=_parking(),
        ),
        current_step=184,
        focal_id="suv-0380",
    ),
    Story(
        name="queue",
        sentence="cars queue side by side at a red light, which turns green while the clip runs",
        family="arterial",
        seed=50,
        demand=replace(_CROWDED_TOWN, flow_per_lane=600),
        current_step=134,
        focal_id="suv-0148",
        without=("car-0057", "pedestrian-0030", "suv-0162"),
    ),
    Story(
        name="roundabout",
        sentence="a car enters a roundabout and circulates in it; others wait in a line behind it",
        family="roundabout",
        seed=30,
        demand=replace(
            _BRISK, flow_per_lane=420, pedestrians_per_km=4, parking=_parking()
        ),
        current_step=64,
        focal_id="car-0012",
        without=("van-0112",),
    ),
    Story(
        name="signalised-junction",
        sentence="lights turn green for a full street of three lanes; the first car turns left",
        family="downtown",
        seed=49,
        demand=_CROWDED_TOWN,
        current_step=374,
        focal_id="suv-0133",
        without=("car-0041", "car-0073", "motorcycle-0172"),
    ),
    Story(
        name="winding-street",
        sentence="a car follows a winding street past parked cars and over a junction where another waits",
        family="winding-street",
        seed=23,
        demand=replace(
            _BRISK, flow_per_lane=260, pedestrians_per_km=8, parking=_parking(0.75)
        ),
        current_step=244,
        focal_id="car-0010",
    ),
)
