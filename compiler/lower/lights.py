"""Lowers lights: photometric or unitless strengths become scene-referred colours; area lights get a shape."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ...lang.elements import Element
from .. import ir
from ..formula import numpy_interpreter
from ..scene import link_sets, transforms
from ..scene.row_records import ALL_RAYS, NO_SHADOW, Color, Input, InstanceData, LightData, MaterialData
from . import daylight_sky
from .context import Context

Kind = ir.LightKind
_DOME = 512  # texels from pole to pole of a pattern on a dome
EVEN = 1e-6  # relative difference of scales, or skew, that still counts as uniform


def light(lowering: Context, element: Element, block: np.ndarray) -> None:
    """Add a light in a block with the matrix `block`."""
    lowering.photometric |= element.photometric
    _LIGHTS[element.kind](lowering, element, block)


def spot_share(cos_cone: float, cos_full: float) -> float:
    """Flux over axial intensity of a spot that fades by smoothstep of the cosine: 2π((1 − cos θ_full) + (cos θ_full − cos θ_cone)/2).

    Source: Pharr, Jakob, Humphreys, Physically Based Rendering, 4th ed., 12.2.1.
    """
    return 2 * math.pi * ((1 - cos_full) + (cos_full - cos_cone) / 2)


def _color(element: Element, strength: float) -> Color:
    r, g, b = element.args["color"]
    return (r * strength, g * strength, b * strength)


def _common(lowering: Context, element: Element) -> dict[str, Any]:
    args = element.args
    return {
        "shadows": args.get("shadows", True), "links": _links(lowering, element), "name": args["name"] or "",
        "group": args.get("group") or "",
    }  # fmt: skip


def _links(lowering: Context, element: Element) -> link_sets.Links | None:
    """The objects that a light lights, and those that cast its shadows, by their names; None for all."""
    given = [element.args.get(name) for name in ("receivers", "blockers")]
    if given == [None, None]:
        return None
    diagnostics, place = lowering.builder.diagnostics, element.place
    return link_sets.Links(*(None if names is None else link_sets.by_names(names, diagnostics, place) for names in given))


def _falloff(element: Element) -> dict[str, Any]:
    given = element.args["falloff"]
    if given is None:
        return {}
    kind = ir.FalloffKind.RAMP if given.kind == "ramp" else ir.FalloffKind.POLYNOMIAL
    return {"falloff": kind, "coefficients": given.coefficients}


def _point(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    intensity = args["intensity"] if args["flux"] is None else args["flux"] / (4 * math.pi)
    position = _moved(block, args["position"])
    data = LightData(Kind.POINT, _color(element, intensity), position, **_falloff(element), **_common(lowering, element))
    lowering.builder.light(data, element.place)


def _spot(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    position, target = _moved(block, args["position"]), _moved(block, args["look_at"])
    direction = transforms.unit(np.subtract(target, position))
    if direction is None:
        lowering.refuse(element, "the spot looks at where it is: it has no direction", "give it another look_at")
        return
    cone, soft = args["cone"], args["soft"]
    if soft > cone:
        if "soft" in element.given:
            wide = f"the spot fades over {math.degrees(soft):.4g}deg, more than its cone of {math.degrees(cone):.4g}deg"
            lowering.error(element, wide, "make soft less")
        soft = cone
    cos_cone, cos_full = math.cos(cone), math.cos(cone - soft)
    if cos_cone >= 1.0:
        lowering.refuse(element, f"the spot's cone of {math.degrees(cone):.4g}deg is too narrow to be told from none")
        return
    intensity = args["intensity"] if args["flux"] is None else args["flux"] / spot_share(cos_cone, cos_full)
    data = LightData(
        Kind.SPOT, _color(element, intensity), position, _tuple(direction), cos_cone=cos_cone, cos_full=cos_full,
        **_falloff(element), **_common(lowering, element),
    )  # fmt: skip
    lowering.builder.light(data, element.place)


def _directional(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    direction = transforms.unit(block[:3, :3] @ np.array(args["from"], dtype=np.float64))
    if direction is None:
        lowering.refuse(element, f"the {element.kind}'s direction is 0", "give it a direction, like from: [1, 2, 1]")
        return
    angle = args["angle"] / 2 if element.kind == "sun" else 0.0
    kind = Kind.SUN if angle > 0 else Kind.DIRECTIONAL
    data = LightData(kind, _color(element, args["illuminance"]), direction=_tuple(direction), angle=angle, **_common(lowering, element))
    lowering.builder.light(data, element.place)


def _sky(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    color = _color(element, args["luminance"])
    if args["turbidity"] is None:
        for name in ("sun", "ground"):
            if name in element.given:
                lowering.error(element, f"an even sky has no `{name}`", "give it a turbidity, like turbidity: 3, for the sky of a day")
        lowering.builder.light(LightData(Kind.SKY, color, **_common(lowering, element)), element.place)
        return
    sun = transforms.unit(block[:3, :3] @ np.array(args["sun"], dtype=np.float64))
    if sun is None or sun[1] < 0.0:
        lowering.refuse(element, "the sun of this sky stands below the horizon", "give it a direction that goes up: sun: [1, 0.5, 0.5]")
        return
    turbidity, ground = float(args["turbidity"]), tuple(args["ground"])
    key = ("daylight", turbidity, *sun.tolist(), *ground)
    builder = lowering.builder
    image = builder.shared(key, lambda: builder.image(daylight_sky.picture(sun, turbidity, ground), "daylight"))
    row = builder.transform(np.eye(4), element.place)
    builder.light(LightData(Kind.DOME, color, transform=row, image=image, **_common(lowering, element)), element.place)


def _dome(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    if (args["file"] is None) == (args["pattern"] is None):
        lowering.refuse(element, "a dome has a picture or a pattern", 'write dome("sky.exr") or dome(pattern: |x, y, z| …)')
        return
    image = _patterned(lowering, element) if args["file"] is None else lowering.materials.image(element, args["file"], "auto", True)
    turn = block if args["rotate"] is None else block @ transforms.rotation(args["rotate"])
    frame, _, _ = rigid(turn)
    frame[:3, 3] = 0.0
    if image >= 0:
        row = lowering.builder.transform(frame, element.place)
        data = LightData(Kind.DOME, _color(element, args["luminance"]), transform=row, image=image, **_common(lowering, element))
        lowering.builder.light(data, element.place)


def _patterned(lowering: Context, element: Element) -> int:
    """The image of a pattern on a dome; -1 after a diagnostic. Negative and undefined values are 0."""
    tape = lowering.materials.pattern_tape(element, element.args["pattern"], color=True, unit=1.0)
    if tape is None:
        return -1
    latitude = np.pi * (0.5 - (np.arange(_DOME) + 0.5) / _DOME)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(2 * _DOME) + 0.5) / (2 * _DOME))[None]
    x, y, z = np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0.0 * turn, np.cos(latitude) * np.cos(turn)
    values = [np.broadcast_to(v, x.size).reshape(x.shape) for v in numpy_interpreter.points(tape, x.ravel(), y.ravel(), z.ravel())]
    rgba = np.stack([*(values if len(values) == 3 else values * 3), np.ones(x.shape)], axis=-1)
    picture = np.where(np.isfinite(rgba), np.maximum(rgba, 0.0), 0.0).astype(np.float32)
    key = ("pattern of a dome", tape.structure(), tape.constants.tobytes())
    return lowering.builder.shared(key, lambda: lowering.builder.image(picture, "pattern"))


def _ambient(lowering: Context, element: Element, block: np.ndarray) -> None:
    data = LightData(Kind.AMBIENT, _color(element, element.args["luminance"]), **{**_common(lowering, element), "shadows": False})
    lowering.builder.light(data, element.place)


def _area(lowering: Context, element: Element, block: np.ndarray) -> None:
    args = element.args
    position = np.array(args["position"])
    towards = (0.0, -1.0, 0.0) if args["look_at"] is None else tuple(np.array(args["look_at"]) - position)
    frame = transforms.facing(tuple(position), towards, args["up"])
    if frame is None:
        lowering.refuse(element, "the area light looks at where it is: it has no direction", "give it another look_at")
        return
    disk = args["shape"] == "disk"
    if disk and args["size"][0] != args["size"][1]:
        lowering.refuse(element, "a disk has one diameter, got two sizes", 'write size: 1m, or shape: "rectangle"')
        return
    frame, scale, even = rigid(block @ frame)
    half = (args["size"][0] / 2 * scale[0], args["size"][1] / 2 * scale[2])
    if not even or (disk and abs(half[0] - half[1]) > EVEN * half[0]):
        lowering.warn(element, "the block around it skews or squeezes this area light: it is drawn even", "use an even scale")
    if disk:
        half = (math.sqrt(half[0] * half[1]), 0.0)
    area = math.pi * half[0] ** 2 if disk else 4 * half[0] * half[1]
    radiance = args["luminance"] if args["flux"] is None else args["flux"] / (math.pi * area)
    add_area_light(lowering, element, Kind.DISK if disk else Kind.RECTANGLE, frame, half, _color(element, radiance))


def add_area_light(
    lowering: Context, element: Element, kind: ir.LightKind, frame: np.ndarray, size: tuple[float, float], radiance: Color
) -> None:
    """Add an area light and its visible instance. A light without shadows blocks no light; others: plan/light_shapes.py."""
    builder = lowering.builder
    shape = {Kind.RECTANGLE: ir.GeometryKind.RECTANGLE, Kind.DISK: ir.GeometryKind.DISK, Kind.SPHERE: ir.GeometryKind.SPHERE}[kind]
    transform = builder.transform(frame, element.place)
    name = element.args["name"] or element.scope or element.kind
    data = LightData(kind, radiance, transform=transform, size=size, **{**_common(lowering, element), "name": name})
    row = builder.light(data, element.place)
    geometry = builder.geometry(shape, size if kind == Kind.RECTANGLE else size[:1], element.place)
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
    made = np.eye(4)
    made[:3, 1], made[:3, 2] = normal, z
    made[:3, 0] = np.cross(normal, z)
    made[:3, 3] = matrix[:3, 3]
    even = abs(float(columns[:, 0] @ columns[:, 2])) <= EVEN * scale[0] * scale[2]
    return made, scale, even


def _moved(block: np.ndarray, at: Any) -> Color:
    return _tuple(block[:3, :3] @ np.array(at, dtype=np.float64) + block[:3, 3])


def _tuple(v: np.ndarray) -> Color:
    x, y, z = v.tolist()
    return (x, y, z)


_LIGHTS: dict[str, Callable[[Context, Element, np.ndarray], None]] = {
    "point": _point,
    "spot": _spot,
    "directional": _directional,
    "sun": _directional,
    "sky": _sky,
    "dome": _dome,
    "ambient": _ambient,
    "area": _area,
}
KINDS = frozenset(_LIGHTS)
