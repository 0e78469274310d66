"""The result of readers of assemblies: meshes, materials, and the places of meshes, in the frame of the file."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....lang import file_types
from ....lang.diagnostics import Span
from ...mesh import polygon_mesh
from ...mesh.polygon_mesh import PolyMesh
from ...scene import partial_coverage
from ...scene.builder import SceneBuilder
from ...scene.row_records import Input, as_color, lambert
from ..common import vertex_colors
from ..common.mesh_options import MeshOptions
from ..common.mesh_parts import Frame, MeshFile, MeshFileError, Part, add


class AssemblyError(MeshFileError):
    """A file that cannot be read. The caller adds the span."""


class BaseMaterial(NamedTuple):
    """A colour with a name."""

    name: str
    color: tuple[float, float, float]  # sRGB, 0 to 1
    opacity: float = 1.0


class AssemblyMesh(NamedTuple):
    """A mesh of faces, each with a material."""

    name: str
    mesh: PolyMesh
    material: np.ndarray  # (f,) rows of Assembly.materials; -1: none


class Place(NamedTuple):
    """A mesh in the file's frame."""

    mesh: int  # row of Assembly.meshes
    matrix: np.ndarray  # (4, 4)
    name: str


class Assembly(NamedTuple):
    """The content of a file."""

    unit: float  # metres
    up: str  # axis that points up: "x", "y" or "z"
    meshes: list[AssemblyMesh]
    materials: list[BaseMaterial]
    places: list[Place]


def parts_of(file: MeshFile, read: Callable[[bytes, Callable[[str], None]], Assembly]) -> list[Part]:
    """The parts of a file of meshes with places and materials: each mesh is one geometry for each of its materials."""
    span, messages, builder = file.span, set[str](), file.builder

    def warn(message: str) -> None:
        if message not in messages:
            messages.add(message)
            file.diagnostics.warning(message, span)

    assembly = read(file.data, warn)
    settings = file.options or MeshOptions()
    frame = Frame(assembly.unit if settings.unit is None else file_types.UNITS[settings.unit], settings.up or assembly.up)
    materials = [_base_row(material, builder, span) for material in assembly.materials]
    pieces: list[list[tuple[int, int | None, str]]] = []
    for each in assembly.meshes:
        title, rows = each.name or file.stem, []
        repaired, source = file.repaired(each.mesh, title)
        for k, mesh in polygon_mesh.split(repaired, each.material if source is None else each.material[source]):
            part = add(mesh, None if k < 0 else materials[k], title, builder, file.diagnostics, span, frame)
            label = assembly.materials[k].name if k >= 0 else ""
            rows += [] if part is None else [(part.geometry, part.material, label)]
        pieces.append(rows)
    return [
        Part(geometry, material, place.name or file.stem, frame.placed(place.matrix)[:3], label)
        for place in assembly.places
        for geometry, material, label in pieces[place.mesh]
    ]


def _base_row(material: BaseMaterial, builder: SceneBuilder, span: Span) -> int:
    """The row of a matt material of a colour."""
    color = as_color(vertex_colors.linear(np.array(material.color)))
    plain = lambert(color, name=material.name)
    return builder.material(partial_coverage.with_opacity(plain, Input.number(material.opacity)), span)
