"""Single-sided surfaces: the faces that a camera sees from behind are not drawn.

An instance with the bit SINGLE_SIDED is drawn from its front alone, as viewers of glTF draw it. `seen_from` takes the faces away that
turn their back to a camera, before a picture is prepared, so that all backends draw the same. A face that is taken away still casts
shadows and shows in mirrors, unless its mesh is a shell around other things that turns its back to the outside, as outlines of drawings
and dolls' houses do: then light passes too. A surface of some opacity is not seen through from behind either. The boundary of glass is
drawn whole: rays that enter it leave through its back.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...materials import traits
from ...materials.contract import Lobes
from .. import ir
from ..ir import F64, I32, Bool
from ..ir.single_sided import SINGLE_SIDED
from ..mesh.topology import connected_vertices, winding_number
from ..scene.row_records import ALL_RAYS, NO_SHADOW

MOST_TRIANGLES = 1 << 25  # that `seen_from` copies
LEFT = f"the backs of this and other single-sided objects are drawn: together more than {MOST_TRIANGLES:,} of their triangles are seen"
_INWARD = -0.5  # greatest of (outward − inward) / (outward + inward) area, weighted by distances from the centroid, of an inward shell
_MOST_KNOWN = 10_000
_closed: dict[bytes, bool] = {}  # of meshes of earlier pictures, by their content


class Resolved(NamedTuple):
    """A scene as one camera sees it, and an instance whose back is drawn as its copies are too many, or -1."""

    scene: ir.Scene
    left: int


def seen_from(scene: ir.Scene, camera: int, paths: bool = False) -> Resolved:
    """The scene without the faces of single-sided instances that a camera sees from behind. Rows of instances stay the same.

    With `paths`, a camera's ray stays one behind a surface of some opacity, and faces that turn their back still light and shade others.
    Without, it goes on as a reflected one, so that these miss such faces too where anything in the scene is see-through.

    Instances move too little during the shutter to show their backs: the scene's time counts.
    """
    tables = scene.tables
    flagged = np.flatnonzero(tables.instances.visible & SINGLE_SIDED)
    if not len(flagged):
        return Resolved(scene, -1)
    visible = tables.instances.visible & ~SINGLE_SIDED
    tables = tables._replace(instances=tables.instances._replace(visible=visible))
    eye, see_through = _eye(tables, camera), _see_through(tables)
    split, skipped = _Split(tables, bool(not paths and see_through[tables.instances.material].any())), -1
    flagged = flagged[~_glass(tables)[tables.instances.material[flagged]]]
    shown = (visible[flagged] & int(ir.Visibility.CAMERA) != 0) & (tables.instances.light[flagged] < 0)
    shown &= tables.geometries.kind[tables.instances.geometry[flagged]] == ir.GeometryKind.MESH
    meshes: dict[int, _Mesh] = {}
    for i in flagged[shown].tolist():
        g, opaque = int(tables.instances.geometry[i]), not see_through[tables.instances.material[i]]
        mesh = meshes.setdefault(g, _Mesh(tables, g))
        local = np.append(tables.transforms.inverse[tables.instances.transform[i]] @ eye, eye[3])
        outside = not mesh.bounds_hold(local)
        if opaque and outside and mesh.closed:
            continue
        front = _faces_eye(mesh.corners, local)
        if front.all() or (opaque and mesh.closed and abs(winding_number(mesh.corners - local[:3])) < 0.5):
            continue
        if split.triangles + int(front.sum()) > MOST_TRIANGLES:
            skipped = i
            continue
        split.add(i, front, outside and mesh.inward)
    return Resolved(replace(scene, tables=split.tables()), skipped)


def _see_through(tables: ir.Tables) -> Bool:
    """(materials,) whether something shows behind a surface."""
    return traits.with_parts(tables, traits.partial(tables) | traits.clear(tables))


def _glass(tables: ir.Tables) -> Bool:
    """(materials,) whether a surface bounds a volume of glass."""
    return traits.with_parts(tables, traits.has(tables, Lobes.GLASS))


def _eye(tables: ir.Tables, camera: int) -> F64:
    """The camera's position as (x, y, z, 1), or the direction (x, y, z, 0) to an orthographic one."""
    matrix = tables.transforms.matrix[tables.cameras.transform[camera]]
    if tables.cameras.projection[camera] == ir.Projection.ORTHOGRAPHIC:
        return np.append(matrix[:, 2], 0.0)
    return np.append(matrix[:, 3], 1.0)


class _Mesh:
    """A mesh in its own frame, with what its instances share."""

    def __init__(self, tables: ir.Tables, g: int) -> None:
        self._tables, self._g = tables, g

    @cached_property
    def corners(self) -> F64:
        """The corners (t, 3, 3) of its triangles."""
        positions, triangles = ir.mesh_arrays(self._tables, self._g)
        return positions[triangles].astype(np.float64) + self._tables.geometries.origin[self._g]

    @cached_property
    def closed(self) -> bool:
        """Whether it is closed, with its front outside."""
        positions, triangles = ir.mesh_arrays(self._tables, self._g)
        key = hashlib.blake2b(positions.tobytes() + triangles.tobytes()).digest()
        if key not in _closed:
            if len(_closed) == _MOST_KNOWN:
                _closed.clear()
            _closed[key] = is_closed_outward(positions, triangles)
        return _closed[key]

    @cached_property
    def inward(self) -> bool:
        """Whether it is a shell that turns its back to the outside."""
        corners = self.corners
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area, middle = np.linalg.norm(normal, axis=1), corners.mean(axis=1)
        away = middle - (middle * area[:, None]).sum(axis=0) / max(float(area.sum()), 1e-300)
        outward = np.einsum("ij,ij->i", normal, away)
        return bool(outward.sum() <= _INWARD * np.abs(outward).sum() < 0.0)

    def bounds_hold(self, eye: F64) -> bool:
        """Whether an eye (x, y, z, w) is in its bounds."""
        low, high = self._tables.geometries.bounds[self._g]
        return bool(eye[3] and ((eye[:3] >= low) & (eye[:3] <= high)).all())



def _faces_eye(corners: F64, eye: F64) -> Bool:
    """(t,) whether triangles turn their front, counter-clockwise, to an eye (x, y, z, w); true for those seen edge-on.

    Mirrors keep it: glTF and USD take the winding in the frame of the mesh.
    """
    a = corners[:, 0]
    normal = np.cross(corners[:, 1] - a, corners[:, 2] - a)
    return np.einsum("ij,ij->i", normal, eye[:3] - eye[3] * a) >= 0.0


def is_closed_outward(positions: np.ndarray, triangles: I32) -> bool:
    """Whether each connected part of a mesh is closed, with its front outside. Points at one place are one."""
    places, place_of = np.unique(positions, axis=0, return_inverse=True)
    corners = place_of.reshape(-1)[triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    n = len(places)
    forward = (corners * np.int64(n) + np.roll(corners, -1, axis=1)).ravel()
    back = (np.roll(corners, -1, axis=1) * np.int64(n) + corners).ravel()
    if not len(corners) or not np.array_equal(np.sort(forward), np.sort(back)):
        return False
    part = connected_vertices(n, corners)
    centered = places[corners].astype(np.float64) - places.mean(axis=0, dtype=np.float64)
    volume = np.bincount(part[corners[:, 0]], np.einsum("ij,ij->i", centered[:, 0], np.cross(centered[:, 1], centered[:, 2])), n)
    return bool((volume[np.unique(part[corners[:, 0]])] > 0.0).all())


class _Split:
    """Collects meshes of the faces that are seen, and the instances that keep the others."""

    def __init__(self, tables: ir.Tables, any_see_through: bool) -> None:
        self._tables, self._through = tables, any_see_through
        self._known: dict[tuple[int, bytes], int] = {}
        self._geometry, self._visible = tables.instances.geometry.copy(), tables.instances.visible.copy()
        self._copies: list[int] = []  # instances that have a second row
        self._whole: list[int] = []  # their visibility there
        self._made: list[tuple[int, np.ndarray]] = []  # geometry, its faces
        self.triangles = 0

    def add(self, i: int, front: Bool, passes_light: bool) -> None:
        """Show the faces `front` of instance i alone. Others cast shadows still, unless the instance `passes_light`."""
        g, faces = int(self._geometry[i]), np.flatnonzero(front)
        if not passes_light:
            seen = NO_SHADOW if self._through else int(ir.Visibility.CAMERA)
            hidden = int(self._visible[i]) & ~seen
            self._visible[i] &= ~ALL_RAYS | seen
            if hidden & ALL_RAYS:
                self._copies.append(i)
                self._whole.append(hidden)
        if not len(faces):
            self._visible[i] &= ~ALL_RAYS if passes_light else ~NO_SHADOW
            return
        key = (g, np.packbits(front).tobytes())
        if key not in self._known:
            self._known[key] = len(self._tables.geometries.kind) + len(self._made)
            self._made.append((g, faces))
            self.triangles += len(faces)
        self._geometry[i] = self._known[key]

    def tables(self) -> ir.Tables:
        """The tables with the new meshes and instances."""
        t = self._tables
        geometries, pools, attributes = t.geometries, t.pools, t.attributes
        if self._made:
            geometries, pools, attributes = _with_subsets(t, self._made)
        instances, rows = t.instances, np.array(self._copies, np.int64)
        columns = {name: np.concatenate([column, column[rows]]) for name, column in instances._asdict().items()}
        columns["geometry"] = np.concatenate([self._geometry, instances.geometry[rows]])
        columns["visible"] = np.concatenate([self._visible, np.array(self._whole, np.int32)]).astype(np.int32)
        return t._replace(geometries=geometries, pools=pools, attributes=attributes, instances=ir.Instances(**columns))


def _with_subsets(tables: ir.Tables, subsets: list[tuple[int, np.ndarray]]) -> tuple[ir.Geometries, ir.Pools, ir.Attributes]:
    """The tables with a mesh more for each (geometry, faces)."""
    source = np.array([g for g, _ in subsets])
    columns = {name: np.concatenate([column, column[source]]) for name, column in tables.geometries._asdict().items()}
    triangles, values = [tables.pools.triangles], [tables.pools.values]
    of_attributes = {name: [column] for name, column in tables.attributes._asdict().items()}
    length, floats, rows = len(tables.pools.triangles), len(tables.pools.values), len(tables.attributes.first)
    for k, (g, faces) in enumerate(subsets, len(tables.geometries.kind)):
        triangles.append(tables.pools.triangles[int(tables.geometries.first_triangle[g]) + faces])
        columns["first_triangle"][k], columns["triangle_count"][k], columns["polygon_count"][k] = length, len(faces), 0
        length += len(faces)
        for name in ("normals", "uvs", "colors"):
            row = int(columns[name][k])
            how = tables.attributes.interpolation[row] if row >= 0 else ir.Interpolation.CONSTANT
            if how not in (ir.Interpolation.FACE, ir.Interpolation.CORNER):
                continue
            width, first, each = int(tables.attributes.width[row]), int(tables.attributes.first[row]), 1
            each = 3 if how == ir.Interpolation.CORNER else 1
            rows_of_values = tables.pools.values[first : first + width * int(tables.attributes.count[row])].reshape(-1, each * width)
            values.append(rows_of_values[faces].ravel())
            for column, value in (("interpolation", how), ("width", width), ("first", floats), ("count", each * len(faces))):
                of_attributes[column].append(np.array([value], of_attributes[column][0].dtype))
            columns[name][k], rows, floats = rows, rows + 1, floats + len(values[-1])
    pools = tables.pools._replace(triangles=np.concatenate(triangles), values=np.concatenate(values))
    attributes = ir.Attributes(**{name: np.concatenate(parts) for name, parts in of_attributes.items()})
    return ir.Geometries(**columns), pools, attributes
