"""A player of scenes: one page of HTML that any browser opens, without a network."""

import base64
import html
import json
import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import DEFAULT_HEIGHT_M
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.palette import DARK, LIGHT, Rgb, agent_color
from pd_editor.scene.road_layers import DASH_M, GAP_M, boundaries, road_layers
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState

SCALE: Final = 100
"""Positions, sizes and speeds are whole centimetres."""
TURN_SCALE: Final = 1000
"""Headings are whole milliradians."""
_PAGE: Final = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>{style}</style>
<body class="pd-player"{pair}>
<noscript>This page needs JavaScript to play the scene.</noscript>
<script type="application/json" id="scenes">{scenes}</script>
<script>{script}</script>
"""


def player_page(scenarios: Sequence[Scenario], *, is_pair: bool = False) -> bytes:
    """The page of one scene or of several, of which the first is shown.

    Two as a pair are side by side, on one clock and with one view.
    """
    scenes = [{"name": one.scenario_id, "data": _packed(one)} for one in scenarios]
    script, style = _built()
    names = scenarios[0].scenario_id if len(scenarios) == 1 else f"{len(scenes)} scenes"
    page = _PAGE.format(
        title=html.escape(names),
        style=style,
        pair=" data-pair" if is_pair else "",
        # Within a script a text ends at the first tag that looks like its end.
        scenes=json.dumps(scenes).replace("<", "\\u003c"),
        script=script,
    )
    return page.encode()


class Player:
    """Scenes that a notebook plays in its output."""

    def __init__(self, *scenarios: Scenario) -> None:
        """Of one scene or several."""
        self.page = player_page(scenarios)

    def _repr_html_(self) -> str:
        page = html.escape(self.page.decode())
        look = "width: 100%; height: 560px; border: 0"
        return (
            f'<iframe sandbox="allow-scripts" style="{look}" srcdoc="{page}"></iframe>'
        )


@cache
def _built() -> tuple[str, str]:
    folder = files("pd_editor.scene.formats")
    script, style = (
        folder.joinpath(f"player.{kind}").read_text("utf-8") for kind in ("js", "css")
    )
    return script, style


def _packed(scenario: Scenario) -> str:
    text = json.dumps(scene_data(scenario), separators=(",", ":"))
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def scene_data(scenario: Scenario) -> dict[str, Any]:
    """What the page shows of a scene; ``client/src/player/scene.ts`` has its types.

    Lines are x and y in turn, numbers of lines and tracks differences from the one before.
    """
    applied, origin = scenario.applied_warp, scenario.provenance
    agents = _agents(scenario, scenario.agents)
    original = None
    if applied is not None:
        before = _agents(scenario, applied.original_agents)
        roads = applied.original_road_map, scenario.road_map
        lines, now = ([one for *_, one in boundaries(road)] for road in roads)
        same = set(map(_extent, now))
        original = {
            "lines": _lines(one for one in lines if _extent(one) not in same),
            "agents": [one for one in before if one not in agents],
        }
    focus = [
        one for one in (scenario.focal_id, EGO_ID) if one in scenario.agents.row_of
    ]
    axis = scenario.time_axis
    return {
        "name": scenario.scenario_id,
        "city": scenario.city,
        "attribution": origin.attribution or "",
        "notes": origin.notes,
        "stepS": axis.step_s,
        "current": axis.current_step,
        "first": scenario.first_step,
        "last": scenario.last_step,
        "colors": {
            name: _colors(getattr(LIGHT, name), getattr(DARK, name))
            for name in ("ground", "glass", "ghost", "selection", "selection_rim")
        },
        "road": list(_road(scenario.road_map)),
        "signals": list(_signals(scenario)),
        "agents": agents,
        "focus": focus[0] if focus else "",
        "original": original,
    }


def _road(road_map: RoadMap) -> Iterator[dict[str, Any]]:
    """Areas and lines from the ground up, each with its colour and look."""
    for one in road_layers(road_map):
        colors = _colors(getattr(LIGHT, one.color_name), getattr(DARK, one.color_name))
        look: dict[str, Any] = {"isArrow": True} if one.is_arrow else {}
        if one.width_m is not None:
            look["width"] = one.width_m
        if one.is_dashed:
            look["dash"] = [DASH_M, GAP_M, DASH_M + GAP_M / 2]
        yield {"colors": colors, "lines": _lines(one.lines), **look}


def _signals(scenario: Scenario) -> Iterator[dict[str, Any]]:
    """Stop lines, with the steps from which a colour holds."""
    numbers = [n for n, one in enumerate(scenario.signals) for _ in one.lane_ids]
    for number, line in zip(numbers, scenario.stop_lines_m(), strict=True):
        states = scenario.signals[number].states
        begins = np.flatnonzero(np.diff(states, prepend=-1))
        phases = [(int(n), SignalState(states[n])) for n in begins]
        yield {
            "line": _lines([line])[0],
            "phases": [
                [n, _colors(LIGHT.signals[state], DARK.signals[state])]
                for n, state in phases
            ],
        }


def _agents(scenario: Scenario, agents: AgentTracks) -> list[dict[str, Any]]:
    found = []
    for row, name in enumerate(agents.ids):
        kind = agents.kinds[row]
        size = (*agents.size_m[row], DEFAULT_HEIGHT_M[kind])
        there = agents.is_valid[row]
        edges = np.flatnonzero(np.diff(there, prepend=False, append=False)).tolist()
        now = scenario.agents.row_of.get(name)
        colors = (
            (LIGHT.ghost, DARK.ghost)
            if now is None
            else [agent_color(scenario, one, now) for one in (LIGHT, DARK)]
        )
        found.append(
            {
                "id": name,
                "kind": kind.in_words,
                "colors": _colors(*colors),
                "size": _whole(np.array(size), SCALE),
                "runs": [
                    _run(agents, row, slice(*ends))
                    for ends in zip(edges[::2], edges[1::2], strict=True)
                ],
            }
        )
    return found


def _run(agents: AgentTracks, row: int, steps: slice) -> list[Any]:
    """A part of a track without gaps: its first step, then x, y, heading and speed."""
    place = agents.position_m[row, steps]
    heading = np.unwrap(agents.heading_rad[row, steps])
    speed = np.linalg.norm(agents.velocity_mps[row, steps], axis=-1)
    return [
        steps.start,
        _changes(place[:, 0], SCALE),
        _changes(place[:, 1], SCALE),
        _changes(heading, TURN_SCALE),
        _changes(speed, SCALE),
    ]


def _extent(line: Float[np.ndarray, "_ D"]) -> tuple[float, ...]:
    """Ends and length, by which a line that a warp did not move is found again."""
    return tuple(
        np.round([*line[0, :2], *line[-1, :2], arc_length(line[:, :2])[-1]], 1)
    )


def _lines(lines: Iterable[Float[np.ndarray, "_ D"]]) -> list[list[int]]:
    return [
        _whole(np.diff(np.rint(one[:, :2] * SCALE), axis=0, prepend=0).ravel(), 1)
        for one in lines
    ]


def _changes(values: Float[np.ndarray, "N"], scale: int) -> list[int]:
    return _whole(np.diff(np.rint(values * scale), prepend=0), 1)


def _whole(values: Float[np.ndarray, "N"], scale: int) -> list[int]:
    return np.rint(values * scale).astype(int).tolist()


def _colors(light: Rgb, dark: Rgb) -> list[str]:
    return ["#{:02x}{:02x}{:02x}".format(*color) for color in (light, dark)]


def _write(scenario: Scenario) -> WrittenScene:
    return WrittenScene(files={f"{scenario.scenario_id}.html": player_page([scenario])})


PLAYER: Final = SceneFormat(name="player", title="Player (HTML)", write=_write)
