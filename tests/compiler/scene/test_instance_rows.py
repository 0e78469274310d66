"""Rows and names of many instances."""

import numpy as np
from maquette.compiler import ir
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics, Span

COUNT = 70_000


def test_copies_between_single_instances():
    found = Diagnostics()
    builder = SceneBuilder(found)
    ball = builder.geometry(ir.GeometryKind.SPHERE, (1.0,))
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, 0, 3] = np.arange(COUNT)
    matrices[7, :3, :3] = 0.0
    builder.instances([ball], [0], [-1], ["first"], [None])
    builder.copies(ball, matrices, np.arange(COUNT) % 2, "many", np.arange(COUNT), Span("a"))
    builder.copies(ball, matrices[:2], np.zeros(2, int), "few", np.array([4, 9]), Span("a"))
    builder.instances([ball], [0], [1], ["last"], [None])
    scene = builder.finish()
    t = scene.tables
    assert [d.message for d in found.items] == ["this is flattened to nothing by its transform (no inverse): it is not drawn"]
    assert len(t.instances.geometry) == len(scene.names.instances) == COUNT + 3
    assert {len(scene.spans.rows[table]) for table in ("instances", "calls")} == {COUNT + 3}
    names = list(scene.names.instances)
    assert (names[0], names[1], names[7], names[8], names[-3:]) == ("first", "many[0]", "many[6]", "many[8]", ["few[4]", "few[9]", "last"])
    assert list(scene.names.instances[-3:]) == names[-3:]
    places = t.transforms.matrix[t.instances.transform, 0, 3]
    assert places.tolist() == [0, *(k for k in range(COUNT) if k != 7), 0, 1, 0]
    assert (np.einsum("nij,nj->ni", t.transforms.inverse[:, :, :3], t.transforms.matrix[:, :, 3]) == -t.transforms.inverse[:, :, 3]).all()
    assert t.instances.material[1:5].tolist() == [0, 1, 0, 1]
    assert t.instances.visible.tolist() == [t.instances.visible[0]] * (COUNT + 3)
    bounds = builder.world_bounds()
    assert bounds is not None
    assert bounds.tolist() == [[-1, -1, -1], [COUNT, 1, 1]]
