"""Imports USD cameras; adds a camera that frames a stage without a main camera, as usdrecord does."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Gf, Tf, UsdGeom

from ....lang.diagnostics import Span
from ... import ir
from ...scene import transforms
from ...scene.builder import SceneBuilder
from ...scene.row_records import NO_PLANES, CameraData
from . import stage
from .layers.reports import reason
from .render_settings import StageSettings
from .stage import Opened

FILM = (20.955, 15.2908)  # mm: usdrecord's default camera
FOCAL = 50.0  # mm
_LENS_UNIT = 0.1  # scene units in one unit of apertures and focal lengths


def camera(prim: Any, matrix: np.ndarray, unit: float, opened: Opened, builder: SceneBuilder, settings: StageSettings) -> int:
    """The row of a Camera prim under the (4, 4) matrix. Its scale is ignored except for `unit`, the stage's own.

    For a picture of another aspect than the film, `asked.conform` selects the part that is kept.
    """
    lens = UsdGeom.Camera(prim).GetCamera(opened.time)
    width, height = lens.horizontalAperture, lens.verticalAperture
    span = opened.span(prim)
    perspective = lens.projection == Gf.Camera.Perspective
    if not (width > 0 and height > 0) or (perspective and not lens.focalLength > 0):
        builder.diagnostics.warning("this camera has no aperture or focal length: it is left out", span)
        return -1
    near, far = lens.clippingRange.min * unit, lens.clippingRange.max * unit
    if not near < far:
        builder.diagnostics.warning("this camera's clipping range is empty: it clips nothing", span)
        near, far = 0.0, math.inf
    opening, shutter = _shutter(prim, opened)
    radius, focus = _aperture(lens, unit, perspective)
    if not settings.motion_blur:
        opening, shutter = 0.0, 0.0
    if not settings.depth_of_field:
        radius, focus = 0.0, 1.0
    exposure = math.log2(max(UsdGeom.Camera(prim).ComputeLinearExposureScale(opened.time), 1e-30))
    fit, wide, high, pixel = _conformed(width, height, settings)
    film_side = wide if fit == ir.Fit.HORIZONTAL else high
    return builder.camera(
        CameraData(
            builder.transform(transforms.unscaled(matrix), span),
            film_side / (2 * lens.focalLength) if perspective else film_side * _LENS_UNIT / 2 * unit,
            ir.Projection.PERSPECTIVE if perspective else ir.Projection.ORTHOGRAPHIC, fit=fit,
            aspect=width / height, near=max(near, 0.0) if perspective else near, far=far,
            shift=(lens.horizontalApertureOffset / wide, lens.verticalApertureOffset / high),
            exposure=exposure or math.nan, opening=opening, shutter=shutter, lens=radius, focus=focus, pixel_aspect=pixel,
            planes=_planes(lens, unit, span, builder), name=str(prim.GetPath()),
        ),
        span,
    )  # fmt: skip


def readable(cameras: list[tuple[Any, Any]], opened: Opened, builder: SceneBuilder) -> list[tuple[Any, Any]]:
    """The cameras, prims and matrices, whose values OpenUSD reads; the others are left out with a warning."""
    valid = []
    for prim, matrix in cameras:
        try:
            UsdGeom.Camera(prim).GetCamera(opened.time)
        except Tf.ErrorException as failure:
            builder.diagnostics.warning(f"this camera is left out: {reason(failure, opened.path)}", opened.span(prim))
        else:
            valid.append((prim, matrix))
    return valid


def _planes(lens: Any, unit: float, span: Span | None, builder: SceneBuilder) -> tuple[tuple[float, ...], ...]:
    """The clippingPlanes of a camera, in its frame. A plane that is not finite or has no normal is left out."""
    planes = np.array([tuple(plane) for plane in lens.clippingPlanes], np.float64).reshape(-1, 4) * (1.0, 1.0, 1.0, unit)
    good = planes[np.isfinite(planes).all(axis=1) & planes[:, :3].any(axis=1)]
    if len(good) < len(planes):
        builder.diagnostics.warning("a clipping plane of this camera has no direction: it is left out", span)
    if len(good) > ir.CLIP_PLANES:
        builder.diagnostics.warning(f"only the first {ir.CLIP_PLANES} of this camera's {len(good)} clipping planes are drawn", span)
    drawn = [tuple(plane) for plane in good[: ir.CLIP_PLANES].tolist()]
    return (*drawn, *NO_PLANES[len(drawn) :])


def _conformed(width: float, height: float, settings: StageSettings) -> tuple[ir.Fit, float, float, float]:
    """The side of a film that is kept, the film's sides in the aspect of the picture, and the width of a pixel over its height.

    The picture is as wide as its pixels together; UsdRender's aspectRatioConformPolicy.
    """
    film = width / height
    pixels, pixel = settings.size[0] / settings.size[1] if settings.size else film / settings.pixel_aspect, settings.pixel_aspect
    if settings.conform == "pixels":
        return ir.Fit.VERTICAL, width, height, film / pixels
    picture = pixels * pixel
    wider = picture > film
    if settings.conform == "horizontal" or (settings.conform == "expand" and not wider) or (settings.conform == "crop" and wider):
        return ir.Fit.HORIZONTAL, width, width / picture, pixel
    return ir.Fit.VERTICAL, height * picture, height, pixel


def tell_conform(prim: Any, opened: Opened, builder: SceneBuilder, settings: StageSettings) -> None:
    """A note where a picture's aspect differs from that of its camera's film and no setting selects the part that is kept."""
    lens = UsdGeom.Camera(prim).GetCamera(opened.time)
    if settings.size and settings.conform is None and lens.verticalAperture > 0:
        picture, film = settings.size[0] / settings.size[1], lens.horizontalAperture / lens.verticalAperture
        if abs(settings.size[0] - film * settings.size[1]) > 1:
            effect = "its sides show more" if picture > film else "its sides are cut off"
            message = f"the picture's aspect {picture:.4g} is not the film's {film:.4g}: the film's height is kept, {effect}"
            builder.diagnostics.note(message, opened.span(prim), "--conform vertical, horizontal, expand, crop or pixels selects the part")


def _aperture(lens: Any, unit: float, perspective: bool) -> tuple[float, float]:
    """Lens radius and focus distance; (0, 1) for a pinhole, that is, without an f-stop or a focus distance."""
    if not (perspective and lens.fStop > 0 and lens.focusDistance > 0):
        return 0.0, 1.0
    return lens.focalLength * _LENS_UNIT * unit / (2 * lens.fStop), lens.focusDistance * unit


def _shutter(prim: Any, opened: Opened) -> tuple[float, float]:
    """Seconds from the current time to the shutter opening, and the exposure time."""
    begin, end = (stage.number(prim.GetAttribute(f"shutter:{name}"), opened.time) for name in ("open", "close"))
    codes = opened.stage.GetTimeCodesPerSecond()
    return (begin / codes, (end - begin) / codes) if codes > 0 and -math.inf < begin < end < math.inf else (0.0, 0.0)


def frame(builder: SceneBuilder) -> np.ndarray | None:
    """Adds a camera that looks along −z at the bounds of the drawn geometry (usdAppUtils/frameRecorder.cpp).

    Returns its (4, 4) placement; None without bounds. The camera stands in front of the bounds.
    Their half diagonal across the view fills half the film's width.
    """
    bounds = builder.world_bounds()
    if bounds is None:
        return None
    size = bounds[1] - bounds[0]
    target = bounds.mean(axis=0)
    tangent = FILM[0] / 2 / FOCAL
    distance = math.hypot(size[0], size[1]) / 2 / tangent + size[2] / 2
    if not distance > 0:
        distance = 1.0
    place = np.eye(4)
    place[:3, 3] = target + np.array([0.0, 0.0, distance])
    builder.camera(CameraData(builder.transform(place), FILM[1] / 2 / FOCAL, aspect=FILM[0] / FILM[1], name="frame"))
    return place
