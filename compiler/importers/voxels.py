"""Reads voxels: densities in a box, from an array of numpy (.npy) or from a picture with the slices below each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...lang.diagnostics import Span
from ..io.regular_files import ANY_SIZE, open_regular
from ..scene.builder import SceneBuilder
from . import images
from .images import MAX_ALL_TEXELS, MAX_TEXELS, ImageError

_DAMAGE = (OSError, EOFError, ValueError, KeyError, TypeError, SyntaxError, MemoryError)
_VOLUMES = (".vdb", ".nvdb", ".vol", ".dat", ".raw", ".nrrd", ".mhd")


def row(builder: SceneBuilder, path: Path, slices: int | None, span: Span | None) -> tuple[int, int]:
    """(row of ir.Images, number of slices) of a file that Files allows; loaded once. Raises ImageError.

    In the image the slices lie below each other, from low to high z, each from low to high y.
    """
    key = ("voxels", str(path), slices)
    limit = min(MAX_TEXELS, MAX_ALL_TEXELS - builder.texels)
    depth: list[int] = []

    def image() -> int:
        voxels = _array(path, limit) if path.suffix.lower() == ".npy" else _picture(path, slices, limit)
        depth.append(len(voxels))
        texels = np.ones((voxels.shape[0] * voxels.shape[1], voxels.shape[2], 4), np.float32)
        texels[..., :3] = voxels.reshape(-1, voxels.shape[2], 1)
        return builder.image(texels, str(path))

    refuse(path.name)
    if path.suffix.lower() == ".npy" and slices is not None:
        raise ImageError("an array has its own number of slices", "leave out `slices`")
    image_row = builder.shared(key, image)
    return image_row, builder.shared((*key, "slices"), lambda: depth[0])


def refuse(name: str) -> None:
    """Raise ImageError for files of volumes that are not read."""
    suffix = Path(name).suffix.lower()
    if suffix in _VOLUMES:
        how = "two lines of Python with pyopenvdb write its grid as an array: docs/media.md has them" if "vdb" in suffix else ""
        raise ImageError(f"{suffix} files are not read", how or 'save its densities with numpy.save("smoke.npy", array), array[z, y, x]')


def _array(path: Path, limit: int) -> np.ndarray:
    """The voxels (z, y, x) of an array file."""
    try:
        with open_regular(path, ANY_SIZE) as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, kind = read(file)
            if len(shape) != 3 or min(shape, default=0) < 1 or kind.kind not in "fiub":
                what = f"of {kind.name} with {len(shape)} dimensions" if min(shape, default=1) > 0 else "without items"
                raise ImageError(f"{path.name} is an array {what}", "voxels are numbers in three dimensions: array[z, y, x]")
            if np.prod([float(n) for n in shape]) > limit:
                raise ImageError(f"{path.name} has {' × '.join(map(str, shape))} voxels", f"at most {limit:,} are read")
            file.seek(0)
            voxels = np.load(file, allow_pickle=False).astype(np.float32)
    except ImageError:
        raise
    except _DAMAGE:
        raise ImageError(f"{path.name} is no array of numpy", 'numpy.save("smoke.npy", array) writes one') from None
    return _checked(voxels, path.name)


def _picture(path: Path, slices: int | None, limit: int) -> np.ndarray:
    """The voxels (z, y, x) of the first channel of a picture."""
    texels = images.read(str(path), path.name, "linear", limit).texels[..., 0]
    if slices is None:
        raise ImageError(f"{path.name} is a picture: its number of slices is missing", "write volume(…, slices: 64)")
    if len(texels) % slices:
        raise ImageError(f"{path.name} is {len(texels)} pixels high, which is no multiple of {slices} slices", "give its number of slices")
    return _checked(texels.reshape(slices, -1, texels.shape[1])[:, ::-1], path.name)


def _checked(voxels: np.ndarray, name: str) -> np.ndarray:
    if not np.isfinite(voxels).all():
        raise ImageError(f"{name} has voxels that are infinite or no numbers", "numpy.nan_to_num replaces them")
    if voxels.min() < 0:
        raise ImageError(f"{name} has densities below 0", "numpy.maximum(array, 0) replaces them")
    return voxels
