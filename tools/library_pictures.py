"""Draws docs/library/FILE.jpg: a sheet of pictures for each file of the library, one picture an entry, with its name.

python tools/library_pictures.py [FILE …] draws whole sheets; FILE:ENTRY draws one entry again, in the sheet that is there.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import maquette
from maquette.lang.stdlib_page import Entry, entries, library
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).resolve().parent.parent
CELL = (132, 112)
LABEL = 15
STEP = CELL[0] + 6, CELL[1] + LABEL + 6
ACROSS = 7
QUALITY = 88  # of JPEG
SAMPLES = {"room": 32, "furniture": 32, "lights": 128, "mechanics": 64, "media": 6}
DENOISED = ("room", "furniture", "media")  # files whose pictures are denoised
BOUNCES = {"media": 24}


EXPOSURE = {"candle": 2.0}  # ev, where metering of a dark room is too bright


def picture(entry: Entry) -> Image.Image:
    """One entry."""
    scene = maquette.load_text(entry.scene)
    image = maquette.render(scene, size=(2 * CELL[0], 2 * CELL[1]), samples=SAMPLES.get(entry.file, 48),
                            bounces=BOUNCES.get(entry.file, 8), denoise=entry.file in DENOISED)
    file = ROOT / "build" / "entry.png"
    if _photometric(entry):
        image.save(file, exposure="metered")
    else:
        image.save(file, exposure=EXPOSURE.get(entry.name, 0.0))
    with Image.open(file) as drawn:
        flat = Image.new("RGB", drawn.size, "white")
        flat.paste(drawn.convert("RGB"))
        return flat.resize(CELL, Image.Resampling.LANCZOS)


def _photometric(entry: Entry) -> bool:
    return entry.file == "room" or entry.name in ("daylight", "overcast", "moonlight", "golden_hour", "blue_hour", "window")


def sheet(file: str, text: str) -> Image.Image:
    """All entries of a library file."""
    listed = entries(file, text)
    across = min(ACROSS, len(listed))
    image = Image.new("RGB", (STEP[0] * across, STEP[1] * math.ceil(len(listed) / across)), "white")
    draw = ImageDraw.Draw(image)
    font = ImageFont.truetype(str(ROOT / "stdlib" / "fonts" / "DejaVuSans.ttf"), 11, layout_engine=ImageFont.Layout.BASIC)
    for k, entry in enumerate(listed):
        corner = _corner(k, across)
        image.paste(picture(entry), corner)
        draw.text((corner[0], corner[1] + CELL[1] + 1), entry.name, "black", font)
    return image


def _corner(k: int, across: int) -> tuple[int, int]:
    return 3 + k % across * STEP[0], 3 + k // across * STEP[1]


def patched_sheet(file: str, text: str, name: str) -> Image.Image:
    """The sheet on disk with one entry drawn again. Raises SystemExit if there is no such entry, or a sheet of others."""
    listed = entries(file, text)
    places = [k for k, entry in enumerate(listed) if entry.name == name]
    if not places:
        raise SystemExit(f"{file} has no entry {name}")
    across = min(ACROSS, len(listed))
    with Image.open(ROOT / "docs" / "library" / f"{file}.jpg") as drawn:
        image = drawn.convert("RGB")
    if image.size != (STEP[0] * across, STEP[1] * math.ceil(len(listed) / across)):
        raise SystemExit(f"docs/library/{file}.jpg shows other entries: draw {file} whole")
    image.paste(picture(listed[places[0]]), _corner(places[0], across))
    return image


def main() -> None:
    """Draw the sheets or entries that are asked for, or all sheets."""
    (ROOT / "build").mkdir(exist_ok=True)
    texts = library()
    for words in sys.argv[1:] or texts:
        file, _, name = words.partition(":")
        image = patched_sheet(file, texts[file], name) if name else sheet(file, texts[file])
        image.save(ROOT / "docs" / "library" / f"{file}.jpg", quality=QUALITY, subsampling=0, optimize=True)
        print(f"docs/library/{file}.jpg: {image.width}x{image.height}")


if __name__ == "__main__":
    main()
