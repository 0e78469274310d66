"""gltf_pbr in USD, mapped to the inputs of UsdPreviewSurface and a sheen; and the nodes of MaterialX that pass a picture on.

Names and defaults: MaterialX 1.39, gltf_pbr 2.0.1. What `principled` does not have is read as slabs (slabs.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .... import ir
from ....io import color_encoding
from ....io.color_config import Config
from . import slabs
from .network import Graph, Picture, Primvar


@dataclass(frozen=True, slots=True)
class Model:
    """How a surface shader is read: for each input of UsdPreviewSurface the shader's name and default, and a weight that multiplies it."""

    inputs: dict[str, tuple[str, Any]]
    weights: dict[str, tuple[str, float]] = field(default_factory=dict)


MODELS = {
    "ND_gltf_pbr_surfaceshader": Model(
        {
            "diffuseColor": ("base_color", (1.0, 1.0, 1.0)), "metallic": ("metallic", 1.0), "roughness": ("roughness", 1.0),
            "ior": ("ior", 1.5), "clearcoat": ("clearcoat", 0.0), "clearcoatRoughness": ("clearcoat_roughness", 0.0),
            "emissiveColor": ("emissive", (0.0, 0.0, 0.0)), "opacity": ("alpha", 1.0), "normal": ("normal", None),
            "occlusion": ("occlusion", 1.0), "sheenColor": ("sheen_color", (0.0, 0.0, 0.0)), "sheenRoughness": ("sheen_roughness", 0.0),
        },
        {"emissiveColor": ("emissive_strength", 1.0)},
    ),
}  # fmt: skip
PREVIEW = ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader")
_ALIASES = {"wrapS": "uaddressmode", "wrapT": "vaddressmode"}  # of ND_image
WRAPS = {"periodic": ir.Wrap.REPEAT, "clamp": ir.Wrap.CLAMP, "mirror": ir.Wrap.MIRROR, "constant": ir.Wrap.BLACK}
_PARTS = {"outr": "r", "outg": "g", "outb": "b", "outa": "a", "outx": "r", "outy": "g", "outz": "b", "outw": "a"}
_NUMBERS = tuple(f"ND_{kind}_{type_}" for kind in ("image", "tiledimage") for type_ in ("float", "vector"))
_PASSING = ("ND_convert_", "ND_dot_", "ND_normalmap", "ND_separate", "ND_extract_")
SOURCES = Picture | Primvar | Graph
Source = Callable[[Any, Any], Any]
"""(an input or None, fallback) → a value, picture or primvar."""


def is_picture(kind: str) -> bool:
    return kind.startswith(("UsdUVTexture", "ND_UsdUVTexture", "ND_image_", "ND_tiledimage_"))


def alias(node: Any, name: str) -> Any:
    """The input of a texture node that UsdUVTexture calls `name`."""
    return node.GetInput(name) or node.GetInput(_ALIASES.get(name, name))


def surface(shader: Any, kind: str, source: Source, tell: Callable[[str], None]) -> dict[str, Any]:
    """The inputs of UsdPreviewSurface that a surface of MODELS gives. A warning names every other authored input."""
    model, inputs = MODELS[kind], {}
    for name, (source_name, default) in model.inputs.items():
        value = source(shader.GetInput(source_name), default)
        if name in model.weights:
            weight_name, fallback = model.weights[name]
            weight = source(shader.GetInput(weight_name), fallback)
            if not isinstance(weight, int | float):
                tell(f"the input `{weight_name}` of {kind} is drawn only as a number")
                weight = fallback or 1.0
            value = value.times(float(weight)) if hasattr(value, "times") else _scaled(value, float(weight))
        inputs[name] = value
    if not hasattr(inputs["opacity"], "times") and np.ndim(inputs["opacity"]) == 1:
        inputs["opacity"] = float(np.mean(inputs["opacity"]))
    inputs["opacityMode"] = "presence"  # the opacity of these models covers highlights, too
    read = {source_name for source_name, _ in model.inputs.values()} | {source_name for source_name, _ in model.weights.values()}
    for shader_input in shader.GetInputs():
        if str(shader_input.GetBaseName()) not in read | slabs.GLTF_NAMES:
            tell(f"the input `{shader_input.GetBaseName()}` of {kind} is not drawn")
    return inputs


def _scaled(value: Any, weight: float) -> Any:
    try:
        return tuple(float(v) * weight for v in value)
    except TypeError:
        return value


def through(node: Any, kind: str, output: str, source: Source, fallback: Any) -> Any:
    """A picture or primvar that a node passes on: whole, a channel, or as a normal map. NotImplemented for other nodes and values."""
    if kind.startswith("ND_constant_"):
        return source(node.GetInput("value"), fallback)
    if not kind.startswith(_PASSING):
        return NotImplemented
    passed = source(node.GetInput("in"), fallback)
    if kind.startswith("ND_normalmap"):
        scale: Any = source(node.GetInput("scale"), 1.0)
        fixed = isinstance(passed, Picture) and not isinstance(scale, SOURCES)
        return passed.as_normals(float(np.mean(np.array(scale, np.float64)))) if fixed else NotImplemented
    if kind.startswith(("ND_separate", "ND_extract_")):
        part = "rgba"[int(source(node.GetInput("index"), 0)) % 4] if kind.startswith("ND_extract_") else _PARTS.get(output, "r")
        return passed.part(part) if isinstance(passed, Picture) else NotImplemented
    return passed if isinstance(passed, Picture | Primvar) else NotImplemented


def place2d(node: Any, source: Source) -> np.ndarray:
    """The (3, 3) frame of ND_place2d_vector2: less the pivot, over the scale, turned clockwise, less the offset, plus the pivot."""
    (px, py), (sx, sy), (ox, oy) = (source(node.GetInput(n), v) for n, v in (("pivot", (0, 0)), ("scale", (1, 1)), ("offset", (0, 0))))
    turn = np.radians(float(source(node.GetInput("rotate"), 0.0)))
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c / (sx or 1), s / (sy or 1), 0.0], [-s / (sx or 1), c / (sy or 1), 0.0], [0.0, 0.0, 1.0]])
    moved, back = np.eye(3), np.eye(3)
    moved[:2, 2], back[:2, 2] = (-px, -py), (px - ox, py - oy)
    return back @ turned @ moved


def tiling(node: Any, source: Source) -> np.ndarray:
    """The (3, 3) frame of ND_tiledimage: times uvtiling, less uvoffset."""
    (tx, ty), (ox, oy) = source(node.GetInput("uvtiling"), (1, 1)), source(node.GetInput("uvoffset"), (0, 0))
    return np.array([[tx, 0.0, -ox], [0.0, ty, -oy], [0.0, 0.0, 1.0]])


def color_space(node: Any, written: str, config: Config | None, tell: Callable[[str, Any], None]) -> str:
    """The colour space of a node's picture, `written` or that in the metadata of its file; see known_space."""
    if str(node.GetIdAttr().Get()).startswith(_NUMBERS):
        return "raw"  # MaterialX converts colours alone
    file_input = node.GetInput("file")
    names = [str(attribute.GetColorSpace()) for attribute in file_input.GetValueProducingAttributes()] if file_input else []
    return known_space(next((n for n in (written, *names) if n), "auto"), config, tell, node.GetPrim())


def attribute_space(attribute: Any, config: Config | None, tell: Callable[[str, Any], None]) -> str:
    """The colour space in the metadata of a file's attribute, likewise."""
    return known_space(str(attribute.GetColorSpace()) or "auto", config, tell, attribute.GetPrim())


def known_space(name: str, config: Config | None, tell: Callable[[str, Any], None], prim: Any) -> str:
    """A colour space as color_encoding.find takes it: one that is not known is "auto", after a warning."""
    if color_encoding.is_known(name, config):
        return name
    tell(f"the colour space `{name}` is not known: its picture is read as `auto` says", prim)
    return "auto"
