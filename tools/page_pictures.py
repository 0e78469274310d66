"""Draws the pictures of the blocks in docs/tutorial.md and docs/howto.md: that of each block before a line `![…](howto/round.jpg)`.

python tools/page_pictures.py [PICTURE …] draws those whose block has changed, or the named ones. The comment of a picture holds the hash of
its scene, and a test compares it.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = ("tutorial.md", "howto.md")
BLOCK = re.compile(r"^```\n((?:(?!^```).*\n)+?)^```\n\n!\[[^\]]*\]\(([\w/]+\.jpg)\)", re.MULTILINE)
SIZE = "320x240"
SAMPLES = "36"
QUALITY = 88


def blocks() -> dict[str, str]:
    """The scene of each picture, by its path below docs/."""
    return {picture: text for page in PAGES for text, picture in BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))}


def mark(scene: str) -> bytes:
    """The comment in the picture of a scene."""
    return b"scene " + hashlib.sha256(scene.encode()).hexdigest().encode()


def is_new(picture: str, scene: str) -> bool:
    """Whether a picture exists that was drawn from this scene."""
    path = DOCS / picture
    return path.is_file() and mark(scene) in path.read_bytes()[:4096]


def draw(picture: str, scene: str) -> None:
    """Render a scene into its picture, without noise where the package for that is installed."""
    with tempfile.TemporaryDirectory(dir=ROOT / "examples") as folder:
        source = Path(folder) / "block.scene"
        source.write_text(re.sub(r'"assets/', '"../assets/', scene), encoding="utf-8")
        target = Path(folder) / "block.png"
        command = [sys.executable, "-P", "-m", "maquette", "render", str(source), "-o", str(target), "--size", SIZE]
        command += ["--samples", SAMPLES, "-q"]
        command += ["--allow", str(ROOT / "examples")] + ["--time", "0.7s"] * ("animate(" in scene)
        if subprocess.run([sys.executable, "-P", "-c", "import pyoidn"], capture_output=True).returncode == 0:
            command.append("--denoise")
        subprocess.run(command, check=True, env={**os.environ, "MAQUETTE_PROGRESS": "off", "MAQUETTE_KERNELS": "general"})
        (DOCS / picture).parent.mkdir(exist_ok=True)
        with Image.open(target) as image:
            image.convert("RGB").save(DOCS / picture, quality=QUALITY, comment=mark(scene))


def main() -> None:
    """Draw the pictures that are asked for, or those that are not new."""
    for picture, scene in blocks().items():
        if picture in sys.argv[1:] or (len(sys.argv) == 1 and not is_new(picture, scene)):
            draw(picture, scene)
            print(f"docs/{picture}", flush=True)


if __name__ == "__main__":
    main()
