"""Values at the texels of an atlas as pictures: textures, and normals of heights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...ir import F64
from ...mesh.shells import Shell, SurfacePoints
from .atlas import Atlas

LookUp = Callable[[SurfacePoints], F64]
"""Points of a surface → (k, 3) values of a texture."""


def surface_points(shell: Shell, atlas: Atlas) -> SurfacePoints:
    """The points of a surface at the texels of its atlas, in the frame of the instance."""
    corners = shell.triangles[atlas.triangle]
    within = np.clip(atlas.weights, 0.0, None)
    within = within / within.sum(axis=1, keepdims=True)
    local = (shell.positions[corners] * atlas.weights[..., None]).sum(axis=1)
    a, b, c = (shell.positions[corners[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    normals = faces if shell.normals is None else (shell.normals[corners] * within[..., None]).sum(axis=1)
    normals = np.where((normals * normals).sum(axis=1, keepdims=True) > 0.0, normals, faces)
    uvs = np.zeros((len(local), 2)) if shell.uvs is None else (shell.uvs[corners] * within[..., None]).sum(axis=1)
    return SurfacePoints(local, _unit(normals), _unit(faces), uvs)


def normals_of_heights(points: SurfacePoints, shell: Shell, atlas: Atlas, stretch: F64, look_up: LookUp) -> F64:
    """(k, 3) normals of a surface with heights in metres, along u and v of the atlas and outward. Slopes are differences over a texel.

    `stretch` (3,) are metres a unit of the instance's frame along its axes; the atlas is one of stretched positions.
    """
    outward = _unit(points.normals / stretch)
    upright = (atlas.axes * outward).sum(axis=1, keepdims=True)
    along = _unit(atlas.tangents[:, 0] * upright - atlas.axes * (atlas.tangents[:, 0] * outward).sum(axis=1, keepdims=True))
    step, gradients = 0.5 / atlas.density, _gradients(shell, atlas)
    slopes = []
    for direction in (along, np.cross(outward, along)):
        move = step * direction / stretch
        of_uv = (gradients * move[:, None]).sum(axis=2)
        ends = (points._replace(local=points.local + sign * move, uvs=points.uvs + sign * of_uv) for sign in (1.0, -1.0))
        high, low = (np.nan_to_num(look_up(moved)[:, 0]) for moved in ends)
        slopes.append((high - low) / (2.0 * step))
    return _unit(np.stack([-slopes[0], -slopes[1], np.ones(len(slopes[0]))], axis=1))


def _gradients(shell: Shell, atlas: Atlas) -> F64:
    """(k, 2, 3) gradients of u and v at the texels, in the frame of the instance."""
    if shell.uvs is None:
        return np.zeros((len(atlas.triangle), 2, 3))
    a, b, c = (shell.positions[shell.triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    size = np.maximum((face * face).sum(axis=1, keepdims=True), 1e-300)
    first, second = np.cross(c - a, face) / size, np.cross(face, b - a) / size
    u, v, w = (shell.uvs[shell.triangles[:, k]] for k in range(3))
    gradients = (v - u)[..., None] * first[:, None] + (w - u)[..., None] * second[:, None]
    return gradients[atlas.triangle]


def picture(atlas: Atlas, values: F64) -> NDArray[np.float32]:
    """(height, width, 3) the values (k, 3) of an atlas; texels between charts have means of those around them, for smaller pictures."""
    pixels, is_set = np.zeros((atlas.height * atlas.width, 3), np.float32), np.zeros(atlas.height * atlas.width, np.float32)
    pixels[atlas.texels], is_set[atlas.texels] = values, 1.0
    shape = atlas.height, atlas.width
    return _filled(pixels.reshape(*shape, 3), is_set.reshape(shape))


def _filled(pixels: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels, where their weight is 0 those of a picture of half the size."""
    if weight.all() or max(weight.shape) == 1:
        return pixels
    height, width = weight.shape
    padded = np.pad(weight, ((0, height % 2), (0, width % 2)))
    sums = np.pad(pixels * weight[..., None], ((0, height % 2), (0, width % 2), (0, 0)))
    share = padded[::2, ::2] + padded[1::2, ::2] + padded[::2, 1::2] + padded[1::2, 1::2]
    total = sums[::2, ::2] + sums[1::2, ::2] + sums[::2, 1::2] + sums[1::2, 1::2]
    half = _filled((total / np.maximum(share, 1.0)[..., None]).astype(np.float32), (share > 0.0).astype(np.float32))
    wide = half.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
    return np.where(weight[..., None] > 0.0, pixels, wide)


def _unit(vectors: F64) -> F64:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
