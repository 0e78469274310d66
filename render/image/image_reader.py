"""Reads pictures of any format that OpenImageIO reads as scene-linear Images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...compiler.io import library_messages
from . import image as images
from .image_files import ABOUT, CHANNEL_NAMES, LIGHT, FormatError
from .srgb import decode_srgb


@library_messages.left_out()
def read(path: Path) -> images.Image:
    """Read a picture in any format of OpenImageIO, as scene-linear rgba with associated alpha (1 without an alpha channel).

    Integer files are sRGB with unassociated alpha, float files are linear. Other channels that maquette writes are read, too. metadata:
    "size" of the whole picture and "crop" in it, "bits" a channel (0 for floats), "alpha": whether it has alpha, and "about": the texts
    that `write` got. Raises FormatError if the file is missing or not a picture.
    """
    wanted = oiio.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)
    if not Path(path).is_file():
        raise FormatError(f"there is no file {path}")
    source = oiio.ImageInput.open(str(path), wanted)
    if source is None:
        raise FormatError(f"{path} is not a picture: {oiio.geterror()}")
    try:
        spec = source.spec()
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            raise FormatError(f"{path} cannot be read: {source.geterror()}")
    finally:
        source.close()
    return _as_image(np.asarray(pixels, dtype=np.float32).reshape(spec.height, spec.width, -1), spec)


def _as_image(pixels: NDArray[np.float32], spec: Any) -> images.Image:
    names = list(spec.channelnames)
    if all(name in names for name in "RGB"):
        rgb = pixels[..., [names.index(name) for name in "RGB"]].astype(np.float64)
    else:
        rgb = np.repeat(pixels[..., :1], 3, axis=2).astype(np.float64)  # grey
    alpha = pixels[..., [spec.alpha_channel]].astype(np.float64) if spec.alpha_channel >= 0 else np.ones_like(rgb[..., :1])
    if spec.format.basetype in (oiio.UINT8, oiio.UINT16):
        rgb = decode_srgb(rgb) * alpha
    found = {"rgba": np.concatenate([rgb, alpha], axis=2).astype(np.float32)}
    for channel, parts in CHANNEL_NAMES.items():
        if channel not in found and all(part in names for part in parts):
            found[channel] = pixels[..., [names.index(part) for part in parts]]
    for part in names:
        if part.startswith("light_") and part.endswith(".R"):
            layer = part.removesuffix(".R")
            found[LIGHT + layer.removeprefix("light_")] = pixels[..., [names.index(f"{layer}.{c}") for c in "RGB"]]
    return images.Image(spec.width, spec.height, found, _read_about(spec))


def _read_about(spec: Any) -> dict[str, Any]:
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    return {
        "size": (spec.full_width, spec.full_height),
        "crop": (x, y, x + spec.width, y + spec.height),
        "alpha": spec.alpha_channel >= 0,
        "bits": {oiio.UINT8: 8, oiio.UINT16: 16}.get(spec.format.basetype, 0),
        "about": {a.name.removeprefix(ABOUT): str(a.value) for a in spec.extra_attribs if a.name.startswith(ABOUT)},
    }
