"""Files that a stage refers to: pictures, UDIM tiles and profiles, on disk or inside a package."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Ar, UsdShade

from ....lang.diagnostics import Span
from ...io.regular_files import read_bytes
from ...scene.builder import SceneBuilder
from .. import images
from ..common import file_names
from .pictures import udim
from .stage import Warnings


@dataclass(frozen=True, slots=True)
class Asset:
    """A file referenced by a stage, on disk or inside a package."""

    path: str
    tiles: udim.Tiles | None = None  # of a UDIM texture; `path` is the first

    def among(self, numbers: tuple[int, ...] | None) -> Asset | None:
        """The tiles of some numbers of a UDIM texture, all for None; None without any."""
        if self.tiles is None or numbers is None:
            return self
        tiles = self.tiles.among(numbers)
        return None if tiles is None else Asset(tiles.paths[0][1], tiles)

    def row(
        self, builder: SceneBuilder, space: str, color: bool = True, span: Span | None = None, missing: tuple[float, ...] = (0, 0, 0, 1)
    ) -> int:  # fmt: skip
        """The row of the image. Tiles of a UDIM texture that are not there have the value `missing`. Raises images.ImageError."""
        if self.tiles is not None:
            return self.tiles.row(builder, space, color, _source, span, missing)
        source = _source(self.path)
        if isinstance(source, str):
            return images.row(builder, Path(source), space, color, span)
        return images.row_from_bytes(builder, source, self.path, space, color, span)


def _source(path: str) -> str | bytes:
    """The path of a file, or the bytes of one in a package."""
    if not path.endswith("]"):
        return path
    opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if opened is None:
        raise images.ImageError(f"the package has no `{path.rsplit('/', 1)[-1].rstrip(']')}`")
    return bytes(opened.GetBuffer())


def contents(path: str) -> bytes:
    """The bytes of a file, on disk or in a package. Raises OSError or images.ImageError."""
    source = _source(path)
    return read_bytes(source) if isinstance(source, str) else source


def asset(value: Any, warnings: Warnings, prim: Any, what: str = "picture") -> Asset | None:
    """The file of an asset-valued attribute. None and a warning if it does not exist."""
    written = str(getattr(value, "path", value) or "")
    without = "its fallback is drawn" if what == "picture" else "it is left out"
    if not written:
        warnings.tell("the texture names no file: its fallback is drawn", prim)
        return None
    resolved = str(getattr(value, "resolvedPath", "") or "")
    tiles: tuple[tuple[int, str], ...] = ()
    if "<UDIM>" in written:
        candidates = [(int(number), str(path)) for path, number in UsdShade.UdimUtils.ResolveUdimTilePaths(written, _layer(prim))]
        candidates += udim.high_tiles(str(Path(_layer(prim).realPath).parent / written))
        faults = [warnings.opened.outside(written.replace("<UDIM>", str(number)), path) for number, path in candidates]
        tiles = tuple(sorted(tile for tile, fault in zip(candidates, faults, strict=True) if not fault))
        for message, hint in filter(None, faults):
            warnings.diagnostics.warning(f"the {what} {message}: it is left out", warnings.opened.span(prim), hint)
        if candidates and not tiles:
            return None
        resolved = tiles[0][1] if tiles else ""
    if not resolved and "<UDIM>" not in written:
        resolved = _otherwise_spelled(written, prim)
    if not resolved:
        warnings.tell(f"there is no {what} `{written}`: {without}", prim)
        return None
    if fault := warnings.opened.outside(written, resolved):
        message, hint = fault
        warnings.diagnostics.warning(f"the {what} {message}: {without}", warnings.opened.span(prim), hint)
        return None
    return Asset(resolved, udim.Tiles(written, tiles) if tiles else None)


def _otherwise_spelled(written: str, prim: Any) -> str:
    """The path of a file that is named with backslashes or in another case beside a layer of the prim; "" for none."""
    folders = (Path(spec.layer.realPath).parent for spec in prim.GetPrimStack() if spec.layer.realPath)
    return next((str(path) for folder in dict.fromkeys(folders) if (path := file_names.existing_path(written, folder)) is not None), "")


def _layer(prim: Any) -> Any:
    return prim.GetPrimStack()[0].layer if prim.GetPrimStack() else prim.GetStage().GetRootLayer()
