"""Textures as values of the inputs that they multiply: pictures, cells of checkers and stripes, their frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import ir
from ..mesh.shells import Shell
from .placement import F64

BLACK = np.zeros(3)


def texture_matrix(tables: ir.Tables, row: int) -> F64:
    """(3, 3) matrix from a surface's u, v to the texture's s, t."""
    frame = np.eye(3)
    frame[:2] = tables.textures.frame[row]
    return frame


def with_cells(tables: ir.Tables, row: int, shell: Shell, scale: float) -> Shell:
    """`shell` with coordinates in cells of a checker or stripes, one unit a cell. `scale` is the shell's scale to world."""
    count = len(shell.triangles)
    uvs = np.zeros((count, 3, 2)) if shell.uvs is None else shell.uvs[shell.triangles]
    frame = texture_matrix(tables, row)
    st = uvs @ frame[:2, :2].T + frame[:2, 2]
    size = float(tables.textures.size[row])
    metric = np.ones((count, 2)) if shell.metric is None else shell.metric
    cells = st * (metric[:, None, :] * scale / size if size > 0.0 else 8.0)
    if tables.textures.kind[row] == ir.TextureKind.STRIPES:
        cells[..., 1] = 0.5
    corner = shell.triangles.ravel()
    normals, colors = (None if v is None else v[corner] for v in (shell.normals, shell.colors))
    numbers = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Shell(shell.positions[corner], numbers, normals, cells.reshape(-1, 2), metric, colors)


def cell_colors(tables: ir.Tables, row: int, constant: F64) -> tuple[F64, F64]:
    """The two colours of a checker or stripes as values of a material's input."""
    textures = tables.textures
    pair = []
    for color in (textures.color_a[row], textures.color_b[row]):
        channel = int(textures.channel[row])
        texel = color if channel < 0 else np.full(3, color[channel] if channel < 3 else 1.0)
        pair.append(constant * (textures.gain[row] * texel + textures.bias[row]))
    return pair[0], pair[1]


def picture(tables: ir.Tables, row: int, constant: F64) -> NDArray[np.float32]:
    """(height, width, 3) pixels of an image texture as values of a material's input: gain, bias and constant applied."""
    textures, images = tables.textures, tables.images
    image = int(textures.image[row])
    texels = pixels(images, image)
    channel = int(textures.channel[row])
    color = texels[..., :3] if channel < 0 else np.repeat(texels[..., channel : channel + 1], 3, axis=2)
    return (constant * (textures.gain[row] * color + textures.bias[row])).astype(np.float32)


def mean(tables: ir.Tables, row: int) -> F64:
    """(3,) mean of a picture, a checker or stripes as values of a material's input."""
    if tables.textures.kind[row] == ir.TextureKind.IMAGE:
        return picture(tables, row, np.ones(3)).mean(axis=(0, 1), dtype=np.float64)
    a, b = cell_colors(tables, row, np.ones(3))
    return 0.5 * (a + b)


def pixels(images: ir.Images, image: int) -> NDArray[np.float32]:
    """(height, width, 4) linear pixels of an image, from the top."""
    first, width, height = int(images.first[image]), int(images.width[image]), int(images.height[image])
    return images.texels[first : first + width * height].reshape(height, width, 4)


def follows_uv(tables: ir.Tables, row: int, kind: int) -> bool:
    """Whether a texture uses the surface's own u, v on a kind of shape (two more mappings equal it on spheres and boxes)."""
    mapping = tables.textures.mapping[row]
    same = (ir.TextureMapping.LATLONG, ir.GeometryKind.SPHERE), (ir.TextureMapping.BOX, ir.GeometryKind.BOX)
    return bool(mapping == ir.TextureMapping.UV) or (mapping, kind) in same
