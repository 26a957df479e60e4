"""Legend of the picture's colours and lines."""

from collections.abc import Iterator
from typing import Final, Literal

import numpy as np

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.locks import Kept
from pd_editor.scene.palette import Palette, Rgb
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.signals import SignalState
from pd_editor.scene.top_view import FOCAL
from pd_editor.viewer.overlay.messages import LegendEntry, LegendState
from pd_editor.viewer.overlay.overlay import Overlay

_LOCKED: Final[dict[Kept, str]] = {
    "trajectory": "Locked trajectory",
    "beginning": "Locked beginning",
    "state": "Locked state",
}


class Legend:
    """A folding list over the picture, in the colours of the theme in force."""

    def __init__(self, overlay: Overlay) -> None:
        """Show nothing yet."""
        self._overlay = overlay

    def show(
        self,
        scenario: Scenario,
        palette: Palette,
        *,
        has_original_road: bool,
        has_original_agents: bool,
        has_plans: bool,
    ) -> None:
        """List what is in the picture, if need be with what is drawn of the original."""
        agents = scenario.agents
        entries: list[LegendEntry] = []
        if scenario.focal_id in agents.row_of:
            entries.append(_entry(FOCAL, "fill", _css(palette.focal)))
        if EGO_ID in agents.row_of:
            entries.append(_entry("Ego", "fill", _css(palette.ego)))
        entries += _kinds(scenario, palette)
        vehicle = _css(palette.kinds[AgentKind.VEHICLE])
        entries += [
            _entry("Past", "line", _css(palette.past)),
            _entry("Trajectory ahead", "line", vehicle),
        ]
        is_there = agents.is_valid[:, scenario.current_step]
        if (~is_there).any():
            entries.append(_entry("Not there at t = 0", "dots", vehicle))
        if has_plans:
            entries.append(_entry("Plan of a policy", "line", _css(palette.plan)))
        ghost = _css(palette.ghost)
        if has_original_road:
            entries.append(_entry("Original road", "line", ghost))
        if has_original_agents:
            entries.append(_entry("Original trajectory", "dots", ghost))
        kept = {lock.keeps for lock in scenario.locks.values()}
        entries += [
            _entry(text, "lock", "", keeps)
            for keeps, text in _LOCKED.items()
            if keeps in kept
        ]
        shown = {
            int(code) for one in scenario.signals for code in np.unique(one.states)
        }
        entries += [
            _entry(
                f"Signal: {state.name.lower()}", "line", _css(palette.signals[state])
            )
            for state in map(SignalState, sorted(shown))
        ]
        entries += [
            _entry("Selected", "ring", _css(palette.selection)),
            _entry("Problem", "ring", _css(palette.warning)),
        ]
        self._overlay.show(LegendState(entries=tuple(entries)))


def _kinds(scenario: Scenario, palette: Palette) -> Iterator[LegendEntry]:
    """The kinds that are there; kinds with one name have one colour."""
    present = set(scenario.agents.kinds)
    names = {kind.label: kind for kind in AgentKind if kind in present}
    for name, kind in names.items():
        glyph = "shaded" if kind is AgentKind.BUS else "fill"
        yield _entry(name, glyph, _css(palette.kinds[kind]))


def _css(color: Rgb) -> str:
    return f"rgb{color}"


def _entry(
    text: str,
    glyph: Literal["fill", "shaded", "line", "dots", "ring", "lock"],
    color: str,
    keeps: str = "",
) -> LegendEntry:
    return LegendEntry(text=text, glyph=glyph, color=color, keeps=keeps)
