"""Imports USD cameras; adds a camera that frames a stage without a main camera, as usdrecord does."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Gf, UsdGeom

from ... import ir
from ...scene import transforms
from ...scene.builder import SceneBuilder
from ...scene.row_records import CameraData
from . import stage
from .stage import Opened

FILM = (20.955, 15.2908)  # mm: usdrecord's default camera
FOCAL = 50.0  # mm
_LENS_UNIT = 0.1  # scene units in one unit of apertures and focal lengths


def camera(prim: Any, matrix: np.ndarray, unit: float, opened: Opened, builder: SceneBuilder) -> int:
    """The row of a Camera prim under the (4, 4) matrix. Its scale is ignored except for `unit`, the stage's own."""
    lens = UsdGeom.Camera(prim).GetCamera(opened.time)
    width, height = lens.horizontalAperture, lens.verticalAperture
    span = opened.span(prim)
    perspective = lens.projection == Gf.Camera.Perspective
    if not (width > 0 and height > 0) or (perspective and not lens.focalLength > 0):
        builder.diagnostics.warning("this camera has no aperture or focal length: it is left out", span)
        return -1
    if len(lens.clippingPlanes):
        builder.diagnostics.warning("clipping planes are not drawn", span)
    near, far = lens.clippingRange.min * unit, lens.clippingRange.max * unit
    if not near < far:
        builder.diagnostics.warning("this camera's clipping range is empty: it clips nothing", span)
        near, far = 0.0, math.inf
    opening, shutter = _shutter(prim, opened)
    radius, focus = _aperture(lens, unit, perspective)
    exposure = stage.number(prim.GetAttribute("exposure"), opened.time)
    return builder.camera(
        CameraData(
            builder.transform(transforms.unscaled(matrix), span),
            height / (2 * lens.focalLength) if perspective else height * _LENS_UNIT / 2 * unit,
            ir.Projection.PERSPECTIVE if perspective else ir.Projection.ORTHOGRAPHIC,
            aspect=width / height, near=max(near, 0.0) if perspective else near, far=far,
            shift=(lens.horizontalApertureOffset / width, lens.verticalApertureOffset / height),
            exposure=exposure or math.nan, opening=opening, shutter=shutter, lens=radius, focus=focus, name=str(prim.GetPath()),
        ),
        span,
    )  # fmt: skip


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
