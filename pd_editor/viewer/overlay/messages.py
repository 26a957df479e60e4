"""What the page is told, and what it tells: the contract of both sides.

``client/src/messages.ts`` is generated from this file (``make page``). ``STATES`` are sent
down, each as the whole of what an element shows; ``EVENTS`` come up. Names are in camel
case on the way. Points are in metres of the scene, pixels in those of the picture.
"""

from typing import Final, Literal

import msgspec

Pixel = tuple[float, float]
Ground = tuple[float, float]
Place = tuple[float, float, float]
Ray = tuple[Place, Place]
Square = tuple[float, float, float]
"""Middle, and half of a side."""
Tone = Literal["", "good", "warn", "bad", "busy"]


class Message(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """A state, an event, or a part of one."""


class PageState(Message):
    title: str
    is_dark: bool


class ThemeState(Message):
    is_dark: bool


class ThemeEvent(Message):
    is_dark: bool


class PageEvent(Message):
    kind: Literal["ready", "missing"]
    names: tuple[str, ...] = ()


class ConnectionState(Message):
    is_new: bool


class OrderState(Message):
    """Keys and buttons that may arm a mode, and the last one that was processed."""

    keys: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    answered: int = 0


class OrderEvent(Message):
    number: int


class PanelState(Message):
    """The tab of viser's panel to open, ``instead`` of another one if that is open."""

    tab: str | None
    is_debug: bool
    instead: str | None = None


class PanelEvent(Message):
    kind: Literal["hold", "release", "tab"]
    title: str = ""


class ViewState(Message):
    """How the camera answers; ``look`` counts poses of the server."""

    is_top: bool
    look: int


class CurtainState(Message):
    """Nodes to wait for while the former picture stays."""

    number: int
    nodes: tuple[str, ...]


class CompassState(Message):
    is_top: bool
    is_heading_up: bool


class CompassEvent(Message):
    kind: Literal["turn"]


class LegendEntry(Message):
    """A line of the legend; ``keeps`` is what a padlock keeps."""

    text: str
    glyph: Literal["fill", "shaded", "line", "dots", "ring", "lock"]
    color: str
    keeps: str = ""


class LegendState(Message):
    entries: tuple[LegendEntry, ...]


class KeyRow(Message):
    keys: str
    does: str


class KeyGroup(Message):
    title: str
    rows: tuple[KeyRow, ...]


class KeysState(Message):
    groups: tuple[KeyGroup, ...]
    num_opened: int


class HintsDone(Message):
    """What the session has done already."""

    select: bool
    drag: bool
    bend: bool
    regenerate: bool


class HintsState(Message):
    is_empty: bool
    done: HintsDone


class BannerState(Message):
    owner: str | None = None
    text: str = ""
    button: str | None = None


class BannerEvent(Message):
    owner: str | None


class TooltipState(Message):
    """Answer to the request ``asked``."""

    at: Pixel
    lines: tuple[str, ...]
    agent: str | None
    asked: int


class TooltipEvent(Message):
    at: Pixel
    ray: Ray
    ask: int


class FanState(Message):
    is_shown: bool


class FanEvent(Message):
    point: Ground | None


class CompareState(Message):
    """How the scene differs from the original; empty while that is hidden."""

    text: str


class CompareEvent(Message):
    kind: Literal["hold", "release"]


class MenuEntry(Message):
    label: str
    key: str
    is_enabled: bool


class MenuState(Message):
    number: int
    at: Pixel
    title: str
    items: tuple[MenuEntry, ...]


class MenuEvent(Message):
    """A right click, or a choice in the menu of that number."""

    kind: Literal["open", "choose"]
    at: Pixel = (0.0, 0.0)
    ray: Ray | None = None
    index: int = -1
    menu: int = 0


class Label(Message):
    text: str
    note: str
    point: Place
    radius: float


class LabelsState(Message):
    labels: tuple[Label, ...]


class LockMark(Message):
    keeps: str
    seconds: str
    label: str
    point: Place
    radius: float


class LocksState(Message):
    locks: tuple[LockMark, ...]


class MeasureState(Message):
    """The tool that measures; ``speed`` in m/s is that of ``agent``."""

    is_active: bool
    start: Ground | None
    speed: float | None
    agent: str


class PlacingState(Message):
    """The mode in which clicks place agents: length, width and height of the ghost."""

    is_active: bool
    size_m: Place
    heading_rad: float
    color: str
    num_kinds: int


class PlacingEvent(Message):
    kind: Literal["point", "place", "kind"]
    point: Ground | None = None
    heading_rad: float | None = None
    number: int = 0


class RegionState(Message):
    is_active: bool
    least_m: float
    square: Square | None


class RegionEvent(Message):
    kind: Literal["drawn", "clear"]
    start: Ground | None = None
    end: Ground | None = None


class MapWindowState(Message):
    title: str = ""
    road: str = ""
    square: Square = (0.0, 0.0, 0.0)
    view: str = ""


class MapWindowEvent(Message):
    kind: Literal["open", "cancel"]
    square: Square | None = None


Icon = Literal[
    "undo", "redo", "3d", "top", "fit", "frame", "measure", "place",
    "agents", "scorecard", "compare", "live", "help",
]  # fmt: skip


class Tool(Message):
    icon: Icon
    hint: str
    is_active: bool
    is_enabled: bool
    is_held: bool
    starts_group: bool


class ToolbarState(Message):
    tools: tuple[Tool, ...]


class ToolbarEvent(Message):
    kind: Literal["press", "release"]
    icon: Icon


class TimelineMark(Message):
    kind: Literal["problem", "finding"]
    step: int
    text: str


class TimelineState(Message):
    """The track, in steps from the current one on; the marks on it."""

    first_step: int
    last_step: int
    begin_step: int
    end_step: int
    step_s: float
    marks: tuple[TimelineMark, ...]


class PlayheadState(Message):
    step: float
    is_playing: bool
    speed: float
    loops: bool


class TimelineEvent(Message):
    """A button of the timeline, a step to go to, or steps to go on by."""

    kind: Literal[
        "play", "current", "speed", "loop", "seek", "step", "problem", "finding"
    ]
    value: int = 0


class Choice(Message):
    value: str | int
    text: str


class SampleLine(Message):
    text: str
    tone: Tone = ""


class SampleCard(Message):
    index: int
    rank: int
    is_adopted: bool
    lines: tuple[SampleLine, ...]
    hint: str


class SamplesState(Message):
    is_open: bool = False
    takes_focus: bool = False
    ranking: str = ""
    rankings: tuple[Choice, ...] = ()
    pick: int = 0
    picks: tuple[Choice, ...] = ()
    cards: tuple[SampleCard, ...] = ()


class SamplePicturesState(Message):
    pictures: tuple[str, ...]


class SamplesEvent(Message):
    kind: Literal["close", "leave", "rank", "pick", "point", "adopt", "keep", "pair"]
    value: str | int = ""


class PairAgent(Message):
    """A box and its trajectory: x, y, heading of each step, in 0.1 m and 0.01 rad."""

    length: float
    width: float
    color: int
    path: tuple[int, ...]


class PairSample(Message):
    index: int
    is_adopted: bool
    agents: tuple[PairAgent, ...]


class PairOffer(Message):
    index: int
    is_adopted: bool


class SamplePairState(Message):
    """Two samples side by side, over the ground as SVG; half the width in metres."""

    is_open: bool = False
    half_width: float = 0.0
    ground: str = ""
    offered: tuple[PairOffer, ...] = ()
    samples: tuple[PairSample, ...] = ()


class SamplePairEvent(Message):
    kind: Literal["close", "use", "choose"]
    value: int = -1
    side: int = 0


class ScoreFinding(Message):
    id: str
    agent: str
    text: str
    time: str
    is_chosen: bool


class ScoreLine(Message):
    """A row of the scorecard; ``findings`` is None unless it is open."""

    name: str
    title: str
    meaning: str
    tone: Tone
    level: Literal["usual", "unusual", "extreme"]
    value: str
    usual: str
    where: str
    count: int
    mark: str
    findings: tuple[ScoreFinding, ...] | None = None
    more: int = 0


class ScorecardState(Message):
    is_open: bool = False
    draws: bool = False
    rows: tuple[ScoreLine, ...] = ()
    is_searching: bool = False
    cures: tuple[str, ...] = ()


class ScorecardEvent(Message):
    """A part of the scorecard; ``covered`` is its share of the picture's width."""

    kind: Literal["close", "draw", "row", "finding", "cure"]
    covered: float
    value: bool = False
    name: str = ""
    id: str = ""


class Chart(Message):
    """One line for each agent; None where it is not there."""

    title: str
    lines: tuple[tuple[float | None, ...], ...]


class ChartsState(Message):
    """Charts of the selected agents, over time in seconds."""

    ids: tuple[str, ...]
    time: tuple[float, ...]
    charts: tuple[Chart, ...]


class ProblemRow(Message):
    id: str
    icon: str
    severity: str
    text: str
    hint: str
    time: str


ProblemGroupName = Literal["new", "notices", "ignored", "recorded"]


class ProblemGroup(Message):
    name: ProblemGroupName
    title: str
    rows: tuple[ProblemRow, ...]
    more: int


class ActiveProblem(Message):
    """The chosen problem: cures, and the label of the button that ignores it."""

    id: str
    message: str
    cures: tuple[str, ...]
    ignore: str
    note: str


class StatusState(Message):
    text: str
    tone: Tone
    fraction: float | None
    action: str
    unsaved: str
    groups: tuple[ProblemGroup, ...]
    active: ActiveProblem | None
    num_closed: int


class StatusEvent(Message):
    """A part of the chip; ``free`` is the share of the picture left of its list."""

    kind: Literal["list", "choose", "cure", "ignore", "cancel", "use", "download"]
    value: str = ""
    free: float = 1.0
    is_open: bool = False


AgentRow = tuple[str, int, float | None, float | None, int, bool]
"""Id, place of the kind, m/s, metres to the focal agent, marks, whether it moves."""


class AgentsState(Message):
    is_open: bool = False
    number: int = 0
    focal: str = ""
    ego: str = ""
    kinds: tuple[tuple[str, str], ...] = ()
    rows: tuple[AgentRow, ...] = ()


class AgentSelectionState(Message):
    """Selected rows of the list of that number."""

    number: int
    rows: tuple[int, ...]


class AgentsEvent(Message):
    kind: Literal["open", "close", "select", "lock", "point"]
    number: int = 0
    rows: tuple[int, ...] = ()
    row: int | None = None


class Note(Message):
    tone: str
    text: str


class GuidanceTool(Message):
    kind: str
    title: str
    hint: str
    is_active: bool
    is_enabled: bool


class GuidanceInput(Message):
    name: str
    label: str
    value: str | float | None
    unit: str
    least: float | None
    most: float | None
    step: float | None
    options: tuple[str, ...]
    empty: str
    notes: dict[str, tuple[str, str]] = {}
    """Few words, and a sentence, on each option."""


class GuidanceRow(Message):
    index: int
    kind: str
    title: str
    agents: str
    name: str
    is_on: bool
    is_chosen: bool
    stop: int
    inputs: tuple[GuidanceInput, ...]
    notes: tuple[Note, ...]


class EncounterLine(Message):
    kind: str
    agent: str
    text: str
    is_made: bool
    is_pointed: bool


class EncounterList(Message):
    label: str = ""
    is_enabled: bool = False
    is_open: bool = False
    about: str = ""
    items: tuple[EncounterLine, ...] = ()


class GuidanceRun(Message):
    label: str
    all: str
    is_enabled: bool


class GuidancePanelState(Message):
    """The list of guidance terms; ``answered`` is the newest event that it answers."""

    version: int
    answered: int
    about: str
    weights: tuple[float, ...]
    tools: tuple[GuidanceTool, ...]
    encounters: EncounterList
    rows: tuple[GuidanceRow, ...]
    run: GuidanceRun
    report: tuple[Note, ...]
    figures: tuple[tuple[str, str, str, str], ...]
    action: str


class GuidancePanelEvent(Message):
    kind: Literal[
        "tool", "run", "take", "look", "leave", "point", "make",
        "choose", "switch", "remove", "weight", "input",
    ]  # fmt: skip
    version: int | None
    count: int
    tool: str = ""
    is_all: bool = False
    number: int | None = None
    index: int = -1
    is_on: bool = False
    stop: int = 0
    is_end: bool = False
    name: str = ""
    value: str | float | None = None


class GuidanceBadge(Message):
    index: int
    kind: str
    is_on: bool
    is_faint: bool
    is_chosen: bool
    lines: tuple[str, ...]
    is_bad: bool


class GuidanceMark(Message):
    """A term on the road, or the badges of an agent at ``at``."""

    shape: Literal["flag", "path", "line", "arrow", "arc", "badges"]
    index: int = 0
    kind: str = ""
    is_on: bool = True
    is_faint: bool = False
    is_chosen: bool = False
    lines: tuple[str, ...] = ()
    is_bad: bool = False
    is_offer: bool = False
    point: Ground | None = None
    start: Place | None = None
    end: Place | None = None
    points: tuple[Ground, ...] | None = None
    at: Place | None = None
    badges: tuple[GuidanceBadge, ...] = ()


class GuidanceMarksState(Message):
    """Marks on the road; middle and radius of agents under arcs."""

    marks: tuple[GuidanceMark, ...]
    agents: tuple[tuple[float, float, float, float], ...]
    refusal: str


class GuidanceMarksEvent(Message):
    kind: Literal["point", "grab", "drag", "drop", "cancel"]
    index: int | None
    point: Ground | None = None


class GuidingGhost(Message):
    text: str = ""
    is_bad: bool = False
    end: Place | None = None
    points: tuple[Ground, ...] | None = None


class GuidingState(Message):
    is_active: bool = False
    kind: str = ""
    gesture: Literal["", "draw", "pick", "click"] = ""
    start: Place = (0.0, 0.0, 0.0)
    ghost: GuidingGhost = GuidingGhost()


class GuidingEvent(Message):
    kind: Literal["point", "click", "drawn"]
    tool: str
    at: Pixel = (0.0, 0.0)
    ray: Ray | None = None
    points: tuple[Ground, ...] = ()


STATES: Final[dict[str, type[Message]]] = {
    "page": PageState,
    "theme": ThemeState,
    "connection": ConnectionState,
    "order": OrderState,
    "panel": PanelState,
    "view": ViewState,
    "curtain": CurtainState,
    "compass": CompassState,
    "legend": LegendState,
    "keys": KeysState,
    "hints": HintsState,
    "banner": BannerState,
    "tooltip": TooltipState,
    "fan": FanState,
    "compare": CompareState,
    "menu": MenuState,
    "labels": LabelsState,
    "locks": LocksState,
    "measure": MeasureState,
    "placing": PlacingState,
    "region": RegionState,
    "mapWindow": MapWindowState,
    "toolbar": ToolbarState,
    "timeline": TimelineState,
    "playhead": PlayheadState,
    "samples": SamplesState,
    "sample-pictures": SamplePicturesState,
    "sample-pair": SamplePairState,
    "scorecard": ScorecardState,
    "charts": ChartsState,
    "status": StatusState,
    "agents": AgentsState,
    "agent-selection": AgentSelectionState,
    "guidance_panel": GuidancePanelState,
    "guidance_marks": GuidanceMarksState,
    "guiding": GuidingState,
}
"""What each element shows."""

EVENTS: Final[dict[str, type[Message]]] = {
    "page": PageEvent,
    "theme": ThemeEvent,
    "order": OrderEvent,
    "panel": PanelEvent,
    "compass": CompassEvent,
    "banner": BannerEvent,
    "tooltip": TooltipEvent,
    "fan": FanEvent,
    "compare": CompareEvent,
    "menu": MenuEvent,
    "placing": PlacingEvent,
    "region": RegionEvent,
    "mapWindow": MapWindowEvent,
    "toolbar": ToolbarEvent,
    "timeline": TimelineEvent,
    "samples": SamplesEvent,
    "sample-pair": SamplePairEvent,
    "scorecard": ScorecardEvent,
    "status": StatusEvent,
    "agents": AgentsEvent,
    "guidance_panel": GuidancePanelEvent,
    "guidance_marks": GuidanceMarksEvent,
    "guiding": GuidingEvent,
}
"""What each element tells."""
