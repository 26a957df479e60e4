"""Legend of the picture's colours and lines."""

from typing import Final

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.meshes.colors import Rgb
from pd_editor.viewer.meshes.palette import Palette
from pd_editor.viewer.overlay.overlay import Overlay

_KIND_NAME: Final[dict[AgentKind, str]] = {
    AgentKind.VEHICLE: "Vehicle",
    AgentKind.BUS: "Bus",
    AgentKind.MOTORCYCLIST: "Motorcyclist",
    AgentKind.CYCLIST: "Cyclist",
    AgentKind.PEDESTRIAN: "Pedestrian",
    AgentKind.CONSTRUCTION: "Construction",
}


class Legend:
    """A folding list over the picture, in the colours of the theme in force."""

    def __init__(self, overlay: Overlay) -> None:
        """Show nothing yet."""
        self._overlay = overlay

    def show(self, scenario: Scenario, palette: Palette, *, has_original: bool) -> None:
        """List what is in the picture, if need be with a ghost of the original."""
        agents = scenario.agents
        entries: list[tuple[str, str, Rgb]] = []
        if scenario.focal_id in agents.row_of:
            entries.append(("Focal agent", "fill", palette.focal))
        if EGO_ID in agents.row_of:
            entries.append(("Ego", "fill", palette.ego))
        kinds = set(agents.kinds)
        entries += [
            (name, "fill", palette.kinds[kind])
            for kind, name in _KIND_NAME.items()
            if kind in kinds
        ]
        vehicle = palette.kinds[AgentKind.VEHICLE]
        entries += [
            ("Past", "line", palette.past),
            ("Trajectory ahead", "line", vehicle),
        ]
        is_there = agents.is_valid[:, scenario.current_step]
        if (~is_there).any():
            entries.append(("Not there at t = 0", "dots", vehicle))
        if has_original:
            entries.append(("Original", "dots", palette.ghost))
        entries += [
            ("Selected", "ring", palette.selection),
            ("Problem", "ring", palette.warning),
        ]
        self._overlay.show(
            "legend",
            {
                "entries": [
                    {"text": text, "glyph": glyph, "color": f"rgb{color}"}
                    for text, glyph, color in entries
                ]
            },
        )
