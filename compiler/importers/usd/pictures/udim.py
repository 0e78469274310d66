"""Tiles of UDIM textures: tile 1001 + u + 10 v covers the unit square from (u, v).

Faces of one tile have its picture alone; faces over several tiles have one image of these.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from .....lang.diagnostics import Span
from ....scene.builder import SceneBuilder
from ... import images

FIRST, COLUMNS = 1001, 10  # number of the tile of u and v from 0 to 1, tiles along u
_LAST = 1100  # the last tile that usd-core looks for
NO_TILE = 0  # in place of the number of a tile where u or v have none
_EDGE = 1e-4  # share of a face that may lie in the next tile
Frame = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Tiles:
    """The tiles of a texture: number and path of each; `name` has <UDIM> in their place."""

    name: str
    paths: tuple[tuple[int, str], ...]

    def _corner(self) -> tuple[int, int, int, int]:
        """The least u and v, and the numbers of columns and rows."""
        us, vs = [(n - FIRST) % COLUMNS for n, _ in self.paths], [(n - FIRST) // COLUMNS for n, _ in self.paths]
        return min(us), min(vs), max(us) - min(us) + 1, max(vs) - min(vs) + 1

    def corner(self, number: int) -> tuple[int, int]:
        """The least u and v of a tile."""
        return (number - FIRST) % COLUMNS, (number - FIRST) // COLUMNS

    def among(self, numbers: Collection[int]) -> Tiles | None:
        """Those of some numbers; None without any."""
        paths = tuple((n, path) for n, path in self.paths if n in numbers)
        return Tiles(self.name, paths) if paths else None

    def row(
        self, builder: SceneBuilder, space: str, color: bool, source: Callable[[str], str | bytes], span: Span | None,
        missing: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
    ) -> int:  # fmt: skip
        """The row of the image of all tiles; `source` gives the path or the bytes of a tile. `missing` tiles have one value.

        Tiles have the size of the largest, less where all images of the scene would be too big. Raises ImageError.
        """
        space = "linear" if space == "auto" and not color else space
        key = ("udim", self.name, self.paths, space, color, missing)
        return builder.shared(key, lambda: builder.image(self._texels(builder, (space, color), source, span, missing), self.name))

    def _texels(
        self, builder: SceneBuilder, how: tuple[str, bool], source: Callable[[str], str | bytes], span: Span | None,
        missing: tuple[float, ...],
    ) -> np.ndarray:  # fmt: skip
        left, low, columns, rows = self._corner()
        tiles, largest = [], max(_room(builder) // (columns * rows), 1)
        for n, path in self.paths:
            name = path.rsplit("/", 1)[-1]
            decoded = images.read(source(path), name, how[0], images.MAX_TEXELS, how[1], builder.files.colors)
            builder.is_wide |= decoded.is_wide
            decoded.warn(name, builder.diagnostics, span)
            tiles.append((n, self._fitting(decoded.texels, largest, builder, span)))
        height, width = (max(texels.shape[axis] for _, texels in tiles) for axis in (0, 1))
        if height * width > largest:
            message = f"the {len(tiles)} tiles of `{self.name}` are too big together: {width * columns} by {height * rows} pixels"
            raise images.ImageError(message, f"at most {images.MAX_TEXELS:,}")
        image = np.empty((height * rows, width * columns, 4), np.float32)
        image[:] = missing
        for n, texels in tiles:
            column, row = (n - FIRST) % COLUMNS - left, rows - 1 - ((n - FIRST) // COLUMNS - low)
            y, x = np.arange(height) * texels.shape[0] // height, np.arange(width) * texels.shape[1] // width
            image[row * height : (row + 1) * height, column * width : (column + 1) * width] = texels[y[:, None], x]
        return image

    def _fitting(self, texels: np.ndarray, largest: int, builder: SceneBuilder, span: Span | None) -> np.ndarray:
        """A tile of at most `largest` texels: halved, as by a texture pyramid, with a warning."""
        height, width = texels.shape[:2]
        while texels.shape[0] * texels.shape[1] > largest and min(texels.shape[:2]) > 1:
            texels = texels[: texels.shape[0] // 2 * 2, : texels.shape[1] // 2 * 2]
            texels = (texels[::2, ::2] + texels[1::2, ::2] + texels[::2, 1::2] + texels[1::2, 1::2]) / np.float32(4.0)
        if texels.shape[:2] != (height, width):
            message = f"tiles of `{self.name}` are drawn with {texels.shape[1]} by {texels.shape[0]} pixels in place of {width} by {height}"
            said = [item.message for item in builder.diagnostics.items]
            if message not in said:
                builder.diagnostics.warning(f"{message}", span, f"all pictures of a scene have at most {images.MAX_ALL_TEXELS:,} pixels")
        return texels

    def frame(self, texture_frame: Frame) -> Frame:
        """The frame `texture_frame` a texture followed by the placement of the tiles in their image."""
        left, low, columns, rows = self._corner()
        (a, b, c), (d, e, f) = texture_frame
        return (a / columns, b / columns, (c - left) / columns), (d / rows, e / rows, (f - low) / rows)


def high_tiles(pattern: str) -> list[tuple[int, str]]:
    """The tiles from 1101 on beside each other in a folder, which usd-core does not look for. `pattern` is a path with <UDIM>."""
    folder, name = os.path.split(pattern)
    before, _, after = name.partition("<UDIM>")
    if not os.path.isdir(folder):
        return []
    wanted = re.compile(re.escape(before) + r"(\d{4})" + re.escape(after))
    numbered = [(int(match[1]), file) for file in os.listdir(folder) if (match := wanted.fullmatch(file))]
    return [(number, os.path.join(folder, file)) for number, file in numbered if number > _LAST]


def _room(builder: SceneBuilder) -> int:
    """Texels that one more image may have. Half of what is left stays for others."""
    return min(images.MAX_TEXELS, (images.MAX_ALL_TEXELS - builder.texels) // 2)


def of_faces(uvs: np.ndarray, counts: np.ndarray, frame: Frame) -> tuple[np.ndarray, np.ndarray, set[int]]:
    """(tile of each face, whether it lies in several tiles, numbers of all tiles that faces lie in).

    `uvs` (c, 2) are the coordinates of the faces' corners, `frame` leads from them to the texture's. Faces without corners have tile 0.
    """
    matrix = np.array(frame)
    coordinates = np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0) @ matrix[:, :2].T + matrix[:, 2]
    face = np.repeat(np.arange(len(counts)), counts)
    middle = np.stack([np.bincount(face, coordinates[:, k], len(counts)) for k in (0, 1)], axis=1) / np.maximum(counts, 1)[:, None]
    inside = coordinates + _EDGE * (middle[face] - coordinates)
    corners, middles = _number(inside), _number(middle)
    middles[counts == 0] = NO_TILE
    several = np.bincount(face, corners != middles[face], len(counts)) > 0
    return middles, several, set(np.unique(np.concatenate([corners, middles[counts > 0]])).tolist())


def _number(coordinates: np.ndarray) -> np.ndarray:
    """Numbers of the tiles at texture coordinates (n, 2)."""
    u, v = np.floor(np.clip(coordinates, -1.0, 1e6)).astype(np.int64).T
    return np.where((u >= 0) & (u < COLUMNS) & (v >= 0), FIRST + u + COLUMNS * v, NO_TILE)
