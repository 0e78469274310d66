"""Images of a difference: false colours, signed light, or A, B and the difference side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...lang.distribution import VERSION
from ...render.image import image_files, metrics, srgb
from ...render.image.image import Image
from .compare import Comparison

LABEL_HEIGHT = 22  # pixels
TEXT_SIZE = 14
MIN_TEXT_SIZE = 10  # longer labels are cut
GAP = 4
BACKGROUND = 0.012  # linear grey
MIN_PANEL_WIDTH = 240  # pixels; smaller pictures are enlarged by whole factors


def write(comparison: Comparison, path: Path, together: bool = False) -> None:
    """Write the difference to `path`; `together`: A, B and the difference side by side, as displayed.

    An EXR holds the signed linear difference A − B, other formats false colours. Raises OSError on a disk error.
    """
    if together:
        _save(side_by_side(comparison), path)
    elif path.suffix.lower() in image_files.LINEAR:
        _save((comparison.a.rgb - comparison.b.rgb).astype(np.float32), path)
    else:
        _save(metrics.false_colour(comparison.a.rgb, comparison.b.rgb), path)


def side_by_side(comparison: Comparison) -> NDArray[np.float32]:
    """(height, width, 3) linear, 0..1: three labelled panels, A and B with one exposure."""
    gain, full = 2.0**comparison.exposure, metrics.full_scale(comparison.a.rgb, comparison.b.rgb)
    panels = [_enlarge(np.clip(np.nan_to_num(side.rgb * gain), 0.0, 1.0)) for side in (comparison.a, comparison.b)]
    panels.append(_enlarge(metrics.false_colour(comparison.a.rgb, comparison.b.rgb, full)))
    labels = (f"A  {comparison.a.about()}", f"B  {comparison.b.about()}", f"A - B  red brighter, blue darker, full {full:.3g}")
    rows, columns = panels[0].shape[:2]
    size = next(
        (size for size in range(TEXT_SIZE, MIN_TEXT_SIZE, -1) if max(_text_width(label, size) for label in labels) <= columns - 2 * GAP),
        MIN_TEXT_SIZE,
    )
    sheet = np.full((rows + LABEL_HEIGHT, 3 * columns + 2 * GAP, 3), BACKGROUND, np.float32)
    for k, (panel, label) in enumerate(zip(panels, labels, strict=True)):
        column = k * (columns + GAP)
        sheet[LABEL_HEIGHT:, column : column + columns] = panel
        sheet[:LABEL_HEIGHT, column : column + columns] = _label(label, columns, size)
    return sheet


def _enlarge(pixels: NDArray[np.floating]) -> NDArray[np.float32]:
    times = max(1, -(-MIN_PANEL_WIDTH // pixels.shape[1]))
    return pixels.repeat(times, axis=0).repeat(times, axis=1).astype(np.float32)


def _label(text: str, width: int, size: int) -> NDArray[np.float32]:
    """(STRIP, width, 3) linear: white text on the background, cut if it is too long."""
    if _text_width(text, size) > width - 2 * GAP:
        text = next((text[:k] + "..." for k in range(len(text), 0, -1) if _text_width(text[:k] + "...", size) <= width - 2 * GAP), "")
    strip = oiio.ImageBuf(oiio.ImageSpec(width, LABEL_HEIGHT, 3, "float"))
    oiio.ImageBufAlgo.fill(strip, (0.0, 0.0, 0.0))
    oiio.ImageBufAlgo.render_text(strip, GAP, LABEL_HEIGHT - 7, text, size, "", (1.0, 1.0, 1.0))
    ink = np.asarray(strip.get_pixels(oiio.FLOAT)).reshape(LABEL_HEIGHT, width, 3)
    return (BACKGROUND + (1.0 - BACKGROUND) * srgb.decode_srgb(ink)).astype(np.float32)


def _text_width(text: str, size: int) -> int:
    return oiio.ImageBufAlgo.text_size(text, size).width


def _save(rgb: NDArray[np.float32], path: Path) -> None:
    rgba = np.concatenate([rgb, np.ones_like(rgb[..., :1])], axis=2).astype(np.float32)
    image_files.write(
        Image(rgb.shape[1], rgb.shape[0], {"rgba": rgba}, {}), path, image_files.Look(), {"version": VERSION}
    )
