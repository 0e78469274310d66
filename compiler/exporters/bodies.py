"""Instances as triangles with materials, for formats that have meshes alone: glTF and USD."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...materials import traits
from ...materials.contract import Lobes
from .. import ir
from ..mesh import shells
from ..mesh.shells import Converters, Shell
from ..scene.row_records import ALL_RAYS
from . import placement
from .export import Export
from .placement import F64

PLANE_REACH = 20.0  # radii of the scene: half the side of the square that stands for an endless plane
_RINGS = 1.0, 2.0, 4.0, 8.0, 16.0, PLANE_REACH  # half sides of squares, in radii: pictures of patterns are finer near the scene
ROUNDING = 3.0 * 2.0**-24  # of a distance from the origin: a position and a matrix of float32 numbers


class Body(NamedTuple):
    """An instance: its mesh in its own frame. Bodies of equal `key` have equal meshes."""

    instance: int
    name: str
    matrix: F64  # (4, 4) to the world
    key: Hashable
    shell: Shell
    parts: list[tuple[int, NDArray[np.intp]]]  # (row of a material, the indices of its triangles)


class Bodies:
    """The instances of a scene that a mesh can stand for. Reports the others.

    A blend stays as it is on instances (rows) of which `is_mixture` is true; otherwise each triangle has one of its parts.
    """

    def __init__(self, out: Export, converters: Converters, is_mixture: Callable[[int], bool] = lambda instance: False) -> None:
        self._is_mixture = is_mixture
        self.out, self.tables, self._converters = out, out.scene.tables, converters
        self.middle, self.radius = placement.reach(self.tables)
        self._shells: dict[Hashable, Shell] = {}

    def __iter__(self) -> Iterator[Body]:
        used: dict[str, int] = {}
        for i in range(len(self.tables.instances.geometry)):
            body = self._body(i)
            if body is not None and not len(body.shell.triangles):
                hint = "a smaller box as `within` has smaller cells"
                self.out.cannot("this has no surface, or is thinner than the cells in which it is sampled: left out", "instances", i, hint)
            elif body is not None:
                count = used[body.name] = used.get(body.name, 0) + 1
                self._tell(body)
                yield body if count == 1 else body._replace(name=f"{body.name}.{count}")

    def _tell(self, body: Body) -> None:
        """Add a body to the note about triangles: their number and their distance from the surface, float32 numbers included."""
        error, size = self._converters.error(body.instance), float(np.linalg.norm(body.matrix[:3, :3], 2))
        reach = float(np.linalg.norm(body.shell.positions, axis=1).max()) * size + float(np.linalg.norm(body.matrix[:3, 3]))
        self.out.triangles += len(body.shell.triangles)
        self.out.deviation = max(self.out.deviation, error * size + ROUNDING * reach)

    def _body(self, i: int) -> Body | None:
        instances, geometries = self.tables.instances, self.tables.geometries
        g, matrix = int(instances.geometry[i]), placement.world(self.tables, i)
        hidden = instances.visible[i] & ALL_RAYS != ALL_RAYS and not self.out.boundaries[instances.material[i]]
        if hidden and instances.light[i] < 0:
            self.out.cannot("this shows in some rays only, and is carried for all", "instances", i)
        names, kind = self.out.scene.names.instances, ir.GeometryKind(int(geometries.kind[g]))
        name = (names[i] if i < len(names) else "") or kind.name.lower()
        endless = kind == ir.GeometryKind.PLANE
        if not endless and self.out.is_endless(i):
            return None
        scale = 0.0 if kind == ir.GeometryKind.MESH else float(np.linalg.norm(matrix[:3, :3], 2))
        key: Hashable = (g, i) if endless else (g, scale)
        if key not in self._shells:
            self._shells[key] = self._plane(i, matrix) if endless else self._shell(i, g, kind)
        shell = self._shells[key]
        rows = self._rows(i, shell, matrix)
        parts = [(int(row), np.flatnonzero(rows == row)) for row in np.unique(rows)]
        split = tuple((row, None if len(parts) == 1 else chosen.tobytes()) for row, chosen in parts)
        return Body(i, name, matrix, (key, split, int(instances.light[i])), shell, parts)

    def _shell(self, i: int, g: int, kind: ir.GeometryKind) -> Shell:
        return shells.mesh(self.tables, g) if kind == ir.GeometryKind.MESH else Shell(*self._converters.tessellate(i))

    def _plane(self, i: int, matrix: F64) -> Shell:
        """A square of an endless plane about the scene's middle; its coordinates are those of the plane."""
        x, _, z = (np.linalg.inv(matrix) @ [*self.middle, 1.0])[:3]
        reach = PLANE_REACH * self.radius / min(np.linalg.norm(matrix[:3, :3], axis=0))
        self.out.note(f"an endless plane is carried as a square of {2 * PLANE_REACH * self.radius:.3g} m", "instances", i)
        halves = reach / PLANE_REACH * np.array(_RINGS) if self._has_pattern(i) else np.array([reach])
        corners = np.array([[x + a * half, 0.0, z + b * half] for half in halves for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))])
        triangles = [[0, 1, 2], [0, 2, 3]]
        for inner in range(0, len(corners) - 4, 4):
            for k in range(4):
                a, b = inner + k, inner + (k + 1) % 4
                triangles += [[a, a + 4, b + 4], [a, b + 4, b]]
        normals = np.tile([0.0, 1.0, 0.0], (len(corners), 1))
        metric = np.ones((len(triangles), 2))
        return Shell(corners, np.array(triangles, np.int32), normals, corners[:, [0, 2]] * [1.0, -1.0], metric)

    def _has_pattern(self, i: int) -> bool:
        """Whether the material of an instance has a pattern, or is a blend."""
        row, textures = int(self.tables.instances.material[i]), self.tables.textures
        used = self.tables.materials.textures[row]
        return bool((textures.kind[used[used >= 0]] == ir.TextureKind.FORMULA).any()) or bool(traits.has(self.tables, Lobes.PARTS)[row])

    def _rows(self, i: int, shell: Shell, matrix: F64) -> NDArray[np.int64]:
        row = int(self.tables.instances.material[i])
        if not traits.has(self.tables, Lobes.PARTS)[row] or self._is_mixture(i):
            return np.full(len(shell.triangles), row, np.int64)
        self.out.note("of blended materials each triangle has the one that counts more", "materials", row)
        centers = shell.positions[shell.triangles].mean(axis=1) @ matrix[:3, :3].T + matrix[:3, 3]
        return self._converters.materials(self.tables, i, centers)


def part_of(shell: Shell, chosen: NDArray[np.intp]) -> Shell:
    """The shell with some of its triangles; all vertices stay."""
    return shell._replace(triangles=shell.triangles[chosen], metric=None if shell.metric is None else shell.metric[chosen])


def compact(shell: Shell, sets: list[F64]) -> tuple[Shell, list[F64]]:
    """The shell without vertices that no triangle uses."""
    used, index = np.unique(shell.triangles, return_inverse=True)
    if len(used) == len(shell.positions):
        return shell, sets
    positions, normals, uvs, colors = (None if v is None else v[used] for v in (shell.positions, shell.normals, shell.uvs, shell.colors))
    assert positions is not None
    triangles = index.reshape(-1, 3).astype(np.int32)
    return Shell(positions, triangles, normals, uvs, shell.metric, colors), [values[used] for values in sets]
