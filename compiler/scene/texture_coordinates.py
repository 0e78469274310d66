"""Warns of meshes whose material has pictures and which have no texture coordinates."""

from __future__ import annotations

import numpy as np

from ...lang.diagnostics import Diagnostics
from .. import ir
from ..formula.tape import load_tape
from ..texture_graph import opcodes as graph_opcodes


def warn_of_missing_coordinates(scene: ir.Scene, diagnostics: Diagnostics) -> None:
    """One warning, at the first instance of a mesh without coordinates whose material has a picture of more than one texel."""
    tables = scene.tables
    textures, materials, images, instances = tables.textures, tables.materials, tables.images, tables.instances
    shown = np.asarray((textures.kind == ir.TextureKind.IMAGE) & (textures.mapping == ir.TextureMapping.UV))
    if not shown.any() and not (textures.kind == ir.TextureKind.FORMULA).any():
        return
    shown[shown] = (images.width * images.height)[textures.image[shown]] > 1
    for row in np.flatnonzero(textures.kind == ir.TextureKind.FORMULA).tolist():
        shown[row] = graph_opcodes.reads_coordinates(load_tape(tables, int(textures.tape[row])))
    needs = np.asarray(np.append(shown, False)[materials.textures].any(axis=1))
    for row in np.flatnonzero(materials.model == ir.MaterialModel.BLEND).tolist():
        needs[row] = needs[materials.first[row]] or needs[materials.second[row]]
    bare = np.asarray((tables.geometries.kind == ir.GeometryKind.MESH) & (tables.geometries.uvs < 0))
    lost = np.flatnonzero(needs[instances.material] & bare[instances.geometry])
    if not len(lost):
        return
    name, more = scene.names.instances[lost[0]], f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
    message = f"`{name}` has a material with pictures and no texture coordinates: each picture shows one texel{more}"
    diagnostics.warning(message, scene.spans.get("instances", int(lost[0])))
