"""What files of triangles lack of a scene's colours, as warnings."""

from __future__ import annotations

from collections.abc import Sequence

from ...lang.diagnostics import Diagnostic
from .. import ir
from .mesh_files import Part


def losses(scene: ir.Scene, parts: Sequence[Part], ending: str) -> list[Diagnostic]:
    """A warning for each texture, and for colours of vertices, that a file with the ending lacks."""
    materials, spans = scene.tables.materials, scene.spans
    used = sorted({row for part in parts for row in part.rows})
    textured = [row for row in used if (materials.textures[row] >= 0).any()]
    message, hint = f"a texture is not carried: a {ending} file has none", ".glb and .usdz hold pictures"
    losses = [Diagnostic("warning", message, spans.at("materials", row), hint) for row in textured]
    tinted = [part.instance for part in parts if part.colors is not None]
    if ending == ".stl" and tinted:
        message, hint = "colours of vertices are not carried: a .stl file has none", ".ply, .obj and .3mf hold colours"
        losses.append(Diagnostic("warning", message, spans.at("instances", tinted[0]), hint))
    return losses
