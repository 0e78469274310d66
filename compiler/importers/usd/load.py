"""Entry points of the USD importer: converts a stage to a scene, or places it in one."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import UsdUtils

from ....lang.diagnostics import Diagnostics, Span, suggest
from ... import ir
from ...scene import defaults, fit_height
from ...scene.builder import SceneBuilder
from ...scene.row_records import LightData
from ..common.replacements import Replacements
from ..stage_options import StageOptions
from . import camera, render_settings
from .layers import text_layers
from .layers.reports import Reports
from .stage import Opened, open_
from .traverse import Walk


def scene(
    path: Path, builder: SceneBuilder, *, time: float | None = None, code: float | None = None, options: StageOptions | None = None,
    later: float = 0.0,
) -> ir.Scene:  # fmt: skip
    """The scene of a stage. `time` is seconds from the stage's start, `code` a time code.

    Without either, the earliest time is read. `later` seconds are added.
    All cameras are imported by path. The first is that of the RenderSettings, main_cam, or one that frames everything as usdrecord does.
    A stage without lights gets a light at that camera. Lengths are in the stage's units. Problems go to the builder's diagnostics.
    """
    options = options or StageOptions()
    opened = open_(path, str(path), builder.files, builder.diagnostics, None, seconds=time, time=code, options=options)
    settings = render_settings.StageSettings() if opened is None else render_settings.read(opened, options, builder)
    if opened is None or builder.diagnostics.failed:
        return builder.finish(str(path))
    opened.wait(later)
    reports = Reports(path)
    walk = Walk(opened, builder, purposes=settings.purposes, complexity=options.complexity, cull=options.cull_backfaces)
    with np.errstate(all="ignore"):  # consumers of non-finite values detect them
        walk.run(opened.stage.GetPseudoRoot(), opened.frame, opened.frame)
        walk.place()
        _refuse_ruins(opened, builder, 0, Span(opened.name))
        settings = _with_camera(settings, walk)
        if options.as_asset:
            settings = replace(settings, depth_of_field=False, motion_blur=False)
        said = _cameras(walk, settings, options)
    if walk.mesh_lights:
        settings = replace(settings, bounces=1)
        said.append("bounces: 1; without bounces, mesh lights light no other prims")
    said += defaults.add(builder, settings.as_ir(), lights=options.default_light)
    reports.tell(builder.diagnostics, Span(opened.name))
    stage = opened.stage
    codes = stage.GetTimeCodesPerSecond()
    duration = (stage.GetEndTimeCode() - stage.GetStartTimeCode()) / codes if stage.HasAuthoredTimeCodeRange() and codes > 0 else None
    return builder.finish(
        str(path), settings=settings.as_ir(), duration=duration or None, fps=stage.GetFramesPerSecond(), defaults=tuple(said),
        files=tuple(dict.fromkeys((*opened.files, *builder.files.read))),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A stage that a scene places."""

    path: Path
    matrix: np.ndarray  # (4, 4) its transform in the scene
    prim: str | None = None  # only this prim and its descendants
    material: int = -1  # a row, for prims without a material and displayColor
    name: str = ""  # a prefix of the prims' paths
    replaced: Replacements = field(default_factory=Replacements)  # materials in place of its own
    height: float | None = None  # in metres, as turned by `rotation`
    rotation: np.ndarray | None = None  # (4, 4) the rotation in `matrix`
    unit: float | None = None  # metres of a unit of the stage, in place of what it says
    up: str | None = None  # "y" or "z", in place of the axis that the stage says


def place(builder: SceneBuilder, placed: Placed, span: Span) -> None:
    """Places a stage in a scene: shapes and lights, in metres. Cameras are left out."""
    path, matrix, prim = placed.path, placed.matrix, placed.prim
    opened = open_(path, str(path), builder.files, builder.diagnostics, span)
    if opened is None:
        return
    opened.override(placed.unit, placed.up)
    root = opened.stage.GetPrimAtPath(prim) if prim and prim.startswith("/") else None
    if prim and not root:
        paths = [str(p.GetPath()) for p in opened.stage.Traverse()]
        builder.diagnostics.error(f"the stage has no prim `{prim}`", span, suggest(prim, paths) or _first(opened))
        return
    reports = Reports(path)
    root = root or opened.stage.GetPseudoRoot()
    if placed.height is not None:
        fit = _fit(opened, root, placed, builder)
        if fit is None:
            builder.diagnostics.error("the stage is flat: it has no height that could be scaled", span, "use scale instead of height")
            return
        matrix = matrix @ fit
    unit = opened.meters_per_unit * float(abs(np.linalg.det(matrix[:3, :3]))) ** (1 / 3)
    base = matrix @ _in_metres(opened)
    walk = Walk(opened, builder, unit=unit, material=placed.material, prefix=placed.name)
    walk.materials.replaced = placed.replaced
    with np.errstate(all="ignore"):
        before = builder.count("instances")
        walk.run(root, base, base)
        walk.place()
        _refuse_ruins(opened, builder, before, span)
    for message, hint in placed.replaced.unused():
        builder.diagnostics.error(message, span, hint)
    reports.tell(builder.diagnostics, span)


def _in_metres(opened: Opened) -> np.ndarray:
    """(4, 4) from the stage's units and up axis to metres, y up."""
    return np.asarray(np.diag([opened.meters_per_unit] * 3 + [1.0]) @ opened.frame)


def _fit(opened: Opened, root: Any, placed: Placed, builder: SceneBuilder) -> np.ndarray | None:
    """The transform that gives what is drawn of a prim the height of `placed`; see fit_height. None if it has none.

    The stage is read for it into a separate builder, whose diagnostics are added: the second reading may not repeat them.
    """
    measured = SceneBuilder(Diagnostics(), builder.files)
    walk = Walk(opened, measured, unit=opened.meters_per_unit)
    walk.materials.replaced = Replacements(placed.replaced.named, placed.replaced.every)
    base = _in_metres(opened)
    with np.errstate(all="ignore"):
        walk.run(root, base, base)
        shapes = [fit_height.Placed(piece.geometry, piece.matrix.reshape(-1, 4, 4)) for piece in walk.drawn() if piece.geometry >= 0]
    said = builder.diagnostics.items
    said += [item for item in measured.diagnostics.items if item not in said]
    return fit_height.fitted(measured, shapes, placed.height or 0.0, placed.rotation)


def _refuse_ruins(opened: Opened, builder: SceneBuilder, before: int, span: Span) -> None:
    """An error for a stage whose statements were left out as damaged, if nothing drawn is left. `before` instances were there."""
    if builder.count("instances") > before or not text_layers.lost(builder.diagnostics):
        return
    message = f"cannot read the stage `{opened.path.name}`: nothing is left to draw without the statements that cannot be read"
    builder.diagnostics.error(message, span, "correct those that the warnings name, or export it again")


def _first(opened: Opened) -> str:
    names = [str(p.GetPath()) for p in opened.stage.GetPseudoRoot().GetChildren()]
    return f"it has {', '.join(names[:12])}" if names else "it has none at all"


def _with_camera(settings: render_settings.StageSettings, walk: Walk) -> render_settings.StageSettings:
    """The settings without a camera that the stage lacks, with a warning."""
    if settings.camera is None or any(str(prim.GetPath()) == settings.camera for prim, _ in walk.cameras):
        return settings
    walk.builder.diagnostics.warning(f"the render settings name the camera `{settings.camera}`, which is not there", Span(walk.opened.name))
    return replace(settings, camera=None)


def _cameras(walk: Walk, settings: render_settings.StageSettings, options: StageOptions) -> list[str]:
    """Adds the cameras, default first, and a light at that camera if the stage has none. Returns notes about the additions."""
    main = UsdUtils.GetPrimaryCameraName()
    valid = camera.readable(walk.cameras, walk.opened, walk.builder)
    cameras = sorted(valid, key=lambda item: (str(item[0].GetPath()) != settings.camera, item[0].GetName() != main))
    said, eye = [], None
    if options.as_asset and not (cameras and cameras[0][0].GetName() == main):
        return said
    if cameras and (settings.camera or cameras[0][0].GetName() == main):
        eye = cameras[0][1]
    else:
        eye = camera.frame(walk.builder)
        if eye is not None:
            x, y, z = (f"{c:.4g}" for c in eye[:3, 3])
            said.append(f"camera: none is called {main}; one at [{x}, {y}, {z}] frames everything, as usdrecord does")
    if said == [] and cameras:
        camera.tell_conform(cameras[0][0], walk.opened, walk.builder, settings)
    for prim, matrix in cameras:
        camera.camera(prim, matrix, walk.unit, walk.opened, walk.builder, settings)
    unlit = not (walk.builder.count("lights") or walk.mesh_lights)
    if options.default_light and not options.as_asset and eye is not None and unlit:
        _head_light(eye, walk.builder)
        said.append("light: the stage has none; it is lit from its first camera, as usdrecord does")
    return said


def _head_light(eye: np.ndarray, builder: SceneBuilder) -> None:
    """Adds a light at the camera without distance falloff; a white diffuse surface facing it has value 1."""
    x, y, z = (float(c) for c in eye[:3, 3])
    white = (math.pi, math.pi, math.pi)
    kind, even = ir.FalloffKind.POLYNOMIAL, (1.0, 0.0, 0.0)
    light = LightData(
        ir.LightKind.POINT, white, position=(x, y, z), falloff=kind, coefficients=even, shadows=False, name="head light"
    )  # fmt: skip
    builder.light(light)
