"""Exports instances as Mitsuba shapes: spheres, boxes, disks, rectangles and cylinders natively, others as meshes (PLY)."""

from __future__ import annotations

import numpy as np

from ....shapes import SHAPES
from ....shapes.contract import MitsubaShape
from ... import ir
from ...mesh import shells
from ...mesh.shells import Shell
from ...plan.plan import Plan
from ...scene.row_records import ALL_RAYS
from .. import placement, ply_file, texture_values
from ..export import Export
from ..placement import F64
from .materials import Look, Materials
from .xml import Node, node, vector


class Shapes:
    """The shapes of a scene with their materials."""

    def __init__(self, out: Export, plan: Plan, name: str, tessellate: shells.Tessellate) -> None:
        self.out, self.plan, self.name, self.tessellate = out, plan, name, tessellate
        self.tables = out.scene.tables
        self.materials = Materials(out, name)
        self.middle, self.radius = placement.reach(self.tables)
        self._meshes: dict[tuple[int | float, ...], str] = {}

    def nodes(self) -> list[Node]:
        """Shapes in instance order, without those of lights, which `of_light` gives."""
        seen = np.flatnonzero(self.tables.instances.light < 0).tolist()
        return [shape for i in seen for shape in self.shapes_of(i)]

    def shapes_of(self, i: int) -> list[Node]:
        tables = self.tables
        instances, geometries = tables.instances, tables.geometries
        g, material = int(instances.geometry[i]), int(instances.material[i])
        look = self.materials.look(material, int(geometries.colors[g]) >= 0, i)
        if instances.visible[i] & ALL_RAYS != ALL_RAYS and not self.out.boundaries[material]:
            self.out.cannot("Mitsuba shows everything to the camera, in mirrors and in shadows: this shows in some only", "instances", i)
        inside: list[Node] = [look.bsdf, *([look.medium] if look.medium is not None else [])]
        if look.emission is not None:
            self._check_emission(i, g)
            inside.append(node("emitter", "area").with_(look.emission))
        shapes = self._native(i, g) if look.texture < 0 else None
        if shapes is None:
            mesh = self._mesh(i, g, look)
            shapes = [] if mesh is None else [mesh]
        return [shape.with_(*inside) for shape in shapes]

    def of_light(self, i: int, radiance: Node) -> list[Node]:
        """The shape of an area light: black, emitting from its front."""
        black = self.materials.look(int(self.tables.instances.material[i]), False, i).bsdf
        g = int(self.tables.instances.geometry[i])
        shapes = self._native(i, g)
        if shapes is None:
            self.out.cannot("an area light under a transform that shears it, or stretches a round one, is not carried", "instances", i)
            return []
        return [shape.with_(black, node("emitter", "area").with_(radiance)) for shape in shapes]

    def _check_emission(self, i: int, g: int) -> None:
        geometries = self.tables.geometries
        shape = SHAPES.get(int(geometries.kind[g]))
        if shape is None or not shape.is_closed(geometries.parameters[g].tolist()):
            self.out.cannot("what shines on both sides here shines on its front only in Mitsuba", "instances", i)
        if not self.plan["interreflection"]:
            self.out.cannot("emissive surfaces light others in Mitsuba, here only with bounces", "instances", i, "--bounces 1")

    # --- shapes Mitsuba has ---

    def _native(self, i: int, g: int) -> list[Node] | None:
        """The native Mitsuba shapes under this transform; None if there are none."""
        shape = SHAPES.get(int(self.tables.geometries.kind[g]))
        if shape is None or shape.mitsuba is None:
            return None
        native, matrix = shape.mitsuba(self.tables.geometries.parameters[g].tolist()), placement.world(self.tables, i)
        scale = placement.even_scale(matrix)
        if (native.transforms == "even" and scale is None) or (native.transforms == "orthogonal" and not _square(matrix)):
            return None
        return [_node(each, matrix, scale or 0.0) for each in native.shapes]

    # --- all others ---

    def _mesh(self, i: int, g: int, look: Look) -> Node | None:
        tables = self.tables
        material, matrix = int(tables.instances.material[i]), placement.world(tables, i)
        colored = int(tables.geometries.colors[g]) >= 0
        flat = bool(tables.materials.shading[material] == ir.Shading.FLAT)
        turned = bool(tables.transforms.flips[tables.instances.transform[i]])
        sized = look.texture >= 0 and tables.textures.kind[look.texture] != ir.TextureKind.IMAGE
        shared = tables.geometries.kind[g] == ir.GeometryKind.MESH  # other shapes are tessellated by their size on screen
        scale = placement.mean_scale(matrix) if sized else 0.0
        key = (g, look.texture, flat, turned, material if colored else -1, -1 if shared else i, scale)
        if key not in self._meshes:
            shell = self._shell(i, g, matrix)
            if shell is None:
                return None
            shell = self._placed(shell, look.texture, i, g, matrix)
            if colored and shell.colors is not None:
                shell = shell._replace(colors=shell.colors * tables.materials.values[material, ir.Slot.DIFFUSE])
            if flat:
                shell = shell._replace(normals=None)
            self._meshes[key] = f"{self.name}.{len(self.out.files)}.ply"
            self.out.files[self._meshes[key]] = ply(shells.flip(shell) if turned else shell)
        return node("shape", "ply", filename=self._meshes[key], face_normals=self._faceted(g, flat), to_world=matrix)

    def _faceted(self, g: int, flat: bool) -> bool:
        """Whether the mesh has face normals: Mitsuba computes smooth normals for a mesh without any."""
        geometries = self.tables.geometries
        return flat or bool(geometries.kind[g] == ir.GeometryKind.MESH and geometries.normals[g] < 0)

    def _shell(self, i: int, g: int, matrix: F64) -> Shell | None:
        kind = ir.GeometryKind(int(self.tables.geometries.kind[g]))
        if kind == ir.GeometryKind.MESH:
            return shells.mesh(self.tables, g)
        if kind == ir.GeometryKind.PLANE:
            inverse = np.linalg.inv(matrix)
            x, _, z = (inverse @ [*self.middle, 1.0])[:3]
            reach = self.radius / min(np.linalg.norm(matrix[:3, :3], axis=0))
            self.out.note("an endless plane is carried as a square that ends 10⁵ times the scene's radius away", "instances", i)
            return shells.plane(float(x), float(z), float(reach))
        if self.out.is_endless(i):
            return None
        shell = Shell(*self.tessellate(i))
        self.out.tessellated(kind, i, len(shell.triangles), self.plan["tolerance"])
        return shell

    def _placed(self, shell: Shell, texture: int, i: int, g: int, matrix: F64) -> Shell:
        """The shell with the coordinates of its texture; v down, scaled by half for a checkerboard (two cells a unit)."""
        if texture < 0:
            return shell._replace(uvs=None)
        tables = self.tables
        if not texture_values.follows_uv(tables, texture, int(tables.geometries.kind[g])):
            name = ir.TextureMapping(int(tables.textures.mapping[texture])).name.lower()
            self.out.cannot(f"the mapping {name} is not carried: Mitsuba takes a surface's own coordinates", "textures", texture)
        if tables.textures.kind[texture] != ir.TextureKind.IMAGE:
            cells = texture_values.with_cells(tables, texture, shell, placement.mean_scale(matrix))
            return cells._replace(uvs=None if cells.uvs is None else cells.uvs / 2)
        frame = texture_values.texture_matrix(tables, texture)
        uvs = np.zeros((len(shell.positions), 2)) if shell.uvs is None else shell.uvs
        st = uvs @ frame[:2, :2].T + frame[:2, 2]
        return shell._replace(uvs=np.stack([st[:, 0], 1.0 - st[:, 1]], axis=1))


def _right_handed(matrix: F64) -> F64:
    """The same placement by a non-mirroring transform, for a shape symmetric about its x = 0."""
    return matrix @ np.diag([-1.0, 1.0, 1.0, 1.0]) if np.linalg.det(matrix[:3, :3]) < 0 else matrix


def _node(shape: MitsubaShape, matrix: F64, scale: float) -> Node:
    """A shape under a transform that scales by `scale`."""
    if shape.matrix is not None:
        return node("shape", shape.plugin, to_world=_right_handed(matrix @ shape.matrix))
    points = (_point(name, (matrix @ [*place, 1.0])[:3]) for name, place in shape.points.items())
    return node("shape", shape.plugin, radius=shape.radius * scale).with_(*points)


def _square(matrix: F64) -> bool:
    """Whether a transform keeps the axes orthogonal."""
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    return bool(np.abs(gram - np.diag(np.diag(gram))).max() <= 1e-9 * np.diag(gram).max())


def _point(name: str, position: F64) -> Node:
    return Node("point", vector(name, position).attributes)


def ply(shell: Shell) -> bytes:
    """A PLY file: positions, then optional normals, u, v and colours; triangles."""
    columns = {axis: shell.positions[:, k] for k, axis in enumerate("xyz")}
    for names, values in (("nx ny nz", shell.normals), ("u v", shell.uvs), ("r g b", shell.colors)):
        if values is not None:
            columns |= {column: values[:, k] for k, column in enumerate(names.split())}
    return ply_file.encode({name: values.astype(np.float32) for name, values in columns.items()}, shell.triangles)
