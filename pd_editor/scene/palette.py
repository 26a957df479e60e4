"""The colours of the light and of the dark theme."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState

Rgb = tuple[int, int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class Palette:
    """Colours of one theme."""

    ground: Rgb
    road: Rgb
    lane: Rgb
    intersection: Rgb
    bike_lane: Rgb
    bus_lane: Rgb
    lane_edge: Rgb
    centerline: Rgb
    direction: Rgb
    """Arrows along lanes."""
    white_marking: Rgb
    yellow_marking: Rgb
    crosswalk: Rgb
    ghost: Rgb
    past: Rgb
    glass: Rgb
    kinds: Mapping[AgentKind, Rgb]
    focal: Rgb
    ego: Rgb
    selection: Rgb
    selection_rim: Rgb
    warning: Rgb
    pointed: Rgb
    """The ring of an agent whose row of the list is pointed at."""
    plan: Rgb
    """The line of what a policy plans."""
    candidate: Rgb
    candidate_speeds: tuple[Rgb, Rgb, Rgb]
    """Slow, middle and fast."""

    @property
    def signals(self) -> Mapping[SignalState, Rgb]:
        """Stop lines by what the signal tells."""
        return {
            SignalState.UNKNOWN: self.past,
            SignalState.STOP: self.warning,
            SignalState.CAUTION: self.yellow_marking,
            SignalState.GO: self.kinds[AgentKind.CYCLIST],
        }


def parts_of_one(color: Rgb) -> tuple[float, float, float]:
    """A colour as matplotlib takes it."""
    red, green, blue = color
    return red / 255, green / 255, blue / 255


def agent_color(scenario: Scenario, palette: Palette, row: int) -> Rgb:
    """Colour of an agent: its kind's, unless it is the focal agent or the ego."""
    agent_id = scenario.agents.ids[row]
    if agent_id == scenario.focal_id:
        return palette.focal
    if agent_id == EGO_ID:
        return palette.ego
    return palette.kinds[scenario.agents.kinds[row]]


LIGHT: Final = Palette(
    ground=(238, 240, 243),
    road=(205, 209, 215),
    lane=(213, 217, 222),
    intersection=(205, 209, 215),
    bike_lane=(197, 214, 203),
    bus_lane=(219, 207, 203),
    lane_edge=(190, 195, 203),
    centerline=(120, 140, 170),
    direction=(164, 175, 194),
    white_marking=(255, 255, 255),
    yellow_marking=(236, 184, 52),
    crosswalk=(245, 246, 248),
    ghost=(112, 84, 190),
    past=(110, 118, 130),
    glass=(38, 44, 54),
    kinds={
        AgentKind.VEHICLE: (44, 104, 206),
        AgentKind.BUS: (34, 52, 128),
        AgentKind.MOTORCYCLIST: (122, 62, 196),
        AgentKind.CYCLIST: (14, 122, 68),
        AgentKind.PEDESTRIAN: (204, 32, 108),
        AgentKind.STATIC: (108, 114, 124),
        AgentKind.BACKGROUND: (108, 114, 124),
        AgentKind.CONSTRUCTION: (160, 88, 0),
        AgentKind.RIDERLESS_BICYCLE: (70, 116, 90),
        AgentKind.UNKNOWN: (108, 114, 124),
    },
    focal=(198, 80, 0),
    ego=(0, 126, 120),
    selection=(255, 196, 0),
    selection_rim=(92, 70, 8),
    warning=(208, 16, 28),
    pointed=(0, 120, 230),
    plan=(38, 44, 54),
    candidate=(0, 116, 104),
    candidate_speeds=((192, 82, 0), (104, 114, 0), (0, 114, 104)),
)
DARK: Final = Palette(
    ground=(24, 27, 33),
    road=(40, 46, 56),
    lane=(46, 52, 63),
    intersection=(40, 46, 56),
    bike_lane=(42, 62, 54),
    bus_lane=(66, 51, 52),
    lane_edge=(64, 71, 84),
    centerline=(110, 135, 175),
    direction=(84, 98, 122),
    white_marking=(222, 226, 232),
    yellow_marking=(226, 176, 60),
    crosswalk=(170, 176, 186),
    ghost=(168, 148, 240),
    past=(140, 148, 160),
    glass=(14, 17, 22),
    kinds={
        AgentKind.VEHICLE: (88, 156, 244),
        AgentKind.BUS: (136, 140, 250),
        AgentKind.MOTORCYCLIST: (196, 136, 250),
        AgentKind.CYCLIST: (56, 190, 120),
        AgentKind.PEDESTRIAN: (250, 110, 164),
        AgentKind.STATIC: (150, 157, 168),
        AgentKind.BACKGROUND: (150, 157, 168),
        AgentKind.CONSTRUCTION: (236, 164, 64),
        AgentKind.RIDERLESS_BICYCLE: (124, 178, 146),
        AgentKind.UNKNOWN: (150, 157, 168),
    },
    focal=(250, 136, 44),
    ego=(28, 196, 184),
    selection=(255, 206, 40),
    selection_rim=(24, 22, 16),
    warning=(250, 96, 88),
    pointed=(90, 180, 255),
    plan=(222, 226, 232),
    candidate=(40, 180, 160),
    candidate_speeds=((244, 150, 50), (190, 200, 60), (40, 196, 170)),
)
