"""Cameras and the settings of the picture."""

from __future__ import annotations

import math

import numpy as np

from ... import ir
from ...scene import transforms
from .. import camera_frames
from ..export import Export
from ..placement import F64, reach, square
from . import words

FILM_HEIGHT = 0.024  # metres, of cameras with an angle of view
_CLOSE = 1e-9
_FOCAL = 0.05  # metres, of cameras whose film has an aspect


def camera(out: Export, row: int, size: tuple[int, int], moves: bool) -> str:
    """The element of a camera (a row) for a picture of `size`. `moves`: whether anything of the scene does, which is lost."""
    scene, cameras = out.scene, out.scene.tables.cameras
    camera_frames.report_planes(out, row)
    names, settings = scene.names.cameras, scene.settings
    texts: dict[str, str] = {"name": words.string(names[row])} if row < len(names) and names[row] not in ("", "default") else {}
    frame = _frame(out, row)
    position, look_at, up = _looking(scene, row, frame)
    texts |= {"look_at": words.numbers(look_at)} | ({"up": words.numbers(up)} if up is not None else {})
    texts |= _lens(out, row, size)
    if cameras.near[row] != 0.0:
        texts["near"] = words.number(float(cameras.near[row]))
    if math.isfinite(float(cameras.far[row])):
        texts["far"] = words.number(float(cameras.far[row]))
    if cameras.shift[row].any():
        texts["shift"] = words.one_or_all(cameras.shift[row])
    if not math.isnan(float(cameras.exposure[row])):
        texts["exposure"] = words.number(float(cameras.exposure[row]))
    if settings.view is not None:
        texts["view"] = words.string(settings.view)
    if settings.white is not None:
        texts["white"] = words.string(settings.white) if isinstance(settings.white, str) else words.number(settings.white)
    if cameras.shutter[row] > 0.0:
        if moves:
            out.cannot("the shutter is not carried: nothing moves", "cameras", row)
        else:
            texts["shutter"] = f"{words.number(float(cameras.shutter[row]))}s"
    return words.call("camera", words.numbers(position), **texts)


def _frame(out: Export, row: int) -> F64:
    """(4, 4) of a camera, without scale. Reports a frame that is sheared."""
    matrix = square(out.scene.tables.transforms.matrix[out.scene.tables.cameras.transform[row]])
    frame = transforms.unscaled(matrix)
    linear = matrix[:3, :3] / np.linalg.norm(matrix[:3, 2])
    if np.abs(linear - frame[:3, :3]).max() > 1e-6:
        out.cannot("the camera's frame is stretched or sheared: not carried", "cameras", row)
    return frame


def _looking(scene: ir.Scene, row: int, frame: F64) -> tuple[F64, F64, F64 | None]:
    """Position, target and what is up, None for +y; the target is at the distance in focus, or at that of the scene's middle."""
    cameras, position = scene.tables.cameras, frame[:3, 3]
    middle, _ = reach(scene.tables)
    forward = -frame[:3, 2]
    distance = float(cameras.focus[row]) if cameras.lens[row] > 0.0 else float((middle - position) @ forward)
    if not distance > 1e-3 * (1.0 + float(np.linalg.norm(position))):
        distance = 1.0
    target = _round_target(position, forward, distance)
    level = transforms.looking(tuple(position), tuple(target), (0.0, 1.0, 0.0))
    if level is not None and np.abs(level[:3, :3] - frame[:3, :3]).max() < 1e-8:
        return position, target, None
    return position, target, frame[:3, 1]


def _round_target(position: F64, forward: F64, distance: float) -> F64:
    """A point ahead with few digits, at a distance or where one coordinate is 0."""
    with np.errstate(all="ignore"):
        crossings = [d for d in (-position / forward).tolist() if math.isfinite(d) and d > 1e-3]
    distances = (distance, *crossings)
    for digits in range(6):
        for each in distances:
            short = np.round(position + each * forward, digits) + 0.0
            again = transforms.looking(tuple(position), tuple(short), (0.0, 1.0, 0.0))
            if again is not None and np.abs(again[:3, 2] + forward).max() < _CLOSE:
                return short
    return position + distance * forward


def _lens(out: Export, row: int, size: tuple[int, int]) -> dict[str, str]:
    """Angle of view or width, and the aperture."""
    cameras, projection = out.scene.tables.cameras, int(out.scene.tables.cameras.projection[row])
    if cameras.pixel_aspect[row] != 1.0:
        out.cannot("pixels that are not square are not carried", "cameras", row)
    if projection == ir.Projection.PANORAMIC:
        return {"projection": words.string("panoramic")}
    extent, aspect = float(cameras.extent[row]), size[0] / size[1] * float(cameras.pixel_aspect[row])
    horizontal = cameras.fit[row] == ir.Fit.HORIZONTAL
    if projection == ir.Projection.ORTHOGRAPHIC:
        return {"width": words.number(2.0 * (extent if horizontal else extent * aspect))}
    extent = extent / aspect if horizontal else extent
    if cameras.aspect[row] > 0.0 and not horizontal:
        film = 2.0 * extent * _FOCAL
        texts = {"focal": "50mm", "film": f"[{_mm(film * float(cameras.aspect[row]))}, {_mm(film)}]"}
        focal = _FOCAL
    else:
        texts, focal = {"fov": words.degrees(2.0 * math.atan(extent), share=1e-9)}, FILM_HEIGHT / 2.0 / extent
    if cameras.lens[row] > 0.0:
        texts["aperture"] = words.number(float(f"{focal / (2.0 * float(cameras.lens[row])):.9g}"))
        texts["focus"] = words.number(float(cameras.focus[row]))
    return texts


def _mm(metres: float) -> str:
    return f"{words.number(float(f'{1000.0 * metres:.10g}'))}mm"


def render(out: Export, settings: ir.Settings, size: tuple[int, int]) -> str:
    """The settings of the picture."""
    if settings.background == "transparent":
        out.cannot("a transparent background is not carried", hint="--background transparent, with maquette render")
    texts: dict[str, str | None] = {"size": f"[{size[0]}, {size[1]}]"}
    for name in ("samples", "bounces", "seed", "error"):
        value = getattr(settings, name)
        texts[name] = None if value is None else words.number(value)
    texts["budget"] = None if settings.budget is None else f"{words.number(settings.budget)}s"
    for name in ("backend", "filter", "working_space"):
        value = getattr(settings, name)
        texts[name] = None if value is None else words.string(value)
    if settings.crop is not None:
        texts["crop"] = words.numbers(settings.crop)
    if settings.aov:
        texts["aov"] = f"[{', '.join(map(words.string, settings.aov))}]"
    if isinstance(settings.background, tuple):
        texts["background"] = words.color(settings.background)
    return words.call("render", **texts)
