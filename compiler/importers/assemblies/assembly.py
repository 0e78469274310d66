"""The result of readers of assemblies: meshes, materials, and the places of meshes, in the frame of the file."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...mesh.polygon_mesh import PolyMesh


class AssemblyError(Exception):
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
