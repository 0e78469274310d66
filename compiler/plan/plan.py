"""Plan of a render: the rules in their order, and the decisions that they make for a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ...lang.diagnostics import Diagnostic, suggest
from ...lights import AMBIENT
from .. import ir
from . import emissive_shapes, picture_rules, raster_rules, scene_rules, transport_rules, without_media
from .decision import Decision, Plan, PlanError, Rule, override

# A rule may read the decisions of the rules before it.
RULES: tuple[Rule, ...] = (
    *scene_rules.BACKEND,
    *picture_rules.FRAMING,
    *transport_rules.LIGHTS,
    *raster_rules.SECONDARY,
    *transport_rules.INTEGRATOR,
    *picture_rules.SAMPLING,
    *picture_rules.OUTPUT,
    *scene_rules.GEOMETRY,
    *transport_rules.VISIBILITY,
    *scene_rules.MOTION,
    *transport_rules.CAUSTICS,
    *scene_rules.TEXTURES,
    *raster_rules.RASTER,
)


def make_plan(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str] | None = None) -> Plan:
    """Decide how to draw `scene`. `settings` are the command line's, and come before the scene's own.

    Raises PlanError for an override or a setting that is not possible.
    """
    requested = settings.over(scene.settings)
    if settings.error is not None and settings.samples is None:
        requested = replace(requested, samples=None)  # an error on the command line comes before a number of samples in the scene
    remaining = dict(overrides or {})
    decided: dict[str, Decision] = {}
    plan = Plan(decided)
    for rule in RULES:
        decision = rule(scene, requested, plan)
        if decision.name in remaining:
            decision = override(decision, remaining.pop(decision.name))
        decided[decision.name] = decision
    for name in remaining:
        hint = suggest(name, decided) or "`maquette explain` lists them"
        raise PlanError(f"no decision is called `{name}`; {hint}")
    return plan


def notes(scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """Notes on parts of the scene that are without effect under the plan."""
    omission = emissive_shapes.without_effect(scene, plan)
    return [*unused_cameras(scene, plan), *([] if omission is None else [omission.diagnostic(scene)])]


def unused_cameras(scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """The note where a picture takes the camera that was added, and the scene has cameras of its own."""
    names, added = scene.names.cameras, any(sentence.startswith("camera:") for sentence in scene.defaults)
    if not added or len(names) < 2 or plan["camera"] != 0:
        return []
    cameras = names[1:]
    takes = f"--camera {cameras[0]} takes " + ("it" if len(cameras) == 1 else "the first")
    several = f"none of the stage's {len(cameras)} cameras is used: none is"
    has = "the stage's camera is not used: it is not" if len(cameras) == 1 else several
    message = f"{has} called `main_cam`, so that the picture frames everything, as usdrecord does"
    return [Diagnostic("note", message, scene.spans.get("cameras", 1), takes)]


def default_notes(scene: ir.Scene) -> list[Diagnostic]:
    """The notes of a picture with the scene's own settings; none if these exclude each other."""
    try:
        return notes(scene, make_plan(scene, ir.Settings()))
    except PlanError:
        return []


def warnings(scene: ir.Scene, plan: Plan) -> list[str]:
    """Contradictions between the scene and the plan."""
    messages = []
    if plan["interreflection"] and ir.is_in(scene.tables.lights.kind, AMBIENT).any():
        messages.append("ambient light stands for interreflection, and bounces compute it: it is counted twice; leave out one")
    x0, y0, x1, y1 = plan["crop"]
    if plan["bloom"] > 0.0 and (x1 - x0, y1 - y0) != tuple(plan["size"]):
        messages.append("the bloom of a crop lacks the light of the rest of the picture")
    if plan["transport"] != "path":
        drawer = "the raster backend" if plan["backend"] == "raster" else "Whitted ray tracing"
        if scene.tables.media.everywhere.any():
            messages.append(f"{drawer} draws fog without the shadows in it; the ray backend draws them by paths")
        if without_media.leaves_out(scene.tables, plan["bounces"] > 0):
            messages.append(f"{drawer} leaves out media that scatter or emit light; the ray backend draws them by paths")
    return messages
