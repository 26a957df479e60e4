"""Draws the road, and its stop lines in the colours of their signals."""

import functools
from typing import Final

import numpy as np
import viser

from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.palette import Palette, Rgb
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import SignalState, states_at
from pd_editor.viewer.meshes.colors import shown_exactly
from pd_editor.viewer.meshes.flat_mesh import (
    FlatMesh,
    MeshNode,
    Primitive,
    glb_of,
    ribbons,
)
from pd_editor.viewer.meshes.road_mesh import LAYERS, Layer, RoadPart, road_parts

GROUND_SIZE_M: Final = 6000.0


class MapView:
    """Nodes of one browser for the road: one per layer, so that each can be hidden."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet but the ground."""
        self._client = client
        self._palette = palette
        self._parts: tuple[RoadPart, ...] = ()
        self._map: RoadMap | None = None
        self._warp: RoadWarp | None = None
        self._nodes: dict[Layer, MeshNode] = {
            layer: MeshNode(client, f"/map/{layer}") for layer in LAYERS
        }
        self._visible: dict[Layer, bool] = {
            layer: layer != "centerlines" for layer in LAYERS
        }
        self._ghost: viser.GlbHandle | None = None
        self._ghost_drawn: tuple[RoadMap, RigidMotion, float, Palette] | None = None
        self._wants_ghost = True
        self._is_compared = False
        self._ground = MeshNode(client, "/ground")
        self._ground.draw(self._ground_meshes())

    @property
    def road_nodes(self) -> tuple[str, ...]:
        """Names of the nodes that another road is sent into."""
        return tuple(
            node.name
            for layer, node in self._nodes.items()
            if node.is_sent and self._visible[layer]
        )

    def show(self, scenario: Scenario) -> None:
        """Show the road of a scenario; unchanged parts are not sent."""
        warp = None if scenario.applied_warp is None else scenario.applied_warp.warp
        is_new_map = scenario.original_road_map is not self._map
        if not is_new_map and warp == self._warp:
            return
        if is_new_map:
            self._map = scenario.original_road_map
            self._parts = road_parts(self._map)
        self._warp = warp
        self._send(LAYERS)
        self._make_ghost()
        self._update_ghost_visibility()

    def set_palette(self, palette: Palette) -> None:
        """Redraw in another theme."""
        self._palette = palette
        self._ground.draw(self._ground_meshes())
        self._send(LAYERS)
        self._make_ghost()
        self._update_ghost_visibility()

    def set_layer_visible(self, layer: Layer, is_visible: bool) -> None:
        """Show or hide a layer."""
        self._visible[layer] = is_visible
        if is_visible:
            self._send((layer,))
        self._nodes[layer].set_visible(is_visible)

    @property
    def shows_original(self) -> bool:
        """Whether the original road is outlined."""
        is_wanted = self._wants_ghost or self._is_compared
        return is_wanted and self._warp is not None

    def set_ghost_wanted(self, is_wanted: bool) -> None:
        """Whether the original road is outlined while it is warped."""
        self._wants_ghost = is_wanted
        self._update_ghost_visibility()

    def set_compared(self, is_compared: bool) -> None:
        """Outline the original road whether or not that is switched off."""
        self._is_compared = is_compared
        self._update_ghost_visibility()

    def _send(self, layers: tuple[Layer, ...]) -> None:
        # From the top down: the page draws opaque meshes in the order in which they
        # came, and what is covered already costs it nothing.
        for layer in layers[::-1]:
            if not self._visible[layer]:
                continue
            parts = [part for part in self._parts if part.layer == layer]
            self._nodes[layer].draw([self._primitive(part) for part in parts[::-1]])

    def _primitive(self, part: RoadPart) -> Primitive:
        points = part.mesh.points_m
        return Primitive(
            points_m=points if self._warp is None else self._warp.apply(points),
            faces=part.mesh.faces,
            height_m=part.height_m,
            color=_material_color(getattr(self._palette, part.color_name)),
        )

    def _make_ghost(self) -> None:
        """Outline the original lanes where the warp has moved them."""
        if self._map is None or self._warp is None:
            return
        reach = min((term.border_m for term in self._warp.terms), default=0.0)
        wanted = (self._map, self._warp.anchor, reach, self._palette)
        if wanted == self._ghost_drawn:
            return
        self._ghost_drawn = wanted
        lines = _lane_sides(self._map)
        ahead = self._warp.distance_ahead(lines.points_m)[lines.faces]
        outline = Primitive(
            points_m=lines.points_m,
            faces=lines.faces[ahead.min(axis=1) > reach],
            height_m=0.055,
            color=_material_color(self._palette.ghost),
            opacity=0.55,
        )
        self._ghost = self._client.scene.add_glb(
            "/map_ghost",
            glb_of([outline]),
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _update_ghost_visibility(self) -> None:
        if self._ghost is not None:
            self._ghost.visible = self.shows_original

    def _ground_meshes(self) -> list[Primitive]:
        half = GROUND_SIZE_M / 2
        square = Primitive(
            points_m=half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]),
            faces=np.array([[0, 1, 2], [0, 2, 3]]),
            # Low enough to stay under the road even where a browser's depth buffer is
            # coarse.
            height_m=-0.3,
            color=_material_color(self._palette.ground),
        )
        return [square, *_shader_keepers()]


def _shader_keepers() -> list[Primitive]:
    """Triangles without area, one per kind of material that nodes send again and again.

    The page compiles a kind's shader when its first mesh is drawn and drops it with the
    last: without these, every change of a node's data would compile it again, which
    takes longer than all the rest. Their extent keeps them in every picture. Two of
    their corners are one: a triangle that is only collinear leaves specks when drawn.
    """
    flat = {
        "points_m": GROUND_SIZE_M / 2 * np.array([[-1.0, 0], [0, 0], [1, 0]]),
        "faces": np.array([[0, 2, 2]]),
        "height_m": 0.0,
        "color": (0.0, 0.0, 0.0),
    }
    return [
        Primitive(**flat, opacity=0.5),
        Primitive(**flat, vertex_opacity=np.zeros(3)),
    ]


@functools.lru_cache(maxsize=2)
def _lane_sides(road_map: RoadMap) -> FlatMesh:
    """Boundaries of all lanes outside intersections, in short pieces."""
    sides = [
        side
        for lane in road_map.lanes
        if not lane.is_intersection
        for side in (lane.left_m, lane.right_m)
    ]
    lines = Lines.of(sides).without_repeats().densified(6.0)
    return ribbons(lines, 0.14)


@functools.cache
def _material_color(color: Rgb) -> tuple[float, float, float]:
    return shown_exactly(color)


class SignalsView:
    """Node of one browser for the stop lines of all signals."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        """Draw nothing yet."""
        self._palette = palette
        self._node = MeshNode(client, "/signals")
        self._drawn: tuple[object, ...] = ()

    def set_palette(self, palette: Palette) -> None:
        """Draw in another theme from the next frame on."""
        self._palette = palette

    def show(self, scenario: Scenario, step: float) -> None:
        """Draw the states at a fractional step; nothing is sent while none changes."""
        states = [int(one.states[int(step)]) for one in scenario.signals]
        wanted = (scenario.signals, scenario.road_map, self._palette, states)
        if wanted == self._drawn or not (scenario.signals or self._node.is_sent):
            return
        self._drawn = wanted
        lines = scenario.stop_lines_m()
        codes = np.array([*states_at(scenario.signals, int(step)).values()], int)
        self._node.draw(
            [
                Primitive(
                    points_m=mesh.points_m,
                    faces=mesh.faces,
                    # Above all parts of the road; stop is on top, then caution, go and
                    # unknown.
                    height_m=0.06 - 0.002 * ((state - 1) % len(SignalState)),
                    color=shown_exactly(color),
                )
                for state, color in self._palette.signals.items()
                if (codes == state).any()
                for mesh in [ribbons(Lines.of([*lines[codes == state]]), 0.8)]
            ]
        )
