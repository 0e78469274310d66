"""Small scenes for the tests of rendering, made with the scene builder: shapes, meshes, lights and a camera in one call each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from maquette.compiler import ir
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import CameraData, Input, InstanceData, LightData, MaterialData, MeshData, lambert
from maquette.render import types
from maquette.render.accel import intersect, scene_bvh
from maquette.render.accel.traverse import motion_alpha
from maquette.render.integrator import ray_stack, whitted
from maquette.render.integrator.state.records import Scene
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.lanes import crosslane, ops
from maquette.render.types import Hit, Options, Ray, VertexLight

IDENTITY = np.eye(4)
OPTIONS = Options(seed=0, bounces=0, interreflection=False, shadows=True, background=0, color=types.Float3(0.0, 0.0, 0.0))


def matrix(translate: Any = (0, 0, 0), linear: Any = None) -> np.ndarray:
    """(4, 4) from a translation and a 3×3 linear part."""
    frame = np.eye(4)
    frame[:3, :3] = np.eye(3) if linear is None else linear
    frame[:3, 3] = translate
    return frame


def turn(axis: int, angle: float) -> np.ndarray:
    """3×3 rotation about x, y or z, counter-clockwise seen from the axis' end."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    rotation[a, a], rotation[a, b], rotation[b, a], rotation[b, b] = c, -s, s, c
    return rotation


def looking(position: Sequence[float], target: Sequence[float], up: Sequence[float] = (0, 1, 0)) -> np.ndarray:
    """(4, 4) frame of a camera that looks down its -z from a position to a point."""
    z = np.asarray(position, float) - np.asarray(target, float)
    z /= np.linalg.norm(z)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    return matrix(position, np.stack([x, np.cross(z, x), z], axis=1))


def facing(position: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """(4, 4) frame whose +y points from a position to a point: where an area light shines."""
    y = np.asarray(target, float) - np.asarray(position, float)
    y /= np.linalg.norm(y)
    x = np.cross(y, [0.0, 0.0, 1.0] if abs(y[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return matrix(position, np.stack([x, y, np.cross(x, y)], axis=1))


def grey(value: float) -> tuple[float, float, float]:
    """The same number for red, green and blue."""
    return (value, value, value)


def mesh(positions: Any, triangles: Any, **attributes: Any) -> MeshData:
    """A mesh from anything that makes arrays."""
    return MeshData(np.asarray(positions, float), np.asarray(triangles, np.int64), **attributes)


def scene(
    shapes: Sequence[tuple[ir.GeometryKind, Sequence[float], np.ndarray, int]] = (),
    meshes: Sequence[tuple[MeshData, np.ndarray, int]] = (),
    materials: Sequence[MaterialData] = (),
    lights: Sequence[LightData] = (),
    camera: CameraData | None = None,
    frame: np.ndarray | None = None,
    prepare: Any = None,
) -> ir.Tables:
    """The tables of shapes (kind, parameters, matrix, material row) and meshes (data, matrix, material row).

    Lights and the camera that say transform=1 stand in `frame`. `prepare(builder)` adds what else is needed
    (textures, pictures) before the materials are made, and returns them if it makes them itself.
    """
    builder = SceneBuilder()
    row = builder.transform(IDENTITY if frame is None else frame)
    if prepare is not None:
        materials = prepare(builder) or materials
    rows = [builder.material(m) for m in materials or [lambert((1.0, 1.0, 1.0))]]
    for kind, parameters, placed, material in shapes:
        builder.instance(InstanceData(builder.geometry(kind, parameters), builder.transform(placed), rows[material]))
    for data, placed, material in meshes:
        builder.instance(InstanceData(builder.mesh(data), builder.transform(placed), rows[material]))
    for light in lights:
        builder.light(replace(light, transform=row if light.transform else 0))
    camera = camera or CameraData(transform=0, extent=1.0)
    builder.camera(replace(camera, transform=row if camera.transform else 0))
    return builder.finish().tables


def phong(
    diffuse: Any = 0.0, specular: Any = 0.0, shininess: Any = 1.0, model: ir.MaterialModel = ir.MaterialModel.PHONG, **more: Any
) -> MaterialData:
    """A grey material of the course's models; `more` are inputs by slot name in lower case, `shading` or `normalized`."""
    slots = {"diffuse": diffuse, "specular": specular, "shininess": shininess, "ambient": diffuse, "ior": 1.0}
    fields = {name: more.pop(name) for name in ("shading", "normalized") if name in more}
    slots.update(more)
    inputs = {ir.Slot[name.upper()]: value if isinstance(value, Input) else Input((value,) * 3) for name, value in slots.items()}
    return MaterialData(model, inputs, **fields)


def no_gouraud(tables: ir.Tables) -> VertexLight:
    """No light computed at vertices."""
    return VertexLight(np.full(len(tables.instances.geometry), -1, np.int64), np.zeros((2, 3)))


def rays(origin: Any, direction: Any, t_min: float = 0.0, t_max: float = np.inf) -> Ray:
    """Rays as lanes from origins and directions (n, 3) or (3,); directions are normalised."""
    o, d = np.broadcast_arrays(np.atleast_2d(np.asarray(origin, float)), np.atleast_2d(np.asarray(direction, float)))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    n = len(o)
    return Ray(tuple(o.T.copy()), tuple(d.T.copy()), np.full(n, t_min), np.full(n, t_max))


def first_hit(tables: ir.Tables, ray: Ray) -> Hit:
    """What rays meet, by brute force."""
    return intersect.closest_hit(intersect.Brute(), tables, ray, np.ones(len(ray.t_min), bool), int(ir.Visibility.CAMERA))


def radiance(
    tables: ir.Tables, ray: Ray, options: Options = OPTIONS, samples: int = 1, light: VertexLight | None = None, pixel: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """(rgb (samples, n, 3), alpha (samples, n)) along rays by the numpy lanes; every sample must be finite."""
    n = len(ray.t_min)
    hit = first_hit(tables, ray)
    stack = ray_stack.stack_for(options, n)
    rgb, alpha = np.zeros((samples, n, 3)), np.zeros((samples, n))
    pixels = pixel + np.arange(n)
    with np.errstate(all="ignore"):
        for s in range(samples):
            scene_of = Scene(tables, intersect.Brute(), light or no_gouraud(tables), options)
            color, alpha[s], sound = whitted.radiance(scene_of, ray, hit, pixels, np.full(n, s), stack)
            assert np.all(sound)
            rgb[s] = np.stack(np.broadcast_arrays(*color, hit.t)[:3], axis=1)
    return rgb, alpha


def radiance_in_kernel(
    tables: ir.Tables, ray: Ray, options: Options = OPTIONS, samples: int = 1, light: VertexLight | None = None, pixel: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """The same by the compiled integrator through the trees."""
    n = len(ray.t_min)
    rgb, alpha = np.zeros((samples, n, 3)), np.zeros((samples, n))
    stack = ray_stack.stack_for(options, crosslane.WIDTH)
    columns = np.stack([*ray.origin, *ray.direction, ray.t_min, ray.t_max])
    frame = Handle(types.Frame(types.View(0, 1, 1), options, np.zeros(1)))
    packed = Handle(tables), Handle(scene_bvh.build(tables)), Handle(light or no_gouraud(tables))  # kept until the kernel is done
    motion_alpha.link(packed[1])
    whitted.link(frame, *packed)
    issues = _each_ray(*packed, frame, columns, pixel, stack, rgb, alpha)
    assert issues == 0
    return rgb, alpha


@kernel
def _each_ray(tables, accel, light, frame, columns, pixel, stack, rgb, alpha):
    n, issues = rgb.shape[1], 0
    for s in range(rgb.shape[0]):
        for start in range(0, n, crosslane.WIDTH):
            k = ops.minimum(crosslane.lane_indices(start), n - 1)
            origin, direction = (columns[0, k], columns[1, k], columns[2, k]), (columns[3, k], columns[4, k], columns[5, k])
            ray = types.Ray(origin, direction, columns[6, k], columns[7, k], None)
            hit = intersect.closest_hit(accel, tables, ray, ops.bool_like(ray.t_max, True), 1)
            number = ops.int_like(k, s)
            color, cover, sound = whitted.linked_radiance(frame, tables, accel, light, ray, hit, pixel + k, number, stack, None)
            for j in range(min(n - start, crosslane.WIDTH)):
                alpha[s, start + j] = crosslane.lane(cover, j)
                for c in range(3):
                    rgb[s, start + j, c] = crosslane.lane(color[c], j)
                issues += 0 if crosslane.lane(sound, j) else 1
    return issues
