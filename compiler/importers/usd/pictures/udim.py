"""Reads the tiles of a UDIM texture into one image: tile 1001 + u + 10 v covers the unit square from (u, v)."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .....lang.diagnostics import Span
from ....scene.builder import SceneBuilder
from ... import images

Frame = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Tiles:
    """The tiles of a texture: number and path of each; `name` has <UDIM> in their place."""

    name: str
    paths: tuple[tuple[int, str], ...]

    def _corner(self) -> tuple[int, int, int, int]:
        """The least u and v, and the numbers of columns and rows."""
        us, vs = [(n - 1001) % 10 for n, _ in self.paths], [(n - 1001) // 10 for n, _ in self.paths]
        return min(us), min(vs), max(us) - min(us) + 1, max(vs) - min(vs) + 1

    def row(
        self, builder: SceneBuilder, space: str, color: bool, source: Callable[[str], str | bytes], span: Span | None
    ) -> int:  # fmt: skip
        """The row of the image of all tiles; `source` gives the path or the bytes of a tile. Tiles that are missing are black.

        Tiles have the size of the largest. Warnings refer to `span`. Raises ImageError.
        """
        space = "linear" if space == "auto" and not color else space
        key = ("udim", self.name, self.paths, space)
        return builder.shared(key, lambda: builder.image(self._texels(builder, space, source, span), self.name))

    def _texels(self, builder: SceneBuilder, space: str, source: Callable[[str], str | bytes], span: Span | None) -> np.ndarray:
        left, low, columns, rows = self._corner()
        limit = min(images.MAX_TEXELS, images.MAX_ALL_TEXELS - builder.texels)
        tiles = []
        for n, path in self.paths:
            name = path.rsplit("/", 1)[-1]
            decoded = images.read(source(path), name, space, limit)
            decoded.warn(name, builder.diagnostics, span)
            tiles.append((n, decoded.texels))
        height, width = (max(texels.shape[axis] for _, texels in tiles) for axis in (0, 1))
        if height * width * columns * rows > limit:
            message = f"the {len(tiles)} tiles of `{self.name}` are too big together: {width * columns} by {height * rows} pixels"
            raise images.ImageError(message, f"at most {images.MAX_TEXELS:,}")
        made = np.zeros((height * rows, width * columns, 4), np.float32)
        made[..., 3] = 1.0
        for n, texels in tiles:
            column, row = (n - 1001) % 10 - left, rows - 1 - ((n - 1001) // 10 - low)
            y, x = np.arange(height) * texels.shape[0] // height, np.arange(width) * texels.shape[1] // width
            made[row * height : (row + 1) * height, column * width : (column + 1) * width] = texels[y[:, None], x]
        return made

    def frame(self, of: Frame) -> Frame:
        """The frame `of` a texture followed by the placement of the tiles in their image."""
        left, low, columns, rows = self._corner()
        (a, b, c), (d, e, f) = of
        return (a / columns, b / columns, (c - left) / columns), (d / rows, e / rows, (f - low) / rows)
