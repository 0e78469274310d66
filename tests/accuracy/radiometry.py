"""What the known answers of light share: pictures of a text by the public door, small receivers, means with their errors, closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import maquette
import numpy as np
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics
from maquette.render.image.image import Image
from numpy.typing import ArrayLike, NDArray

EVERY = ("ray", "raster", "reference")
TRACERS = ("ray", "reference")  # the backends that follow reflected, refracted and diffuse rays
SINGLE = 1e-5  # relative, of pictures in single precision

Array = NDArray[np.float64]


def load(folder: Path, text: str) -> ir.Scene:
    """The scene of a text among the files of a folder; nothing unexpected is said about it."""
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    found = Diagnostics()
    scene = maquette.load(path, diagnostics=found)
    assert [d.message for d in found.items] == []
    return scene


def picture(folder: Path, text: str | ir.Scene, backend: str, **settings: Any) -> Image:
    """A text or scene on a backend; 48 by 48 pixels, one sample and a box filter if not said. All of it is finite.

    Pixels are independent of each other, as those who tell errors by how far they lie apart must have it.
    """
    scene = load(folder, text) if isinstance(text, str) else text
    asked = {"size": (48, 48), "samples": 1, "filter": "box", "threads": 1, **settings, "backend": backend}
    if asked.get("error") is None and asked.get("budget") is None:
        asked["plan"] = {"noise": "white", **asked.get("plan", {})}
    image = maquette.render(scene, **asked)
    assert image.metadata["issues"] == 0
    assert np.isfinite(image.channels["rgba"]).all()
    return image


def grey(image: Image) -> Array:
    """(h, w) a picture that must have no colour."""
    rgb = image.channels["rgba"].astype(np.float64)
    assert np.array_equal(rgb[..., 0], rgb[..., 1])
    assert np.array_equal(rgb[..., 0], rgb[..., 2])
    return rgb[..., 0]


def position(image: Image) -> tuple[Array, Array]:
    """(h, w) x and z of what the pixels show."""
    place = image.channels["position"].astype(np.float64)
    return place[..., 0], place[..., 2]


def unit(vector: ArrayLike) -> Array:
    v = np.asarray(vector, float)
    return v / np.linalg.norm(v)


def across(n: Array) -> Array:
    """A unit vector across another."""
    return unit(np.cross(n, [1.0, 0.0, 0.0] if abs(n[0]) < 0.6 else [0.0, 0.0, 1.0]))


def written(vector: ArrayLike) -> str:
    """A list of the language, to the last digit."""
    return "[" + ", ".join(f"{float(c)!r}" for c in np.asarray(vector, float)) + "]"


def receiver(point: Sequence[float] = (0, 0, 0), normal: Sequence[float] = (0, 1, 0), surface: str = "", albedo: float = 1.0) -> str:
    """A white disk of 1 cm, or another surface there, of which the picture shows a tenth of a millimetre: all pixels see the same light."""
    n, p = unit(normal), np.asarray(point, float)
    eye, up = written(p + 0.002 * n), written(across(n))
    shape = surface or f"disk(0.01, center: {written(p)}, normal: {written(n)}, material: lambert({albedo}))\n"
    return f"camera(position: {eye}, look_at: {written(p)}, up: {up}, width: 0.0001, near: 0.0005, far: 0.004)\n{shape}"


def within_error(
    measured: Any, number: int, name: str, backend: str, values: ArrayLike, answer: float, scale: float | None = None, note: str = ""
) -> None:
    """Independent values have the answer as their mean within 4 standard errors, and these are at most 0.2 % of it, or of `scale`.

    Where all values are alike what is left is the rounding of pictures.
    """
    found = np.asarray(values, float).ravel()
    scale = abs(answer) if scale is None else scale
    error = float(found.std(ddof=1) / math.sqrt(found.size)) / scale
    assert error <= 0.002, f"{name}: a standard error of {error:.3%} says too little"
    off = abs(float(found.mean()) - answer) / scale
    measured.answer(number, name, backend, off, max(4 * error, SINGLE), note=note)


# --- closed forms of irradiance, for radiance 1 ------------------------------------------------------------------------------------


def clipped(corners: Array, point: Array, normal: Array) -> list[Array]:
    """A polygon seen from a point, above its horizon (Sutherland and Hodgman 1974)."""
    v = [c - point for c in corners]
    kept: list[Array] = []
    for a, b in zip(v, v[1:] + v[:1], strict=True):
        da, db = float(a @ normal), float(b @ normal)
        if da >= 0:
            kept.append(a)
        if da * db < 0:
            kept.append(a + (b - a) * (da / (da - db)))
    return kept


def under_polygon(corners: ArrayLike, point: ArrayLike = (0, 0, 0), normal: ArrayLike = (0, 1, 0)) -> float:
    """E = ½ |Σ βᵢ n·Γᵢ|, Γᵢ = unit(vᵢ × vᵢ₊₁), βᵢ the angle between them, of the part above the horizon (Lambert 1760)."""
    n = unit(normal)
    v = clipped(np.asarray(corners, float), np.asarray(point, float), n)
    total = 0.0
    for a, b in zip(v, v[1:] + v[:1], strict=True):
        crossed = np.cross(a, b)
        length = float(np.linalg.norm(crossed))
        total += math.atan2(length, float(a @ b)) * float(crossed @ n) / length if length > 0 else 0.0
    return abs(total) / 2


def under_sphere(radius: float, distance: float, angle: float) -> float:
    """E of a sphere whose middle is at an angle from the normal (Snyder 1996; Naito's cut by the horizon)."""
    h = distance / radius
    x = math.sqrt(h * h - 1)
    if math.cos(angle) * h >= 1:  # all above the horizon
        return math.pi * math.cos(angle) / (h * h)
    if math.cos(angle) * h <= -1:
        return 0.0
    y = -x / math.tan(angle)
    s = math.sqrt(1 - y * y)
    part = (math.cos(angle) * math.acos(y) - x * math.sin(angle) * s) / (math.pi * h * h)
    return math.pi * part + math.atan(math.sin(angle) * s / x)


def under_disk(radius: float, height: float, offset: float) -> float:
    """E of a parallel disk: ½π [1 − (h² + q² − R²)/√((h² + q² + R²)² − 4R²q²)]."""
    r, h, q = radius**2, height**2, offset**2
    return 0.5 * math.pi * (1 - (h + q - r) / math.sqrt((h + q + r) ** 2 - 4 * r * q))


def legendre(low: float, high: float, n: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre's rule over an interval."""
    x, w = np.polynomial.legendre.leggauss(n)
    return low + (high - low) * (x + 1) / 2, w * (high - low) / 2
