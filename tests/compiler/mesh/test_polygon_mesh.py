"""Polygon meshes are split by labels of their faces."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.mesh import polygon_mesh
from maquette.compiler.scene.row_records import MeshAttribute

KIND = ir.Interpolation


def mesh() -> polygon_mesh.PolyMesh:
    """A square, a triangle and a pentagon among 12 points."""
    random = np.random.default_rng(1)
    counts, indices = np.array([4, 3, 5]), np.array([9, 2, 5, 7, 2, 9, 1, 0, 7, 3, 11, 4])
    given = {"normals": (12, KIND.CORNER), "uvs": (12, KIND.VERTEX), "colors": (3, KIND.FACE)}
    attributes = {name: MeshAttribute(random.random((rows, 3)).astype(np.float32), kind) for name, (rows, kind) in given.items()}
    return polygon_mesh.PolyMesh(random.random((12, 3)), counts, indices, **attributes, groups=np.array([1, 0, 2]))


def values(attribute: MeshAttribute | None, mesh: polygon_mesh.PolyMesh) -> np.ndarray:
    """An attribute at the corners of a mesh."""
    assert attribute is not None
    of_faces = np.repeat(np.arange(len(mesh.counts)), mesh.counts)
    rows = {KIND.VERTEX: mesh.indices, KIND.FACE: of_faces, KIND.CORNER: np.arange(len(mesh.indices))}
    return attribute.values[rows[attribute.interpolation]]


def test_parts_have_the_faces_of_their_label():
    whole = mesh()
    found = dict(polygon_mesh.split(whole, np.array([7, 3, 7])))
    assert list(found) == [3, 7]
    for label, faces in ((3, [1]), (7, [0, 2])):
        part, expected = found[label], polygon_mesh.subset(whole, np.array(faces))
        assert part.counts.tolist() == expected.counts.tolist()
        assert part.groups is not None
        assert expected.groups is not None
        assert part.groups.tolist() == expected.groups.tolist()
        assert (part.points[part.indices] == expected.points[expected.indices]).all()
        assert len(part.points) == len(np.unique(expected.indices))
        for name in ("normals", "uvs", "colors"):
            assert (values(getattr(part, name), part) == values(getattr(expected, name), expected)).all()


@pytest.mark.parametrize("faces", [0, 3])
def test_faces_of_one_label_are_the_mesh_itself(faces):
    whole = polygon_mesh.subset(mesh(), np.arange(faces))
    assert [(label, part is whole) for label, part in polygon_mesh.split(whole, np.zeros(faces, np.int64))] == [(0, True)] * (faces > 0)
