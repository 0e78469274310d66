"""Pictures of channels: linear light and auxiliary channels as 8-bit RGBA."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lang.schema.picture_channels import CHANNELS
from ..render.image import image_files, srgb

Codes = NDArray[np.uint8]
PARTS = 2  # of a picture, converted at the same time
POOL = ThreadPoolExecutor(PARTS, "display")
HEAT = np.array([[30, 30, 60], [60, 70, 160], [40, 150, 150], [130, 200, 90], [250, 220, 80], [250, 120, 60]], np.float64)


def colors(rgba: NDArray[np.float32], look: image_files.Look) -> Codes:
    """(h, w, 4) codes of linear light; coverage is kept if the look has alpha, else it is 255."""
    parts = list(POOL.map(lambda rows: image_files.display(rows, look), np.array_split(rgba, PARTS)))  # numpy frees Python's lock
    pixels = np.empty((*rgba.shape[:2], 4), np.uint8)
    np.concatenate(parts, out=pixels[..., : parts[0].shape[2]])
    if not look.alpha:
        pixels[..., 3] = 255
    return pixels


def auxiliary(name: str, values: NDArray[Any]) -> Codes:
    """(h, w, 4) codes of the channel `name`, (h, w, k), for looking at, by `shown` of its row of CHANNELS.

    distance: white is near, black is far. direction: -1 to 1 become 0 to 255. share: 0 to 1 become black to white. color: linear.
    fraction: the part after the point. row: a colour for each row. count: from blue to red.
    """
    match CHANNELS[name].shown:
        case "distance":
            rgb = np.repeat(_depth_shades(values[..., 0])[..., None], 3, axis=2)
        case "direction":
            rgb = np.rint(np.clip(values * 0.5 + 0.5, 0.0, 1.0) * 255.0)
        case "share":
            rgb = np.repeat(np.rint(np.clip(np.nan_to_num(values[..., :1]), 0.0, 1.0) * 255.0), 3, axis=2)
        case "color":
            rgb = srgb.codes(np.ascontiguousarray(values, dtype=np.float32), 0.0)
        case "fraction":
            share = np.nan_to_num(values - np.floor(values)) * 255.0
            rgb = np.concatenate([share, np.zeros_like(share[..., :1])], axis=2)
        case "row":
            rgb = _id_colors(values[..., 0].astype(np.int64))
        case "count":
            rgb = _heat(values)
        case _:
            raise ValueError(f"the channel {name} is not shown")
    return _opaque(rgb.astype(np.uint8))


def _depth_shades(depth: NDArray[np.float32]) -> NDArray[np.float64]:
    finite = np.isfinite(depth)
    shades = np.zeros(depth.shape)
    if finite.any():
        near, far = np.percentile(depth[finite], (1.0, 98.0))
        share = (np.where(finite, depth, far) - near) / max(float(far - near), 1e-12)
        shades[finite] = (255.0 - 215.0 * np.clip(share, 0.0, 1.0))[finite]
    return shades


def _id_colors(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """A colour for each row by a hash (Wang 2007); black for -1."""
    h = (rows.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    h ^= h >> np.uint64(29)
    parts = [(h >> np.uint64(shift)) & np.uint64(0x7F) for shift in (8, 24, 40)]
    rgb = np.stack(parts, axis=-1).astype(np.int64) + 96
    rgb[rows < 0] = 0
    return rgb


def _heat(samples: NDArray[Any]) -> NDArray[np.float64]:
    logs = np.log2(np.maximum(samples.astype(np.float64), 1.0))
    low, high = float(logs.min(initial=0.0)), float(logs.max(initial=0.0))
    place = (logs - low) / max(high - low, 1e-12) * (len(HEAT) - 1)
    first = np.clip(place.astype(int), 0, len(HEAT) - 2)
    share = (place - first)[..., None]
    return (1.0 - share) * HEAT[first] + share * HEAT[first + 1]


def _opaque(rgb: NDArray[Any]) -> Codes:
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = rgb
    return pixels


def resized(pixels: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """(height, width, …) nearest pixels of a smaller picture."""
    if pixels.shape[:2] == (height, width):
        return pixels
    rows = np.arange(height) * pixels.shape[0] // height
    columns = np.arange(width) * pixels.shape[1] // width
    return pixels[rows[:, None], columns]
