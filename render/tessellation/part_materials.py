"""Materials of a printable mesh: which material each triangle has, and its color."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.formula import numpy_interpreter
from ...compiler.formula.tape import load_tape
from ...compiler.mesh.parts import Material
from ...compiler.scene.row_records import DEFAULT_MATERIAL
from ...compiler.texture_graph.opcodes import is_graph
from ...materials import traits
from ...materials.contract import Lobes
from ..image.srgb import encode_srgb

_SLOT = ir.Slot


def triangle_materials(tables: ir.Tables, i: int, centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """(m,) rows of the materials of an instance at points (m, 3) of the world: of blends, the part with the greater weight."""
    materials = tables.materials
    rows = np.full(len(centers), int(tables.instances.material[i]), np.int64)
    inverse = tables.transforms.inverse[tables.instances.transform[i]]
    local = centers @ inverse[:, :3].T + inverse[:, 3]
    blended = traits.has(tables, Lobes.PARTS)
    while (blends := np.unique(rows[blended[rows]])).size:
        for row in blends.tolist():
            blended_rows = np.flatnonzero(rows == row)
            second = _weights(tables, row, local[blended_rows]) > 0.5
            rows[blended_rows] = np.where(second, materials.second[row], materials.first[row])
    return rows


def _weights(tables: ir.Tables, row: int, local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weight of the second part of a blend at points of the instance's frame; textures other than formulas of the point count 1."""
    weight = np.full(len(local), float(tables.materials.values[row, _SLOT.WEIGHT, 0]))
    texture = int(tables.materials.textures[row, _SLOT.WEIGHT])
    if texture >= 0 and tables.textures.kind[texture] == ir.TextureKind.FORMULA:
        tape = load_tape(tables, int(tables.textures.tape[texture]))
        if is_graph(tape.code, tape.results):
            return weight
        value = numpy_interpreter.points(tape, *local.T)[0]
        weight = weight * (tables.textures.gain[texture, 0] * value + tables.textures.bias[texture, 0])
    return weight


def material_of(scene: ir.Scene, row: int) -> Material:
    """Name and color of a material; textures are left out."""
    tables, names = scene.tables, scene.names.materials
    linear = tables.materials.values[row, traits.color_slots(tables)[row]]
    linear = linear / max(float(linear.max()), 1.0)  # emission may exceed 1
    name = names[row] if row < len(names) else ""
    return Material(name or f"material{row}", tuple(encode_srgb(linear).tolist()), name == DEFAULT_MATERIAL)
