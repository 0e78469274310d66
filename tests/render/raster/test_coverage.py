"""The rasterizer against known answers: coverage, clipping, depth, perspective-correct weights; equal pictures of all fills."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, LightData, MaterialData, MeshAttribute, MeshData, Outlines, lambert
from maquette.render.accel import intersect
from maquette.render.backends import prepare, raster
from maquette.render.jit.packed_struct import Handle
from maquette.render.raster import scalar_raster, view_geometry
from maquette.render.tessellation import analytic_shapes, pixel_tolerance
from maquette.render.types import Hit, Tile, View

from .. import pictures, tables

K = ir.GeometryKind
ORTHOGRAPHIC = ir.Projection.ORTHOGRAPHIC
SUN = LightData(ir.LightKind.DIRECTIONAL, (3.0, 3.0, 3.0), direction=(0.48, 0.8, 0.36))
EYE = CameraData(transform=0, extent=1.0)  # at the origin, looking down -z, 90 degrees high


def mesh(points, triangles, **more) -> MeshData:
    return MeshData(np.asarray(points, float), np.asarray(triangles), **more)


def hits(scene: ir.Tables, size=(96, 96), tile=None, overrides=None, **settings) -> Hit:
    """The rasterizer's hits at pixel centres, (h, w) each."""
    drawn = pictures.renderer(scene, "raster", overrides, size=size, **settings)
    tile = tile or Tile(0, 0, *size)
    _, hit = drawn.centres(tile)
    return Hit(*(np.asarray(c).reshape(tile.y1 - tile.y0, tile.x1 - tile.x0) for c in hit))


def traced(scene: ir.Tables, size=(96, 96)) -> Hit:
    """Ray hits at pixel centres, by brute force."""
    drawn = pictures.renderer(scene, "raster", size=size)
    ray, _ = drawn.centres(Tile(0, 0, *size))
    hit = intersect.closest_hit(intersect.Brute(), scene, ray, np.ones(size[0] * size[1], bool), int(ir.Visibility.CAMERA))
    return Hit(*(np.asarray(c).reshape(size[1], size[0]) for c in hit))


# --- coverage ------------------------------------------------------------------------------------------------------------


def test_a_disc_covers_the_samples_of_its_equation():
    """Pixel centres with (i + ½ - cx)² + (j + ½ - cy)² <= R², R² halfway between possible values; a metre is a pixel."""
    radius = math.sqrt(40.0**2 + 0.5)
    upright = tables.matrix((0, 0, -5), tables.turn(0, math.pi / 2))
    scene = tables.scene([(K.DISK, [radius], upright, 0)], camera=CameraData(0, 48.0, ORTHOGRAPHIC))
    j, i = np.mgrid[0:96, 0:96]
    squared = (i + 0.5 - 48) ** 2 + (j + 0.5 - 48) ** 2
    assert np.array_equal(hits(scene, overrides={"tolerance": "1e-4"}).instance == 0, squared <= radius**2)
    default = hits(scene).instance == 0
    assert (squared[~default] > (radius - 0.06) ** 2).all()
    assert (squared[default] <= radius**2).all()


def test_a_sphere_off_the_axis_is_an_ellipse():
    """sin α = R/d, angle θ off the axis, Δ = cos²θ - sin²α: centre sin θ cos θ / Δ, half axes sin α cos α / Δ and sin α / √Δ."""
    center, radius = np.array([1.2, 0.0, -2.5]), 1.0
    d = np.linalg.norm(center)
    sin_a, cos_t, sin_t = radius / d, 2.5 / d, 1.2 / d
    cos_a, delta = math.sqrt(1 - sin_a**2), cos_t**2 - sin_a**2
    size = 512
    scene = tables.scene([(K.SPHERE, [radius], tables.matrix(center), 0)], camera=CameraData(0, 1.3))
    seen = hits(scene, (size, size)).instance == 0
    pixel = 2 * 1.3 / size
    j, i = np.nonzero(seen)
    assert seen.sum() * pixel**2 == pytest.approx(math.pi * sin_a**2 * cos_a / delta**1.5, rel=1e-3)
    assert ((i.mean() + 0.5) - size / 2) * pixel == pytest.approx(sin_t * cos_t / delta, abs=0.1 * pixel)
    assert (i.max() + 1 - i.min()) * pixel / 2 == pytest.approx(sin_a * cos_a / delta, abs=pixel)
    assert (j.max() + 1 - j.min()) * pixel / 2 == pytest.approx(sin_a / math.sqrt(delta), abs=pixel)


@pytest.mark.parametrize("total", [1, 4])
def test_closed_meshes_cover_each_sample_once_a_layer(total):
    """The triangles of a convex mesh, drawn one by one, cover each sample twice, front and back, or not at all."""
    scene = tables.scene([(K.SPHERE, [1.0], tables.matrix((0.1, 0.2, -2.2), tables.turn(0, 0.5)), 0)], camera=EYE)
    view, tile = View(0, 48, 48), Tile(0, 0, 48, 48)
    tessellation = analytic_shapes.tessellate(K.SPHERE, [1.0], 0.1)
    model, ranges = view_geometry.build_model(scene, view, {0: tessellation})
    packed = Handle(model)
    drawn = pictures.renderer(scene, "raster", size=(48, 48), filter="box")
    reach = 128 if total > 1 else 0
    positions = Handle(scalar_raster.scratch_for(tile, total, reach, scalar_raster.workspace_for(scene)))
    raster.place_samples(tile, drawn.prepared.frame, 0, total, positions)
    placed = positions.tables.samples
    covered = np.zeros(len(placed.x), int)
    for triangle in range(ranges[0, 0], ranges[0].sum()):
        scratch = scalar_raster.scratch_for(tile, total, reach, scalar_raster.workspace_for(scene))
        scratch.samples.x[:], scratch.samples.y[:] = placed.x, placed.y
        scalar_raster.draw_triangle(packed, 0, triangle, tile, 0, Handle(scratch))
        covered += scratch.depth.instance >= 0
    assert set(np.unique(covered)) == {0, 2}


# --- clipping and depth --------------------------------------------------------------------------------------------------


def test_a_triangle_from_behind_the_eye_matches_the_tracer():
    """Depths -1, 0.01 and 5: clipping comes before division by w."""
    points = [[-0.3, -1.0, 1.0], [0.4, 0.005, -0.01], [-1.0, 3.0, -5.0]]
    scene = tables.scene(meshes=[(mesh(points, [[0, 1, 2]]), np.eye(4), 0)], camera=EYE)
    ours, theirs = hits(scene), traced(scene)
    differ = (ours.instance >= 0) != (theirs.instance >= 0)
    assert (theirs.instance >= 0).sum() > 1000
    assert differ.sum() <= 2  # samples within 1/512 pixel of an edge
    both = (ours.instance >= 0) & (theirs.instance >= 0)
    assert np.allclose(ours.t[both], theirs.t[both], rtol=1e-9)


@pytest.mark.parametrize("far", [math.inf, 8.7])
def test_near_and_far_cut_where_rays_end(far):
    shapes = [(K.SPHERE, [1.0], tables.matrix((0, 0, -1.5)), 0), (K.BOX, [9.0, 9.0, 0.5], tables.matrix((0, 0, -9)), 0)]
    camera = CameraData(0, 1.0, near=1.0, far=far)
    scene = tables.scene(shapes, camera=camera)
    ours, theirs = hits(scene), traced(scene)
    assert (ours.instance != theirs.instance).sum() <= 8
    inside = (ours.instance == theirs.instance) & (ours.instance >= 0)
    assert np.allclose(ours.t[inside], theirs.t[inside], rtol=1e-9)


def test_depths_a_millionth_apart_keep_their_order():
    """Near 0.1, far 1e5, at 1e4: a 24-bit buffer steps by 59 m there; 1/w in float64 parts Δz/z = 1e-6."""
    square = np.array([[-9e3, -9e3, 0], [9e3, -9e3, 0], [9e3, 9e3, 0], [-9e3, 9e3, 0.0]])
    quad = mesh(square, [[0, 1, 2], [0, 2, 3]])
    for first, second in ((1e4, 1e4 + 0.01), (1e4 + 0.01, 1e4)):
        placed = [(quad, tables.matrix((0, 0, -z)), 0) for z in (first, second)]
        scene = tables.scene(meshes=placed, camera=CameraData(0, 0.5, near=0.1, far=1e5))
        assert (hits(scene).instance == (0 if first < second else 1)).all()


def test_of_equal_depths_the_lowest_instance_wins():
    quad = mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3], [0, 1, 2]])
    scene = tables.scene(meshes=[(quad, tables.matrix((0, 0, -2)), 0)] * 3, camera=CameraData(0, 0.4))
    hit = hits(scene)
    assert (hit.instance == 0).all()
    assert set(np.unique(hit.primitive)) == {0, 1}


def test_perspective_weights_at_the_middle():
    """Between depths 1 and 9 the picture's centre shows u = 1 / (1 + 9), not 1/2."""
    points = [[-0.5, -1, -1], [4.5, -9, -9], [4.5, 9, -9], [-0.5, 1, -1]]
    uv = MeshAttribute(np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    scene = tables.scene(meshes=[(mesh(points, [[0, 1, 2], [0, 2, 3]], uvs=uv), np.eye(4), 0)], camera=EYE)
    uv_there = pictures.aov(scene, "uv", size=(97, 97))[48, 48]
    assert uv_there[0] == pytest.approx(0.1, rel=1e-6)


def test_weights_over_a_ratio_of_a_million():
    """Corners at depths 1e-3, 1 and 1e3."""
    points = [[-0.0008, -0.0009, -1e-3], [0.9, -0.2, -1.0], [-200.0, 900.0, -1e3]]
    scene = tables.scene(meshes=[(mesh(points, [[0, 1, 2]]), np.eye(4), 0)], camera=EYE)
    ours, theirs = hits(scene), traced(scene)
    both = (ours.instance >= 0) & (theirs.instance >= 0)
    assert both.sum() > 500
    assert abs(ours.u - theirs.u)[both].max() <= 1e-5
    assert abs(ours.v - theirs.v)[both].max() <= 1e-5


def test_a_plane_reaches_its_horizon():
    """An unbounded plane 1 m below the eye fills the lower half: depth is 1 / tan at any distance."""
    scene = tables.scene([(K.PLANE, [], tables.matrix((0, -1, 0)), 0)], camera=EYE)
    hit = hits(scene)
    assert (hit.instance[:48] < 0).all()
    assert (hit.instance[48:] == 0).all()
    depth = pictures.aov(scene, "depth")
    slope = (np.arange(48) + 0.5) / 48
    assert np.allclose(depth[48:], (1 / slope)[:, None], rtol=1e-6)


def test_huge_triangles_are_cut_at_the_guard_band():
    """Corners 1e9 pixels away: fixed-point numbers would overflow."""
    points = [[-1e9, -1e9 - 3, -10], [1e9, -1e9, -10.0], [0.0, 1e9, -11]]
    scene = tables.scene(meshes=[(mesh(points, [[0, 1, 2]]), np.eye(4), 0)], camera=EYE)
    ours, theirs = hits(scene), traced(scene)
    assert (ours.instance == 0).all()
    assert np.allclose(ours.t, theirs.t, rtol=1e-9)


# --- pictures ------------------------------------------------------------------------------------------------------------


def holed_polygon() -> MeshData:
    """A concave polygon with a hole, and a quad, triangulated, with their outlines."""
    import mapbox_earcut

    outline = [[-1, -1], [1, -1], [0.4, 0.1], [1, 1], [-1, 1], [-0.7, 0.2]]
    hole = [[-0.3, -0.4], [-0.3, 0.3], [0.2, 0.2], [0.1, -0.4]]
    flat = np.array(outline + hole, float)
    cut = mapbox_earcut.triangulate_float64(flat, np.array([6, 10], np.uint32)).reshape(-1, 3)
    quad = np.array([[1.2, -1, 0], [1.7, -1, 0.2], [1.7, 1, 0.2], [1.2, 1, 0]])
    points = np.concatenate([np.append(flat, 0 * flat[:, :1], axis=1), quad])
    triangles = np.concatenate([cut, [[10, 11, 12], [10, 12, 13]]])
    polygons = np.array([[0, 2, 0, len(cut)], [2, 1, len(cut), 2]])
    outlines = Outlines(np.arange(14), np.array([[0, 6], [6, 4], [10, 4]]), polygons)
    return mesh(points, triangles, outlines=outlines)


def still_life(**material) -> ir.Tables:
    frame = tables.looking((0.5, 1.6, 4.0), (0, 0.5, 0))
    shapes = [
        (K.PLANE, [], tables.matrix((0, 0, 0)), 0),
        (K.SPHERE, [0.6], tables.matrix((-0.8, 0.6, 0)), 1),
        (K.TORUS, [0.5, 0.15], tables.matrix((0.9, 0.3, 0.5), tables.turn(0, 0.7)), 1),
        (K.CONE, [0.4, 0.0, 0.5, 1], tables.matrix((0.2, 0.5, -0.8)), 0),
    ]
    polygon = (holed_polygon(), tables.matrix((-0.2, 1.0, -1.5), tables.turn(1, 0.4)), 1)
    materials = [lambert((0.8, 0.8, 0.8)), tables.phong(0.6, 0.3, 20.0, **material)]
    return tables.scene(shapes, [polygon], materials, [SUN], CameraData(1, 0.6), frame)


def test_the_three_fills_make_the_same_picture():
    fills = ("edges", "areas", "scanline")
    drawn = {fill: pictures.picture(still_life(), overrides={"raster.coverage": fill}, samples=4) for fill in fills}
    assert drawn["edges"].channels["rgba"][..., :3].max() > 0.3
    for fill in ("areas", "scanline"):
        assert np.array_equal(drawn[fill].channels["rgba"], drawn["edges"].channels["rgba"])


def test_scanline_fills_whole_polygons():
    """A concave polygon with a hole is filled by its outline; each sample sees the same triangle as with fill by triangles."""
    scene = still_life()
    flat = np.zeros(2, np.bool_)
    scalar_raster.flat_polygons(Handle(scene), flat)
    assert flat.tolist() == [True, True]
    by = {fill: hits(scene, (300, 300), overrides={"raster.coverage": fill}) for fill in ("edges", "scanline")}
    assert (by["edges"].instance == 4).sum() > 1000
    for column in ("instance", "primitive", "t"):
        assert np.array_equal(getattr(by["edges"], column), getattr(by["scanline"], column))


def test_threads_and_crops_change_nothing():
    complete = pictures.picture(still_life(), samples=4).channels["rgba"]
    for threads in (2, 5):
        assert np.array_equal(pictures.picture(still_life(), samples=4, threads=threads).channels["rgba"], complete)
    cropped = pictures.picture(still_life(), samples=4, crop=(13, 22, 71, 90)).channels["rgba"]
    assert np.array_equal(cropped, complete[22:90, 13:71])


def test_textures_are_the_right_way_up():
    """On the front of a box u points right and v up; on its top v points away."""
    frame = tables.looking((0, 1.5, 4), (0, 0, 0))
    scene = tables.scene([(K.BOX, [1, 1, 1], np.eye(4), 0)], camera=CameraData(1, 0.5), frame=frame)
    uv, normal = pictures.aov(scene, "uv"), pictures.aov(scene, "normal")
    for face in (2, 1):
        j, i = np.nonzero(normal[..., face] > 0.9)
        middle = int(np.median(j))
        row = uv[middle, i[j == middle]]
        assert (np.diff(row[:, 0]) > 0).all()
        column = uv[j[i == 48], 48]
        assert (np.diff(column[:, 1]) < 0).all()
        assert ((uv[j, i] >= 0) & (uv[j, i] <= 1)).all()


# --- preparation ---------------------------------------------------------------------------------------------------------


def test_tolerance_is_measured_where_a_shape_is_nearest():
    places = [tables.matrix((0, 0, -11)), tables.matrix((0, 0, -6), np.diag([1.0, 1, 1])), tables.matrix((0, 0, -22), 2 * np.eye(3))]
    scene = tables.scene([(K.SPHERE, [1.0], p, 0) for p in places] + [(K.PLANE, [], np.eye(4), 0)], camera=EYE)
    tolerance = pixel_tolerance.instance_tolerances(scene, View(0, 200, 100), 0.05)
    exact = 0.05 * 2 / 100 * np.array([10, 5, 10])  # 20 m away, twice as large
    assert (tolerance[:3] <= exact).all()
    assert (tolerance[:3] > exact / math.sqrt(2) * 0.999).all()
    assert math.isnan(tolerance[3])


def test_like_instances_share_a_tessellation():
    from maquette.compiler.scene.builder import SceneBuilder
    from maquette.compiler.scene.row_records import InstanceData

    builder = SceneBuilder()
    ball = builder.geometry(K.SPHERE, [1.0])
    material = builder.material(lambert((1.0, 1.0, 1.0)))
    for k in range(50):
        builder.instance(InstanceData(ball, builder.transform(tables.matrix((k - 25, 0, -100))), material))
    builder.camera(CameraData(0, 1.0))
    scene, decided, view = pictures.planned(builder.finish().tables, "raster")
    tessellations = prepare.prepare(scene, decided, view).tessellations
    assert len(tessellations) == 50
    assert len({id(s) for s in tessellations.values()}) <= 2


@pytest.mark.long
def test_shapes_shaded_at_vertices_become_meshes_in_every_backend():
    scene = still_life(shading=ir.Shading.GOURAUD)
    for backend in ("raster", "ray", "reference"):
        planned, decided, view = pictures.planned(scene, backend)
        ready = prepare.prepare(planned, decided, view)
        kinds = ready.tables.geometries.kind[ready.tables.instances.geometry]
        assert kinds.tolist() == [K.PLANE, K.MESH, K.MESH, K.CONE, K.MESH]
    a, b = (pictures.picture(scene, backend).channels["rgba"] for backend in ("raster", "ray"))
    assert (abs(a - b).max(axis=2) > 1e-4).sum() <= 20


def test_materials_the_rasterizer_simplifies_are_noted():
    from maquette.render.backends import raster

    materials = [lambert((1.0, 1.0, 1.0)), MaterialData(ir.MaterialModel.GLASS), MaterialData(ir.MaterialModel.MIRROR)]
    scene = tables.scene([(K.SPHERE, [1.0], np.eye(4), k) for k in (0, 1, 2, 1)], materials=materials)
    planned, decided, _ = pictures.planned(scene, "raster")
    rows = scene.instances.material
    assert raster.notes(planned, decided) == [
        ("raster draws glass without refraction: the sky and the ground's mean light show", "materials", rows[1]),
        ("raster draws mirrors without reflected objects: the sky and the ground's mean light show", "materials", rows[2]),
    ]


@pytest.mark.parametrize("fill", ["edges", "scanline"])
def test_nothing_to_draw_is_the_background(fill):
    drawn = pictures.picture(
        tables.scene(camera=EYE), overrides={"raster.coverage": fill}, size=(1, 1), background=(0.25, 0.5, 0.75), aov=("depth", "id")
    )
    assert drawn.channels["rgba"].tolist() == [[[0.25, 0.5, 0.75, 0.0]]]
    assert drawn.channels["depth"].tolist() == [[[math.inf]]]
    assert drawn.channels["id"].tolist() == [[[-1.0, -1.0]]]


def test_what_the_camera_may_not_see_is_not_drawn():
    from maquette.compiler.scene.builder import SceneBuilder
    from maquette.compiler.scene.row_records import InstanceData

    builder = SceneBuilder()
    material, shape = builder.material(lambert((1.0, 1.0, 1.0))), builder.geometry(K.SPHERE, [1.0])
    for z, visible in ((-3.0, int(ir.Visibility.SHADOW)), (-6.0, int(ir.Visibility.CAMERA))):
        builder.instance(InstanceData(shape, builder.transform(tables.matrix((0, 0, z))), material, visible=visible))
    builder.camera(CameraData(0, 0.1))
    assert (hits(builder.finish().tables).instance == 1).all()
