"""Lowers elements that are lights, as their modules in lights/ say; area lights get a shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lang.elements import Element
from ...lang.formula_graph import Formula
from ...lights import DISKS, LIGHTS, RECTANGLES, SURFACES
from ...lights.catalogue import ELEMENTS
from ...lights.contract import Form, LightError, Row
from ...lights.rectangle import EVEN
from .. import ir
from ..formula.tape import Tape
from ..scene import link_sets, transforms
from ..scene.row_records import ALL_RAYS, NO_SHADOW, Color, Input, InstanceData, LightData, MaterialData
from .context import Context

KINDS = frozenset(ELEMENTS)


def light(lowering: Context, element: Element, block: np.ndarray) -> None:
    """Add a light in a block with the matrix `block`."""
    lowering.photometric |= element.photometric
    try:
        row = ELEMENTS[element.kind].lower(element.args, _Lowering(lowering, element, block))
    except LightError as error:
        lowering.refuse(element, error.message, error.hint)
        return
    if row is not None:
        _add(lowering, element, row)


class _Lowering:
    """What the functions of lights.contract.Element use; see lights.contract.Lowering."""

    def __init__(self, lowering: Context, element: Element, block: np.ndarray) -> None:
        self._lowering, self._element, self.block, self.has_unit = lowering, element, block, element.photometric

    unit, facing, rotation = staticmethod(transforms.unit), staticmethod(transforms.facing), staticmethod(transforms.rotation)

    def rigid(self, matrix: np.ndarray, /) -> tuple[np.ndarray, np.ndarray, bool]:
        return rigid(matrix)

    def is_given(self, name: str) -> bool:
        return name in self._element.given

    def error(self, message: str, hint: str = "") -> None:
        self._lowering.error(self._element, message, hint)

    def warn(self, message: str, hint: str = "") -> None:
        self._lowering.warn(self._element, message, hint)

    def point(self, point: Any) -> Color:
        return _tuple((self.block[:3, :3] @ np.array(point, dtype=np.float64) + self.block[:3, 3]).tolist())

    def direction(self, vector: Any) -> np.ndarray | None:
        return transforms.unit(self.block[:3, :3] @ np.array(vector, dtype=np.float64))

    def image_file(self, name: str) -> int:
        return self._lowering.materials.image(self._element, name, "auto", True)

    def image(self, key: Any, name: str, make: Callable[[], NDArray[np.float32]]) -> int:
        builder = self._lowering.builder
        return builder.shared(key, lambda: builder.image(make(), name))

    def pattern(self, formula: Formula) -> Tape | None:
        return self._lowering.materials.pattern_tape(self._element, formula, color=True, unit=1.0)


def _add(lowering: Context, element: Element, row: Row) -> None:
    """Add the row of a light, and the shape of an area light without a profile."""
    color = element.args["color"] if row.color is None else row.color
    r, g, b = (c * row.strength * tint for c, tint in zip(color, row.tint, strict=True))
    kind = LIGHTS[row.kind]
    if row.kind in SURFACES and kind.profile is None and row.frame is not None:
        add_area_light(lowering, element, row.kind, row.frame, row.size, (r, g, b), row.image)
        return
    builder = lowering.builder
    transform = {} if row.frame is None else {"transform": builder.transform(row.frame, element.place)}
    common = _common(lowering, element) | _falloff(element)
    if kind.FORM == Form.AMBIENT:
        common["shadows"] = False
    data = LightData(
        row.kind, (r, g, b), _tuple(row.position), _tuple(row.direction), size=row.size, cos_cone=row.cos_cone, cos_full=row.cos_full,
        angle=row.angle, image=row.image, **transform, **common,
    )  # fmt: skip
    builder.light(data, element.place)


def _common(lowering: Context, element: Element) -> dict[str, Any]:
    args = element.args
    return {
        "shadows": args.get("shadows", True), "links": _links(lowering, element), "name": args["name"] or "",
        "group": args.get("group") or "",
    }  # fmt: skip


def _links(lowering: Context, element: Element) -> link_sets.Links | None:
    """The objects that a light lights, and those that cast its shadows, by their names; None for all."""
    patterns = [element.args.get(name) for name in ("receivers", "blockers")]
    if patterns == [None, None]:
        return None
    diagnostics, place = lowering.builder.diagnostics, element.place
    return link_sets.Links(*(None if names is None else link_sets.by_names(names, diagnostics, place) for names in patterns))


def _falloff(element: Element) -> dict[str, Any]:
    falloff = element.args.get("falloff")
    if falloff is None:
        return {}
    kind = ir.FalloffKind.RAMP if falloff.kind == "ramp" else ir.FalloffKind.POLYNOMIAL
    return {"falloff": kind, "coefficients": falloff.coefficients}


def add_area_light(
    lowering: Context, element: Element, kind: ir.LightKind, frame: np.ndarray, size: tuple[float, float], radiance: Color, image: int = -1
) -> None:  # fmt: skip
    """Add an area light and, if it is visible, its instance; `image` is that of its profile.

    A light without shadows blocks no light; others: plan/light_shapes.py.
    """
    builder = lowering.builder
    flat = ir.GeometryKind.RECTANGLE if kind in RECTANGLES else ir.GeometryKind.DISK
    shape = flat if kind in RECTANGLES + DISKS else ir.GeometryKind.SPHERE
    transform = builder.transform(frame, element.place)
    name = element.args["name"] or element.scope or element.kind
    data = LightData(kind, radiance, transform=transform, size=size, image=image, **{**_common(lowering, element), "name": name})
    row = builder.light(data, element.place)
    if not element.args.get("visible", True):
        return
    geometry = builder.geometry(shape, size if kind in RECTANGLES else size[:1], element.place)
    material = builder.material(MaterialData(ir.MaterialModel.EMISSIVE, {ir.Slot.EMISSION: Input(radiance)}), element.place)
    visible = ALL_RAYS if data.shadows else NO_SHADOW
    builder.instance(InstanceData(geometry, transform, material, row, visible, name), element.place)


def rigid(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """(rigid frame of a matrix, scale along its axes, whether the matrix has no skew).

    The frame keeps the surface normal along y, and z; it is right-handed even if the matrix mirrors.
    """
    columns = matrix[:3, :3]
    scale = np.linalg.norm(columns, axis=0)
    y = columns[:, 1] / scale[1]
    # The normal is perpendicular to x and z; with a skew, it differs from y.
    normal = np.cross(columns[:, 2], columns[:, 0])
    normal /= np.linalg.norm(normal)
    normal = normal if normal @ y > 0 else -normal
    z = columns[:, 2] / scale[2]
    frame = np.eye(4)
    frame[:3, 1], frame[:3, 2] = normal, z
    frame[:3, 0] = np.cross(normal, z)
    frame[:3, 3] = matrix[:3, 3]
    even = abs(float(columns[:, 0] @ columns[:, 2])) <= EVEN * scale[0] * scale[2]
    return frame, scale, even


def _tuple(v: Sequence[float]) -> Color:
    x, y, z = v
    return (float(x), float(y), float(z))
