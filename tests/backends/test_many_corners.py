"""A face of thousands of corners: many thin triangles lie in one pixel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from maquette.render.image import image_reader

CORNERS = 4000
ANGLES = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
RADIUS = 1 + 0.3 * np.sin(9 * ANGLES)


def alpha(folder: Path, backend: str) -> np.ndarray:
    """The alpha of the face, drawn in a process of its own."""
    options = ["--size", "480x360", "--samples", "16", "--no-denoise", "--backend", backend]
    command = [sys.executable, "-m", "maquette", "render", "a.usda", "-o", f"{backend}.exr", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return image_reader.read(folder / f"{backend}.exr").channels["rgba"][..., 3].astype(float)


@pytest.mark.long
def test_a_face_of_many_corners_is_drawn_whole(tmp_path: Path) -> None:
    """The rasterizer wrote past its buffer of points where sixteen fragments belong to sixteen thin triangles."""
    x, y = RADIUS * np.cos(ANGLES), RADIUS * np.sin(ANGLES)
    points = ", ".join(f"({a:.7g}, {b:.7g}, 0)" for a, b in zip(x, y, strict=True))
    (tmp_path / "a.usda").write_text(f"""#usda 1.0
def Mesh "m" {{
    int[] faceVertexCounts = [{CORNERS}]
    int[] faceVertexIndices = [{", ".join(map(str, range(CORNERS)))}]
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "none"
}}
""")
    ray, raster = alpha(tmp_path, "ray"), alpha(tmp_path, "raster")
    inside = np.hypot(*(np.mgrid[:360, :480] - np.array([179.5, 239.5])[:, None, None])) < 60
    for picture in (ray, raster):
        assert (picture[inside] == 1).all()
    assert 0.25 < ray.mean() < 0.5
    assert raster.mean() == pytest.approx(ray.mean(), rel=0.002)
    assert np.abs(ray - raster).max() <= 0.5
