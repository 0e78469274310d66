"""Saves the pixels of a picture that could not be written."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...render.image.image import Image


def save(image: Image, path: Path) -> str:
    """Save a picture that could not be written at `path` as an EXR there or in the temporary folder. Returns a message."""
    from ...render.image import image_files

    for folder in (path.parent, Path(tempfile.gettempdir())):
        other = None
        try:
            descriptor, name = tempfile.mkstemp(".rescued.exr", f"{path.stem[:60]}.", folder)  # new, and a name that nobody could foresee
            os.close(descriptor)
            other = folder / Path(name).name
            image_files.write(image, other, image_files.Look(), {})
        except Exception as fault:
            reason = fault
            if other is not None:
                with suppress(OSError):
                    other.unlink()
        else:
            return f"its pixels are in {other}"
    return f"its pixels are lost: {reason}"
