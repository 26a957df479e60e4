"""What the page is told, and what it tells: the contract of both sides.

``client/src/messages.ts`` is generated from this file (``make page``). ``STATES`` are sent
down, each as the whole of what an element shows; ``EVENTS`` come up. Names are in camel
case on the way. Points are in metres of the scene, pixels in those of the picture.
"""

from collections.abc import Iterable
from typing import Annotated, Final, Literal

import msgspec

Pixel = tuple[float, float]
Ground = tuple[float, float]
Place = tuple[float, float, float]
Ray = tuple[Place, Place]
Square = tuple[float, float, float]
"""Middle, and half of a side."""
Tone = Literal["", "good", "warn", "bad", "busy"]


def rounded_place(point_m: Iterable[float]) -> Place:
    """A point as it is sent, in whole centimetres."""
    x, y, z = (round(float(value), 2) for value in point_m)
    return x, y, z


class Message(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """A state, an event, or a part of one."""


class PageState(Message, frozen=True):
    title: str
    is_dark: bool


class ThemeState(Message, frozen=True):
    is_dark: bool


class ThemeEvent(Message, frozen=True):
    is_dark: bool


class PageEvent(Message, frozen=True):
    kind: Literal["ready", "missing"]
    names: tuple[str, ...] = ()


class ConnectionState(Message, frozen=True):
    is_new: bool


class OrderState(Message, frozen=True):
    """Keys and buttons that may arm a mode, and the last one that was processed."""

    keys: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    answered: int = 0


class OrderEvent(Message, frozen=True):
    number: int


class PanelState(Message, frozen=True):
    """The tab of viser's panel to open."""

    tab: str | None
    is_debug: bool
    asked: int = 0
    """Counts what was asked for, so that a tab opens again after another one."""
    takes_focus: bool = False


class PanelEvent(Message, frozen=True):
    kind: Literal["hold", "narrow", "refused", "release", "tab"]
    title: str = ""
    typed: str = ""
    kept: str = ""
    is_whole: bool = False


class ViewState(Message, frozen=True):
    """How the camera answers; ``look`` counts poses of the server."""

    is_top: bool
    look: int


class CurtainState(Message, frozen=True):
    """Nodes to wait for while the former picture stays."""

    number: int
    nodes: tuple[str, ...]


class CompassState(Message, frozen=True):
    is_top: bool
    is_heading_up: bool


class CompassEvent(Message, frozen=True):
    kind: Literal["turn"]


class LegendEntry(Message, frozen=True):
    """A line of the legend; ``keeps`` is what a padlock keeps."""

    text: str
    glyph: Literal["fill", "shaded", "line", "dots", "ring", "lock"]
    color: str
    keeps: str = ""


class LegendState(Message, frozen=True):
    entries: tuple[LegendEntry, ...]


class KeyRow(Message, frozen=True):
    keys: str
    does: str


class KeyGroup(Message, frozen=True):
    title: str
    rows: tuple[KeyRow, ...]


class KeysState(Message, frozen=True):
    groups: tuple[KeyGroup, ...]
    num_opened: int


class HintsDone(Message, frozen=True):
    """What the session has done already."""

    select: bool
    drag: bool
    bend: bool
    regenerate: bool


class HintsState(Message, frozen=True):
    is_empty: bool
    done: HintsDone


class BannerState(Message, frozen=True):
    owner: str | None = None
    text: str = ""
    buttons: tuple[str, ...] = ()


class BannerEvent(Message, frozen=True):
    owner: str | None
    button: str


class TooltipState(Message, frozen=True):
    """Answer to the request ``asked``."""

    at: Pixel
    lines: tuple[str, ...]
    agent: str | None
    asked: int


class TooltipEvent(Message, frozen=True):
    at: Pixel
    ray: Ray
    ask: Annotated[int, msgspec.Meta(ge=0, le=2**53)]


class FanState(Message, frozen=True):
    is_shown: bool


class FanEvent(Message, frozen=True):
    point: Ground | None


class CompareState(Message, frozen=True):
    """How the scene differs from the original; empty while that is hidden."""

    text: str = ""


class CompareEvent(Message, frozen=True):
    kind: Literal["hold", "release"]


class MenuEntry(Message, frozen=True):
    label: str
    key: str
    is_enabled: bool


class MenuState(Message, frozen=True):
    number: int
    at: Pixel
    title: str
    items: tuple[MenuEntry, ...]


class MenuEvent(Message, frozen=True):
    """A right click, or a choice in the menu of that number."""

    kind: Literal["open", "choose"]
    at: Pixel = (0.0, 0.0)
    ray: Ray | None = None
    index: int = -1
    menu: int = 0


class Label(Message, frozen=True):
    text: str
    note: str
    point: Place
    radius: float


class LabelsState(Message, frozen=True):
    labels: tuple[Label, ...]


class LockMark(Message, frozen=True):
    keeps: str
    seconds: str
    label: str
    point: Place
    radius: float


class LocksState(Message, frozen=True):
    locks: tuple[LockMark, ...]


class MeasureState(Message, frozen=True):
    """The tool that measures; ``speed`` in m/s is that of ``agent``."""

    is_active: bool
    start: Ground | None
    speed: float | None
    agent: str


class PlacingState(Message, frozen=True):
    """The mode in which clicks place agents: length, width and height of the ghost."""

    is_active: bool
    size_m: Place
    heading_rad: float
    color: str
    num_kinds: int


class PlacingEvent(Message, frozen=True):
    kind: Literal["point", "place", "kind"]
    point: Ground | None = None
    heading_rad: Annotated[float, msgspec.Meta(ge=-7, le=7)] | None = None
    number: int = 0


class BendingState(Message, frozen=True):
    """The mode in which the road is pulled aside."""

    is_active: bool
    num_kinds: int


class BendingEvent(Message, frozen=True):
    kind: Literal["grab", "pull", "end", "cancel", "kind"]
    point: Ground | None = None
    number: int = 0


class RegionState(Message, frozen=True):
    is_active: bool
    least_m: float
    square: Square | None


class RegionEvent(Message, frozen=True):
    kind: Literal["drawn", "clear"]
    start: Ground | None = None
    end: Ground | None = None


class MapWindowState(Message, frozen=True):
    title: str = ""
    road: str = ""
    square: Square = (0.0, 0.0, 0.0)
    view: str = ""


class MapWindowEvent(Message, frozen=True):
    kind: Literal["open", "cancel"]
    square: Square | None = None


Icon = Literal[
    "undo", "redo", "select", "place", "goal-point", "follow-path", "stop-at-line",
    "bend", "measure", "3d", "top", "fit", "frame", "agents", "scorecard", "compare",
    "live", "scenes", "help",
]  # fmt: skip


class Tool(Message, frozen=True):
    icon: Icon
    hint: str
    is_active: bool
    is_enabled: bool
    is_held: bool
    starts_group: bool


class ToolbarState(Message, frozen=True):
    tools: tuple[Tool, ...]


class ToolbarEvent(Message, frozen=True):
    kind: Literal["press", "release"]
    icon: Icon


class TimelineMark(Message, frozen=True):
    kind: Literal["problem", "notice", "finding"]
    step: int
    text: str


class TimelineState(Message, frozen=True):
    """The track, in steps from the current one on; the marks on it."""

    first_step: int
    last_step: int
    begin_step: int
    end_step: int
    step_s: float
    marks: tuple[TimelineMark, ...]


class PlayheadState(Message, frozen=True):
    step: float
    is_playing: bool
    speed: float
    loops: bool


class TimelineEvent(Message, frozen=True):
    """A button of the timeline, a step to go to, or steps to go on by."""

    kind: Literal[
        "play",
        "current",
        "speed",
        "loop",
        "seek",
        "step",
        "problem",
        "notice",
        "finding",
    ]
    value: int = 0


class TimeHandle(Message, frozen=True):
    """A time that can be dragged: of a goal, a way-point or a lock."""

    kind: str
    step: int
    text: str
    is_chosen: bool


class TimeHandlesState(Message, frozen=True):
    handles: tuple[TimeHandle, ...] = ()


class TimeHandlesEvent(Message, frozen=True):
    kind: Literal["grab", "drag", "drop", "cancel"]
    index: int
    step: int | None = None


class SpeedCurveState(Message, frozen=True):
    """Speeds of the one selected agent in m/s, from ``begin_step`` on; none without it.

    None where it is not there. ``former`` are speeds of the original, if they differ.
    """

    agent: str = ""
    begin_step: int = 0
    speeds: tuple[float | None, ...] = ()
    former: tuple[float | None, ...] = ()
    harsh: tuple[int, ...] = ()
    """Steps with more than a comfortable acceleration."""


class SpeedCurveEvent(Message, frozen=True):
    """The curve is pulled to a speed at a step, let go, or given up."""

    kind: Literal["pull", "release", "cancel"]
    step: int = 0
    speed: float = 0.0


class Choice(Message, frozen=True):
    value: str | int
    text: str


class SceneTile(Message, frozen=True):
    """A scenario that can be opened; ``picture`` names what its picture shows."""

    key: str
    title: str
    lines: tuple[str, ...]
    picture: str
    is_open: bool = False
    is_saved: bool = False
    is_ticked: bool | None = None
    """None: it cannot be ticked."""
    can_save: bool = False
    reject: str = ""
    """What X does; empty: nothing."""


class SceneFacet(Message, frozen=True):
    name: Literal["city", "split", "agents", "future", "sort"]
    label: str
    value: str
    choices: tuple[Choice, ...]


class BulkButton(Message, frozen=True):
    """A button for several scenarios at once."""

    name: str
    text: str
    hint: str
    is_on: bool = True


class StartPageState(Message, frozen=True):
    """A page of the scenarios of one source that pass the filter."""

    is_open: bool
    source: str
    sources: tuple[Choice, ...]
    line: str
    is_wrong: bool
    told: str
    common: tuple[str, ...]
    """Conditions that a button adds to the line."""
    facets: tuple[SceneFacet, ...]
    index: str
    """Label of the button that indexes or cancels that; empty: there is none."""
    is_indexing: bool
    bulk: tuple[BulkButton, ...]
    """Those under the list; empty: there is no bar of them."""
    tiles: tuple[SceneTile, ...]
    first: int
    total: int


class ScenePictureState(Message, frozen=True):
    name: str
    picture: str


class StartPageEvent(Message, frozen=True):
    kind: Literal[
        "close", "source", "line", "common", "facet", "index", "page",
        "draw", "open", "save", "reject", "tick", "bulk",
    ]  # fmt: skip
    value: str = ""
    name: str = ""
    first: int = 0
    keys: tuple[str, ...] = ()


class CardLine(Message, frozen=True):
    text: str
    tone: Tone = ""


class StripCard(Message, frozen=True):
    """A scenario to choose; ``mark`` stands at the right of its name."""

    index: int
    name: str
    mark: str
    is_adopted: bool
    lines: tuple[CardLine, ...]
    hint: str
    can_drop: bool = False
    is_kept: bool = False
    """Whether it is in the library."""
    fork_of: int | None = None
    """Index of the card that it branches off from."""


class StripState(Message, frozen=True):
    """Cards over the lower part of the picture, and how many more were dropped."""

    is_open: bool = False
    takes_focus: bool = False
    title: str = ""
    ranking: str = ""
    rankings: tuple[Choice, ...] = ()
    pick: int = 0
    picks: tuple[Choice, ...] = ()
    cards: tuple[StripCard, ...] = ()
    num_dropped: int = 0


class SamplesState(StripState, frozen=True):
    """Samples of the last run."""


class BranchesState(StripState, frozen=True):
    """Branches of the history."""


class SamplePicturesState(Message, frozen=True):
    """Pictures of cards by their index."""

    pictures: dict[int, str]


class BranchPicturesState(SamplePicturesState, frozen=True):
    """The same of branches."""


class StripEvent(Message, frozen=True):
    kind: Literal[
        "close",
        "leave",
        "rank",
        "pick",
        "point",
        "adopt",
        "keep",
        "pair",
        "drop",
        "restore",
        "carry",
        "rename",
    ]
    value: str | int = ""
    text: str = ""


class PairAgent(Message, frozen=True):
    """A box and its trajectory: x, y, heading of each step, in 0.1 m and 0.01 rad."""

    length: float
    width: float
    color: int
    path: tuple[int, ...]


class PairSide(Message, frozen=True):
    """A scenario over its ground, as the path of an SVG."""

    index: int
    is_adopted: bool
    ground: str
    agents: tuple[PairAgent, ...]


class ScenePairState(Message, frozen=True):
    """Two scenarios side by side, which are such a ``noun``; half the width in metres."""

    is_open: bool = False
    noun: str = ""
    half_width: float = 0.0
    offered: tuple[Choice, ...] = ()
    sides: tuple[PairSide, ...] = ()


class ScenePairEvent(Message, frozen=True):
    kind: Literal["close", "use", "choose"]
    value: int = -1
    side: int = 0


class ScoreFinding(Message, frozen=True):
    id: str
    agent: str
    text: str
    time: str
    is_chosen: bool


class ScoreLine(Message, frozen=True):
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


class ScorecardState(Message, frozen=True):
    is_open: bool = False
    draws: bool = False
    rows: tuple[ScoreLine, ...] = ()
    is_searching: bool = False
    cures: tuple[str, ...] = ()


class ScorecardEvent(Message, frozen=True):
    """A part of the scorecard; ``covered`` is its share of the picture's width."""

    kind: Literal["close", "draw", "row", "finding", "cure"]
    covered: float
    value: bool = False
    name: str = ""
    id: str = ""


class Chart(Message, frozen=True):
    """One line for each agent; None where it is not there."""

    title: str
    lines: tuple[tuple[float | None, ...], ...]


class ChartsState(Message, frozen=True):
    """Charts of the selected agents, over time in seconds."""

    ids: tuple[str, ...]
    time: tuple[float, ...]
    charts: tuple[Chart, ...]


class ProblemRow(Message, frozen=True):
    id: str
    icon: str
    severity: str
    text: str
    hint: str
    time: str


ProblemGroupName = Literal["new", "notices", "ignored", "recorded"]


class ProblemGroup(Message, frozen=True):
    name: ProblemGroupName
    title: str
    rows: tuple[ProblemRow, ...]
    more: int


class ActiveProblem(Message, frozen=True):
    """The chosen problem: cures, and the label of the button that ignores it."""

    id: str
    message: str
    cures: tuple[str, ...]
    ignore: str
    note: str


class StatusState(Message, frozen=True):
    text: str
    tone: Tone
    unsaved: str
    groups: tuple[ProblemGroup, ...]
    active: ActiveProblem | None
    num_closed: int


class StatusEvent(Message, frozen=True):
    """A part of the chip; ``free`` is the share of the picture left of its list."""

    kind: Literal["list", "choose", "cure", "ignore", "download"]
    value: str = ""
    free: float = 1.0
    is_open: bool = False


class RunVerb(Message, frozen=True):
    """A button that starts a run: what it does to whom."""

    label: str
    target: str
    is_enabled: bool


class RunBarState(Message, frozen=True):
    """Regenerate and Resample; ``text`` tells how a run goes, or how the last one went."""

    verbs: tuple[RunVerb, RunVerb]
    scope: str
    scopes: tuple[str, ...]
    samples: int
    seed: int
    limits: dict[str, tuple[int, int]]
    text: str
    tone: Tone
    fraction: float | None
    action: str


class RunBarEvent(Message, frozen=True):
    kind: Literal["regenerate", "resample", "cancel", "use", "scope", "samples", "seed"]
    value: str | int = ""


AgentRow = tuple[str, int, float | None, float | None, int, bool]
"""Id, place of the kind, m/s, metres to the focal agent, marks, whether it moves."""


class AgentsState(Message, frozen=True):
    is_open: bool = False
    number: int = 0
    focal: str = ""
    ego: str = ""
    kinds: tuple[tuple[str, str], ...] = ()
    rows: tuple[AgentRow, ...] = ()


class AgentSelectionState(Message, frozen=True):
    """Selected rows of the list of that number."""

    number: int
    rows: tuple[int, ...]


class AgentsEvent(Message, frozen=True):
    kind: Literal["open", "close", "select", "lock", "point"]
    number: int = 0
    rows: tuple[int, ...] = ()
    row: int | None = None


class Note(Message, frozen=True):
    tone: str
    text: str


class GuidanceTool(Message, frozen=True):
    kind: str
    title: str
    hint: str
    is_active: bool
    is_enabled: bool


class GuidanceInput(Message, frozen=True):
    name: str
    label: str
    value: str | float | None
    unit: str = ""
    least: float | None = None
    most: float | None = None
    step: float | None = None
    options: tuple[str, ...] = ()
    empty: str = ""
    notes: dict[str, tuple[str, str]] = {}
    """Few words, and a sentence, on each option."""


class GuidanceRow(Message, frozen=True):
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
    action: str = ""
    """What a button of the row does; empty: there is none."""


class EncounterLine(Message, frozen=True):
    kind: str
    agent: str
    text: str
    is_made: bool
    is_pointed: bool


class EncounterList(Message, frozen=True):
    label: str = ""
    is_enabled: bool = False
    is_open: bool = False
    about: str = ""
    items: tuple[EncounterLine, ...] = ()


class GuidancePanelState(Message, frozen=True):
    """The list of guidance terms; ``answered`` is the newest event that it answers."""

    version: int
    answered: int
    about: str
    weights: tuple[float, ...]
    tools: tuple[GuidanceTool, ...]
    encounters: EncounterList
    rows: tuple[GuidanceRow, ...]
    report: tuple[Note, ...]
    figures: tuple[tuple[str, str, str, str], ...]
    action: str | None


class GuidancePanelEvent(Message, frozen=True):
    kind: Literal[
        "tool", "take", "look", "leave", "point", "make",
        "choose", "switch", "remove", "weight", "input", "act",
    ]  # fmt: skip
    version: int | None
    count: int
    tool: str = ""
    number: int | None = None
    index: int = -1
    is_on: bool = False
    stop: int = 0
    is_end: bool = False
    name: str = ""
    value: str | float | None = None


class GuidanceBadge(Message, frozen=True):
    index: int
    kind: str
    is_on: bool
    is_faint: bool
    is_chosen: bool
    lines: tuple[str, ...]
    is_bad: bool


class GuidanceMark(Message, frozen=True):
    """A term on the road, or the badges of an agent at ``at``."""

    shape: Literal["flag", "path", "line", "arrow", "arc", "badge", "dot"]
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
    node: int | None = None
    """Number of a way-point, or of the one before a point that is offered."""
    label: str = ""
    achieved: Ground | None = None
    """Where the agent is when it should be at the point."""


class GuidanceMarksState(Message, frozen=True):
    """Marks on the road; middle and radius of agents under arcs."""

    marks: tuple[GuidanceMark, ...]
    agents: tuple[tuple[float, float, float, float], ...]
    refusal: str


class GuidanceMarksEvent(Message, frozen=True):
    kind: Literal["point", "grab", "drag", "drop", "cancel"]
    index: int | None
    point: Ground | None = None
    node: int | None = None
    is_offer: bool = False
    is_free: bool = False
    """Whether points do not snap to lanes."""


class GuidingGhost(Message, frozen=True):
    text: str = ""
    is_bad: bool = False
    end: Place | None = None
    points: tuple[Ground, ...] | None = None


class GuidingState(Message, frozen=True):
    is_active: bool = False
    kind: str = ""
    gesture: Literal["", "draw", "pick", "click"] = ""
    start: Place = (0.0, 0.0, 0.0)
    ghost: GuidingGhost = GuidingGhost()


class GuidingEvent(Message, frozen=True):
    kind: Literal["point", "click", "drawn"]
    tool: str
    at: Pixel = (0.0, 0.0)
    ray: Ray | None = None
    points: tuple[Ground, ...] = ()
    is_clicked: bool = False
    """Whether the points were clicked one by one."""


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
    "bending": BendingState,
    "region": RegionState,
    "mapWindow": MapWindowState,
    "toolbar": ToolbarState,
    "timeline": TimelineState,
    "playhead": PlayheadState,
    "speedCurve": SpeedCurveState,
    "timeHandles": TimeHandlesState,
    "startPage": StartPageState,
    "scene-picture": ScenePictureState,
    "samples": SamplesState,
    "sample-pictures": SamplePicturesState,
    "branches": BranchesState,
    "branch-pictures": BranchPicturesState,
    "pair": ScenePairState,
    "scorecard": ScorecardState,
    "charts": ChartsState,
    "status": StatusState,
    "run": RunBarState,
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
    "bending": BendingEvent,
    "region": RegionEvent,
    "mapWindow": MapWindowEvent,
    "toolbar": ToolbarEvent,
    "timeline": TimelineEvent,
    "speedCurve": SpeedCurveEvent,
    "timeHandles": TimeHandlesEvent,
    "startPage": StartPageEvent,
    "samples": StripEvent,
    "branches": StripEvent,
    "pair": ScenePairEvent,
    "scorecard": ScorecardEvent,
    "status": StatusEvent,
    "run": RunBarEvent,
    "agents": AgentsEvent,
    "guidance_panel": GuidancePanelEvent,
    "guidance_marks": GuidanceMarksEvent,
    "guiding": GuidingEvent,
}
"""What each element tells."""
