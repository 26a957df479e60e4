"""``pd-editor find``: look up scenes by what happens in them."""

import json as json_text
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.analysis.manoeuvres.events import EVENT_KINDS
from pd_editor.base.plain_text import number_of, one_line
from pd_editor.cli.options import Switch, shown
from pd_editor.experiments.scene_index.index_file import SceneIndex
from pd_editor.experiments.scene_index.query import (
    FoundScene,
    find_scenes,
    texts_missed,
)
from pd_editor.experiments.work_engine.work_engine import WorkFailure


@dataclass(frozen=True, kw_only=True)
class Found:
    """Scenes that a query describes."""

    scenes: tuple[FoundScene, ...]
    is_json: bool = False
    failures: Mapping[str, WorkFailure] = field(default_factory=dict)
    noun: str = "scene"
    hints: tuple[str, ...] = ()
    """Why none was found."""

    def __str__(self) -> str:
        """A line per event, or per scene without one; or JSON."""
        if self.is_json:
            return json_text.dumps([asdict(one) for one in self.scenes], indent=1)
        lines = [line for one in self.scenes for line in _lines(one)]
        told = f"{number_of(len(self.scenes), self.noun)}."
        return "\n".join([*lines, " ".join([told, *self.hints])])


def found_in(
    index: SceneIndex,
    query: str,
    *,
    is_json: bool,
    noun: str = "scene",
    failures: Mapping[str, WorkFailure] | None = None,
) -> Found:
    """What a query finds in an index, and of which texts there is none."""
    scenes = find_scenes(index, query)
    return Found(
        scenes=scenes,
        is_json=is_json,
        failures=failures or {},
        noun=noun,
        hints=() if scenes else texts_missed(index, query),
    )


def find(
    index: Annotated[str | Path, tyro.conf.Positional, shown("INDEX")],
    query: Annotated[str, tyro.conf.Positional, shown("QUERY")],
    /,
    *,
    json: Switch = False,
) -> Found:
    """Find scenes by what happens in them, such as 'cut-in by bus and density > 20'.

    Words are joined by and, or, not and brackets. Events may be followed by kinds of
    agents and their quantity: 'crossing with pedestrian pet < 1.5'. Times are seconds
    after the current step. pd-editor edit opens a scene.

    Args:
        index: File of pd-editor index, or the folder that it is in.
        query: Events (lane-change-left, left-turn, cut-in, yielding, near-miss ...), quantities (pet, ttc, headway, gap, braking, turn, lag) and facts (agents, density, speed, city, junction, format, edited ...).
        json: Print JSON, with all facts.
    """
    return found_in(SceneIndex.read(index), query, is_json=json)


def _lines(scene: FoundScene) -> list[str]:
    lines = []
    for one in scene.events:
        who = f"{one.agent_id} > {one.other_id}" if one.other_id else one.agent_id
        value = "" if one.value is None else f"  {EVENT_KINDS[one.kind]} {one.value:g}"
        time = f"{one.begin_s:6.1f} to {one.end_s:.1f} s"
        lines.append(f"{scene.path}  {one.kind:<18}{who:<20}{time}{value}")
    return [one_line(line) for line in lines or [scene.path]]
