"""Which primvars of a mesh its material reads: texture coordinates, colours, and a number that varies over the mesh."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pxr import UsdGeom

from ....lang.diagnostics import Diagnostics, Span
from ...ir import F64
from ...mesh.polygon_mesh import corner_values
from ..common import uv_sets
from . import geometry, stage
from .materials import DISPLAY_COLOR, DISPLAY_OPACITY, Materials
from .pictures import udim
from .shaders.network import Fit, Network, Picture

_UV_NAMES = ("st", "UVMap", "uv", "map1", "Texture_uv")


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Faces of a mesh (None: all) whose material is used alike."""

    faces: np.ndarray | None
    fit: Fit = field(default_factory=Fit)
    name: str = ""


def reads(network: Network | None, prim: Any) -> geometry.Reads:
    """The primvars of the texture coordinates and of varying colours; without pictures a varying number in place of the former."""
    color = network.color_name if network else DISPLAY_COLOR
    color = color if color is not None and varies(prim, color) else None
    numbers = network.numbers if network else (DISPLAY_OPACITY,)
    if network is None or not network.varnames:
        number = next((name for name in numbers if varies(prim, name)), None)
        if number is not None:
            return geometry.Reads(number, color, True)
    return geometry.Reads(network.varnames[0] if network and network.varnames else _uv_name(prim), color)


def varies(prim: Any, name: str) -> bool:
    """Whether a prim's own or inherited primvar is not constant."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    return bool(primvar) and primvar.HasValue() and str(primvar.GetInterpolation()) != "constant"


def _uv_name(prim: Any) -> str | None:
    """The texture coordinates of a mesh whose material names none, for the uv channel."""
    for name in _UV_NAMES:
        attribute = prim.GetAttribute(f"primvars:{name}")
        if attribute and attribute.HasAuthoredValue():
            return name
    return None


def parts(network: Network | None, prim: Any, read: geometry.Reads, faces: np.ndarray | None, materials: Materials) -> list[Part]:
    """The parts of a mesh's faces: one for each map between the texture coordinates that the material's pictures read, and each tile."""
    fit, time = Fit(read.color is not None, number=read.uv if read.ramp else None), materials.opened.time
    others, tiled = network.varnames[1:] if network else (), _tiled(network, materials)
    if not (others or tiled) or str(prim.GetTypeName()) in geometry.SHAPES:
        return [Part(faces, fit)]
    counts, indices = geometry.topology(prim, time)
    points = len(stage.numbers(prim.GetAttribute("points"), time, np.float64, 3))
    if not len(counts) or (counts < 0).any() or counts.sum() != len(indices) or not points:
        return [Part(faces, fit)]
    if not others:
        primvar = geometry.primvar(UsdGeom.PrimvarsAPI(prim), str(read.uv), time, 2, points, counts, Diagnostics(), Span(""))
        if primvar is None:
            return [Part(faces, fit)]
        values = corner_values(primvar, counts, np.clip(indices, 0, points - 1)).astype(np.float64)
        return _by_tiles(values, counts, faces, fit, tiled, materials)
    api, coordinates = UsdGeom.PrimvarsAPI(prim), {}
    for name in (str(read.uv), *others):
        primvar = geometry.primvar(api, name, time, 2, points, counts, Diagnostics(), Span(""))
        if primvar is not None:
            coordinates[name] = corner_values(primvar, counts, np.clip(indices, 0, points - 1)).astype(np.float64)
    present = [name for name in others if name in coordinates]
    maps: dict[str, np.ndarray | None] = dict.fromkeys(others)
    if read.uv not in coordinates or not present:
        return [Part(faces, Fit(fit.colored, maps))]
    groups = uv_sets.split(coordinates[read.uv], np.concatenate([coordinates[name] for name in present], axis=1), counts)
    if groups is None:
        return [Part(faces, Fit(fit.colored, maps))]
    pieces = []
    for k, (rows, affine) in enumerate(groups):
        chosen = rows if faces is None else np.intersect1d(rows, faces)
        if len(chosen):
            each = Fit(fit.colored, maps | dict(zip(present, affine, strict=True)))
            pieces.append(Part(faces, each) if len(groups) == 1 else Part(chosen, each, f"uv{k}"))
    return pieces


def _tiled(network: Network | None, materials: Materials) -> list[tuple[Picture, udim.Tiles]]:
    """The pictures of a material in UDIM tiles, if all have one frame."""
    pictures = [source for source in network.inputs.values() if isinstance(source, Picture)] if network else []
    tiled_pictures = [(each, file.tiles) for each in pictures if (file := materials.file(each)) is not None and file.tiles is not None]
    return tiled_pictures if len({each.frame for each, _ in tiled_pictures}) == 1 else []


def _by_tiles(
    uvs: F64, counts: np.ndarray, faces: np.ndarray | None, fit: Fit, tiled: list[tuple[Picture, udim.Tiles]], materials: Materials
) -> list[Part]:  # fmt: skip
    """The parts of faces with coordinates (c, 2) at their corners: one for each tile, and one for the faces over several tiles."""
    number, several, used = udim.of_faces(uvs, counts, tiled[0][0].frame)
    for picture, tiles in tiled:
        missing = sorted(used - {n for n, _ in tiles.paths})
        if missing and missing != [udim.NO_TILE]:
            names = ", ".join(str(n) for n in missing if n != udim.NO_TILE)
            materials.tell(f"`{tiles.name}` has no tile {names}: its fallback is drawn there", picture.shader.GetPrim())
    groups = [(f"tile{n}", (n,), np.flatnonzero((number == n) & ~several)) for n in np.unique(number[~several]).tolist()]
    groups.append(("tiles", tuple(sorted(used)), np.flatnonzero(several)))
    parts = []
    for name, tiles, rows in groups:
        chosen = rows if faces is None else np.intersect1d(rows, faces)
        if len(chosen):
            is_everything = len(chosen) == len(counts) and faces is None
            parts.append(Part(None if is_everything else chosen, replace(fit, tiles=tiles), "" if is_everything else name))
    return parts

