"""A point that shines into a cone, which fades by smoothstep of the cosine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..lang.schema.argument_types import REQUIRED, Arg
from ..shapes.lanes import helper, ops
from .arguments import FALLOFF, light_entry
from .contract import Element, ExportedLight, Form, GltfLight, Lane, LightError, Lowering, MitsubaLight, PovrayLight, Row, Text, UsdLight

PIXELS = 1024  # width of the image that shapes the falloff in Mitsuba
WIDEST = np.radians(80.0)  # of Mitsuba


def flux_share(cos_cone: float, cos_full: float) -> float:
    """Flux over axial intensity of a spot that fades by smoothstep of the cosine: 2π((1 − cos θ_full) + (cos θ_full − cos θ_cone)/2).

    Source: Pharr, Jakob, Humphreys, Physically Based Rendering, 4th ed., 12.2.1.
    """
    return 2 * math.pi * ((1 - cos_full) + (cos_full - cos_cone) / 2)


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    position, target = lowering.point(args["position"]), lowering.point(args["look_at"])
    direction = lowering.unit(np.subtract(target, position))
    if direction is None:
        raise LightError("the spot looks at where it is: it has no direction", "give it another look_at")
    cone, soft = args["cone"], args["soft"]
    if soft > cone:
        if lowering.is_given("soft"):
            wide = f"the spot fades over {math.degrees(soft):.4g}deg, more than its cone of {math.degrees(cone):.4g}deg"
            lowering.error(wide, "make soft less")
        soft = cone
    cos_cone, cos_full = math.cos(cone), math.cos(cone - soft)
    if cos_cone >= 1.0:
        raise LightError(f"the spot's cone of {math.degrees(cone):.4g}deg is too narrow to be distinguished from none")
    intensity = args["intensity"] if args["flux"] is None else args["flux"] / flux_share(cos_cone, cos_full)
    return Row(KIND, intensity, position=position, direction=direction.tolist(), cos_cone=cos_cone, cos_full=cos_full)


KIND = ir.LightKind.SPOT
ELEMENTS = (
    Element(
        light_entry(
            "spot",
            "a point light that shines into a cone",
            Arg("position", "point", REQUIRED, "its position"),
            Arg("look_at", "point", (0.0, 0.0, 0.0), "point that it aims at", keyword=True),
            Arg("cone", "angle", math.radians(30), "half angle of the cone", above=0.0, maximum=math.pi, keyword=True),
            Arg("soft", "angle", math.radians(5), "angle inside the edge of the cone over which it fades", minimum=0.0, keyword=True),
            Arg("intensity", "intensity", 9 * math.pi, "candela along its axis", minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "total lumen in the cone", minimum=0.0, keyword=True),
            FALLOFF,
            exclusive=(("intensity", "flux"),),
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.POINT, False, False


@helper
def smoothstep(cosine: Lane, cos_cone: Lane, cos_full: Lane) -> Lane:
    """Smoothstep of the cosine, from cos_cone to cos_full (pbrt-v4 §12.2.3)."""
    t = ops.clip((cosine - cos_cone) / ops.maximum(cos_full - cos_cone, 1e-12), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@helper
def profile(lights: Any, row: Lane, cosine: Lane) -> Lane:
    return smoothstep(cosine, lights.cos_cone[row], lights.cos_full[row])


def widest(lights: ir.Lights, row: int) -> float:
    return float(np.arccos(np.clip(lights.cos_cone[row], -1.0, 1.0)))


def source(lights: ir.Lights, row: int) -> Mapping[str, float]:
    cone, full = (math.acos(min(max(float(cosine[row]), -1.0), 1.0)) for cosine in (lights.cos_cone, lights.cos_full))
    return {"cone": cone, "soft": cone - full}


def usd(light: ExportedLight) -> UsdLight:
    softness = 1.0 - light.full / light.cone if light.cone > 0 else 0.0
    shaping = {"ShapingConeAngle": math.degrees(light.cone), "ShapingConeSoftness": softness}
    return UsdLight("SphereLight", {"TreatAsPoint": True, "Normalize": True}, 4.0, shaping)


def gltf(light: ExportedLight) -> GltfLight:
    outer = min(light.cone, math.pi / 2)
    return GltfLight({"type": "spot", "spot": {"innerConeAngle": min(light.full, 0.999999 * outer), "outerConeAngle": outer}})


def povray(light: ExportedLight, text: Text) -> PovrayLight:
    full, cone = (text.number(float(np.degrees(angle))) for angle in (light.full, light.cone))
    return PovrayLight(f" spotlight point_at {text.vector(light.position + light.direction)} radius {full} falloff {cone} tightness 0")


def mitsuba(light: ExportedLight) -> MitsubaLight:
    """The falloff is a texture: Mitsuba's is linear in the angle, ours is smoothstep of the cosine."""
    loss = f"a spot wider than {np.degrees(WIDEST):.0f}° is not carried" if light.cone > WIDEST else ""
    cone = min(light.cone, WIDEST)
    degrees = float(np.degrees(cone))
    texture = picture(cone, math.cos(light.cone), math.cos(light.full))
    parameters = {"cutoff_angle": degrees, "beam_width": degrees}
    return MitsubaLight("spot", "intensity", parameters, is_turned=True, texture=texture, loss=loss)


def picture(cone: float, cos_cone: float, cos_full: float) -> np.ndarray:
    """(n, n, 3) relative intensity of a spot over the square about its cone, on a plane perpendicular to its axis."""
    place = ((np.arange(PIXELS) + 0.5) / PIXELS * 2.0 - 1.0) * np.tan(cone)
    cosine = 1.0 / np.sqrt(1.0 + place[:, None] ** 2 + place[None] ** 2)
    t = np.clip((cosine - cos_cone) / max(cos_full - cos_cone, 1e-12), 0.0, 1.0)
    return np.repeat((t * t * (3.0 - 2.0 * t))[..., None], 3, axis=2).astype(np.float32)
