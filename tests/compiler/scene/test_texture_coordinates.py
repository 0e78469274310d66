"""The warning about pictures on meshes without texture coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula.tape import X
from maquette.compiler.scene import texture_coordinates
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import Input, InstanceData, MaterialData, MeshAttribute, MeshData, TextureData
from maquette.compiler.texture_graph.graph_builder import GraphBuilder
from maquette.compiler.texture_graph.opcodes import U, V
from maquette.lang.diagnostics import Diagnostics, Span

QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(("uvs", "size", "blended", "warned"), [
    (None, 2, False, True), (None, 2, True, True), (None, 1, False, False), (QUAD[:, :2], 2, False, False),
])  # fmt: skip
def test_pictures_on_meshes_without_coordinates(uvs: np.ndarray | None, size: int, blended: bool, warned: bool) -> None:
    """A picture of one texel needs no coordinates; a picture in a part of a blend does."""
    b = SceneBuilder()
    picture = b.texture(TextureData(ir.TextureKind.IMAGE, b.image(np.ones((size, size, 4), np.float32))))
    painted = b.material(MaterialData(inputs={ir.Slot.DIFFUSE: Input(texture=picture)}))
    if blended:
        painted = b.material(MaterialData(ir.MaterialModel.BLEND, first=b.default_material(), second=painted))
    mesh = b.mesh(MeshData(QUAD, TRIANGLES, uvs=None if uvs is None else MeshAttribute(uvs)))
    for name in ("bare", "other"):
        b.instance(InstanceData(mesh, 0, painted, name=name), Span("a.scene", 3))
    found = Diagnostics()
    texture_coordinates.warn_of_missing_coordinates(b.finish(), found)
    message = "`bare` has a material with pictures and no texture coordinates: each picture shows one texel (and 1 more)"
    assert [(d.message, d.span) for d in found.items] == ([(message, Span("a.scene", 3))] if warned else [])


@pytest.mark.parametrize(("name", "warned"), [(U, True), (V, True), (X, False)])
@pytest.mark.parametrize("scaled", [True, False])
def test_graphs_that_read_coordinates_need_them(name: int, warned: bool, scaled: bool) -> None:
    b, graph = SceneBuilder(), GraphBuilder()
    tape = graph.finish(graph.scale(name, 2.0) if scaled else name)
    row = b.texture(TextureData(ir.TextureKind.FORMULA, tape=b.tape(tape)))
    painted = b.material(MaterialData(inputs={ir.Slot.DIFFUSE: Input(texture=row)}))
    b.instance(InstanceData(b.mesh(MeshData(QUAD, TRIANGLES)), 0, painted, name="bare"))
    diagnostics = Diagnostics()
    texture_coordinates.warn_of_missing_coordinates(b.finish(), diagnostics)
    assert bool(diagnostics.items) == warned
