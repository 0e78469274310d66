"""The plan: what a render needs and no more, each decision with its name, value, reason and switch."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...lang.diagnostics import suggest
from ...lang.schema.elements import MAX_BOUNCES as MAX_BOUNCES
from .. import ir
from . import caustic_casters, light_shapes, path_reuse
from .scene_facts import POLISHED as POLISHED  # what a plan's readers ask, too
from .scene_facts import extents, glossy_materials, ground, lit_materials, moving, partial, shines, specular_materials, used_materials
from .scene_facts import open_during as open_during

DEFAULT_SIZE = (800, 600)
DEFAULT_WIDTH = 960  # for cameras that bring a film's aspect, as usdrecord does
SAMPLES_SHARP = 16  # antialiasing alone
SAMPLES_SOFT = 64  # antialiasing and lights that have an extent
MAX_SAMPLES = 4096  # where a render gives up that looks for an error
ENDLESS_SAMPLES = 1 << 20  # and one that spends a budget
SPECULAR_BOUNCES = 8
UNSEEN = 0.02  # of a place's light, that may be missing where no error was asked for
TOLERANCE = 0.05  # pixels
RASTER_PLACES = 16  # of samples in a pixel that bands have at once
MANY_PLACES = 16  # samples of a pixel, from which on patterns are not averaged over parts of it as well
RASTER_MOMENTS = 16  # at which the raster backend draws what moves
BRUTE_FORCE_INSTANCES = 2  # up to this many analytic shapes a loop is as quick as the tree (9.2 against 8.9 million rays a second at 2)
BACKENDS = ("ray", "raster", "reference")
FILTERS = ("box", "tent", "gaussian", "blackman-harris")
CHANNELS = ("depth", "normal", "position", "albedo", "uv", "id", "variance", "samples", "cryptomatte", "lights", "issues")
_MATTES = ("crypto_object", "crypto_material")  # what `cryptomatte` stands for
LIGHT = "light:"  # before the name of a light group
REST = "rest"  # the light group of what names none

TRANSPORTS = ("paths", "tree")
NOISES = ("blue", "white")
RASTER_SHADOWS = ("rays", "map", "none")
SECONDARY = ("none", "trace")  # what becomes of rays that the raster backend's mirrors, metals and glass send on
WEIGHINGS = ("power", "balance", "lights", "surfaces")  # as in render/integrator/path.py
PRECISIONS = ("float32", "float64")
FLOAT32_RATIO = 5000.0  # of the largest coordinate over the smallest thing, up to which single precision does

_SOFT_LIGHTS = (ir.LightKind.SUN, ir.LightKind.SKY, ir.LightKind.DOME, ir.LightKind.RECTANGLE, ir.LightKind.DISK, ir.LightKind.SPHERE)


class PlanError(ValueError):
    """An override that names no decision, or gives it a value it cannot have; the message says which there are."""


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision. `choices` are the values an override may have; empty: any value of the same type.

    `fixed` says why `--plan` cannot change it here (an option of its own does).
    """

    name: str
    value: Any
    reason: str
    choices: tuple[Any, ...] = ()
    overridden: bool = False
    fixed: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """All decisions by name: `plan["raster.fill"]`."""

    decisions: Mapping[str, Decision]

    def __getitem__(self, name: str) -> Any:
        return self.decisions[name].value

    def values(self) -> dict[str, Any]:
        """The decisions as plain data, for `--stats` and picture metadata."""
        return {d.name: list(d.value) if isinstance(d.value, tuple) else d.value for d in self.decisions.values()}


def adaptive(plan: Plan) -> bool:
    """Whether each pixel takes as many samples as it needs, until an error or a budget is reached."""
    return plan["error"] > 0.0 or math.isfinite(plan["budget"])


def make(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str] | None = None) -> Plan:
    """Decide what drawing `scene` takes. `settings` are the command line's; the scene's own stand behind them.

    Raises PlanError for an override that cannot be, or a camera that is not there.
    """
    asked = settings.over(scene.settings)
    if settings.error is not None and settings.samples is None:
        asked = replace(asked, samples=None)  # an error asked for now goes before the number of samples in the scene
    overrides = dict(overrides or {})
    decided: dict[str, Decision] = {}
    for rule in RULES:
        decision = rule(scene, asked, decided)
        if decision.name in overrides:
            decision = _overridden(decision, overrides.pop(decision.name))
        decided[decision.name] = decision
    for name in overrides:
        hint = suggest(name, decided) or "`maquette explain` lists them"
        raise PlanError(f"no decision is called `{name}`; {hint}")
    return Plan(decided)


def _overridden(decision: Decision, text: str) -> Decision:
    if decision.fixed:
        raise PlanError(f"`{decision.name}` is set by {decision.fixed}")
    value: Any = text
    if isinstance(decision.value, bool):
        value = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}.get(text.lower())
        choices: tuple[Any, ...] = ("on", "off")
    else:
        choices = decision.choices
        if isinstance(decision.value, int | float):
            try:
                value = type(decision.value)(text)
            except ValueError:
                value = None
    valid = value is not None and (isinstance(decision.value, bool) or not choices or value in choices)
    if isinstance(value, int | float) and not isinstance(value, bool):
        valid = valid and math.isfinite(value) and (value > 0 or value == decision.value)
    if not valid:
        wanted = ", ".join(map(str, choices)) if choices else f"a positive number like {decision.value}"
        raise PlanError(f"`{decision.name}` cannot be {text}; it can be: {wanted}")
    return Decision(decision.name, value, "set with --plan", decision.choices, overridden=True)


# --- the rules, in the order they are taken; a rule may look at the decisions before it ---------------------------------


def _backend(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    if asked.backend in (None, "auto"):
        return Decision("backend", "ray", "draws everything a scene can hold", BACKENDS, fixed="--backend")
    return Decision("backend", asked.backend, "asked for", BACKENDS, fixed="--backend")


def _camera(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    names = scene.names.cameras
    if asked.camera is not None:
        row = find_camera(names, asked.camera)
        return Decision("camera", row, f"asked for `{names[row]}`", fixed="--camera")
    reason = f"`{names[0]}`, the first of {len(names)}" if len(names) > 1 else "the only one"
    if any(d.startswith("camera") for d in scene.defaults):
        reason = next(d for d in scene.defaults if d.startswith("camera"))
    return Decision("camera", 0, reason, fixed="--camera")


def find_camera(names: tuple[str, ...], wanted: str) -> int:
    """The row of the camera called `wanted`, by its whole name or the last part of its path."""
    for row, name in enumerate(names):
        if wanted in (name, name.rsplit("/", 1)[-1]):
            return row
    there = ", ".join(f"`{n}`" for n in names if n) or "none with a name"
    raise PlanError(f"no camera is called `{wanted}`; the scene has: {there}. {suggest(wanted, names)}".strip())


def _lens(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    cameras, row = scene.tables.cameras, done["camera"].value
    fixed = "the camera"
    if cameras.projection[row] == ir.Projection.PANORAMIC:
        if done["backend"].value == "raster":
            raise PlanError("the raster backend draws no panoramic pictures: write --backend ray")
        return Decision("lens", "panorama", "the camera is panoramic: all directions, longitude by latitude", fixed=fixed)
    radius, focus = float(cameras.lens[row]), float(cameras.focus[row])
    if radius > 0.0:
        how = f"; drawn from {RASTER_MOMENTS} points of it" if done["backend"].value == "raster" else ""
        reason = f"an aperture {2e3 * radius:.3g} mm wide in focus at {focus:.3g} m: rays begin all over it{how}"
        return Decision("lens", "thin", reason, fixed=fixed)
    if cameras.projection[row] == ir.Projection.ORTHOGRAPHIC:
        return Decision("lens", "pinhole", "the camera is orthographic: parallel rays, no aperture", fixed=fixed)
    return Decision("lens", "pinhole", "the camera has no aperture: one ray for each place in the picture", fixed=fixed)


def _size(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if asked.size is not None:
        return Decision("size", asked.size, "asked for", fixed="--size")
    aspect = float(scene.tables.cameras.aspect[done["camera"].value])
    if aspect > 0:
        size = (DEFAULT_WIDTH, max(1, int(DEFAULT_WIDTH / aspect)))
        return Decision("size", size, f"the camera's film is {aspect:.4g} : 1", fixed="--size")
    return Decision("size", DEFAULT_SIZE, "the default", fixed="--size")


def _crop(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    width, height = done["size"].value
    whole = (0, 0, width, height)
    if asked.crop is None:
        return Decision("crop", whole, "the whole picture", fixed="--crop")
    x0, y0, x1, y1 = asked.crop
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise PlanError(f"the crop {x0},{y0},{x1},{y1} does not lie inside the picture of {width}x{height} pixels")
    return Decision("crop", asked.crop, "asked for", fixed="--crop")


def _soft(scene: ir.Scene, *_: Any) -> Decision:
    lights = scene.tables.lights
    soft = [k for k in _SOFT_LIGHTS if np.any((lights.kind == k) & np.any(lights.color > 0, axis=1))]
    if soft and not lit_materials(scene.tables).any():
        reason = "no surface is lit: things shine, mirror or let through"
        soft = []
    elif soft:
        reason = f"{', '.join(k.name.lower() for k in soft)}: sampled with random numbers"
    else:
        reason = "only point-like lights: one exact shadow ray each, no random numbers"
    return Decision("soft lights", bool(soft), reason, fixed="the scene's lights")


def _secondary(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    reason = "mirrors, metals and glass show the sky and, below it, the ground's mean light: no ray is followed from what is seen"
    if not (specular_materials(scene) & used_materials(scene.tables)).any():
        reason = "no material reflects or refracts"
    return Decision("raster.secondary", "none", reason, SECONDARY)


def _bounces(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if done["backend"].value == "raster" and done["raster.secondary"].value == "none":
        reason = "the raster backend follows no rays from what is seen: --plan raster.secondary=trace does"
        return Decision("bounces", 0, reason, fixed="--bounces")
    if asked.bounces is not None:
        return Decision("bounces", asked.bounces, "asked for", fixed="--bounces")
    if specular_materials(scene).any():
        return Decision("bounces", SPECULAR_BOUNCES, "some materials reflect or refract", fixed="--bounces")
    return Decision("bounces", 0, "no material reflects or refracts: direct light only", fixed="--bounces")


def _interreflection(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    diffuse = scene.tables.materials.values[:, ir.Slot.DIFFUSE].max(axis=1, initial=0.0) > 0
    if asked.bounces and done["bounces"].value > 0 and diffuse.any():
        return Decision("interreflection", True, "bounces were asked for: matt surfaces light each other too")
    if done["bounces"].value > 0 and (glossy_materials(scene) & used_materials(scene.tables)).any():
        return Decision("interreflection", True, "glossy surfaces mirror what is around them: light comes from all directions")
    reason = "no bounces were asked for: rays go on at mirrors and glass only" if diffuse.any() else "no material is matt"
    return Decision("interreflection", False, reason)


def _random(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    fixed = "the scene's lights and materials"
    why = []
    if done["soft lights"].value:
        why.append("soft lights")
    if done["interreflection"].value:
        why.append("light between surfaces")
    if (glossy_materials(scene) & used_materials(scene.tables)).any():
        why.append("what glossy surfaces mirror")
    if (scene.tables.materials.model[used_materials(scene.tables)] == ir.MaterialModel.BLEND).any():
        why.append("blends of materials")
    if why:
        return Decision("random numbers", True, f"{', '.join(why)}: found by samples", fixed=fixed)
    return Decision("random numbers", False, "none but those of antialiasing: light is exact at each sample", fixed=fixed)


def _transport(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if not done["interreflection"].value:
        return Decision("transport", "tree", "light goes by mirrors and glass alone: every branch is followed", TRANSPORTS[1:])
    if done["backend"].value == "raster":
        return Decision("transport", "tree", "rays go on from what is seen of triangles: every branch is followed", TRANSPORTS[1:])
    return Decision("transport", "paths", "matt surfaces light each other: one random direction a surface", TRANSPORTS)


def _path_precision(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if done["transport"].value != "paths" or done["backend"].value != "ray":
        return Decision("precision", "float64", "all but paths of the ray backend is computed in double precision", PRECISIONS[1:])
    if (scene.tables.geometries.kind == ir.GeometryKind.FORMULA).any() or (scene.tables.textures.kind == ir.TextureKind.FORMULA).any():
        return Decision("precision", "float64", "formulas are evaluated in double precision", PRECISIONS[1:])
    largest, smallest = extents(scene.tables)
    ratio = largest / smallest if smallest > 0.0 else math.inf
    figures = f"coordinates up to {largest:.3g} m over {smallest:.3g} m, the smallest thing: {ratio:.3g}"
    if ratio <= FLOAT32_RATIO:
        return Decision("precision", "float32", f"{figures}; rays start 2e-6 of their coordinates off a surface", PRECISIONS)
    return Decision("precision", "float64", f"{figures}; more than {FLOAT32_RATIO:g}, too much for float32", PRECISIONS)


def _weighing(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if done["transport"].value != "paths":
        return Decision("weighing", "power", "no path finds light in two ways", WEIGHINGS[:1])
    reason = "light is looked for, and found by chance: the likelier way counts more (`lights`, `surfaces`: one way alone)"
    return Decision("weighing", "power", reason, WEIGHINGS)


def _shadows(scene: ir.Scene, *_: Any) -> Decision:
    if scene.tables.lights.shadows.any():
        return Decision("shadows", True, "some light casts them")
    if shines(scene.tables)[used_materials(scene.tables)].any():
        return Decision("shadows", True, "things shine")
    return Decision("shadows", False, "no light casts any")


def _bodies(scene: ir.Scene, *_: Any) -> Decision:
    if light_shapes.that_block(scene.tables).any():
        return Decision("shadows.lamps", True, "lamps' shapes stand in the light of others")
    return Decision("shadows.lamps", False, "no lamp's shape stands in the light of another", fixed="the scene's lights")


def _error(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    if asked.error is not None and asked.samples is None:
        return Decision("error", float(asked.error), "asked for: samples are added tile by tile until √relMSE is below it", fixed="--error")
    reason = "a number of samples was asked for" if asked.error is not None else "none was asked for"
    return Decision("error", 0.0, reason, fixed="--error")


def _budget(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    if asked.budget is not None:
        return Decision("budget", float(asked.budget), "asked for: seconds of rendering at the most", fixed="--budget")
    return Decision("budget", math.inf, "none was asked for", fixed="--budget")


def _samples(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if asked.samples is not None:
        return Decision("samples", asked.samples, "asked for", fixed="--samples")
    if done["error"].value > 0:
        return Decision("samples", MAX_SAMPLES, "at the most; the error or the budget ends it", fixed="--samples")
    if math.isfinite(done["budget"].value):
        return Decision("samples", ENDLESS_SAMPLES, "at the most; the budget ends it", fixed="--samples")
    if done["random numbers"].value:
        return Decision("samples", SAMPLES_SOFT, "soft light needs more than antialiasing does", fixed="--samples")
    return Decision("samples", SAMPLES_SHARP, "antialiasing; light is exact at each sample", fixed="--samples")


def _filter(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if asked.filter is not None:
        return Decision("filter", asked.filter, "asked for", FILTERS)
    return Decision("filter", "gaussian", "the default: smooth edges", FILTERS)


def _noise(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if done["error"].value > 0 or math.isfinite(done["budget"].value):
        return Decision("noise", "white", "pixels take as many samples as they need: each has a sequence of its own", NOISES[1:])
    return Decision("noise", "blue", "pixels share sequences, so that neighbours' errors balance each other", NOISES)


def _seed(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    return Decision("seed", asked.seed or 0, "asked for" if asked.seed else "the default", fixed="--seed")


def _background(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    if asked.background is not None:
        return Decision("background", asked.background, "asked for", fixed="--background")
    kinds = scene.tables.lights.kind
    if ir.among(kinds, (ir.LightKind.SKY, ir.LightKind.DOME)).any():
        return Decision("background", "sky", "the scene has a sky", fixed="--background")
    return Decision("background", "transparent", "the scene has no sky", fixed="--background")


def _exposure(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    of_camera = float(scene.tables.cameras.exposure[done["camera"].value])
    if asked.exposure is not None:
        return Decision("exposure", asked.exposure, "asked for", fixed="--exposure")
    if not math.isnan(of_camera):
        return Decision("exposure", of_camera, "the camera's", fixed="--exposure")
    if scene.photometric:
        return Decision("exposure", "metered", "some light has a unit: the log-average becomes middle grey", fixed="--exposure")
    return Decision("exposure", 0.0, "all light values are bare", fixed="--exposure")


def _view(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    return Decision("view", asked.view or "sRGB", "asked for" if asked.view else "the default", fixed="--view")


def _aov(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    found: list[str] = []
    groups = {*scene.names.groups, REST} - {""}
    for name in asked.aov or ():
        if not is_channel(name):
            raise PlanError(f"no channel is called `{name}`; there are {', '.join(CHANNELS)}. {suggest(name, CHANNELS)}".strip())
        if name.startswith(LIGHT) and name.removeprefix(LIGHT) not in groups:
            raise PlanError(f"no light has the group `{name.removeprefix(LIGHT)}`; there are {', '.join(sorted(groups))}")
        if name == "variance" and done["samples"].value < 2:
            raise PlanError("one sample says nothing of its variance: write --samples 2 or more")
        expanded = {"cryptomatte": _MATTES, "lights": tuple(LIGHT + group for group in sorted(groups))}
        found += expanded.get(name, (name,))
    if found:
        return Decision("aov", tuple(dict.fromkeys(found)), "asked for", fixed="--aov")
    return Decision("aov", (), "none was asked for: none is computed", fixed="--aov")


def is_channel(name: str) -> bool:
    """Whether a picture of some scene has a channel of this name."""
    return name in CHANNELS or (name.startswith(LIGHT) and len(name) > len(LIGHT))


def light_groups(plan: Plan) -> tuple[str, ...]:
    """The light groups whose light is asked for by itself."""
    return tuple(name.removeprefix(LIGHT) for name in plan["aov"] if name.startswith(LIGHT))


def _denoise(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if not asked.denoise:
        return Decision("denoise", False, "not asked for: noise says how far off a picture may be", fixed="--denoise")
    if importlib.util.find_spec("pyoidn") is None:
        raise PlanError("denoising takes the package pyoidn, which is not installed: pip install maquette[denoise]")
    return Decision("denoise", True, "asked for: Open Image Denoise, guided by albedo and normals", fixed="--denoise")


def _threads(scene: ir.Scene, asked: ir.Settings, _: Mapping[str, Decision]) -> Decision:
    reason = "asked for" if asked.threads else "0: one a core; the picture is the same with any number"
    return Decision("threads", asked.threads or 0, reason, fixed="--threads")


def _accelerator(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    tables = scene.tables
    choices = ("bvh", "brute")
    meshes = tables.geometries.kind[tables.instances.geometry] == ir.GeometryKind.MESH
    count = len(tables.instances.geometry)
    if done["backend"].value == "reference":
        return Decision("accelerator", "brute", "the reference tries every primitive", fixed="--backend")
    if count <= BRUTE_FORCE_INSTANCES and not meshes.any():
        return Decision("accelerator", "brute", f"{count} shapes: trying each is quicker than a tree", choices)
    reason = f"{count} instances of {len(tables.geometries.kind)} geometries, {len(tables.pools.triangles)} triangles"
    return Decision("accelerator", "bvh", reason, choices)


def _formulas(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    tables, choices = scene.tables, ("closed", "bounds")
    shown = np.unique(tables.instances.geometry)
    surfaces = shown[tables.geometries.kind[shown] == ir.GeometryKind.FORMULA].tolist()
    if done["backend"].value == "reference":
        return Decision("formulas", "bounds", "the reference asks bounds and nothing else", fixed="--backend")
    if not surfaces:
        return Decision("formulas", "bounds", "no surface is a formula", fixed="the scene's shapes")
    from ..formula import closed_form_solids  # what other scenes do not load

    closed = sum(closed_form_solids.of_geometry(tables, g) is not None for g in surfaces)
    if not closed:
        return Decision("formulas", "bounds", "no surface consists of planes, quadrics and tori: roots are found by bounds", ("bounds",))
    count = f"{closed} of {len(surfaces)}" if closed < len(surfaces) else "each" if closed > 1 else "it"
    return Decision("formulas", "closed", f"surfaces of planes, quadrics and tori ({count}): all roots along a ray in closed form", choices)


def _tolerance(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if asked.tolerance is not None:
        return Decision("tolerance", float(asked.tolerance), "asked for: pixels a tessellated shape may be off its true outline")
    return Decision("tolerance", TOLERANCE, "the default: pixels a tessellated shape may be off its true outline")


def _horizon(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    lights = scene.tables.lights
    if not (ir.among(lights.kind, (ir.LightKind.SKY, ir.LightKind.DOME)) & lights.shadows).any():
        return Decision("horizon", False, "no sky casts shadows")
    row = ground(scene.tables)
    if row < 0:
        return Decision("horizon", False, "no plane has the whole scene on its upper side", fixed="the scene's planes")
    named = scene.names.instances[row] if row < len(scene.names.instances) else ""
    name = f"`{named}`" if named else "a plane"
    return Decision("horizon", True, f"{name} bounds the scene from below: sky under it is blocked for all, and is not sampled")


def _opacity(scene: ir.Scene, *_: Any) -> Decision:
    instances = scene.tables.instances
    count = int(partial(scene.tables)[instances.material].sum())
    if not count:
        return Decision("opacity", False, "everything is wholly there", fixed="the scene's materials")
    what = "is one thing" if count == 1 else f"are {count} things"
    reason = f"there {what} with an opacity: rays pass where it is 0, and go on where it is less than 1"
    return Decision("opacity", True, reason, fixed="the scene's materials")


def _raster_shadows(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    if not done["shadows"].value:
        return Decision("raster.shadows", "none", "no light casts any", RASTER_SHADOWS[2:])
    reason = "each point asks the trees whether it sees a lamp: exact"
    if done["opacity"].value:
        return Decision("raster.shadows", "rays", f"{reason}; no map tells what lets some light through", ("rays", "none"))
    reason += " (`map`: what lamps see is drawn once and filtered; soft lights keep rays)"
    return Decision("raster.shadows", "rays", reason, RASTER_SHADOWS)


def _motion(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    tables, row = scene.tables, done["camera"].value
    shutter = float(tables.cameras.shutter[row])
    if shutter <= 0.0:
        return Decision("motion", False, "the shutter is open for no time", fixed="the camera's shutter")
    if not moving(tables, row):
        return Decision("motion", False, f"nothing moves in the {shutter:.4g} s that the shutter is open", fixed="the scene's motion")
    count = int((tables.transforms.first_key[tables.instances.transform] >= 0).sum())
    camera = ", the camera" if tables.transforms.first_key[tables.cameras.transform[row]] >= 0 else ""
    things = f"{count} thing{'s' if count != 1 else ''}{camera}"
    how = "each ray has a time" if done["backend"].value != "raster" else f"drawn at {RASTER_MOMENTS} moments, sample by sample in turn"
    return Decision("motion", True, f"moving in the {shutter:.4g} s of the shutter: {things}; {how}")


def _textures(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    tables = scene.tables
    rows = np.unique(tables.materials.textures[np.unique(tables.instances.material)])
    rows = rows[rows >= 0]
    kind, plain = tables.textures.kind[rows], tables.textures.nearest[rows]
    patterns, pictures = bool((kind == ir.TextureKind.FORMULA).any()), bool(((kind == ir.TextureKind.IMAGE) & ~plain).any())
    cells = bool(ir.among(kind, (ir.TextureKind.CHECKER, ir.TextureKind.STRIPES)).any())
    if not patterns and not pictures and not cells:
        return Decision("textures", "sharp", "no picture and no pattern lies on anything", fixed="the scene's materials")
    why = ""
    rounds = done["error"].value or math.isfinite(done["budget"].value)
    if not pictures and (rounds or (not cells and done["samples"].value >= MANY_PLACES)):
        why = "each pixel looks at patterns in many places anyway"
    if done["transport"].value == "paths":
        why = "paths take many samples"
    elif done["motion"].value or done["lens"].value != "pinhole":
        why = "each pixel has many rays from the eye"
    if why:
        return Decision("textures", "sharp", why, ("sharp",))
    if patterns or not pictures:
        return Decision("textures", "filtered", "patterns are averaged over what a pixel sees of them", ("filtered", "sharp"))
    reason = "pictures are looked at in the size and along the direction in which a pixel sees them"
    return Decision("textures", "filtered", reason, ("filtered", "sharp"))


def _caustics(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    value, reason, choices = caustic_casters.carrier(scene.tables, done["transport"].value, done["backend"].value, done["motion"].value)
    return Decision("transport.caustics", value, reason, choices, fixed="--backend" if done["backend"].value == "reference" else "")


def _reuse(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    found = path_reuse.by_blocks(scene.tables, done["transport"].value, done["backend"].value, done["motion"].value)
    return Decision("transport.reuse", *found)


def _fill(scene: ir.Scene, *_: Any) -> Decision:
    return Decision("raster.fill", "edges", "exact edge functions; all three cover the same samples", ("edges", "areas", "scanline"))


def _places(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    samples, name = done["samples"].value, "raster.places"
    if done["error"].value > 0.0 or math.isfinite(done["budget"].value):
        return Decision(name, "own", "how many samples a pixel takes is found out while it is drawn", ("own",))
    if samples == 1:
        return Decision(name, "shared", "a sample stands for its whole pixel, in its middle", ("shared",))
    if done["random numbers"].value:
        why = "light with random numbers: samples and numbers are the ray backend's, so that both err alike"
    elif samples > RASTER_PLACES:
        why = f"edges finer than 1/{RASTER_PLACES} of a pixel: each pixel has the ray backend's places"
    else:
        return Decision(name, "shared", "the same places in every pixel, in bands", ("shared", "own"))
    return Decision(name, "own", f"{why} (`shared`: sooner, in bands)", ("own", "shared"))


def _shading(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    choices = ("pixel", "sample")
    textured = bool((scene.tables.materials.textures >= 0).any())
    shadowed = done["raster.shadows"].value != "none"
    if shadowed or textured:
        what = "shadows" if shadowed else "textures"
        return Decision("raster.shading", "sample", f"edges of {what} run across triangles: each sample is lit", choices)
    return Decision("raster.shading", "pixel", "light has no edges within a triangle: it is lit once in each pixel", choices)


def _precision(scene: ir.Scene, asked: ir.Settings, done: Mapping[str, Decision]) -> Decision:
    instances, materials = scene.tables.instances, scene.tables.materials
    shown = instances.visible & ir.Visibility.CAMERA != 0
    used = np.unique(instances.material[shown])
    why = ""
    if done["raster.shadows"].value != "none" or ir.among(scene.tables.lights.kind, _SOFT_LIGHTS).any():
        why = "rays go to lights"
    elif (scene.tables.geometries.kind[instances.geometry[shown]] != ir.GeometryKind.MESH).any():
        why = "rays meet shapes that are no mesh"
    elif done["opacity"].value:
        why = "some surface lets light through"
    elif (scene.tables.textures.kind == ir.TextureKind.FORMULA).any():
        why = "patterns are formulas, which are computed in float64"
    elif (materials.textures[used][:, [ir.Slot.NORMAL, ir.Slot.BUMP]] >= 0).any():
        why = "some normals are turned by maps"
    elif ir.among(materials.model[used], (ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR, ir.MaterialModel.METAL)).any():
        why = "some highlight is of microfacets"
    elif (materials.model[used] == ir.MaterialModel.BLEND).any():
        why = "some material is a blend"
    elif specular_materials(scene)[used].any() or (materials.shading[used] == ir.Shading.GOURAUD).any():
        why = "some material mirrors, refracts or is shaded at vertices"
    if why:
        return Decision("raster.precision", "float64", why, ("float64",))
    reason = "lamps without shadows on meshes: light in float32 is within 1e-5"
    return Decision("raster.precision", "float32", reason, ("float32", "float64"))


RULES: tuple[Callable[[ir.Scene, ir.Settings, Mapping[str, Decision]], Decision], ...] = (
    _backend, _camera, _lens, _size, _crop, _soft, _secondary, _bounces, _interreflection, _random, _transport, _weighing, _path_precision,
    _shadows, _bodies, _error, _budget, _samples, _filter, _noise, _seed,
    _background, _exposure, _view, _aov, _denoise, _threads, _accelerator, _formulas, _horizon, _opacity,
    _raster_shadows, _motion, _caustics, _reuse, _textures, _tolerance, _fill, _places, _shading, _precision,
)  # fmt: skip


def warnings(scene: ir.Scene, plan: Plan) -> list[str]:
    """What the plan finds odd about the scene."""
    found = []
    if plan["interreflection"] and (scene.tables.lights.kind == ir.LightKind.AMBIENT).any():
        found.append("ambient light stands for interreflection, and bounces compute it: it is counted twice; leave out one")
    return found
