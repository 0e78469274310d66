"""Subdivision surfaces against known limit points, B-spline surfaces, and what creases, corners and boundaries must keep."""

# pyright: reportOptionalMemberAccess=false

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.mesh import subdivision
from maquette.compiler.mesh.polygon_mesh import PolyMesh
from maquette.compiler.mesh.subdivision import Scheme
from maquette.compiler.scene.row_records import MeshAttribute

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
TRIANGLES = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
EDGES = np.array(sorted({tuple(sorted((f[k], f[(k + 1) % 4]))) for f in QUADS for k in range(4)}))


def poly(points, faces, **more):
    return PolyMesh(np.asarray(points, float), np.array([len(f) for f in faces]), np.concatenate(faces), **more)


def grid(n, height=lambda x, y: 0 * x):
    """n × n quads over 0 … n."""
    y, x = np.mgrid[0 : n + 1, 0 : n + 1].astype(float)
    points = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    at = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1)
    return points, [[a, a + 1, a + n + 2, a + n + 1] for a in at.tolist()]


PLAIN = Scheme()


def limits(mesh, scheme=PLAIN, level=2):
    return subdivision.refine(mesh, scheme, level)[0]


@pytest.mark.parametrize("level", [1, 2, 3])
def test_corners_of_a_cube_go_to_their_limit(level):
    """(9 p + 4 Σ edges + Σ faces) / 24 at valence 3 (Halstead et al. 1993): one half, at every level."""
    assert np.allclose(limits(poly(CUBE, QUADS), level=level).points[:8], CUBE / 2)


def test_a_cube_becomes_a_round_closed_body():
    made = limits(poly(CUBE, QUADS), level=4)
    radius = np.linalg.norm(made.points, axis=1)
    assert (len(made.counts), radius.min() > 0.7, radius.max() < 0.9) == (2 * 6 * 4**4, True, True)
    normals = made.normals.values
    corners = made.points[made.indices]
    assert np.einsum("ij,ij->i", normals, corners / np.linalg.norm(corners, axis=1)[:, None]).min() > 0.98  # outwards
    triangles = corners.reshape(-1, 3, 3)
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    assert np.einsum("tci,ti->tc", normals.reshape(-1, 3, 3), flat).min() > 0.995


def test_a_regular_grid_is_the_bicubic_b_spline():
    """Away from boundaries, the limit of a control point is (1 4 1)ᵀ(1 4 1) / 36 of its neighbours."""
    points, faces = grid(6, lambda x, y: np.sin(3 * x) * y**2)
    made = limits(poly(points, faces), level=1)
    z = points[:, 2].reshape(7, 7)
    row = (z[1:-1] * 4 + z[:-2] + z[2:]) / 6
    expected = (row[:, 1:-1] * 4 + row[:, :-2] + row[:, 2:]) / 6
    assert np.allclose(made.points[:49, 2].reshape(7, 7)[1:-1, 1:-1], expected)


def test_a_boundary_is_a_cubic_b_spline_and_keeps_its_corners():
    points, faces = grid(4, lambda x, y: x**2)
    made = limits(poly(points, faces), level=2)
    assert np.allclose(made.points[[0, 4, 20, 24]], points[[0, 4, 20, 24]])
    assert np.allclose(made.points[2], (points[1] + 4 * points[2] + points[3]) / 6)
    rounded = limits(poly(points, faces), Scheme(boundary="edgeOnly"))
    assert np.allclose(rounded.points[0], (4 * points[0] + points[1] + points[5]) / 6)


def test_without_boundary_interpolation_the_outer_faces_are_left_out():
    points, faces = grid(4)
    made, parents = subdivision.refine(poly(points, faces), Scheme(boundary="none"), 2)
    assert sorted(set(parents.tolist())) == [5, 6, 9, 10]
    assert len(made.counts) == 4 * 2 * 16


def test_infinitely_sharp_edges_keep_the_cube():
    made = limits(poly(CUBE, QUADS), Scheme(crease_edges=EDGES, crease_sharpness=np.full(12, 10.0)), 2)
    assert np.allclose(np.abs(made.points).max(axis=1), 1)
    assert np.allclose(made.points[:8], CUBE)
    faces = made.normals.values.reshape(-1, 3, 3)
    assert np.allclose(np.abs(faces).max(axis=2), 1)  # each side has its own normals


def test_semi_sharp_edges_lie_between():
    """The volume grows with sharpness from the round body to the cube."""
    sizes = []
    for sharpness in (0, 0.5, 1, 1.5, 2, 3, 10):
        made = limits(poly(CUBE, QUADS), Scheme(crease_edges=EDGES, crease_sharpness=np.full(12, float(sharpness))), 4)
        corners = made.points[made.indices].reshape(-1, 3, 3)
        sizes.append(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)
    assert sizes == sorted(sizes)
    assert sizes[-1] == pytest.approx(8)


def test_a_crease_of_sharpness_one_is_one_sharp_refinement():
    """Then the rules are smooth: the same as refining the sharp cage once without limits, and its result smoothly."""
    creased = limits(poly(CUBE, QUADS), Scheme(crease_edges=EDGES, crease_sharpness=np.ones(12)), 3)
    bilinear, _ = subdivision.refine(poly(CUBE, QUADS), Scheme("bilinear"), 1)
    quads = [[a, b, c, d] for a, b, c, _, _, d in bilinear.indices.reshape(-1, 6).tolist()]
    smooth = limits(poly(bilinear.points, quads), level=2)
    assert np.allclose(np.sort(np.round(creased.points, 9), axis=0), np.sort(np.round(smooth.points, 9), axis=0))


def test_a_sharp_corner_keeps_its_place():
    made = limits(poly(CUBE, QUADS), Scheme(corners=np.array([7]), corner_sharpness=np.array([10.0])), 3)
    assert np.allclose(made.points[7], CUBE[7])
    assert np.linalg.norm(made.points[0]) < 1


def test_loop_of_an_octahedron():
    """The limit of a vertex p of valence 4: (1 − 4 ω) p + ω Σ neighbours, ω = 1 / (4 + 3 / (8 β)); opposite neighbours cancel."""
    beta = (0.625 - (0.375 + 0.25 * np.cos(np.pi / 2)) ** 2) / 4
    omega = 1 / (4 + 0.375 / beta)
    for level in (1, 3):
        made = limits(poly(OCTAHEDRON, TRIANGLES), Scheme("loop"), level)
        assert np.allclose(made.points[:6], (1 - 4 * omega) * OCTAHEDRON)
        assert len(made.counts) == 8 * 4**level
    corners = made.points[made.indices]
    assert np.einsum("ij,ij->i", made.normals.values, corners / np.linalg.norm(corners, axis=1)[:, None]).min() > 0.97


def test_bilinear_faces_stay_where_they_are():
    made = limits(poly(CUBE, QUADS), Scheme("bilinear"), 2)
    assert made.normals is None
    assert np.allclose(np.abs(made.points).max(axis=1), 1)


def test_faces_of_any_size():
    prism = [[np.cos(a), s, -np.sin(a)] for s in (-1, 1) for a in np.arange(5) * 2 * np.pi / 5]
    faces = [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9], *([k, (k + 1) % 5, 5 + (k + 1) % 5, 5 + k] for k in range(5))]
    made, parents = subdivision.refine(poly(prism, faces), Scheme(), 2)
    assert np.bincount(parents).tolist() == [2 * 5 * 4] * 2 + [2 * 4 * 4] * 5
    assert np.abs(made.points).max() < 1


def test_smooth_triangles_are_another_surface():
    plain = limits(poly(OCTAHEDRON, TRIANGLES), level=3)
    smooth = limits(poly(OCTAHEDRON, TRIANGLES), Scheme(smooth_triangles=True), 3)
    wave = [np.ptp(np.linalg.norm(m.points, axis=1)) for m in (plain, smooth)]
    assert wave[1] < wave[0]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-2, 2), min_size=12, max_size=12), st.sampled_from(["catmullClark", "loop", "bilinear"]))
def test_refinement_commutes_with_affine_maps(numbers, name):
    matrix, moved = np.array(numbers[:9]).reshape(3, 3), np.array(numbers[9:])
    points, faces = (OCTAHEDRON, TRIANGLES) if name == "loop" else (CUBE, QUADS)
    scheme = Scheme(name, corners=np.array([1]), corner_sharpness=np.array([1.5]))
    one = limits(poly(points, faces), scheme).points @ matrix.T + moved
    assert np.allclose(limits(poly(points @ matrix.T + moved, faces), scheme).points, one, atol=1e-9)


# --- attributes ---


def uvs(points, faces, interpolation):
    rows = np.concatenate(faces) if interpolation == ir.Interpolation.CORNER else np.arange(len(points))
    return MeshAttribute(points[rows, :2], interpolation)


def test_face_varying_values_follow_the_surface_or_stay_linear():
    points, faces = grid(4)
    made = limits(poly(points, faces, uvs=uvs(points, faces, ir.Interpolation.CORNER)))
    assert np.allclose(made.uvs.values, made.points[made.indices][:, :2])  # the same rules as the points
    linear = limits(poly(points, faces, uvs=uvs(points, faces, ir.Interpolation.CORNER)), Scheme(face_varying="all"))
    inner = np.array([1 / 4, 1 / 2, 3 / 4])
    assert np.isin(np.round(linear.uvs.values % 1, 6), np.append(inner, 0)).all()


def test_a_seam_of_face_varying_values_is_a_boundary():
    points, faces = grid(2)
    values = points[np.concatenate(faces), :2].copy()
    values[4:8] += [10, 0]  # the second face is an island
    for rule, corner in (("none", False), ("cornersOnly", True), ("boundaries", True)):
        made = limits(poly(points, faces, uvs=MeshAttribute(values, ir.Interpolation.CORNER)), Scheme(face_varying=rule), 3)
        island = made.uvs.values[made.uvs.values[:, 0] > 5]
        assert (np.abs(island - [11, 0]).max(axis=1) < 1e-9).any() == corner
    assert ((island[:, 0] >= 11 - 1e-9) & (island[:, 0] <= 12 + 1e-9)).all()


def test_vertex_and_varying_and_uniform_values():
    points, faces = grid(3)
    colors = MeshAttribute(np.eye(9)[:, :3], ir.Interpolation.FACE)
    mesh = poly(points, faces, uvs=uvs(points, faces, ir.Interpolation.VERTEX), colors=colors)
    made, parents = subdivision.refine(mesh, Scheme(), 2)
    assert np.allclose(made.uvs.values, made.points[:, :2])
    assert np.allclose(made.colors.values, np.eye(9)[parents, :3])
    varying = limits(mesh, Scheme(linear=frozenset(["uvs"])), 1)
    assert np.allclose(varying.uvs.values[:16], points[:, :2])  # not moved to the limit


def test_levels_are_limited_by_the_number_of_faces():
    assert subdivision.levels_within(6, 24, 3, "catmullClark") == 3
    assert subdivision.levels_within(1_000_000, 4_000_000, 3, "catmullClark") == 1
    assert subdivision.levels_within(8, 24, 2, "loop") == 2
