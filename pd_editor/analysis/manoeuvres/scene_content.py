"""All that an index knows of a scene: its events and facts."""

from dataclasses import dataclass
from itertools import chain

from pd_editor.analysis.manoeuvres.agent_events import (
    hard_brakings,
    lane_changes,
    on_crosswalks,
    stops,
    turns_and_crossings,
)
from pd_editor.analysis.manoeuvres.lane_tracks import lane_tracks
from pd_editor.analysis.manoeuvres.motion import Motion
from pd_editor.analysis.manoeuvres.pair_events import (
    Pairs,
    cut_ins,
    followings,
    meetings,
    near_misses,
    passings,
)
from pd_editor.analysis.manoeuvres.scene_event import SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import scene_facts
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class SceneContent:
    """What happens in a scene."""

    events: tuple[SceneEvent, ...]
    """In the order of their times."""
    facts: dict[str, float | str]
    """Values by the names of ``FACTS``."""


def scene_content(scenario: Scenario) -> SceneContent:
    """Events and facts of a scenario's road users.

    They are read from the tracks and, where there is one, the map; the tracks may have
    gaps, and the lanes may be cut into any pieces.
    """
    motion = Motion.of(scenario)
    lanes = lane_tracks(scenario.road_map, motion)
    changes, met = list(lane_changes(motion, lanes)), list(meetings(motion, lanes))
    pairs = Pairs.of(motion, lanes)
    found = chain(
        changes,
        turns_and_crossings(motion, lanes),
        stops(motion, lanes),
        hard_brakings(motion),
        on_crosswalks(motion, scenario),
        followings(pairs),
        cut_ins(pairs, changes),
        met,
        passings(pairs),
        near_misses(motion, met),
    )
    found = found if len(motion) else ()
    order = sorted(found, key=lambda one: (one.begin_s, one.kind, one.agent_id))
    return SceneContent(
        events=tuple(order),
        facts=scene_facts(scenario, motion, lanes),
    )
