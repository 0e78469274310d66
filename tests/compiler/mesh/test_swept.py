"""Meshes of swept profiles: closed, with the volumes of their closed forms (Pappus, prisms), and what solids make of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.formula import closed_form_solids
from maquette.compiler.mesh import polygon_mesh, profiles, swept

from .test_mesh_csg import BOX, triangles

REST = "\ncamera([0, 1, 5])\nsun()\n"


def solid(mesh: polygon_mesh.PolyMesh) -> trimesh.Trimesh:
    """The triangles of a polygon mesh as they are, equal vertices not merged."""
    data, dropped = polygon_mesh.assemble(mesh)
    assert dropped == 0
    return trimesh.Trimesh(data.positions, data.triangles, process=False)


def of_scene(scene: ir.Scene) -> trimesh.Trimesh:
    """The triangles of the first instance, in the world, equal vertices merged."""
    return trimesh.Trimesh(*triangles(scene), process=False)


def sides_of(profile: np.ndarray, angle: float) -> int:
    whole = swept.sides(float(profile[:, 0].max()), profiles.extent(profile) / profiles.FINENESS)
    return max(3, math.ceil(whole * angle / (2 * math.pi)))


RING = [(1.0, 0.0), (2, 0), (2, 1), (1, 1)]
BOWL = [(0.0, 0.0), (1, 0), (2, 1), (1.8, 1), (0.9, 0.2), (0, 0.2)]


@pytest.mark.parametrize("angle", [2 * math.pi, math.radians(270), math.radians(10)])
@pytest.mark.parametrize(("points", "genus"), [(RING, 1), (BOWL, 0)])
def test_a_revolved_polygon_has_the_volume_of_pappus(points, genus, angle):
    profile = profiles.outline(points)
    made = solid(swept.revolve(profile, True, angle))
    count = sides_of(profile, angle)
    # Pappus: the area times the way of its centroid, ∫ r dA · angle = angle / 2 · ∮ r² dy.
    r, y = profile.T
    after_r, after_y = np.roll(r, -1), np.roll(y, -1)
    moment = ((r**2 + r * after_r + after_r**2) * (after_y - y)).sum() / 6
    assert made.is_watertight
    assert made.volume == pytest.approx(moment * count * math.sin(angle / count), rel=1e-12)
    assert made.euler_number == (2 - 2 * genus if angle == 2 * math.pi else 2)
    assert made.volume == pytest.approx(moment * angle, rel=1e-3)


def test_a_sphere_by_its_half_circle(compiled):
    scene = compiled("revolve([[cos(k * 2deg), sin(k * 2deg)] for k in -45..45])" + REST)
    made = of_scene(scene)
    assert made.is_watertight
    assert made.volume == pytest.approx(4 / 3 * math.pi, rel=2e-3)


def test_an_open_profile_is_a_surface():
    line = profiles.curve([(1.0, 0.0), (1, 2)], "linear", False)
    data, _ = polygon_mesh.assemble(swept.revolve(line, False, 2 * math.pi))
    made = trimesh.Trimesh(data.positions, data.triangles, process=False)
    assert not made.is_watertight
    assert made.area == pytest.approx(4 * math.pi, rel=1e-3)
    assert (made.face_normals[:, [0, 2]] * made.triangles_center[:, [0, 2]]).sum(axis=1).min() > 0.9  # upwards faces outwards
    assert data.uvs is not None
    u, v = data.uvs.values.T
    assert (u.min(), u.max(), v.min(), v.max()) == (0, 1, 0, 1)


def test_a_revolved_surface_has_the_texture_of_a_cylinder():
    """u = 1/2 + atan2(x, z) / 2π, v upwards."""
    line = profiles.curve([(1.0, 0.0), (1, 2)], "linear", False)
    data, _ = polygon_mesh.assemble(swept.revolve(line, False, 2 * math.pi))
    assert data.uvs is not None
    x, y, z = data.positions[data.triangles.reshape(-1)].T
    u, v = data.uvs.values.T
    longitude = 0.5 + np.arctan2(x, z) / (2 * math.pi)
    assert np.abs((u - longitude + 0.5) % 1 - 0.5).max() < 1e-6
    assert v == pytest.approx(0.5 * y)


L_SHAPE = [(0, 0), (2, 0), (2, -1), (1, -1), (1, -2), (0, -2)]  # [x, -z]


def prism(loops, sweep: swept.Sweep) -> trimesh.Trimesh:
    return solid(swept.extrude(loops, sweep))


def test_a_prism_has_area_times_height():
    made = prism([profiles.outline(L_SHAPE)], swept.Sweep(-1, 2.5))
    assert made.is_watertight
    assert made.volume == pytest.approx(3 * 2.5, rel=1e-12)
    assert made.bounds.ravel().tolist() == [0, -1, 0, 2, 1.5, 2]
    assert len(made.faces) == 2 * 6 + 2 * 4


def test_a_prism_with_holes():
    outer = profiles.outline([(0, 0), (4, 0), (4, 4), (0, 4)])
    holes = [profiles.outline([(1 + k, 1), (1.5 + k, 1), (1.5 + k, 3), (1 + k, 3)]) for k in (0, 1.5)]
    made = prism(profiles.with_holes(outer, holes), swept.Sweep(0, 1))
    assert made.is_watertight
    assert made.volume == pytest.approx(16 - 2 * 0.5 * 2, rel=1e-12)
    assert made.euler_number == 2 - 2 * 2


@pytest.mark.parametrize(("taper", "share"), [((0.0, 0.0), 1 / 3), ((0.5, 0.5), 7 / 12), ((2.0, 2.0), 7 / 3), ((1.0, 0.5), 3 / 4)])
def test_a_tapered_prism_is_a_frustum(taper, share):
    """∫ (1 + (a − 1) t) (1 + (b − 1) t) dt from 0 to 1."""
    made = prism([profiles.outline(L_SHAPE)], swept.Sweep(0, 2, 0.0, taper))
    assert made.is_watertight
    assert made.volume == pytest.approx(3 * 2 * share, rel=1e-3 if taper[0] != taper[1] else 1e-12)


@pytest.mark.parametrize("taper", [(1.0, 1.0), (0.0, 0.0), (0.5, 1.0)])
def test_a_twist_keeps_the_volume(taper):
    """Each section keeps its area, whatever the turn."""
    plain = prism([profiles.outline(L_SHAPE)], swept.Sweep(0, 2, 0.0, taper))
    made = prism([profiles.outline(L_SHAPE)], swept.Sweep(0, 2, -2.5, taper))
    assert made.is_watertight
    assert made.volume == pytest.approx(plain.volume, rel=2e-3)


def test_a_twisted_side_is_within_its_tolerance():
    """Turned back, every point of a twisted square column lies on the sides of the square."""
    square = profiles.outline([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    made = prism([square], swept.Sweep(0, 3, 2.0))
    for point in (made.triangles_center, made.triangles.mean(axis=1), 0.5 * (made.triangles[:, 0] + made.triangles[:, 1])):
        angle = 2.0 * point[:, 1] / 3
        x = np.cos(angle) * point[:, 0] - np.sin(angle) * point[:, 2]
        z = np.sin(angle) * point[:, 0] + np.cos(angle) * point[:, 2]
        side = (point[:, 1] > 1e-9) & (point[:, 1] < 3 - 1e-9)
        assert np.abs(np.maximum(np.abs(x), np.abs(z))[side] - 1).max() <= 1.5 * 2 / profiles.FINENESS


def test_a_twist_turns_as_the_element_twist_does(compiled):
    """A point [1, 0] of the profile is turned to -z by a quarter turn about y."""
    made = of_scene(compiled("extrude([[0, -0.1], [1, -0.1], [1, 0.1], [0, 0.1]], 1, twist: 90deg)" + REST))
    top = made.vertices[made.vertices[:, 1] > 0.999]
    assert top[:, 2].min() == pytest.approx(-1, abs=1e-6)
    assert top[:, 2].max() < 1e-6


radii = st.integers(0, 40).map(lambda k: k / 10)


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(radii, radii), min_size=3, max_size=9, unique=True), st.sampled_from([2 * math.pi, 2.0]))
def test_every_simple_profile_is_closed(points, angle):
    try:
        profile = profiles.outline(points)
    except profiles.ProfileError:
        return
    made = solid(swept.revolve(profile, True, angle))
    assert made.is_watertight
    assert made.volume > 0
    upright = prism([profile], swept.Sweep(0, 1))
    assert upright.is_watertight
    assert upright.volume == pytest.approx(profiles.signed_area(profile), rel=1e-9)


@pytest.mark.parametrize(
    ("text", "volume"),
    [
        (f"difference {{ {BOX}; revolve([[0, -1], [0.25, -1], [0.25, 1], [0, 1]]) }}", 1 - math.pi / 16),
        (f"difference {{ {BOX}; extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 1, scale: 2) }}", 1 - 0.125),
        (f"intersection {{ {BOX}; revolve([[0, 0], [0.5, 0], [0, 0.5]], angle: 90deg) }}", math.pi / 96),
        (f"union {{ {BOX}; extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 1, centered: true) }}", 1 + 1 - 0.25),
        ('difference { revolve([[0, 0], [1, 0], [1, 1], [0, 1]]); extrude([[-1, 0], [0, 1], [1, 0], [0, -1]], 9, kind: "bspline") }', None),
    ],
)  # fmt: skip
def test_swept_shapes_are_parts_of_meshes(compiled, text, volume):
    made = of_scene(compiled(text + REST))
    assert made.is_watertight
    assert volume is None or made.volume == pytest.approx(volume, rel=2e-3)


EIGHT = "revolve([[0, 0], [1, 0], [0.5, 1], [1, 2], [0, 2]])"


@pytest.mark.parametrize(
    ("text", "closed"),
    [
        (f"union {{ {EIGHT} }}", True),
        (f"difference {{ {EIGHT}; extrude([[0, 0], [1, 0], [1, 1], [0.5, 0.2], [0, 1]], 3, taper: 0.5, translate: [0, 0.5, 0]) }}", True),
        (f"difference(round: 0.1) {{ {EIGHT}; box(1) }}", False),
        ("shell(0.1) { extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 3, twist: 1rad) }", False),
    ],
)
def test_solids_of_straight_profiles_have_equations(compiled, text, closed):
    """Planes and cones: their roots are closed forms, or proved ones where fillets and twists are."""
    tables = compiled(text + REST).tables
    g = int(tables.instances.geometry[0])
    assert tables.geometries.kind[g] == ir.GeometryKind.FORMULA
    assert (closed_form_solids.of_geometry(tables, g) is not None) == closed


@pytest.mark.parametrize(
    "text",
    [
        "revolve([[cos(k * 2deg), sin(k * 2deg)] for k in -45..45])",
        "extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 1, taper: [1, 0.5])",
        'extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 1, kind: "catmull_rom")',
    ],
)
def test_solids_of_other_profiles_are_meshes(compiled, text):
    tables = compiled(f"union {{ {text} }}" + REST).tables
    assert tables.geometries.kind[tables.instances.geometry[0]] == ir.GeometryKind.MESH


def test_a_wrong_profile_in_a_solid_is_told_once(said):
    found = said("difference { box(1); extrude([[0, 0], [1, 1], [1, 0], [0, 1]]) }" + REST)
    assert found.count("error: ") == 1
    assert found.startswith("a.scene:1:22: error: the profile crosses or touches itself near [0.5, 0.5] m")


def test_edges_are_sharp_from_the_crease_angle(compiled):
    """A column of sixteen sides has edges of 22.5°."""
    text = "extrude([[cos(k * 22.5deg), sin(k * 22.5deg)] for k in 0..15], 1{})"

    def bent(more: str) -> bool:
        scene = compiled(text.format(more) + REST)
        pools, geometry = scene.tables.pools, scene.tables.geometries
        first, count = int(geometry.first_triangle[0]), int(geometry.triangle_count[0])
        corners = pools.positions[pools.triangles[first : first + count]]
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        face /= np.linalg.norm(face, axis=1)[:, None]
        normals = pools.values[: 9 * count].reshape(-1, 3, 3)
        return bool((np.einsum("tci,ti->tc", normals, face) < 0.999).any())

    assert bent("")
    assert bent(", crease: 23deg")
    assert not bent(", crease: 22deg")
