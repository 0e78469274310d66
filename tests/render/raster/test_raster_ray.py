"""The rasterizer agrees with ray tracing, except on outlines: first hits, positions, normals and light."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, LightData, MeshAttribute, MeshData, lambert

from .. import pictures, tables

K = ir.GeometryKind
SIZE = (120, 90)
MATERIALS = [lambert((0.8, 0.8, 0.8)), tables.phong(0.5, 0.4, 30.0), tables.phong(0.3, 0.2, 9.0, ir.MaterialModel.BLINN_PHONG)]
LIGHTS = [
    LightData(ir.LightKind.DIRECTIONAL, (2.0, 2.0, 2.0), direction=(0.48, 0.8, 0.36)),
    LightData(ir.LightKind.POINT, (9.0, 6.0, 3.0), position=(-2.0, 3.0, 2.0)),
    LightData(ir.LightKind.AMBIENT, (0.1, 0.1, 0.2)),
]
FRAME = tables.looking((0.7, 1.8, 4.5), (0, 0.4, 0))
FLOOR = (K.PLANE, [], tables.matrix((0, 0, 0)), 0)
SQUASHED = np.diag([1.5, 0.6, -0.8]) @ tables.turn(2, 0.4)


def bumpy() -> MeshData:
    """A sheet of 40 × 40 quads with smooth normals, uv and vertex colours."""
    x, z = (g.ravel() for g in np.meshgrid(np.linspace(-1.5, 1.5, 41), np.linspace(-1.5, 1.5, 41), indexing="ij"))
    y = 0.15 * np.sin(4 * x) * np.cos(3 * z)
    normals = np.stack([-0.6 * np.cos(4 * x) * np.cos(3 * z), np.ones_like(x), 0.45 * np.sin(4 * x) * np.sin(3 * z)], axis=1)
    i, j = (g.ravel() for g in np.meshgrid(np.arange(40), np.arange(40), indexing="ij"))
    a, b, c, d = 41 * i + j, 41 * i + j + 1, 41 * (i + 1) + j + 1, 41 * (i + 1) + j
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return MeshData(
        np.stack([x, y, z], axis=1),
        triangles,
        normals=MeshAttribute(normals),
        uvs=MeshAttribute(np.stack([x, z], axis=1)),
        colors=MeshAttribute(np.stack([0.5 + x / 3, 0.5 + z / 3, 0 * x + 0.7], axis=1)),
    )


def scene(*shapes, meshes=(), camera: CameraData | None = None) -> ir.Tables:
    return tables.scene(shapes, meshes, MATERIALS, LIGHTS, camera or CameraData(1, 0.45), FRAME)


SCENES: dict[str, Callable[[], ir.Tables]] = {
    "spheres and a plane": lambda: scene(
        FLOOR, (K.SPHERE, [0.8], tables.matrix((-0.6, 0.8, 0)), 1), (K.SPHERE, [0.5], tables.matrix((0.5, 0.5, 0.7), SQUASHED), 2)
    ),
    "boxes": lambda: scene(
        FLOOR,
        (K.BOX, [0.4, 0.6, 0.3], tables.matrix((-0.9, 0.6, 0), tables.turn(1, 0.6)), 1),
        (K.BOX, [0.4, 0.2, 0.4], tables.matrix((0.6, 0.7, 0.2), SQUASHED), 2),
        (K.RECTANGLE, [0.5, 0.9], tables.matrix((0.2, 1.2, -1.0), tables.turn(0, 1.2)), 1),
    ),
    "cylinders": lambda: scene(
        FLOOR,
        (K.CYLINDER, [0.4, 0.6, 1], tables.matrix((-1.0, 0.7, 0), tables.turn(2, 0.5)), 1),
        (K.CYLINDER, [0.4, 0.5, 0], tables.matrix((0.8, 0.6, 0.3), tables.turn(0, 0.9)), 2),
        (K.DISK, [0.6], tables.matrix((0.1, 0.9, -1.0), tables.turn(0, 1.0)), 1),
    ),
    "cones": lambda: scene(
        FLOOR,
        (K.CONE, [0.6, 0.0, 0.6, 1], tables.matrix((-0.9, 0.6, 0)), 1),
        (K.CONE, [0.2, 0.6, 0.4, 0], tables.matrix((0.8, 0.5, 0.3), tables.turn(2, 0.4)), 2),
    ),
    "tori": lambda: scene(
        FLOOR,
        (K.TORUS, [0.6, 0.2], tables.matrix((-0.8, 0.5, 0), tables.turn(0, 0.8)), 1),
        (K.TORUS, [0.2, 0.35], tables.matrix((0.8, 0.5, 0.3), tables.turn(2, 0.4)), 2),
    ),
    "capsules": lambda: scene(FLOOR, (K.CAPSULE, [0.3, 0.5], tables.matrix((0, 0.6, 0), tables.turn(2, 1.0)), 1)),
    "quadrics in boxes": lambda: scene(
        FLOOR,
        (K.QUADRIC, [1, -1, 1, 0, 0, 0, 0, 0, 0, -0.05, 0.6, 0.5, 0.6], tables.matrix((-0.8, 0.6, 0), tables.turn(2, 0.3)), 1),
        (K.QUADRIC, [1, 0, 1, 0, 0, 0, 0, -0.5, 0, 0, 0.5, 0.5, 0.5], tables.matrix((0.8, 0.5, 0.3)), 2),
    ),
    "endless quadrics": lambda: scene(
        (K.QUADRIC, [1, 0, 1, 0, 0, 0, 0, 0, 0, -0.1, *[math.inf] * 3], tables.matrix((-0.6, 0, 0), tables.turn(2, 0.2)), 1),
        (K.QUADRIC, [1, -1, 1, 0, 0, 0, 0, 0, 0, 0, *[math.inf] * 3], tables.matrix((1.2, 0.5, -2), tables.turn(0, 1.3)), 2),
    ),
    "a mesh": lambda: scene(FLOOR, meshes=[(bumpy(), tables.matrix((0, 0.6, 0), tables.turn(1, 0.3)), 1)]),
    "orthographic": lambda: scene(
        FLOOR,
        (K.SPHERE, [0.8], tables.matrix((-0.6, 0.8, 0)), 1),
        (K.BOX, [0.4, 0.3, 0.4], tables.matrix((0.9, 0.3, 0), tables.turn(1, 0.5)), 2),
        camera=CameraData(1, 1.6, ir.Projection.ORTHOGRAPHIC),
    ),
    "shifted, near and far": lambda: scene(
        FLOOR,
        (K.SPHERE, [0.8], tables.matrix((-0.6, 0.8, 0)), 1),
        (K.TORUS, [0.6, 0.2], tables.matrix((0.8, 0.5, 0.8), tables.turn(0, 0.8)), 2),
        camera=CameraData(1, 0.45, near=4.0, far=6.0, shift=(0.1, -0.05)),
    ),
    "from inside": lambda: scene(
        (K.SPHERE, [9.0], np.eye(4), 1), (K.BOX, [6.0, 6.0, 6.0], tables.matrix((0, 0, 0), tables.turn(1, 0.4)), 2)
    ),
}


def interior(*maps: np.ndarray) -> np.ndarray:
    """Pixels whose eight neighbours are equal in every map."""
    h, w = maps[0].shape[:2]
    same = np.zeros((h, w), bool)
    same[1:-1, 1:-1] = True
    for ids in maps:
        for dj in (-1, 0, 1):
            for di in (-1, 0, 1):
                same[1:-1, 1:-1] &= ids[1 + dj : h - 1 + dj, 1 + di : w - 1 + di] == ids[1:-1, 1:-1]
    return same


@pytest.mark.parametrize("name", SCENES)
def test_raster_sees_what_rays_see(name):
    tables = SCENES[name]()
    names = ("depth", "normal", "position", "uv", "id")
    ours, theirs = (pictures.picture(tables, backend, size=SIZE, aov=names).channels for backend in ("raster", "ray"))
    ids = theirs["id"][..., 0]
    assert len(np.unique(ids)) > 1 or name == "from inside"
    assert (ours["id"] != theirs["id"]).any(axis=2).mean() < 0.003  # outlines: within 0.05 pixel
    inside = interior(ids)
    if name == "shifted, near and far":
        inside &= interior(np.round(theirs["depth"][..., 0] * 2))  # where planes cut a shape its own far side lies behind
    assert inside.mean() > 0.5
    assert np.array_equal(ours["id"][inside], theirs["id"][inside])
    folds = 0.002 if name == "a mesh" else 0.0  # a mesh has outlines before itself
    for channel in ("depth", "position"):
        same = np.isclose(ours[channel][inside], theirs[channel][inside], rtol=1e-5, atol=1e-5).all(axis=1)
        assert (~same).mean() <= folds, channel
    creases = np.abs(ours["normal"] - theirs["normal"])[inside].max(axis=1) > 1e-5
    assert creases.mean() <= max(folds, 0.001)
    assert np.array_equal(ours["rgba"][..., 3] > 0, ours["id"][..., 0] >= 0)
    light = np.abs(ours["rgba"] - theirs["rgba"])[inside].max(axis=1) > 1e-4 * (1 + theirs["rgba"][inside].max(axis=1))
    assert light.mean() <= max(folds, 0.001)


@pytest.mark.long
def test_antialiased_pictures_agree():
    """Sixteen samples at fixed positions under a filter are closer to many random samples than sixteen random ones."""
    tables = SCENES["spheres and a plane"]()
    drawn = {
        name: pictures.picture(tables, backend, size=SIZE, samples=samples).channels["rgba"]
        for name, backend, samples in (("ours", "raster", 16), ("rays", "ray", 16), ("many", "ray", 256))
    }
    ours, rays = (np.abs(drawn[name] - drawn["many"]).max(axis=2) for name in ("ours", "rays"))
    assert ours.mean() < 5e-4
    assert ours.mean() < rays.mean()
    assert np.median(ours) < 1e-6
    assert ours.max() < 0.05
