"""Shaping of USD lights: cone, focus and IES profile as an image of the factor by direction.

The formulas are those of OpenUSD's hdEmbree (pxr/imaging/plugin/hdEmbree/lightSamplers.cpp, version 25.05).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....lang.diagnostics import Span
from ...ir import F64
from ...scene.builder import NONE, SceneBuilder
from .. import ies
from ..images import ImageError
from . import stage
from .assets import asset, contents
from .materials import Materials

_ROWS = 2048  # of the image, from the axis to its opposite
_COLUMNS = 128  # of profiles that are not round
_SIDE_ROWS = 192  # of images in another frame than the light's
_WIDEST = 180.0  # degrees: a cone of this angle or more has no effect


def profile(prim: Any, time: Any, builder: SceneBuilder, materials: Materials, span: Span, side: F64 | None = None) -> int:
    """The row of the image of a light's factor by direction, its top along the light's −z; NONE for an even light.

    With `side`, the rotation (3, 3) of a frame in that of the light, the image is in that frame, coarser, its top along the frame's −z.
    """
    if not prim.HasAPI("ShapingAPI"):
        return NONE
    photometry = _photometry(prim, time, materials)
    columns = 1 if photometry is None or len(photometry.horizontal) == 1 else _COLUMNS
    rows, columns = (_ROWS, columns) if side is None else (_SIDE_ROWS, 2 * _SIDE_ROWS)
    down = ((np.arange(rows, dtype=np.float64) + 0.5) * (np.pi / rows))[:, None]
    # The image's columns go around −z so that the light's direction has the angle 2π (s − 1/4).
    round_ = (2 * np.pi * ((np.arange(columns, dtype=np.float64) + 0.5) / columns - 0.25))[None]
    way = np.stack(np.broadcast_arrays(np.sin(down) * np.cos(round_), np.sin(down) * np.sin(round_), -np.cos(down) + 0 * round_), axis=-1)
    if side is not None:
        way = way @ side.T
    angle, around = np.arccos(np.clip(-way[..., 2], -1.0, 1.0)), np.arctan2(way[..., 1], way[..., 0])
    factor = _cone(prim, time, angle)[..., None] * _focus(prim, time, angle)
    if photometry is not None:
        factor = factor * _candela(prim, time, photometry, angle, around)[..., None]
    if (factor == 1.0).all():
        return NONE
    if not np.isfinite(factor).all():
        builder.diagnostics.warning("the shaping of this light is not finite: it is left out", span)
        return NONE
    rgba = np.concatenate([factor, np.ones((*factor.shape[:2], 1))], axis=2).astype(np.float32)
    return builder.shared(("light profile", rgba.tobytes()), lambda: builder.image(rgba, "profile"))


def _number(prim: Any, name: str, time: Any, fallback: float) -> float:
    return stage.number(prim.GetAttribute(f"inputs:shaping:{name}"), time, fallback)


def _cone(prim: Any, time: Any, angle: F64) -> F64:
    """The factor of the cone: 1 − smoothstep of the angle, from (1 − softness) · cone to cone. Without an authored cone 1."""
    authored = any(prim.GetAttribute(f"inputs:shaping:cone:{name}").HasAuthoredValue() for name in ("angle", "softness"))
    cone, soft = _number(prim, "cone:angle", time, 90.0), min(max(_number(prim, "cone:softness", time, 0.0), 0.0), 1.0)
    if not authored or (cone >= _WIDEST and soft == 0.0):
        return np.ones(angle.shape)
    edge = np.radians(max(cone, 0.0))
    start = edge * (1.0 - soft)
    t = np.clip((angle - start) / max(edge - start, 1e-9), 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def _focus(prim: Any, time: Any, angle: F64) -> F64:
    """The factor of the focus, with a last axis of 3: |cos|^focus is the share of white, the rest has the tint."""
    focus = _number(prim, "focus", time, 0.0)
    if focus <= 0.0:
        return np.ones((*angle.shape, 3))
    share = np.abs(np.cos(angle))[..., None] ** focus
    attribute = prim.GetAttribute("inputs:shaping:focusTint")
    tint = stage.numbers(attribute, time, np.float64)
    tint = np.maximum(stage.linear(attribute, tint), 0.0) if len(tint) == 3 else np.zeros(3)
    return tint + (1.0 - tint) * share


def _photometry(prim: Any, time: Any, materials: Materials) -> ies.Photometry | None:
    value = stage.value(prim.GetAttribute("inputs:shaping:ies:file"), time)
    if not getattr(value, "path", ""):
        return None
    file = asset(value, materials.warnings, prim, "IES profile")
    if file is None:
        return None
    try:
        return ies.read(contents(file.path))
    except (ies.IesError, ImageError, OSError) as failure:
        materials.tell(f"the IES profile `{Path(file.path).name}` is left out: {failure}", prim)
        return None


def _candela(prim: Any, time: Any, photometry: ies.Photometry, angle: F64, around: F64) -> F64:
    """The factor of an IES profile: candela, over their mean with `normalize`.

    `angleScale` scales angles about the direction opposite to the axis by 1 / (1 + angleScale). Horizontal angles are those of the
    direction to the light around its z, from x to y, which is opposite to the light's.
    """
    scale = 1.0 + _number(prim, "ies:angleScale", time, 0.0)
    vertical = np.clip((angle - np.pi) / scale + np.pi, 0.0, np.pi) if scale > 0 else angle
    candela = photometry.intensity(vertical, around + np.pi)
    mean = photometry.mean() if stage.value(prim.GetAttribute("inputs:shaping:ies:normalize"), time) else 1.0
    return candela / mean if mean > 0 else candela
