"""Exports instances as POV-Ray objects: analytic shapes natively, meshes and textured shapes as mesh2."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....shapes import SHAPES
from ... import ir
from ...mesh import shells
from ...mesh.shells import Shell
from ...plan.plan import Plan
from .. import number_text, placement, texture_values
from ..export import Export
from ..number_text import number
from ..placement import F64
from .materials import Finishes


def bracket(values: Any) -> str:
    """A vector: <x, y, z>."""
    return f"<{number_text.numbers(values)}>"


def objects(out: Export, plan: Plan, finishes: Finishes, tessellate: shells.Tessellate) -> list[str]:
    """All instances, each an object with texture and transform."""
    tables, lines = out.scene.tables, []
    for i, light in enumerate(tables.instances.light.tolist()):
        if light < 0:
            lines += _Object(out, plan, finishes, tessellate, i).text()
    return lines


class _Object:
    """One instance."""

    def __init__(self, out: Export, plan: Plan, finishes: Finishes, tessellate: shells.Tessellate, i: int) -> None:
        self.out, self.plan, self.finishes, self.tessellate, self.i = out, plan, finishes, tessellate, i
        self.tables = out.scene.tables
        self.g = int(self.tables.instances.geometry[i])
        self.material = int(self.tables.instances.material[i])
        self.kind = ir.GeometryKind(int(self.tables.geometries.kind[self.g]))
        self.matrix = placement.world(self.tables, i)

    def text(self) -> list[str]:
        look = self.finishes.look(self.material)
        texture = look.texture
        if texture >= 0 and not texture_values.follows_uv(self.tables, texture, self.kind):
            name = ir.TextureMapping(int(self.tables.textures.mapping[texture])).name.lower()
            self.out.cannot(f"the mapping {name} is not carried: only a surface's own coordinates are", "textures", texture)
        shape = self._shape(texture)
        if shape is None:
            return []
        head, body = shape
        pigment = look.pigment if texture < 0 else look.pigment.replace("PLACE", self._place(texture))
        mapping = "uv_mapping " if texture >= 0 and self.kind != ir.GeometryKind.PLANE else ""
        flags = self._flags(look.glass)
        place = f"  matrix <{number_text.numbers(self.matrix[:3].T)}>"
        texture_lines = ["  texture {", f"    {mapping}pigment {{ {pigment} }}", f"    {look.finish}", "  }"]
        lines = [f"{head} {{", *body, *texture_lines, *look.more, place, *flags, "}"]
        if look.glass and self.tables.instances.visible[self.i] & ir.Visibility.SHADOW:
            # our shadow rays stop at glass, POV-Ray's pass: a copy visible to shadow rays only stops them
            lines += [f"{head} {{", *body, "  pigment { rgb 0 }", place, "  no_image no_reflection", "}"]
        return ["\n".join(lines)]

    def _flags(self, glass: bool) -> list[str]:
        visible = int(self.tables.instances.visible[self.i])
        flags = []
        if not visible & ir.Visibility.CAMERA:
            flags.append("no_image")
        if not visible & ir.Visibility.REFLECTION:
            flags.append("no_reflection")
        if glass or not visible & ir.Visibility.SHADOW:
            flags.append("no_shadow")
        return [f"  {' '.join(flags)}"] if flags else []

    # --- shapes ---

    def _shape(self, texture: int) -> tuple[str, list[str]] | None:
        p, kind = self.tables.geometries.parameters[self.g], self.kind
        if kind == ir.GeometryKind.MESH:
            return self._mesh(shells.mesh(self.tables, self.g), texture)
        if texture >= 0 and kind != ir.GeometryKind.PLANE:
            return self._meshed(texture)
        return self._native(kind, [float(v) for v in p])

    def _native(self, kind: ir.GeometryKind, p: list[float]) -> tuple[str, list[str]] | None:
        shape = SHAPES.get(kind)
        return self._meshed(-1) if shape is None or shape.povray is None else shape.povray(p, PovrayText())

    def _meshed(self, texture: int) -> tuple[str, list[str]] | None:
        if self.out.is_endless(self.i, "a texture on " if texture >= 0 else ""):
            return None
        shell = Shell(*self.tessellate(self.i))
        self.out.tessellated(self.kind, self.i, len(shell.triangles), self.plan["tolerance"])
        return self._mesh(shell, texture)

    def _mesh(self, shell: Shell, texture: int) -> tuple[str, list[str]]:
        if int(self.tables.geometries.colors[self.g]) >= 0:
            self.out.cannot("the mesh's colours are not carried", "instances", self.i)
        if self.tables.materials.shading[self.material] == ir.Shading.FLAT:
            shell = shell._replace(normals=None)
        if texture >= 0 and self.tables.textures.kind[texture] != ir.TextureKind.IMAGE:
            shell = texture_values.with_cells(self.tables, texture, shell, placement.mean_scale(self.matrix))
        elif texture >= 0 and shell.uvs is not None:
            frame = texture_values.texture_matrix(self.tables, texture)
            shell = shell._replace(uvs=shell.uvs @ frame[:2, :2].T + frame[:2, 2])
        body = [_list("vertex_vectors", shell.positions)]
        if shell.normals is not None:
            body.append(_list("normal_vectors", shell.normals))
        if texture >= 0 and shell.uvs is not None:
            body.append(_list("uv_vectors", shell.uvs))
        body.append(_list("face_indices", shell.triangles))
        return "mesh2", [*body, "  inside_vector <0.1234, 1, 0.0567>"]  # inside test, required for glass

    # --- textures ---

    def _place(self, texture: int) -> str:
        """The mapping of a pigment: coordinates on a mesh; on a plane a matrix from x, z to cells or to the image."""
        if self.kind != ir.GeometryKind.PLANE:
            return ""
        tables = self.tables
        frame = texture_values.texture_matrix(tables, texture)  # of u = x, v = -z
        if tables.textures.kind[texture] != ir.TextureKind.IMAGE:
            size = float(tables.textures.size[texture])
            frame[:2] *= placement.mean_scale(self.matrix) / size if size > 0.0 else 8.0
            if tables.textures.kind[texture] == ir.TextureKind.STRIPES:
                frame[1] = [0.0, 0.0, 0.5]
        return pattern_matrix(frame)


def pattern_matrix(frame: F64) -> str:
    """The `matrix` that maps a pattern onto a plane's x, z: (frame · (x, -z, 1), 0.5) is the pattern's point."""
    take = np.eye(4)
    take[:2, 0], take[:2, 2], take[:2, 3] = frame[:2, 0], -frame[:2, 1], frame[:2, 2]
    take[1, 1] = 0.0
    take[2] = [0.0, 1.0, 0.0, 0.5]
    if abs(np.linalg.det(take[:3, :3])) < 1e-12:  # stripes: the whole second axis lies in one cell
        across = np.array([take[0, 2], 0.0, -take[0, 0]])
        take[1, :3] = across * 1e-9
    back = np.linalg.inv(take)
    return f"matrix <{', '.join(f'{v + 0.0:.17g}' for v in back[:3].T.ravel())}>"  # all digits: POV-Ray inverts the matrix again


class PovrayText:
    """Numbers and vectors of POV-Ray."""

    number = staticmethod(number)
    vector = staticmethod(bracket)


def _list(name: str, rows: Any) -> str:
    """`name { count, <…>, <…> }`, one item a line."""
    array = np.asarray(rows)
    shown = (f"<{', '.join(map(str, row))}>" for row in array.tolist())
    if array.dtype.kind == "f":
        shown = (f"<{', '.join(f'{v:.9g}' for v in row)}>" for row in array.tolist())
    return f"  {name} {{ {len(array)},\n    " + ",\n    ".join(shown) + "\n  }"
