"""Low-poly shapes of agents, in a unit box.

x ahead, y left, z up; length, width and height are all 1, centred in the plane and
standing on the ground, so that an instance is scaled by an agent's true size.
"""

import functools
from dataclasses import dataclass

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import interpolate_angle
from pd_editor.viewer.meshes.flat_mesh import Primitive, glb_of


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentPoses:
    """All agents at one moment."""

    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    is_present: Bool[np.ndarray, "A"]


def poses_at(agents: AgentTracks, step: float) -> AgentPoses:
    """Poses at a fractional step, interpolated between its two neighbours.

    If only one neighbour exists, an agent has its pose for that half of the interval.
    """
    before = int(np.clip(np.floor(step), 0, agents.num_steps - 1))
    after = min(before + 1, agents.num_steps - 1)
    fraction = float(np.clip(step - before, 0.0, 1.0))
    here, there = agents.is_valid[:, before], agents.is_valid[:, after]
    weight = np.where(here & there, fraction, np.where(here, 0.0, 1.0))
    start, end = agents.position_m[:, before], agents.position_m[:, after]
    return AgentPoses(
        position_m=start + weight[:, None] * (end - start),
        heading_rad=interpolate_angle(
            agents.heading_rad[:, before], agents.heading_rad[:, after], weight
        ),
        is_present=np.where(fraction < 0.5, here, there) | (here & there),
    )


def yaw_quaternions(heading_rad: Float[np.ndarray, "N"]) -> Float[np.ndarray, "N 4"]:
    """Rotations about +z as w, x, y, z."""
    quaternions = np.zeros((len(heading_rad), 4))
    quaternions[:, 0] = np.cos(heading_rad / 2)
    quaternions[:, 3] = np.sin(heading_rad / 2)
    return quaternions


Profile = list[tuple[float, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentShape:
    """A part in the agent's colour, and a dark part (glass, wheels), if any."""

    body: trimesh.Trimesh
    dark: trimesh.Trimesh | None


def _extruded(profile: Profile, width: float, y_m: float = 0.0) -> trimesh.Trimesh:
    """A side view (x, z), extruded across."""
    mesh = trimesh.creation.extrude_polygon(
        shapely.Polygon(profile), height=width, engine="earcut"
    )
    turned = mesh.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]
    turned[:, 1] += width / 2 + y_m
    return trimesh.Trimesh(turned, mesh.faces, process=False)


def _box(
    x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]
) -> trimesh.Trimesh:
    bounds = np.array([[x[0], y[0], z[0]], [x[1], y[1], z[1]]])
    return trimesh.creation.box(bounds=bounds)


def _ellipse(x: float, z: float, radius_x: float, radius_z: float) -> Profile:
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False) + np.pi / 10
    return [
        (float(x + radius_x * np.cos(a)), float(z + radius_z * np.sin(a)))
        for a in angle
    ]


def _sphere(x: float, z: float, radii: tuple[float, float, float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.apply_scale(radii)
    mesh.apply_translation([x, 0.0, z])
    return mesh


def _frustum(
    x: float,
    z: tuple[float, float],
    low: tuple[float, float],
    high: tuple[float, float],
) -> trimesh.Trimesh:
    """A tapered eight-sided column; ``low`` and ``high`` are its x and y radii."""
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False) + np.pi / 8
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = [
        np.column_stack([circle * radii + [x, 0.0], np.full(8, height)])
        for radii, height in ((low, z[0]), (high, z[1]))
    ]
    return trimesh.convex.convex_hull(np.concatenate(rings))


def _rise(mesh: trimesh.Trimesh) -> np.ndarray:
    """1 for faces that look up, -1 for those that look down, 0 for sides."""
    return np.round(mesh.face_normals[:, 2])


def _kept(mesh: trimesh.Trimesh, keeps: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[keeps], process=False)


def _joined(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    """The parts without faces that look down: cameras stay above the ground."""
    mesh = trimesh.util.concatenate(parts)
    assert isinstance(mesh, trimesh.Trimesh)
    return _kept(mesh, _rise(mesh) >= 0)


def _wheels(
    positions_x: tuple[float, ...],
    radii: tuple[float, float],
    width: float,
    sides: tuple[float, ...],
) -> list[trimesh.Trimesh]:
    """Wheels; what of those beside a body is inside it is left out."""
    wheels = []
    for x in positions_x:
        for side in sides:
            wheel = _extruded(_ellipse(x, radii[1], *radii), width, side)
            is_seen = (wheel.face_normals[:, 1] * side >= 0) & (_rise(wheel) < 1)
            wheels.append(_kept(wheel, is_seen) if side else wheel)
    return wheels


def _car() -> AgentShape:
    shell: Profile = [
        (-0.5, 0.16), (0.49, 0.14), (0.5, 0.40), (0.46, 0.50), (0.21, 0.60),
        (-0.40, 0.64), (-0.48, 0.60), (-0.5, 0.46),
    ]  # fmt: skip
    cabin: Profile = [(-0.43, 0.60), (0.24, 0.57), (0.07, 0.95), (-0.29, 0.96)]
    roof: Profile = [(-0.31, 0.93), (0.09, 0.92), (0.05, 0.99), (-0.27, 1.0)]
    return AgentShape(
        body=_joined(_extruded(shell, 1.0), _extruded(roof, 0.80)),
        dark=_joined(
            _extruded(cabin, 0.86),
            *_wheels((-0.31, 0.31), (0.073, 0.21), 0.14, (-0.44, 0.44)),
        ),
    )


def _bus() -> AgentShape:
    shell: Profile = [
        (-0.5, 0.10), (0.5, 0.10), (0.5, 0.42), (0.49, 0.94), (0.47, 1.0),
        (-0.48, 1.0), (-0.5, 0.96),
    ]  # fmt: skip
    window: Profile = [(-0.46, 0.50), (0.503, 0.44), (0.496, 0.84), (-0.46, 0.84)]
    return AgentShape(
        body=_extruded(shell, 0.99),
        dark=_joined(
            _extruded(window, 1.0),
            *_wheels((-0.30, 0.33), (0.042, 0.15), 0.12, (-0.44, 0.44)),
        ),
    )


def _two_wheeler(frame_height: float, *, has_rider: bool) -> AgentShape:
    wheel_radius = 0.20 if has_rider else 0.30
    frame: Profile = [
        (-0.32, wheel_radius), (0.0, wheel_radius * 0.9), (0.34, wheel_radius * 1.2),
        (0.24, frame_height), (0.18, frame_height), (-0.16, frame_height * 0.86),
    ]  # fmt: skip
    bar_z = frame_height * 1.04
    parts = [
        _extruded(frame, 0.22),
        _box((0.16, 0.22), (-0.42, 0.42), (bar_z - 0.02, bar_z + 0.02)),
    ]
    if has_rider:
        parts += [
            _frustum(-0.06, (frame_height * 0.9, 0.84), (0.10, 0.34), (0.11, 0.46)),
            _sphere(0.02, 0.92, (0.075, 0.22, 0.08)),
            _tick(0.52, 0.3, 0.9),
        ]
    wheels = _wheels((-0.33, 0.33), (0.165, wheel_radius), 0.12, (0.0,))
    return AgentShape(body=_joined(*parts), dark=_joined(*wheels))


def _tick(x: float, length: float, width: float) -> trimesh.Trimesh:
    """Flat arrowhead on the ground that shows the direction of a small glyph."""
    corners = [(x, -width / 2), (x + length, 0.0), (x, width / 2)]
    return trimesh.creation.extrude_polygon(
        shapely.Polygon(corners), height=0.03, engine="earcut"
    )


def _pedestrian() -> AgentShape:
    return AgentShape(
        body=_joined(
            _frustum(0.0, (0.0, 0.48), (0.16, 0.20), (0.24, 0.32)),
            _frustum(0.0, (0.48, 0.83), (0.24, 0.36), (0.22, 0.44)),
            _sphere(0.0, 0.91, (0.17, 0.17, 0.09)),
            _tick(0.48, 0.55, 0.7),
        ),
        dark=None,
    )


def _block() -> AgentShape:
    side: Profile = [
        (-0.5, 0.0), (0.5, 0.0), (0.5, 0.86), (0.42, 1.0), (-0.42, 1.0), (-0.5, 0.86)
    ]  # fmt: skip
    return AgentShape(body=_extruded(side, 1.0), dark=None)


def _cone() -> AgentShape:
    return AgentShape(
        body=_joined(
            _box((-0.5, 0.5), (-0.5, 0.5), (0.0, 0.07)),
            _frustum(0.0, (0.07, 1.0), (0.36, 0.36), (0.08, 0.08)),
        ),
        dark=None,
    )


@functools.cache
def shape_of(kind: AgentKind) -> AgentShape:
    """The shape drawn for a kind of agent."""
    match kind:
        case AgentKind.VEHICLE:
            return _car()
        case AgentKind.BUS:
            return _bus()
        case AgentKind.MOTORCYCLIST:
            return _two_wheeler(0.52, has_rider=True)
        case AgentKind.CYCLIST:
            return _two_wheeler(0.50, has_rider=True)
        case AgentKind.RIDERLESS_BICYCLE:
            return _two_wheeler(0.86, has_rider=False)
        case AgentKind.PEDESTRIAN:
            return _pedestrian()
        case AgentKind.CONSTRUCTION:
            return _cone()
        case AgentKind.STATIC | AgentKind.BACKGROUND | AgentKind.UNKNOWN:
            return _block()


@functools.cache
def ring(inner: float) -> trimesh.Trimesh:
    """A flat ring of radius 1 around a hole of radius ``inner``."""
    solid = trimesh.creation.annulus(r_min=inner, r_max=1.0, height=0.02, sections=48)
    return _kept(solid, _rise(solid) == 1)


@functools.cache
def box_outline() -> trimesh.Trimesh:
    """The edge of a unit footprint, with a notch that points ahead."""
    edge = shapely.Polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    hole = shapely.Polygon(
        [(-0.46, -0.4), (0.3, -0.4), (0.46, 0.0), (0.3, 0.4), (-0.46, 0.4)]
    )
    return trimesh.creation.extrude_polygon(
        edge.difference(hole), height=0.02, engine="earcut"
    )


@functools.cache
def pointer() -> trimesh.Trimesh:
    """A pyramid that points down, one high, tip at the origin."""
    corners = [
        [0, 0, 0],
        [0.5, 0.5, 1],
        [-0.5, 0.5, 1],
        [-0.5, -0.5, 1],
        [0.5, -0.5, 1],
    ]
    return trimesh.convex.convex_hull(np.array(corners, float))


@functools.cache
def contact_shadow() -> bytes:
    """A soft dark patch on the ground as glTF, for a unit footprint."""
    edge: Float[np.ndarray, "4 2"] = np.array(
        [[-1.0, -1], [1, -1], [1, 1], [-1, 1]], float
    )
    points = np.concatenate([edge * 0.44, edge * 0.60])
    faces = [[0, 1, 2], [0, 2, 3]]
    for near in range(4):
        far = (near + 1) % 4
        faces += [[near, near + 4, far], [far, near + 4, far + 4]]
    return glb_of(
        [
            Primitive(
                points_m=points,
                faces=np.array(faces),
                height_m=0.0,
                color=(0.0, 0.0, 0.0),
                vertex_opacity=np.repeat([0.42, 0.0], 4),
            )
        ]
    )
