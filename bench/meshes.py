"""Procedural meshes and rays, equal on every machine by seed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.scene.builder import SceneBuilder
from ..compiler.scene.row_records import CameraData, InstanceData, MaterialData, MeshAttribute, MeshData

F32 = NDArray[np.float32]
SIZES = {"70k": (350, 100), "400k": (1000, 200), "1M": (2000, 250)}  # rings along a knot, corners of a ring
TINY = {"2k": (100, 10)}


def sizes(quick: bool) -> dict[str, tuple[int, int]]:
    """The mesh sizes of a benchmark, or small ones for a quick run."""
    return TINY if quick else SIZES


OUTSIDE = 1e-4  # share of the scene's size by which secondary rays start off the surface


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles, counter-clockwise from outside."""

    positions: F32  # (v, 3)
    normals: F32  # (v, 3) unit
    triangles: NDArray[np.int32]  # (t, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """origin + t · direction for 0 < t < limit; float32, directions of unit length."""

    name: str
    origin: F32  # (n, 3)
    direction: F32  # (n, 3)
    limit: F32  # (n,)


def knot(rings: int, corners: int) -> Mesh:
    """A closed (2, 3) torus knot with a bumpy tube, inside the unit sphere: 2 · rings · corners triangles with occlusion.

    Vertices are ordered ring by ring, as modelling programs write them.
    """
    along = 2.0 * np.pi * np.arange(rings)[:, None] / rings
    around = 2.0 * np.pi * np.arange(corners)[None, :] / corners
    positions = _tube(along, around)
    step = 1e-5
    forward = _tube(along + step, around) - _tube(along - step, around)
    normals = np.cross(forward, _tube(along, around + step) - _tube(along, around - step))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    i, j = np.meshgrid(np.arange(rings), np.arange(corners), indexing="ij")
    a, b = i * corners + j, (i + 1) % rings * corners + j
    c, d = (i + 1) % rings * corners + (j + 1) % corners, i * corners + (j + 1) % corners
    triangles = np.stack([np.stack([a, c, d], -1), np.stack([a, b, c], -1)], axis=2).reshape(-1, 3)
    return Mesh(positions.reshape(-1, 3).astype(np.float32), normals.reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))


def _tube(along: NDArray[np.float64], around: NDArray[np.float64]) -> NDArray[np.float64]:
    def curve(t: NDArray[np.float64]) -> NDArray[np.float64]:
        ring = 0.55 + 0.22 * np.cos(3.0 * t)
        return np.stack([ring * np.cos(2.0 * t), 0.3 * np.sin(3.0 * t), ring * np.sin(2.0 * t)], -1)

    tangent = curve(along + 1e-4) - curve(along - 1e-4)
    side = np.cross(tangent, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    over = np.cross(side, tangent)
    over /= np.linalg.norm(over, axis=-1, keepdims=True)
    bumps = 0.13 * (1.0 + 0.12 * np.sin(40.0 * along) * np.sin(8.0 * around) + 0.03 * np.sin(170.0 * along + 23.0 * around))
    return curve(along) + bumps[..., None] * (np.cos(around)[..., None] * side + np.sin(around)[..., None] * over)


def boulders(count: int, seed: int = 1) -> NDArray[np.float64]:
    """(count, 3, 4) transforms that rotate, shrink and scatter copies of the unit sphere in a cube of side 2."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    turn = np.stack([
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    ], -1).reshape(-1, 3, 3)  # fmt: skip
    size = 1.3 * count ** (-1.0 / 3.0) * rng.uniform(0.4, 1.0, count)
    return np.concatenate([turn * size[:, None, None], rng.uniform(-0.9, 0.9, (count, 3, 1))], axis=2)


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """(3, 4) camera to world: at `eye`, -z towards `target`, y up."""
    back = np.subtract(eye, target)
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back, np.asarray(eye, dtype=np.float64)], axis=1)


EYE = (0.9, 0.8, 2.4)
EXTENT = 0.38  # tangent of half the field of view


def scene(mesh: Mesh, transforms: NDArray[np.float64] | None = None, material: MaterialData | None = None, lights: tuple = ()) -> ir.Scene:
    """A scene of one mesh or of its instances, seen from EYE."""
    builder = SceneBuilder()
    geometry = builder.mesh(MeshData(mesh.positions, mesh.triangles, normals=MeshAttribute(mesh.normals)))
    material_row = builder.material(material or MaterialData())
    for matrix in [np.eye(4)] if transforms is None else transforms:
        builder.instance(InstanceData(geometry, builder.transform(matrix), material_row))
    for light in lights:
        builder.light(light)
    builder.camera(CameraData(builder.transform(look_at(EYE)), EXTENT))
    return builder.finish("bench")


def primary(resolution: int) -> Rays:
    """Rays through the pixels of a square picture from EYE, in Morton order; `resolution` is a power of two."""
    k = np.arange(resolution * resolution)
    x, y = np.zeros_like(k), np.zeros_like(k)
    for bit in range(int(resolution - 1).bit_length()):
        x |= (k >> 2 * bit & 1) << bit
        y |= (k >> 2 * bit + 1 & 1) << bit
    matrix = look_at(EYE)
    px, py = ((x + 0.5) / resolution * 2 - 1) * EXTENT, (1 - (y + 0.5) / resolution * 2) * EXTENT
    direction = np.stack([px, py, np.full(len(k), -1.0)], -1) @ matrix[:, :3].T
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = np.broadcast_to(matrix[:, 3], direction.shape)
    return Rays("primary", _f32(origin), _f32(direction), np.full(len(k), np.inf, np.float32))


def diffuse(points: NDArray[np.float64], normals: NDArray[np.float64], seed: int = 2) -> Rays:
    """A cosine-distributed ray from each point, incoherent like a second bounce."""
    rng = np.random.default_rng(seed)
    direction = normals + _sphere(rng, len(points))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Rays("diffuse", _f32(points), _f32(direction), np.full(len(points), np.inf, np.float32))


def shadow(points: NDArray[np.float64], light: tuple[float, float, float] = (2.0, 3.0, 1.5)) -> Rays:
    """A ray from each point to a point light."""
    to = np.asarray(light) - points
    far = np.linalg.norm(to, axis=1)
    return Rays("shadow", _f32(points), _f32(to / far[:, None]), _f32(far * 0.999))


def _sphere(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _f32(values: NDArray[np.float64]) -> F32:
    return np.ascontiguousarray(values, dtype=np.float32)


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write a binary PLY of positions and triangles, without normals: renderers treat smooth normals differently at grazing angles."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.positions)}\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z"))
        + f"element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    path.write_bytes(head.encode() + mesh.positions.astype("<f4").tobytes() + faces.tobytes())
