"""Lowers cameras and the settings of `render(…)`."""

from __future__ import annotations

import math
from typing import Any

from ...lang.diagnostics import suggest
from ...lang.elements import Element
from ...lang.schema.picture_channels import CHANNELS
from ...lang.schema.setting_values import MAX_SIDE
from .. import ir
from ..plan import channels
from ..scene import defaults, transforms
from ..scene.row_records import CameraData
from .context import Context

FILM_HEIGHT = 0.024  # metres, for the aperture of a camera with a `fov`


def camera(lowering: Context, element: Element) -> None:
    """Add a camera."""
    args = element.args
    frame = transforms.looking(args["position"], args["look_at"], args["up"])
    if frame is None:
        lowering.refuse(element, "the camera looks at where it is: it has no direction", "give it another position or look_at")
        return
    near, far = args["near"] or 0.0, args["far"] or math.inf
    if not near < far:
        lowering.refuse(element, f"the camera's near ({near:.6g} m) is not before its far ({far:.6g} m)")
        return
    lens = _projection(lowering, element)
    if lens is None or not _focused(lowering, element, lens):
        return
    if near < 0.0 and lens.get("projection") != ir.Projection.ORTHOGRAPHIC:
        lowering.refuse(element, f"the camera's near ({near:.6g} m) lies behind it", "only orthographic cameras show objects behind them")
        return
    exposure = math.nan if args["exposure"] is None else args["exposure"]
    data = CameraData(
        lowering.builder.transform(frame), near=near, far=far, shift=args["shift"], exposure=exposure, shutter=args["shutter"] or 0.0,
        name=args["name"] or "", **lens
    )
    lowering.builder.camera(data, element.place)


def _focused(lowering: Context, element: Element, lens: dict[str, Any]) -> bool:
    """Add the aperture radius and the focus distance to `lens`; False after a diagnostic."""
    args = element.args
    if args["aperture"] is None:
        if args["focus"] is not None:
            lowering.refuse(element, "`focus` goes with `aperture`", "write aperture: 2.8, focus: 3m")
        return args["focus"] is None
    if lens.get("projection", ir.Projection.PERSPECTIVE) != ir.Projection.PERSPECTIVE:
        lowering.refuse(element, "only perspective cameras have an aperture", "leave it out: everything is in focus")
        return False
    focal = FILM_HEIGHT / 2 / lens["extent"] if args["focal"] is None else args["focal"]
    lens["lens"] = focal / (2.0 * args["aperture"])
    lens["focus"] = args["focus"] or math.dist(args["position"], args["look_at"])
    return True


def _projection(lowering: Context, element: Element) -> dict[str, Any] | None:
    """Projection, extent, fit and aspect; None after a diagnostic."""
    args = element.args
    wanted = args["projection"]
    if wanted == "panoramic":
        for name in ("fov", "focal", "width", "shift"):
            if name in element.given:
                lowering.refuse(element, f"a panoramic camera shows all directions: it has no `{name}`", "leave it out")
                return None
        return {"extent": math.pi / 2, "projection": ir.Projection.PANORAMIC, "aspect": 2.0}
    if "film" in element.given and args["focal"] is None:
        lowering.refuse(element, "`film` goes with `focal`", "write focal: 50mm, film: [36mm, 24mm]")
        return None
    if args["width"] is not None:
        if wanted == "perspective":
            message = '`width` makes a camera orthographic: it does not go with projection: "perspective"'
            lowering.refuse(element, message, "write fov instead")
            return None
        return {"extent": args["width"] / 2, "projection": ir.Projection.ORTHOGRAPHIC, "fit": ir.Fit.HORIZONTAL}
    if wanted == "orthographic":
        lowering.refuse(element, "an orthographic camera has a `width`", "write width: 4m")
        return None
    if args["focal"] is not None:
        width, height = args["film"]
        return {"extent": height / 2 / args["focal"], "aspect": width / height}
    return {"extent": math.tan((args["fov"] or defaults.FOV) / 2)}


def settings(lowering: Context, render: Element | None, cameras: tuple[Element, ...]) -> ir.Settings:
    """The settings of the scene."""
    view = next((c.args["view"] for c in cameras if c.args["view"] is not None), None)
    white = next((c.args["white"] for c in cameras if c.args["white"] is not None), None)
    if render is None:
        return ir.Settings(view=view, white=white)
    args = render.args
    lowering.builder.settings_at(render.place)
    if args["size"] is not None and max(args["size"]) > MAX_SIDE:
        width, height = args["size"]
        lowering.error(render, f"a picture of {width} by {height} pixels is too big", f"at most {MAX_SIDE} each way")
    same = ("size", "backend", "samples", "error", "budget", "bounces", "seed", "filter", "background", "working_space")
    values = {name: args[name] for name in same}
    return ir.Settings(**values, crop=_crop(lowering, render), aov=_aov(lowering, render), view=view, white=white)


def _crop(lowering: Context, render: Element) -> tuple[int, int, int, int] | None:
    limits = render.args["crop"]
    if limits is None:
        return None
    if len(limits) != 4 or any(value != int(value) for value in limits):
        return lowering.error(render, "a crop is the four whole numbers x0, y0, x1, y1", "pixels, from the top left")
    x0, y0, x1, y1 = map(int, limits)
    width, height = render.args["size"] or (math.inf, math.inf)
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        inside = f" of {width} by {height} pixels" if render.args["size"] else ""
        return lowering.error(render, f"the crop [{x0}, {y0}, {x1}, {y1}] does not lie inside the picture{inside}", "x0 < x1 and y0 < y1")
    return (x0, y0, x1, y1)


def _aov(lowering: Context, render: Element) -> tuple[str, ...] | None:
    channel_names = render.args["aov"]
    for name in channel_names or ():
        if not channels.is_channel(name):
            hint = suggest(name, CHANNELS) or f"there are {', '.join(CHANNELS)}"
            return lowering.error(render, f"no channel is called `{name}`", hint)
    return tuple(channel_names) if channel_names else None
