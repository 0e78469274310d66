"""Reads RenderSettings and RenderProduct prims: resolution, camera, purposes, conform policy, crop and switches of the camera."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf, UsdRender

from ....lang.diagnostics import Span
from ... import ir
from ...scene.builder import SceneBuilder
from ..stage_options import CONFORM, StageOptions
from . import stage
from .stage import Opened


@dataclass(frozen=True, slots=True)
class StageSettings:
    """Settings of a stage for its pictures. Options of the command line precede it."""

    size: tuple[int, int] | None = None
    camera: str | None = None
    purposes: tuple[str, ...] | None = None
    conform: str | None = None  # key of CONFORM; None: not given, vertical
    crop: tuple[int, int, int, int] | None = None
    depth_of_field: bool = True
    motion_blur: bool = True
    pixel_aspect: float = 1.0  # width of a pixel over its height
    bounces: int | None = None  # None: not given

    def as_ir(self) -> ir.Settings:
        return ir.Settings(size=self.size, camera=self.camera, crop=self.crop, bounces=self.bounces)


def read(opened: Opened, options: StageOptions, builder: SceneBuilder) -> StageSettings:
    """The settings of the prim named by the options, else by the stage's renderSettingsPrimPath; defaults without one."""
    span = Span(opened.name)
    path = options.render_settings or str(opened.stage.GetMetadata("renderSettingsPrimPath") or "")
    if not path:
        return _over(StageSettings(), options)
    prim = opened.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim or not prim.IsA(UsdRender.SettingsBase):
        message = f"`{path}` is not a RenderSettings or RenderProduct prim"
        if options.render_settings:
            paths = [str(p.GetPath()) for p in opened.stage.TraverseAll() if p.IsA(UsdRender.SettingsBase)]
            builder.diagnostics.error(message, span, f"the stage has {', '.join(paths[:12])}" if paths else "the stage has none")
        else:
            builder.diagnostics.warning(f"{message}: the renderSettingsPrimPath of the stage has no effect", span)
        return _over(StageSettings(), options)
    return _over(_from_prim(prim, opened, builder), options)


def _over(settings: StageSettings, options: StageOptions) -> StageSettings:
    """The settings with the options of the command line over them."""
    size = options.size or settings.size
    crop = settings.crop if size == settings.size else None
    purposes = options.purposes or settings.purposes
    return replace(settings, size=size, crop=crop, purposes=purposes, conform=options.conform or settings.conform)


def _from_prim(prim: Any, opened: Opened, builder: SceneBuilder) -> StageSettings:
    settings, products = prim, []
    if prim.IsA(UsdRender.Settings):
        products = [opened.stage.GetPrimAtPath(target) for target in UsdRender.Settings(prim).GetProductsRel().GetTargets()]
        products = [p for p in products if p]
    first = products[0] if products else prim
    if len(products) > 1:
        builder.diagnostics.warning(f"only the first of {len(products)} render products is drawn: {first.GetPath()}", opened.span(prim))
    sources = [p for p in (first, settings) if p]  # a product's authored values precede its settings'

    def value(name: str) -> Any:
        for source in sources:
            attribute = source.GetAttribute(name)
            if attribute and attribute.HasAuthoredValue():
                return stage.value(attribute, opened.time)
        return None

    variables = UsdRender.Product(first).GetOrderedVarsRel().GetTargets() if first.IsA(UsdRender.Product) else []
    if variables:
        names = ", ".join(target.name for target in variables)
        builder.diagnostics.note(f"render variables are channels of an .exr, asked for by --aov: {names}", opened.span(first))
    cameras = next((targets for s in sources if (targets := UsdRender.SettingsBase(s).GetCameraRel().GetTargets())), [])
    resolution = value("resolution")
    size = (int(resolution[0]), int(resolution[1])) if resolution is not None and min(resolution) > 0 else None
    policy = str(value("aspectRatioConformPolicy") or "expandAperture")
    conform = next((name for name, token in CONFORM.items() if token == policy), None)
    if conform is None:
        builder.diagnostics.warning(f"the aspectRatioConformPolicy `{policy}` is drawn as expandAperture", opened.span(prim))
    pixel = float(value("pixelAspectRatio") or 1.0)
    if not 0 < pixel < math.inf:
        builder.diagnostics.warning(f"the pixelAspectRatio {pixel:g} counts as 1", opened.span(prim))
        pixel = 1.0
    purposes = settings.GetAttribute("includedPurposes")
    wanted = tuple(map(str, purposes.Get() or ())) if purposes and purposes.HasAuthoredValue() else None
    return StageSettings(
        size, str(cameras[0]) if cameras else None, wanted, conform or "expand", _crop(value("dataWindowNDC"), size),
        depth_of_field=not value("disableDepthOfField"), motion_blur=not (value("disableMotionBlur") or value("instantaneousShutter")),
        pixel_aspect=pixel,
    )  # fmt: skip


def _crop(window: Any, size: tuple[int, int] | None) -> tuple[int, int, int, int] | None:
    """The pixels whose centers lie in dataWindowNDC (left, bottom, right, top in 0…1); None for the whole picture."""
    if window is None or size is None:
        return None
    left, bottom, right, top = np.clip(np.array(window, np.float64), 0.0, 1.0)
    width, height = size
    x0, x1, y0, y1 = (int(np.ceil(v - 0.5)) for v in (left * width, right * width, (1 - top) * height, (1 - bottom) * height))
    full = (0, 0, width, height)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 and (x0, y0, x1, y1) != full else None
