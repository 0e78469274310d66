"""Pictures of a difference: false colours or signed light to a file, and A, B and their difference side by side under labels."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...render.image import image_files, metrics
from ...render.image.image import Image
from .compare import Comparison

STRIP = 22  # pixels of a label's height
TEXT = 14
LEGIBLE = 10  # the smallest text, cut where it is still too long
GAP = 4
FIELD = 0.012  # linear grey behind the panels
LEAST = 240  # pixels a panel is wide at least, so that its label can be read: smaller pictures are enlarged, pixel by pixel


def write(found: Comparison, path: Path, together: bool = False) -> None:
    """Write the difference to `path`; `together`: A, B and the difference side by side, as they would be shown.

    In an EXR the signed linear difference A − B, else false colours. Raises OSError where the disk will not.
    """
    if together:
        _save(side_by_side(found), path)
    elif path.suffix.lower() in image_files.LINEAR:
        _save((found.a.rgb - found.b.rgb).astype(np.float32), path)
    else:
        _save(metrics.false_colour(found.a.rgb, found.b.rgb), path)


def side_by_side(found: Comparison) -> NDArray[np.float32]:
    """(height, width, 3) linear, 0..1: the three panels with labels above, A and B under one exposure."""
    gain, full = 2.0**found.exposure, metrics.full_scale(found.a.rgb, found.b.rgb)
    panels = [_enlarged(np.clip(np.nan_to_num(side.rgb * gain), 0.0, 1.0)) for side in (found.a, found.b)]
    panels.append(_enlarged(metrics.false_colour(found.a.rgb, found.b.rgb, full)))
    labels = (f"A  {found.a.about()}", f"B  {found.b.about()}", f"A - B  red brighter, blue darker, full {full:.3g}")
    rows, columns = panels[0].shape[:2]
    size = next((size for size in range(TEXT, LEGIBLE, -1) if max(_length(label, size) for label in labels) <= columns - 2 * GAP), LEGIBLE)
    sheet = np.full((rows + STRIP, 3 * columns + 2 * GAP, 3), FIELD, np.float32)
    for k, (panel, label) in enumerate(zip(panels, labels, strict=True)):
        at = k * (columns + GAP)
        sheet[STRIP:, at : at + columns] = panel
        sheet[:STRIP, at : at + columns] = _label(label, columns, size)
    return sheet


def _enlarged(pixels: NDArray[np.floating]) -> NDArray[np.float32]:
    times = max(1, -(-LEAST // pixels.shape[1]))
    return pixels.repeat(times, axis=0).repeat(times, axis=1).astype(np.float32)


def _label(text: str, width: int, size: int) -> NDArray[np.float32]:
    """(STRIP, width, 3) linear white text on the field, cut where it is too long."""
    if _length(text, size) > width - 2 * GAP:
        text = next((text[:k] + "..." for k in range(len(text), 0, -1) if _length(text[:k] + "...", size) <= width - 2 * GAP), "")
    strip = oiio.ImageBuf(oiio.ImageSpec(width, STRIP, 3, "float"))
    oiio.ImageBufAlgo.fill(strip, (0.0, 0.0, 0.0))
    oiio.ImageBufAlgo.render_text(strip, GAP, STRIP - 7, text, size, "", (1.0, 1.0, 1.0))
    ink = np.asarray(strip.get_pixels(oiio.FLOAT)).reshape(STRIP, width, 3)
    return (FIELD + (1.0 - FIELD) * image_files.decode_srgb(ink)).astype(np.float32)


def _length(text: str, size: int) -> int:
    return oiio.ImageBufAlgo.text_size(text, size).width


def _save(rgb: NDArray[np.float32], path: Path) -> None:
    rgba = np.concatenate([rgb, np.ones_like(rgb[..., :1])], axis=2).astype(np.float32)
    image_files.write(
        Image(rgb.shape[1], rgb.shape[0], {"rgba": rgba}, {}), path, image_files.Look(), {"version": metadata.version("maquette")}
    )
