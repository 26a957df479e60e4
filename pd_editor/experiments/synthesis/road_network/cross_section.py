"""Cross-sections of streets."""

from dataclasses import dataclass, replace

from pd_editor.experiments.synthesis.road_network.plain_xml import Strip, StripKind


@dataclass(frozen=True, kw_only=True)
class Carriageway:
    """Cross-section of one direction of a street: sidewalk, parking, bike, vehicle lanes."""

    num_lanes: int
    lane_width_m: float
    speed_mps: float
    has_bus_lane: bool = False
    """Whether the rightmost vehicle lane is a bus lane."""
    bike_width_m: float = 0.0
    parking_width_m: float = 0.0
    sidewalk_width_m: float = 0.0
    median_m: float = 0.0
    """Width of the median between the two directions."""
    is_one_way: bool = False

    def lanes_only(self, num_lanes: int) -> "Carriageway":
        """So many plain lanes, without anything between them and the kerb."""
        return replace(
            self,
            num_lanes=num_lanes,
            has_bus_lane=False,
            bike_width_m=0.0,
            parking_width_m=0.0,
            sidewalk_width_m=0.0,
        )

    def strips(self) -> tuple[Strip, ...]:
        """Lanes (strips) from the kerb to the left."""
        beside = [
            (StripKind.SIDEWALK, self.sidewalk_width_m),
            (StripKind.PARKING, self.parking_width_m),
            (StripKind.BIKE, self.bike_width_m),
        ]
        lanes = [StripKind.CAR] * self.num_lanes
        if self.has_bus_lane:
            lanes[0] = StripKind.BUS
        return tuple(
            [Strip(kind=kind, width_m=width) for kind, width in beside if width > 0]
            + [Strip(kind=kind, width_m=self.lane_width_m) for kind in lanes]
        )

    def width_m(self) -> float:
        """Total width of all strips."""
        return sum(strip.width_m for strip in self.strips())
