"""False-colour pictures of luminance: colours by a logarithmic scale, contours at its steps, and the scale beside the picture."""

from __future__ import annotations

import math
from importlib import resources
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNIT = "cd/m²"
DECADES = 3  # most of the scale, below the brightest pixels
BRIGHTEST = 0.999  # share of the pixels that the scale covers
FONT, GAP, BAR = 12, 8, 16  # pixels
LEAST = 120  # pixels of the scale's height
# Turbo by a polynomial of degree 5 for each of red, green and blue (Mikhailov 2019).
TURBO = np.array([
    [0.13572138, 4.61539260, -42.66032258, 132.13108234, -152.94239396, 59.28637943],
    [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604],
    [0.10667330, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973],
])  # fmt: skip
F64 = NDArray[np.float64]


def steps(luminance: F64) -> list[float]:
    """The numbers of the scale: 1, 2 and 5 times powers of ten, up to one that nearly all pixels are below."""
    bright = np.sort(luminance[np.isfinite(luminance) & (luminance > 0.0)])
    if not len(bright):
        return [0.1, 1.0]
    top, bottom = float(bright[min(int(BRIGHTEST * len(bright)), len(bright) - 1)]), float(bright[int(0.01 * len(bright))])
    low = max(bottom, top * 10.0**-DECADES)
    every = [float(f"{m}e{e}") for e in range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(top)) + 1) for m in (1, 2, 5)]
    last = next((k for k, step in enumerate(every) if step >= top), len(every) - 1)
    first = max((k for k, step in enumerate(every) if step <= low), default=0)
    return every[min(first, last - 1) : last + 1]


def colors(luminance: F64, scale: list[float]) -> NDArray[np.uint8]:
    """(…, 3) sRGB of luminance on a scale; black where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(luminance / scale[0]) / math.log(scale[-1] / scale[0])
    place = np.clip(np.nan_to_num(place, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    rgb = np.clip((place[..., None, None] ** np.arange(6) * TURBO).sum(axis=-1), 0.0, 1.0)
    return np.where((luminance > 0.0)[..., None], np.rint(255 * rgb), 0.0).astype(np.uint8)


def contours(luminance: F64, scale: list[float]) -> NDArray[np.bool_]:
    """(h, w) pixels at which the mean of 3 × 3 pixels passes a number of the scale."""
    wide = np.pad(np.nan_to_num(luminance), 1, mode="edge")
    height, width = luminance.shape
    smooth = sum(wide[y : y + height, x : x + width] for y in range(3) for x in range(3)) / 9.0
    band = np.searchsorted(np.array(scale), smooth)
    edges = np.zeros(luminance.shape, bool)
    edges[:, 1:] |= band[:, 1:] != band[:, :-1]
    edges[1:] |= band[1:] != band[:-1]
    return edges


def picture(luminance: F64) -> bytes:
    """A PNG of luminance (h, w) in candela a square metre with contours, and its scale to the right."""
    from PIL import Image, ImageDraw, ImageFont

    scale = steps(luminance)
    rgb = colors(luminance, scale)
    rgb[contours(luminance, scale)] = 255
    file = resources.files("maquette") / "stdlib" / "fonts" / "DejaVuSans.ttf"
    # Without Raqm, because Pillow's HarfBuzz gives wrong widths in a process that has loaded another HarfBuzz.
    font = ImageFont.truetype(BytesIO(file.read_bytes()), FONT, layout_engine=ImageFont.Layout.BASIC)
    labels = [f"{step:g}" for step in scale]
    height, width = luminance.shape
    beside = 3 * GAP + BAR + math.ceil(max(map(font.getlength, (*labels, UNIT))))
    sheet: Any = Image.new("RGB", (width + beside, max(height, LEAST)), "black")
    sheet.paste(Image.fromarray(rgb), (0, 0))
    draw = ImageDraw.Draw(sheet)
    top, bottom, left = FONT + 3 * GAP, sheet.height - FONT, width + GAP
    share = 1.0 - (np.arange(top, bottom) - top) / (bottom - top - 1)
    bar = colors((scale[0] * (scale[-1] / scale[0]) ** share)[:, None] * np.ones(BAR), scale)
    sheet.paste(Image.fromarray(bar), (left, top))
    draw.text((left, GAP // 2), UNIT, "white", font)
    above = math.inf
    for step, label in zip(scale, labels, strict=True):
        y = bottom - 1 - (bottom - top - 1) * math.log(step / scale[0]) / math.log(scale[-1] / scale[0])
        draw.line((left, round(y), left + BAR - 1, round(y)), "white")
        if above - y >= FONT:
            draw.text((left + BAR + GAP // 2, y - FONT * 0.6), label, "white", font)
            above = y
    out = BytesIO()
    sheet.save(out, "PNG")
    return out.getvalue()
