"""Places 36 and 37: NURBS with repeated knots; what the naive method does at a subdivided corner, and that it is not built yet.

When that is built its test here fails: it then gets a place of its own, with our figure.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from maquette.lang.diagnostics import SceneError

from . import naive


def repeated_knots() -> str:
    values = [naive.basis([0, 0, 0, 1, 1, 1], i, 2, 0.25) for i in range(3)]
    assert np.isnan(values).any()
    return f"0/0 in Cox–de Boor: N = {', '.join(f'{v:.3g}' for v in values)}"


def limit_corner() -> str:
    off = math.dist((1, 1, 1), (0.5, 0.5, 0.5))
    return f"the cage itself: a cube's corner is {off:.2f} from its limit (½, ½, ½)"


WAITING: list[tuple[int, str, Callable[[], str], str, str]] = [
    (37, "Catmull–Clark at a corner", limit_corner, "subdivision(points: [[0, 0, 0]])", "deep subdivision within 10⁻⁴"),
]


@pytest.mark.long
def test_repeated_knots(measured, load):
    """Quarters of a circle joined at double knots, with triple ones at the ends, along a profile that a triple knot breaks."""
    profile = [[1, k, 0.3 * k] for k in range(7)]
    rows = f"[[[p[0] * c[0], p[1], p[0] * c[1], c[2]] for c in surfaces.circle] for p in {profile}]"
    knots = "u_knots: surfaces.circle_knots, v_knots: [0, 0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1, 1]"
    made, said = load(f'use "std/surfaces"\nsurfaces.nurbs({rows}, degree: [2, 3], {knots}, steps: 16)\n')
    assert said == []
    tables = made.tables
    places = tables.pools.positions + tables.geometries.origin[0]
    assert len(places) == 17 * 17
    off = float(np.abs(np.hypot(places[:, 0], places[:, 2]) - 1.0).max())
    attributes = tables.attributes
    row = next(k for k in range(len(attributes.first)) if made.names.attributes[k] == "normals")
    first, count = int(attributes.first[row]), int(attributes.count[row])
    normals = tables.pools.values[first : first + 3 * count].reshape(-1, 3)
    long = float(np.abs(np.linalg.norm(normals, axis=1) - 1.0).max())
    measured.place(
        36, "NURBS with repeated knots", naive=repeated_knots(), ours=f"off the circle by {off:.1g}, normals' lengths by {long:.1g}",
        bound="0/0 = 0, unit normals: 10⁻⁶",
    )  # fmt: skip
    assert off < 1e-6
    assert long < 1e-6


@pytest.mark.parametrize(("number", "name", "plain", "text", "bound"), WAITING, ids=[str(row[0]) for row in WAITING])
def test_places_of_what_is_not_built_yet(measured, load, number, name, plain, text, bound):
    feature = text.partition("(")[0]
    with pytest.raises(SceneError) as caught:
        load(f"camera(position: [0, 0, 5], look_at: [0, 0, 0])\n{text}\n")
    said = [d.message for d in caught.value.diagnostics]
    measured.place(number, name, naive=plain(), ours=f"waits for `{feature}`", bound=bound, note=f"message: {said[0]}")
    assert f"`{feature}` is not built yet" in said


CUBE = """#usda 1.0
( upAxis = "Y"
  metersPerUnit = 1 )
def Mesh "Cube" {
  int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
  int[] faceVertexIndices = [0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6]
  point3f[] points = [(-1, -1, -1), (-1, -1, 1), (-1, 1, -1), (-1, 1, 1), (1, -1, -1), (1, -1, 1), (1, 1, -1), (1, 1, 1)]
}
"""


def test_subdivided_meshes_of_usd_files(measured, load, tmp_path):
    """The cube [−1, 1]³ as OpenUSD means it: its corners' limits are (±½, ±½, ±½)."""
    (tmp_path / "a.usda").write_text(CUBE, encoding="utf-8")
    loaded, said = load('camera(position: [0, 0, 5])\nusd("a.usda")\n')
    corner = np.abs(loaded.tables.pools.positions + loaded.tables.geometries.origin[0]).max(axis=0)
    off = math.dist(corner.tolist(), (0.5, 0.5, 0.5))
    measured.place(
        37, "a USD mesh, subdivided by default", naive=f"the cage: corners off by {math.dist((1, 1, 1), (0.5, 0.5, 0.5)):.2f}",
        ours=f"off by {off:.2f}; message: {'; '.join(said) or 'nothing'}", bound="10⁻⁴, or a message",
    )  # fmt: skip
    assert off < 1e-4 or said
