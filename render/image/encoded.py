"""Encodes arrays as picture files in memory."""

from __future__ import annotations

import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np

from .srgb import encode_srgb


def png(pixels: np.ndarray, color: bool = False, alpha: np.ndarray | None = None) -> bytes:
    """A PNG of 8 bits a channel of (height, width, 3) values from 0 to 1; colours are linear and become sRGB. alpha: (height, width)."""
    from PIL import Image

    channels = np.clip(encode_srgb(pixels) if color else np.nan_to_num(pixels), 0.0, 1.0)
    if alpha is not None:
        channels = np.concatenate([channels, np.clip(alpha, 0.0, 1.0)[..., None]], axis=2)
    out = BytesIO()
    Image.fromarray(np.round(255.0 * channels).astype(np.uint8)).save(out, "PNG")
    return out.getvalue()


def exr(pixels: np.ndarray) -> bytes:
    """An OpenEXR file of (height, width, 3) half floats."""
    import OpenImageIO as oiio

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "picture.exr")
        picture = oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))
        picture.write(str(path), oiio.HALF)
        return path.read_bytes()
