"""Flat coloured meshes on the ground, and their binary glTF form."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import mapbox_earcut
import numpy as np
import shapely
import viser
from jaxtyping import Float, Int

from pd_editor.scene.geometry.lines import Lines

_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatMesh:
    """Triangles in the plane, counter-clockwise seen from above."""

    points_m: Float[np.ndarray, "V 2"]
    faces: Int[np.ndarray, "F 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Primitive:
    """A mesh with its height and material, ready to be sent."""

    points_m: Float[np.ndarray, "V 2"]
    faces: Int[np.ndarray, "F 3"]
    height_m: float | Float[np.ndarray, "V"]
    color: tuple[float, float, float]
    """Linear material colour; may exceed 1."""
    opacity: float = 1.0
    vertex_opacity: Float[np.ndarray, "V"] | None = None
    vertex_color: Float[np.ndarray, "V 3"] | None = None
    """Multiplied with ``color``; linear."""


def merged(meshes: Sequence[FlatMesh]) -> FlatMesh:
    """All meshes as one."""
    if not meshes:
        return FlatMesh(points_m=np.zeros((0, 2)), faces=np.zeros((0, 3), int))
    counts = np.array([len(mesh.points_m) for mesh in meshes])
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return FlatMesh(
        points_m=np.concatenate([mesh.points_m for mesh in meshes]),
        faces=np.concatenate(
            [mesh.faces + start for mesh, start in zip(meshes, first, strict=True)]
        ),
    )


def strips(left: Lines, right_m: Float[np.ndarray, "P 2"]) -> FlatMesh:
    """The bands between pairs of lines with equally many points."""
    count = len(right_m)
    near = np.delete(np.arange(count), left.ends[1])
    faces = np.concatenate(
        [
            np.stack([near, near + count, near + 1], axis=-1),
            np.stack([near + 1, near + count, near + count + 1], axis=-1),
        ]
    )
    return FlatMesh(points_m=np.concatenate([left.points_m, right_m]), faces=faces)


def facing_up(mesh: FlatMesh) -> FlatMesh:
    """The mesh with every triangle counter-clockwise seen from above."""
    a, b, c = (mesh.points_m[mesh.faces[:, corner]] for corner in range(3))
    cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = mesh.faces.copy()
    faces[cross < 0] = faces[cross < 0][:, ::-1]
    return FlatMesh(points_m=mesh.points_m, faces=faces)


def ribbons(lines: Lines, width_m: float) -> FlatMesh:
    """Lines drawn with a width."""
    half = width_m / 2
    return strips(lines.offset(half), lines.offset(-half).points_m)


def triangulated(polygons: Sequence[shapely.Polygon]) -> FlatMesh:
    """Polygons, holes and all, cut into triangles."""
    if not len(polygons):
        return merged([])
    rings, owner = shapely.get_rings(
        shapely.orient_polygons(polygons), return_index=True
    )
    points, ring = shapely.get_coordinates(rings, return_index=True)
    # The last point of a ring is its first one again.
    is_new = np.append(np.diff(ring) == 0, False)
    points, count = points[is_new], np.bincount(ring[is_new])
    faces, first = [], 0
    for ends in np.split(np.cumsum(count), np.flatnonzero(np.diff(owner)) + 1):
        triangles = mapbox_earcut.triangulate_float64(
            points[first : ends[-1]], (ends - first).astype(np.uint32)
        )
        faces.append(first + triangles.reshape(-1, 3).astype(int))
        first = ends[-1]
    return facing_up(FlatMesh(points_m=points, faces=np.concatenate(faces)))


def glb_of(primitives: Sequence[Primitive]) -> bytes:
    """Unlit binary glTF of all primitives; z is up."""
    buffers: list[bytes] = []
    views: list[dict] = []
    accessors: list[dict] = []

    def add(array: np.ndarray, component: int, kind: str, **extra: object) -> int:
        data = array.tobytes()
        offset = sum(len(part) for part in buffers)
        buffers.append(data + b"\0" * (-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(data)})
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": component,
                "count": len(array),
                "type": kind,
                **extra,
            }
        )
        return len(accessors) - 1

    gltf_primitives, materials = [], []
    for primitive in primitives:
        if not len(primitive.faces):
            continue
        points = np.empty((len(primitive.points_m), 3), "<f4")
        points[:, :2] = primitive.points_m
        points[:, 2] = primitive.height_m
        attributes = {
            "POSITION": add(
                points,
                _FLOAT,
                "VEC3",
                min=points.min(0).tolist(),
                max=points.max(0).tolist(),
            )
        }
        colors = _vertex_colors(primitive)
        if colors is not None:
            attributes["COLOR_0"] = add(colors, _FLOAT, "VEC4")
        is_small = len(points) < 2**16
        indices = add(
            primitive.faces.astype("<u2" if is_small else "<u4").reshape(-1),
            _UNSIGNED_SHORT if is_small else _UNSIGNED_INT,
            "SCALAR",
        )
        gltf_primitives.append(
            {"attributes": attributes, "indices": indices, "material": len(materials)}
        )
        materials.append(_material(primitive))
    if not gltf_primitives:
        return glb_of([_INVISIBLE])
    return _packed(gltf_primitives, materials, views, accessors, b"".join(buffers))


_INVISIBLE = Primitive(
    points_m=np.zeros((3, 2)),
    faces=np.array([[0, 1, 2]]),
    height_m=0.0,
    color=(0.0, 0.0, 0.0),
)


def _vertex_colors(primitive: Primitive) -> np.ndarray | None:
    if primitive.vertex_opacity is None and primitive.vertex_color is None:
        return None
    colors = np.ones((len(primitive.points_m), 4), "<f4")
    if primitive.vertex_color is not None:
        colors[:, :3] = primitive.vertex_color
    if primitive.vertex_opacity is not None:
        colors[:, 3] = primitive.vertex_opacity
    return colors


def _material(primitive: Primitive) -> dict:
    # One-sided: the page draws two-sided transparent meshes twice, and looks up their
    # shaders anew on every frame.
    is_transparent = primitive.opacity < 1 or primitive.vertex_opacity is not None
    return {
        "pbrMetallicRoughness": {
            "baseColorFactor": [*primitive.color, primitive.opacity],
            "metallicFactor": 0.0,
        },
        "extensions": {"KHR_materials_unlit": {}},
        **({"alphaMode": "BLEND"} if is_transparent else {}),
    }


def _packed(
    primitives: list[dict],
    materials: list[dict],
    views: list[dict],
    accessors: list[dict],
    binary: bytes,
) -> bytes:
    # glTF is y-up and viser's scene z-up; viser shows glTF coordinates as they are
    # when the node itself carries no rotation, so nothing is turned here.
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, total),
            struct.pack("<II", len(text), 0x4E4F534A),
            text,
            struct.pack("<II", len(binary), 0x004E4942),
            binary,
        ]
    )


class MeshNode:
    """A node of one browser's scene for meshes that replace each other; without shadows."""

    def __init__(self, client: viser.ClientHandle, name: str) -> None:
        """Send nothing yet."""
        self._scene, self.name = client.scene, name
        self._handle: viser.GlbHandle | None = None

    @property
    def is_sent(self) -> bool:
        """Whether the browser has it."""
        return self._handle is not None

    def draw(self, meshes: list[Primitive]) -> None:
        """Send meshes in the place of those before."""
        data = glb_of(meshes)
        if self._handle is None:
            self._handle = self._scene.add_glb(
                self.name, data, cast_shadow=False, receive_shadow=False
            )
        else:
            self._handle.glb_data = data

    def set_visible(self, is_visible: bool) -> None:
        """Show or hide what has been sent."""
        if self._handle is not None:
            self._handle.visible = is_visible
