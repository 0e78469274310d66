"""Decisions about the picture: camera, size, samples, filter, exposure and channels."""

from __future__ import annotations

import importlib.util
import math

from ...lang.diagnostics import suggest
from ...lang.distribution import install_command
from ...lang.schema.picture_channels import CHANNELS, CRYPTOMATTES, LIGHT
from ...lang.schema.picture_settings import FILTERS, MAX_SAMPLES
from ...lights import SKIES
from .. import ir
from ..io import color_config, environment
from . import light_temperature
from .channels import REST, is_channel
from .decision import DEFAULT_ERROR, Decision, Plan, PlanError, Rule, by_default

DEFAULT_SIZE = (800, 600)
DEFAULT_WIDTH = 960  # of cameras whose film has an aspect ratio, as in usdrecord
SAMPLES_SHARP = 16  # antialiasing alone
SAMPLES_SOFT = 64  # antialiasing and Monte Carlo integration of light
SAMPLES_MOST = 256  # a pixel of a picture that ends at the default error
RASTER_MOMENTS = 16  # times, or lens points, at which the raster backend draws motion blur and depth of field
NOISES = ("blue", "white")


def _camera(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    names = scene.names.cameras
    if settings.camera is not None:
        row = find_camera(names, settings.camera)
        return Decision("camera", row, f"asked for `{names[row]}`", fixed="--camera")
    reason = f"`{names[0]}`, the first of {len(names)}" if len(names) > 1 else "the only one"
    if any(d.startswith("camera") for d in scene.defaults):
        reason = next(d for d in scene.defaults if d.startswith("camera"))
    return Decision("camera", 0, reason, fixed="--camera")


def find_camera(names: tuple[str, ...], wanted: str) -> int:
    """The row of the camera called `wanted`, by its whole name or the last part of its path. Raises PlanError."""
    for row, name in enumerate(names):
        if wanted in (name, name.rsplit("/", 1)[-1]):
            return row
    names_with_text = ", ".join(f"`{n}`" for n in names if n) or "none with a name"
    raise PlanError(f"no camera is called `{wanted}`; the scene has: {names_with_text}. {suggest(wanted, names)}".strip())


def _lens(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    cameras, row = scene.tables.cameras, plan["camera"]
    fixed = "the camera"
    if cameras.projection[row] == ir.Projection.PANORAMIC:
        if plan["backend"] == "raster":
            raise PlanError("the raster backend draws no panoramic pictures: write --backend ray")
        return Decision("lens", "panorama", "the camera is panoramic: all directions, longitude by latitude", fixed=fixed)
    if plan["backend"] == "raster" and cameras.planes[row].any():
        raise PlanError("the raster backend draws no pictures of cameras with clipping planes: write --backend ray")
    radius, focus = float(cameras.lens[row]), float(cameras.focus[row])
    if radius > 0.0:
        how = f"; drawn from {RASTER_MOMENTS} points of it" if plan["backend"] == "raster" else ""
        reason = f"an aperture {2e3 * radius:.3g} mm wide, in focus at {focus:.3g} m: rays start all over it{how}"
        return Decision("lens", "thin", reason, fixed=fixed)
    if cameras.projection[row] == ir.Projection.ORTHOGRAPHIC:
        return Decision("lens", "pinhole", "the camera is orthographic: parallel rays, no aperture", fixed=fixed)
    return Decision("lens", "pinhole", "the camera has no aperture: one ray for each point of the picture", fixed=fixed)


def _size(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.size is not None:
        return Decision("size", settings.size, "asked for", fixed="--size")
    cameras, row = scene.tables.cameras, plan["camera"]
    aspect = float(cameras.aspect[row] / cameras.pixel_aspect[row])
    if aspect > 0:
        size = (DEFAULT_WIDTH, max(1, int(DEFAULT_WIDTH / aspect)))
        return Decision("size", size, f"the camera's film is {aspect:.4g} : 1", fixed="--size")
    return Decision("size", DEFAULT_SIZE, "the default", fixed="--size")


def _crop(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    width, height = plan["size"]
    if settings.crop is None:
        return Decision("crop", (0, 0, width, height), "the whole picture", fixed="--crop")
    x0, y0, x1, y1 = settings.crop
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise PlanError(f"the crop {x0},{y0},{x1},{y1} does not lie inside the picture of {width}x{height} pixels")
    return Decision("crop", settings.crop, "asked for", fixed="--crop")


def _error(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.error is not None and settings.samples is None:
        return Decision("error", float(settings.error), "asked for: tiles get more samples until √relMSE is below it", fixed="--error")
    reason = "a number of samples was asked for" if settings.samples is not None else "none was asked for"
    if settings.samples is None and settings.budget is None and plan["backend"] == "ray" and plan["monte_carlo"]:
        reason = f"the default: pixels get more samples until √relMSE is below it, but at most {SAMPLES_MOST}"
        return Decision("error", DEFAULT_ERROR, reason, fixed="--error")
    return Decision("error", 0.0, reason, fixed="--error")


def _budget(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.budget is not None:
        return Decision("budget", float(settings.budget), "asked for: most seconds of rendering", fixed="--budget")
    return Decision("budget", math.inf, "none was asked for", fixed="--budget")


def _samples(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.samples is not None:
        return Decision("samples", settings.samples, "asked for", fixed="--samples")
    if settings.error is not None:
        return Decision("samples", MAX_SAMPLES, "at most; the error, or a budget, ends the render", fixed="--samples")
    if plan["error"] > 0:
        return Decision("samples", SAMPLES_MOST, f"at most; an error of {plan['error']:.0%} ends the render before", fixed="--samples")
    if math.isfinite(plan["budget"]):
        return Decision("samples", MAX_SAMPLES, "at most; the budget ends the render", fixed="--samples")
    if plan["monte_carlo"]:
        return Decision("samples", SAMPLES_SOFT, "light integrated by samples needs more than antialiasing does", fixed="--samples")
    return Decision("samples", SAMPLES_SHARP, "antialiasing; light is exact at each sample", fixed="--samples")


def _filter(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.filter is not None:
        return Decision("filter", settings.filter, "asked for", FILTERS)
    return Decision("filter", "gaussian", "the default: smooth edges", FILTERS)


def _noise(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if plan["error"] > 0 or math.isfinite(plan["budget"]):
        return Decision("noise", "white", "adaptive sampling: each pixel has a sequence of its own", NOISES[1:])
    return Decision("noise", "blue", "pixels share sequences: errors of neighbours cancel", NOISES)


def _seed(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    return Decision("seed", settings.seed or 0, "asked for" if settings.seed else "the default", fixed="--seed")


def _background(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.background is not None:
        return Decision("background", settings.background, "asked for", fixed="--background")
    if ir.is_in(scene.tables.lights.kind, SKIES).any():
        return Decision("background", "sky", "the scene has a sky", fixed="--background")
    return Decision("background", "transparent", "the scene has no sky", fixed="--background")


def _exposure(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    of_camera = float(scene.tables.cameras.exposure[plan["camera"]])
    if settings.exposure is not None:
        return Decision("exposure", settings.exposure, "asked for", fixed="--exposure")
    if not math.isnan(of_camera):
        return Decision("exposure", of_camera, "the camera's", fixed="--exposure")
    if scene.photometric:
        return Decision("exposure", "metered", "some light has a unit: the log-average becomes middle grey", fixed="--exposure")
    return Decision("exposure", 0.0, "no light has a unit", fixed="--exposure")


def _working_space(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    reason = "asked for: light is computed with its primaries" if settings.working_space else "the default"
    return Decision("working_space", settings.working_space or "rec709", reason, fixed="--working-space")


def _ocio(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    reason = "asked for" if settings.ocio else "the variable OCIO" if environment.has_color_config() else "the library's default"
    return Decision("ocio", environment.color_config(settings.ocio), reason, fixed="--ocio")


def _display(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    reason = "asked for" if settings.display else "the default: the first of the configuration, for its views alone"
    return Decision("display", settings.display or "", reason, fixed="--display")


def _look(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    return Decision("look", settings.look or "", "asked for" if settings.look else "none was asked for", fixed="--look")


def _view(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.view:
        return Decision("view", settings.view, "asked for", fixed="--view")
    if settings.ocio or settings.display or settings.look:
        try:
            name = color_config.opened(plan["ocio"]).default_view(plan["display"])
        except color_config.ConfigError as fault:
            raise PlanError(f"{fault.message}. {fault.hint}".strip(". ")) from None
        return Decision("view", name, "the default view of the configuration's display", fixed="--view")
    if scene.photometric:
        return Decision("view", "rolloff", "some light has a unit, as for a photograph: highlights roll off", fixed="--view")
    return Decision("view", "sRGB", "the default", fixed="--view")


def _white(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.white == "auto":
        kelvin = light_temperature.of_lights(scene.tables)
        reason = "auto: the temperature of the scene's lights" if kelvin else "auto: the lights have no temperature"
        return Decision("white", kelvin, reason, fixed="--white")
    if settings.white is not None:
        return Decision("white", settings.white, "asked for: kelvin of the light that becomes white", fixed="--white")
    return Decision("white", 0.0, "no white balance was asked for: light as it is", fixed="--white")


def _bloom(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.bloom is None:
        return Decision("bloom", 0.0, "not asked for: a lens without glare", fixed="--bloom")
    if scene.tables.cameras.projection[plan["camera"]] != ir.Projection.PERSPECTIVE:
        return Decision("bloom", 0.0, "only a perspective camera has a lens", fixed="--bloom")
    return Decision("bloom", settings.bloom, "asked for: share of the light that the lens scatters", fixed="--bloom")


def _aov(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    chosen: list[str] = []
    groups = {*scene.names.groups, REST} - {""}
    for name in settings.aov or ():
        if not is_channel(name):
            raise PlanError(f"no channel is called `{name}`; there are {', '.join(CHANNELS)}. {suggest(name, CHANNELS)}".strip())
        if name.startswith(LIGHT) and name.removeprefix(LIGHT) not in groups:
            raise PlanError(f"no light has the group `{name.removeprefix(LIGHT)}`; there are {', '.join(sorted(groups))}")
        if name == "variance" and plan["samples"] < 2:
            raise PlanError("one sample has no variance: write --samples 2 or more")
        expanded = {"cryptomatte": CRYPTOMATTES, "lights": tuple(LIGHT + group for group in sorted(groups))}
        chosen += expanded.get(name, (name,))
    if chosen:
        return Decision("aov", tuple(dict.fromkeys(chosen)), "asked for", fixed="--aov")
    return Decision("aov", (), "none was asked for", fixed="--aov")


def _denoise(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    how, installed = "Open Image Denoise, guided by albedo and normals", importlib.util.find_spec("pyoidn") is not None
    if settings.denoise and not installed:
        raise PlanError(f"denoising takes the package pyoidn, which is not installed: {install_command('denoise')}")
    if settings.denoise:
        return Decision("denoise", "on", f"asked for: {how}", fixed="--denoise")
    if settings.denoise is None and installed and by_default(plan):
        reason = f"the default, if {plan['samples']} samples a pixel do not reach the error: {how}"
        return Decision("denoise", "above_error", reason, fixed="--no-denoise")
    if settings.denoise is None and installed and _only_time_is_limited(settings, plan):
        reason = f"the default, if √relMSE is above {DEFAULT_ERROR:.0%} when the budget ends: {how}"
        return Decision("denoise", "above_error", reason, fixed="--no-denoise")
    return Decision("denoise", "off", "not asked for: noise shows the error of a picture", fixed="--denoise")


def _only_time_is_limited(settings: ir.Settings, plan: Plan) -> bool:
    """Whether a budget alone ends the picture: neither samples nor an error were asked for."""
    limited = settings.budget is not None and settings.samples is None and settings.error is None
    return limited and bool(plan["backend"] == "ray" and plan["monte_carlo"])


def _threads(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    reason = "asked for" if settings.threads else "0: one a core; the picture is the same with any number"
    return Decision("threads", settings.threads or 0, reason, fixed="--threads")


FRAMING: tuple[Rule, ...] = (_camera, _lens, _size, _crop)
SAMPLING: tuple[Rule, ...] = (_error, _budget, _samples, _filter, _noise, _seed)
OUTPUT: tuple[Rule, ...] = (
    _background, _working_space, _exposure, _ocio, _display, _look, _view, _white, _bloom, _aov, _denoise, _threads,
)  # fmt: skip
