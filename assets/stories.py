"""The demos: what each shows, and the window of simulated traffic that shows it."""

from typing import Final

from assets.story import Story
from pd_editor.synthesis.demand_options import DemandOptions, ParkingOptions


def _parking(
    kerb_share: float = 0.5, fullness: tuple[float, float] = (0.3, 1.0)
) -> ParkingOptions:
    """Vehicles along the kerb only; driveways and lots lie off the paved ground."""
    return ParkingOptions(
        kerb_share=kerb_share,
        fullness=fullness,
        angled_share=0.0,
        driveways_per_km=0.0,
        lots_per_km=0.0,
    )


_MIXED_TOWN: Final = DemandOptions(
    flow_per_lane=400,
    pedestrians_per_km=14,
    shares={
        "car": 0.5, "suv": 0.25, "van": 0.07, "truck": 0.03, "bus": 0.05,
        "motorcycle": 0.04, "bicycle": 0.05,
    },
    parking=_parking(0.75, (0.5, 1.0)),
)  # fmt: skip
_DENSE_DOWNTOWN: Final = DemandOptions(
    flow_per_lane=300,
    pedestrians_per_km=22,
    shares={
        "car": 0.5, "suv": 0.26, "van": 0.08, "truck": 0.035, "bus": 0.04,
        "motorcycle": 0.025, "bicycle": 0.06,
    },
    parking=_parking(0.9, (0.6, 1.0)),
)  # fmt: skip
_MANY_BUSES: Final = DemandOptions(
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
        seed=11,
        demand=_MANY_BUSES,
        current_step=420,
        focal_id="car-0011",
    ),
    Story(
        name="crosswalk",
        sentence="a van turns right and waits while two pedestrians walk over the crosswalk",
        family="downtown",
        seed=30,
        demand=_MIXED_TOWN,
        current_step=320,
        focal_id="van-0162",
    ),
    Story(
        name="downtown",
        sentence="a boulevard of many lanes, with parked cars, cyclists, pedestrians and a full side street",
        family="downtown",
        seed=25,
        demand=_DENSE_DOWNTOWN,
        current_step=330,
        focal_id="suv-0094",
    ),
    Story(
        name="merge",
        sentence="a car comes from a ramp and joins a divided road, where another leaves it room",
        family="merge",
        seed=40,
        demand=DemandOptions(
            flow_per_lane=1000,
            flow_spread=0.25,
            pedestrians_per_km=3,
            parking=_parking(),
        ),
        current_step=205,
        focal_id="car-0084",
        without=("bicycle-0347",),
    ),
    Story(
        name="queue",
        sentence="cars queue side by side at a red light, which turns green while the clip runs",
        family="t-junctions",
        seed=30,
        demand=_MIXED_TOWN,
        current_step=285,
        focal_id="car-0042",
    ),
    Story(
        name="roundabout",
        sentence="a car gives way, enters a roundabout and circulates in it; others wait behind",
        family="roundabout",
        seed=23,
        demand=DemandOptions(
            flow_per_lane=420, pedestrians_per_km=4, parking=_parking()
        ),
        current_step=145,
        focal_id="car-0042",
    ),
    Story(
        name="signalised-junction",
        sentence="a car turns left at a large junction just before the lights change",
        family="grid",
        seed=30,
        demand=_MIXED_TOWN,
        current_step=175,
        focal_id="car-0091",
    ),
    Story(
        name="winding-street",
        sentence="a car follows a winding street between parked cars and a line of oncoming traffic",
        family="winding-street",
        seed=23,
        demand=DemandOptions(
            flow_per_lane=260, pedestrians_per_km=8, parking=_parking(0.7)
        ),
        current_step=160,
        focal_id="suv-0077",
    ),
)
