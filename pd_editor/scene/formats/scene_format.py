"""What a format of scenes is."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.formats.packed_file import head_of, unpacked_name
from pd_editor.scene.scenario import Scenario

IDS_NAME: Final = "ids.csv"


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenScene:
    """Files of a scene in some format."""

    files: Mapping[str, bytes]
    """Contents by file name, without folders."""
    losses: tuple[str, ...] = ()
    """One sentence for each part of the scene that the format cannot say."""
    renamed: Mapping[str, str] = field(default_factory=dict)
    """Ids that agents have when the files are opened again, where these are others."""


def parts_of(scenario: Scenario) -> dict[str, tuple[str, bool]]:
    """What a format may lack: its name in sentences, and whether the scene has it."""
    road_map, agents = scenario.road_map, scenario.agents
    lanes, known = road_map.lanes, road_map.lane_of
    links = [n for one in lanes for n in (*one.successors, *one.predecessors)]
    beside = [n for one in lanes for n in (one.left_neighbor, one.right_neighbor)]
    rises = any(line[:, 2].any() for line in road_map.polylines)
    static = set(agents.kinds) - ROAD_USER_KINDS - {AgentKind.UNKNOWN}
    parts = (scenario, road_map, *lanes, *road_map.crosswalks, *road_map.drivable_areas)
    more = any(one.source_fields for one in parts)
    areas, makes_up = road_map.drivable_areas, agents.has_made_up_past.any()
    return {
        "signals": ("traffic signals and their states", bool(scenario.signals)),
        "signal names": ("names of signals", bool(scenario.signals)),
        "shared signals": (
            "which lanes share a signal",
            any(len(one.lane_ids) > 1 for one in scenario.signals),
        ),
        "links": ("which lanes follow which", bool(links)),
        "outside": ("links to lanes outside the map", bool(set(links) - set(known))),
        "neighbors": ("neighbours of lanes", any(beside)),
        "oncoming": ("neighbours that lead the other way", bool(road_map.oncoming)),
        "fields": ("further fields of its source", more),
        "lane kinds": ("kinds of lanes", {n.kind for n in lanes} != {"VEHICLE"}),
        "junctions": ("what is an intersection", any(n.is_intersection for n in lanes)),
        "marks": ("lane markings", bool(lanes)),
        "heights": ("elevations", rises),
        "crosswalks": ("crosswalks", bool(road_map.crosswalks)),
        "paved": ("drivable areas beside the lanes", bool(areas)),
        "city": ("the city's name", bool(scenario.city)),
        "now": ("the current step", len(agents) > 0),
        "focal": ("which agent is the focal one", bool(scenario.focal_id)),
        "categories": ("benchmark categories", len(agents) > 0),
        "static kinds": ("kinds of static objects", bool(static)),
        "assumed": ("which sizes are assumed", not agents.has_known_size.all()),
        "made up": ("made-up pasts", bool(makes_up)),
        "activity": ("who is parked", bool(agents.activity.any())),
    }


def losses_of(
    scenario: Scenario, *losses: str, keeps: Collection[str]
) -> tuple[str, ...]:
    """What a format cannot say of a scene: ``losses``, and parts that it does not keep.

    What is new among the parts is so told until a format keeps it.
    """
    parts = parts_of(scenario)
    assert parts.keys() >= set(keeps), "a part has no other name"
    lost = (
        told for name, (told, is_in) in parts.items() if is_in and name not in keeps
    )
    told = ", ".join(lost)
    return (*losses, f"{told[:1].upper()}{told[1:]}.") if told else losses


@dataclass(frozen=True, kw_only=True)
class SceneFormat:
    """A format of files that hold scenes; it reads them, writes them, or both.

    A format of one's own is a module-level value that the entry point group
    ``pd_editor.formats`` names.
    """

    name: str
    """For the shell, such as ``commonroad``."""
    title: str
    """For people, such as "CommonRoad"."""
    endings: tuple[str, ...] = ()
    """Endings of its files in lower case; empty if its scenes are folders."""
    recognises: Callable[[Path], bool] = lambda _path: False
    """Whether a path, also of a folder, holds this format, by its name and first bytes."""
    read: Callable[[Path], Scenario] | None = None
    """Reads a path; raises an ``InputError`` of one sentence."""
    write: Callable[[Scenario], WrittenScene] | None = None
    """Makes the files of a scene; raises an ``ExportError`` of one sentence."""


def has_root(root: str, *endings: str) -> Callable[[Path], bool]:
    """Tells whether a path has one of these endings, or is XML that begins with an element."""
    begin = re.compile(rf"<([\w.-]+:)?{root}[\s/>]".encode())

    def recognises(path: Path) -> bool:
        name = unpacked_name(path.name).lower()
        return name.endswith(endings) or (
            name.endswith(".xml") and begin.search(head_of(path)) is not None
        )

    return recognises
