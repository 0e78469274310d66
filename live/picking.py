"""Picking: the name, material, depth and source position of the surface at a pixel, and its luminance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..compiler import ir
from ..render.image import metrics
from .passes import Shown
from .scene_files import place


def pick(scene: ir.Scene, shown: Shown, x: float, y: float) -> dict[str, Any]:
    """The surface at a place of the picture; x and y are shares of its width and height, 0 to 1 from the top left."""
    ids, depths = shown.channels.get("id"), shown.channels.get("depth")
    nothing = {"hit": False, "x": x, "y": y, "luminance": luminance(shown, x, y)}
    if ids is None or depths is None:
        return nothing
    height, width = ids.shape[:2]
    row, column = min(max(int(y * height), 0), height - 1), min(max(int(x * width), 0), width - 1)
    instance, material = (int(v) for v in ids[row, column])
    depth = float(depths[row, column, 0])
    if instance < 0:
        return nothing
    tables, names = scene.tables, scene.names
    geometry = int(tables.instances.geometry[instance])
    light = int(tables.instances.light[instance])
    return {
        "hit": True, "x": x, "y": y, "luminance": nothing["luminance"], "depth": depth if math.isfinite(depth) else None,
        "name": _name(names.instances, instance) or _name(names.geometries, geometry),
        "shape": ir.GeometryKind(int(tables.geometries.kind[geometry])).name.lower(),
        "material": _name(names.materials, material),
        "model": ir.MaterialModel(int(tables.materials.model[material])).name.lower() if material >= 0 else "",
        "light": _name(names.lights, light) if light >= 0 else None,
        "place": place(scene.spans.get("instances", instance)),
        "material_place": place(scene.spans.get("materials", material)),
    }  # fmt: skip


def luminance(shown: Shown, x: float, y: float) -> float | None:
    """The luminance in candela a square metre that a place of the picture shows; None where it is not finite."""
    height, width = shown.rgba.shape[:2]
    row, column = min(max(int(y * height), 0), height - 1), min(max(int(x * width), 0), width - 1)
    value = float(metrics.luminance(shown.rgba[row, column, :3]))
    return value if math.isfinite(value) else None


def center_depth(shown: Shown) -> float | None:
    """Depth in metres of what is nearest to the picture's center; None if nothing is seen."""
    depths = shown.channels.get("depth")
    if depths is None:
        return None
    height, width = depths.shape[:2]
    depth = float(depths[height // 2, width // 2, 0])
    if math.isfinite(depth):
        return depth
    finite = [float(d) for d in depths[::8, ::8, 0].ravel() if math.isfinite(d)]
    return sorted(finite)[len(finite) // 2] if finite else None


def _name(names: Sequence[str], row: int) -> str:
    return names[row] if 0 <= row < len(names) else ""
