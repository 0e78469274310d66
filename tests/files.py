"""Image files for tests to read, written as OpenImageIO writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest


def write_image(path: Path, pixels: Any, **attributes: object) -> Path:
    """Write pixels (height, width, channels) in their own number type; `a__b=…` is the attribute a:b. The path is given back."""
    values = np.ascontiguousarray(pixels)
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, {"float32": "float", "float64": "float"}.get(values.dtype.name, values.dtype.name))
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    out = oiio.ImageOutput.create(str(path))
    assert out is not None, oiio.geterror()
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(values), out.geterror()
    out.close()
    return path


def standing_by(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> Path:
    """A folder that is the current one from now on, with a text as its a.scene."""
    monkeypatch.chdir(folder)
    (folder / "a.scene").write_text(text, encoding="utf-8")
    return folder
