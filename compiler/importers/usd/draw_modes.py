"""Stand-ins of models by model:drawMode: the edges of their bounds, the axes of their frame, or textured cards.

The rules are those of UsdGeomModelAPI; corners and texture coordinates of cards are those of OpenUSD's usdImaging.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from ....lang.diagnostics import Span
from ... import ir
from ...ir import F64
from ...mesh.polygon_mesh import PolyMesh
from ...scene import metallic_roughness
from ...scene.builder import NONE
from ...scene.row_records import WHITE, Color, Input, MeshAttribute, TextureData, as_color
from .. import images
from . import geometry, stage
from .assets import Asset, asset, contents
from .materials import DEFAULT_COLOR, DISPLAY_COLOR, Materials

MODES = ("bounds", "origin", "cards")
_PURPOSES = [UsdGeom.Tokens.default_, UsdGeom.Tokens.proxy, UsdGeom.Tokens.render]
_LINE = 0.005  # width of the edges of bounds, over their diagonal
_AXIS = 0.01  # width of the axes of a frame, of length 1
_GAP = 1e-4  # between the two cards of an axis, over the extent
_THRESHOLD = 0.1  # of the opacity of cards
_FACES = ("XPos", "YPos", "ZPos", "XNeg", "YNeg", "ZNeg")
_QUAD = np.array([(1.0, 1.0), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0)])


def resolved_mode(prim: Any, inherited: str) -> str:
    """The draw mode at a prim whose parent has `inherited`."""
    attribute = prim.GetAttribute("model:drawMode")
    written = str(attribute.Get()) if attribute else "inherited"
    return written if written in (*MODES, "default") else inherited


def is_replaced(prim: Any, mode: str) -> bool:
    """Whether a stand-in is drawn for a prim and its descendants: with model:applyDrawMode, and for components without it."""
    if mode == "default":
        return False
    attribute = prim.GetAttribute("model:applyDrawMode")
    return bool(attribute.Get()) if attribute and attribute.HasAuthoredValue() else prim.IsComponent()


def stand_in(prim: Any, mode: str, materials: Materials) -> list[tuple[int, int]]:
    """(geometry, material) of each part of the stand-in, in the frame of the prim."""
    builder, span, name = materials.builder, materials.opened.span(prim), str(prim.GetName())
    color = _color(prim, materials)
    texture_cards = mode == "cards" and str(prim.GetAttribute("model:cardGeometry").Get()) == "fromTexture"
    if texture_cards:
        return _cards_of_textures(prim, color, materials, span)
    bounds = _bounds(prim)
    if mode != "origin" and bounds is None:
        materials.tell(f"this model has no extent: its {mode} are not drawn", prim)
        return []
    if mode == "cards" and bounds is not None:
        return _cards(prim, bounds, color, materials, span)
    lines = _bars(np.stack([np.zeros((3, 3)), np.eye(3)], axis=1), _AXIS) if bounds is None or mode == "origin" else _edges(bounds)
    row = geometry.row(lines, builder, span, name)
    return [(row, materials.plain(color, 1.0, DISPLAY_COLOR))] if row != NONE else []


def _color(prim: Any, materials: Materials) -> Color:
    components = stage.numbers(prim.GetAttribute("model:drawModeColor"), materials.opened.time, np.float64)
    return materials.without_negatives(as_color(components), prim, "the drawModeColor") if len(components) == 3 else DEFAULT_COLOR


def _bounds(prim: Any) -> F64 | None:
    """The bounds (2, 3) of a model in its own frame at the earliest time, from extentsHint where it has one."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), _PURPOSES, useExtentsHint=True)
    box = cache.ComputeUntransformedBound(prim).ComputeAlignedRange()
    bounds = np.array([box.GetMin(), box.GetMax()], np.float64)
    return None if box.IsEmpty() or not np.isfinite(bounds).all() else bounds


def _edges(bounds: F64) -> PolyMesh:
    """The twelve edges of a box as bars."""
    corners = np.array(list(product((0, 1), repeat=3)))
    pairs = [(a, b) for a, b in product(range(8), repeat=2) if a < b and np.abs(corners[a] - corners[b]).sum() == 1]
    places = np.where(corners == 0, bounds[0], bounds[1])
    return _bars(places[np.array(pairs)], _LINE * float(np.linalg.norm(bounds[1] - bounds[0])))


def _bars(segments: F64, width: float) -> PolyMesh:
    """Square bars along segments (n, 2, 3) that are parallel to an axis."""
    low, high = segments.min(axis=1) - width / 2, segments.max(axis=1) + width / 2
    corners = np.array(list(product((0, 1), repeat=3)))
    points = np.where(corners == 0, low[:, None], high[:, None])
    faces = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    rows = faces[None] + 8 * np.arange(len(segments))[:, None, None]
    return PolyMesh(points.reshape(-1, 3), np.full(6 * len(segments), 4), rows.reshape(-1))


def _cards(prim: Any, bounds: F64, color: Color, materials: Materials, span: Span) -> list[tuple[int, int]]:
    """The cards of the axes that have a picture, or all of them; one picture serves both cards of an axis."""
    written = [getattr(stage.value(prim.GetAttribute(f"model:cardTexture{face}"), materials.opened.time), "path", "") for face in _FACES]
    box = str(prim.GetAttribute("model:cardGeometry").Get()) == "box"
    up = "XYZ".index(str(UsdGeom.GetStageUpAxis(prim.GetStage())).upper())
    simple = _visibility(prim) == "simple"
    cards, rows = [], {}
    for k in range(6):
        axis, other = k % 3, (k + 3) % 6
        if (any(written) and not (written[k] or written[other])) or (simple and axis == up):
            continue
        source = k if written[k] else other
        quad = bounds[0] + (bounds[1] - bounds[0]) * _corners(k, box)
        mesh = PolyMesh(quad, np.array([4]), np.arange(4), uvs=MeshAttribute(_coordinates(k, source != k)))
        row = geometry.row(mesh, materials.builder, span, f"{prim.GetName()} {_FACES[k]}")
        if row != NONE:
            if source not in rows:
                rows[source] = _card_material(_file(prim, source, materials) if written[source] else None, color, materials, span)
            cards.append((row, rows[source]))
    return cards


def _corners(face: int, box: bool) -> F64:
    """The corners (4, 3) of a card in the unit cube, counter-clockwise from outside."""
    turned = np.column_stack([np.full(4, 1.0 if box else 0.5 + _GAP), [1, 0, 0, 1], [1, 1, 0, 0]])
    if face >= 3:
        turned = turned[::-1]
    x, y, z = turned.T
    placed = np.stack([(x, y, z), (1 - y, x, z), (y, z, x)][face % 3], axis=1)
    return placed if face < 3 else 1.0 - placed


def _coordinates(face: int, borrowed: bool) -> F64:
    """Texture coordinates (4, 2) of a card; a picture `borrowed` from the opposite card is mirrored."""
    if face % 3 < 2:
        across, upright = borrowed, False
    else:
        across, upright = face == 5, borrowed == (face == 2)
    flips = np.array([across, upright])
    return np.where(flips, 1.0 - _QUAD, _QUAD)


def _visibility(prim: Any) -> str:
    """The own or inherited model:cardVisibility: full or simple."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute("model:cardVisibility")
        if attribute and str(attribute.Get()) in ("full", "simple"):
            return str(attribute.Get())
        prim = prim.GetParent()
    return "full"


def _file(prim: Any, face: int, materials: Materials) -> Asset | None:
    value = stage.value(prim.GetAttribute(f"model:cardTexture{_FACES[face]}"), materials.opened.time)
    return asset(value, materials.warnings, prim) if getattr(value, "path", "") else None


def _card_material(file: Asset | None, color: Color, materials: Materials, span: Span) -> int:
    """A matt material with a picture and its opacity; of one colour where the picture cannot be read."""
    builder = materials.builder
    try:
        image = file.row(builder, "auto", span=span) if file else NONE
    except images.ImageError as failure:
        builder.diagnostics.warning(failure.message, span, failure.hint)
        image = NONE
    if image == NONE:
        return materials.plain(color, 1.0, DISPLAY_COLOR)
    picture, alpha = (
        builder.texture(TextureData(ir.TextureKind.IMAGE, image, wrap_u=ir.Wrap.CLAMP, wrap_v=ir.Wrap.CLAMP, channel=channel))
        for channel in (-1, 3)
    )
    surface = metallic_roughness.Surface(
        Input(WHITE, picture), roughness=metallic_roughness.ALL, opacity=Input.number(1.0, alpha), threshold=_THRESHOLD, name="card"
    )  # fmt: skip
    return builder.material(metallic_roughness.material(surface))


def _cards_of_textures(prim: Any, color: Color, materials: Materials, span: Span) -> list[tuple[int, int]]:
    """A card for each picture whose metadata worldtoscreen maps it to the square from −1 to 1."""
    cards = []
    for k, face in enumerate(_FACES):
        file = _file(prim, k, materials)
        if file is None:
            continue
        matrix = _world_to_screen(file)
        if matrix is None:
            materials.tell(f"the card of `{Path(file.path).name}` is not drawn: its metadata have no worldtoscreen matrix", prim)
            continue
        corners = np.column_stack([2.0 * _QUAD - 1.0, np.zeros(4), np.ones(4)]) @ matrix
        mesh = PolyMesh(corners[:, :3] / corners[:, 3:], np.array([4]), np.arange(4), uvs=MeshAttribute(_QUAD))
        row = geometry.row(mesh, materials.builder, span, f"{prim.GetName()} {face}")
        if row != NONE:
            cards.append((row, _card_material(file, color, materials, span)))
    return cards


def _world_to_screen(file: Asset) -> F64 | None:
    """The inverse (4, 4), for row vectors, of a picture's worldtoscreen matrix; older libraries call it worldtoNDC."""
    try:
        matrix = images.matrix(contents(file.path), Path(file.path).name, ("worldtoscreen", "worldtoNDC"))
        inverse = np.linalg.inv(matrix) if matrix is not None else None
    except (images.ImageError, OSError, np.linalg.LinAlgError):
        return None
    return inverse if inverse is not None and np.isfinite(inverse).all() else None
