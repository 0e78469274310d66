"""Adds a default camera and default lights to a scene without them, each with a sentence for `explain`."""

from __future__ import annotations

import math

import numpy as np

from ...lang.diagnostics import Span
from .. import ir
from . import transforms
from .builder import SceneBuilder
from .row_records import CameraData, LightData

DIRECTION = (0.55, 0.4, 1.0)  # from target to eye: three-quarter view, slightly from above
FOV = math.radians(40)
MARGIN = 1.08
SUN = math.pi * 0.75  # together with the sky, a white diffuse surface facing the sun has value 1
SUN_FROM = (1.0, 2.0, 1.5)
SUN_ANGLE = math.radians(0.53)
SKY = 0.25


def add(builder: SceneBuilder, settings: ir.Settings, span: Span | None = None, lights: bool = True) -> tuple[str, ...]:
    """Adds the missing camera and, with `lights`, the missing lights; returns the sentences that describe them.

    A scene without instances is a warning at `span`. Nothing is added after an error, since the scene will not be drawn.
    """
    sentences: list[str] = []
    if builder.diagnostics.failed:
        return ()
    if builder.count("instances") + builder.count("media") == 0:
        hint = "place a shape, for example sphere(1)"
        builder.diagnostics.warning("there is nothing to draw: the picture will be empty", span, hint)
    if builder.count("cameras") == 0:
        sentences.append(_camera(builder, settings))
    if lights and builder.count("lights") == 0 and not _is_lit(builder, settings):
        builder.light(LightData(ir.LightKind.SUN, (SUN, SUN, SUN), direction=_unit(SUN_FROM), angle=SUN_ANGLE / 2, name="sun"))
        builder.light(LightData(ir.LightKind.SKY, (SKY, SKY, SKY), name="sky"))
        x, y, z = SUN_FROM
        sentences.append(f"sun: the scene has no light; one from [{x:g}, {y:g}, {z:g}] with {SUN:.4g} lx")
        sentences.append(f"sky: the scene has no light; an even one of {SKY:g} nit")
    return tuple(sentences)


def _is_lit(builder: SceneBuilder, settings: ir.Settings) -> bool:
    """Whether what emits lights the rest: where bounces are asked for, and in scenes with media, whose paths are traced by default."""
    emits, participates = builder.emission()
    traced = settings.bounces > 0 if settings.bounces is not None else participates and settings.backend != "raster"
    return emits and traced


def framing(
    bounds: np.ndarray, fov: float, aspect: float, direction: tuple[float, float, float] = DIRECTION
) -> tuple[np.ndarray, np.ndarray]:
    """Eye and target of a camera with vertical `fov` and this aspect that frames a box (2, 3), with a margin.

    The distance is the least for which all eight corners lie inside the view frustum, plus the margin.
    """
    target = bounds.mean(axis=0)
    towards = np.array(_unit(direction))
    frame = transforms.looking(tuple(towards), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert frame is not None
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - target
    x, y, z = (corners @ frame[:3, :3]).T
    up = math.tan(fov / 2)
    distance = float(np.max(z + np.maximum(np.abs(y) / up, np.abs(x) / (up * aspect)))) * MARGIN
    if not distance > 0:
        distance = 1.0  # a single point
    return target + distance * towards, target


def _camera(builder: SceneBuilder, settings: ir.Settings) -> str:
    bounds = builder.world_bounds()
    what = "the bounded objects"
    if bounds is None:
        bounds, what = np.array([[-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]]), "the origin, as nothing is bounded"
    width, height = settings.size or (1, 1)  # square by default: a wider picture shows more
    eye, target = framing(bounds, FOV, width / height)
    frame = transforms.looking(tuple(eye), tuple(target), (0.0, 1.0, 0.0))
    assert frame is not None
    builder.camera(CameraData(builder.transform(frame), math.tan(FOV / 2), name="default"))
    x, y, z = (f"{c:.4g}" for c in eye)
    return f"camera: the scene has none; one at [{x}, {y}, {z}] with a fov of {math.degrees(FOV):.0f}deg frames {what}"


def _unit(v: tuple[float, float, float]) -> tuple[float, float, float]:
    length = math.hypot(*v)
    return (v[0] / length, v[1] / length, v[2] / length)
