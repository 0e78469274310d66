"""Light inside and behind surfaces of MaterialX: `subsurface` of surface shaders, and graphs of subsurface_bsdf and translucent_bsdf.

Their inputs join those of UsdPreviewSurface in a Network: `subsurface` is a weight, `subsurfaceColor` a colour, `subsurfaceRadius` three
lengths in units of the stage, `transmissionColor` what passes a sheet, `thinWalled` says that a surface is one. A part of a body is blended
with the rest of its surface by the weight, less the metallic part.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import UsdShade

from .....lang.diagnostics import Span
from .....materials import subsurface
from .... import ir
from ....scene import metallic_roughness, partial_coverage
from ....scene.builder import SceneBuilder
from ....scene.row_records import BLACK, WHITE, Color, Input, MaterialData, MediumData, as_color, scale_color

GRAPH = "ND_surface"
DIFFUSE = ("ND_oren_nayar_diffuse_bsdf", "ND_burley_diffuse_bsdf")
MOST_NODES = 64  # BSDFs of a graph
Tell = Callable[[str], None]


def radius(radius: Any, scale: Any) -> Color:
    """Three lengths by a number or a colour, times another; without pictures."""
    lengths = [np.broadcast_to(np.array(v, np.float64), 3) if np.shape(v) in ((), (3,)) else np.ones(3) for v in (radius, scale)]
    return as_color(lengths[0] * lengths[1])


def is_plain(shader: Any) -> bool:
    """Whether the BSDFs below ND_surface are those of this module: diffuse ones, sheets, bodies, and highlights of constant weights."""
    edf = shader.GetInput("edf")
    if edf and edf.HasConnectedSource():
        return False
    waiting, seen = [(shader, "bsdf")], 0
    while waiting and seen < MOST_NODES:
        node, name = waiting.pop()
        shader_input, seen = node.GetInput(name), seen + 1
        for attribute in shader_input.GetValueProducingAttributes() if shader_input else []:
            below = UsdShade.Shader(attribute.GetPrim())
            kind = str(below.GetIdAttr().Get()) if below else ""
            if kind in _JOINS:
                waiting += [(below, end) for end in _JOINS[kind]]
                weights = [below.GetInput("mix"), below.GetInput("in2") if kind.startswith("ND_multiply") else None]
            else:
                weights = [below.GetInput(end) for end in ("weight", "roughness", "tint", "normal", "thinfilm_thickness")]
                mode = below.GetInput("scatter_mode")
                if kind not in _LOBES or (mode and mode.Get() not in (None, "R")):
                    return False
                if any(_differs(below.GetInput(name), plain) for name, plain in _LOBES[kind].items()):
                    return False
            if any(weight and weight.HasConnectedSource() for weight in weights):
                return False
    return True


_JOINS = {"ND_layer_bsdf": ("top", "base"), "ND_add_bsdf": ("in1", "in2"), "ND_mix_bsdf": ("fg", "bg"), "ND_multiply_bsdfF": ("in1",),
          "ND_multiply_bsdfC": ("in1",)}  # fmt: skip
_LOBES: Mapping[str, Mapping[str, Any]] = {  # BSDFs, and the values of inputs that `Graph` does not read; closures.py reads others
    "ND_oren_nayar_diffuse_bsdf": {"roughness": 0.0}, "ND_burley_diffuse_bsdf": {}, "ND_translucent_bsdf": {},
    "ND_subsurface_bsdf": {}, "ND_dielectric_bsdf": {"tint": 1.0, "thinfilm_thickness": 0.0, "weight": 1.0},
}  # fmt: skip


def _differs(shader_input: Any, plain: float) -> bool:
    """Whether an input has another value."""
    value = shader_input.Get() if shader_input else None
    return value is not None and bool(np.any(np.array(value, np.float64) != plain))


class Graph:
    """The BSDFs of a graph below ND_surface, as inputs of a Network."""

    def __init__(self, source: Callable[[Any, Any], Any], tell: Tell) -> None:
        self._source, self._tell = source, tell
        self.inputs: dict[str, Any] = {}
        self._count = 0

    def read(self, shader: Any) -> dict[str, Any]:
        """The inputs of a surface."""
        black = (0.0, 0.0, 0.0)
        self.inputs = {"diffuseColor": black, "ior": 1.0, "roughness": 1.0, "opacityMode": "presence"}
        self.inputs["opacity"] = self._source(shader.GetInput("opacity"), 1.0)
        self._node(shader, "bsdf", 1.0)
        return self.inputs

    def _node(self, shader: Any, name: str, factor: float) -> None:
        shader_input = shader.GetInput(name)
        attributes = shader_input.GetValueProducingAttributes() if shader_input else []
        node = UsdShade.Shader(attributes[0].GetPrim()) if attributes else None
        kind = str(node.GetIdAttr().Get()) if node else ""
        self._count += 1
        if not node or factor == 0.0:
            return
        if self._count > MOST_NODES:
            self._tell(f"more than {MOST_NODES} BSDFs feed each other: the others are not drawn")
        elif kind == "ND_layer_bsdf":
            self._node(node, "top", factor)
            self._node(node, "base", factor)
        elif kind == "ND_add_bsdf":
            self._node(node, "in1", factor)
            self._node(node, "in2", factor)
        elif kind == "ND_mix_bsdf":
            share = min(max(self._number(node, "mix", 0.0), 0.0), 1.0)
            self._node(node, "fg", factor * share)
            self._node(node, "bg", factor * (1.0 - share))
        elif kind in ("ND_multiply_bsdfF", "ND_multiply_bsdfC"):
            self._node(node, "in1", factor * self._number(node, "in2", 1.0))
        else:
            self._lobe(node, kind, factor * self._number(node, "weight", 1.0))

    def _lobe(self, node: Any, kind: str, weight: float) -> None:
        if kind in DIFFUSE:
            self._put("diffuseColor", node, weight, (0.18, 0.18, 0.18))
        elif kind == "ND_translucent_bsdf":
            self._put("transmissionColor", node, weight, (1.0, 1.0, 1.0))
        elif kind == "ND_subsurface_bsdf":
            self.inputs["subsurface"] = weight
            self.inputs["subsurfaceColor"] = self._source(node.GetInput("color"), (0.18, 0.18, 0.18))
            self.inputs["subsurfaceRadius"] = radius(self._source(node.GetInput("radius"), (1.0, 1.0, 1.0)), 1.0)
            if self._number(node, "anisotropy", 0.0):
                self._tell(f"the input `anisotropy` of {kind} is not drawn: light scatters evenly")
        elif kind == "ND_dielectric_bsdf" and str(self._source(node.GetInput("scatter_mode"), "R")) == "R":
            self.inputs["ior"] = self._number(node, "ior", 1.5)
            self.inputs["roughness"] = self._number(node, "roughness", 0.05) ** 0.5  # α of microfacets
        else:
            self._tell(f"the shader `{kind}` is not drawn: the other BSDFs of its surface are")

    def _put(self, name: str, node: Any, weight: float, default: Color) -> None:
        color = self._source(node.GetInput("color"), default)
        if hasattr(color, "times"):
            self.inputs[name] = color.times(weight)
        else:
            before = np.array(self.inputs.get(name, BLACK), np.float64) if not hasattr(self.inputs.get(name), "times") else np.zeros(3)
            self.inputs[name] = as_color(before + weight * np.broadcast_to(np.array(color, np.float64), 3))

    def _number(self, node: Any, name: str, default: float) -> float:
        """The mean of an input that is a number, or a colour of one grey."""
        value = self._source(node.GetInput(name), default)
        try:
            return float(np.mean(np.array(value, np.float64)))
        except (TypeError, ValueError):
            self._tell(f"a picture stands where one number is wanted: `{name}` takes its default")
            return default


def row(
    builder: SceneBuilder, surface: metallic_roughness.Surface, body: tuple[float, Input, Color], sheet: Input | None, thin: bool,
    span: Span, tell: Tell,
) -> int:  # fmt: skip
    """The row of a surface of which a share is a body (weight, colour, mean free path in metres), or that is a sheet which passes light."""
    weight, color, lengths = body
    opacity = surface.opacity, surface.threshold
    opaque = metallic_roughness.material(replace(surface, opacity=metallic_roughness.ALL, threshold=0.0))
    if sheet is not None:
        inside = _sheet(surface, surface.diffuse, sheet)
        weight = 1.0
    else:
        metallic = surface.metallic.value[0] if surface.metallic.texture < 0 else 0.0
        weight = min(max(weight, 0.0), 1.0) * (1.0 - min(max(metallic, 0.0), 1.0))
        half = replace(color, value=scale_color(color.value, 0.5))
        inside = _sheet(surface, half, half) if thin else _body(builder, surface, color, lengths, span)
    if weight <= 0.0:
        return builder.material(metallic_roughness.material(surface), span)
    if weight >= 1.0:
        shines, coated = surface.emissive.value != BLACK, surface.coat.value[0] > 0.0
        for name, is_set in (("clear coat", coated), ("sheen", surface.sheen.value != BLACK), ("emission", shines)):
            if is_set:
                tell(f"the {name} over a material that scatters light inside or passes it is not drawn")
        return builder.material(partial_coverage.with_opacity(inside, *opacity), span)
    parts = builder.material(opaque, span), builder.material(inside, span)
    share = {ir.Slot.WEIGHT: Input.number(weight)}
    mix = MaterialData(ir.MaterialModel.BLEND, share, first=parts[0], second=parts[1], name=surface.name, medium=inside.medium)
    return builder.material(partial_coverage.with_opacity(mix, *opacity), span)


def _sheet(surface: metallic_roughness.Surface, reflected: Input, passed: Input) -> MaterialData:
    inputs = {ir.Slot.AMBIENT: reflected, ir.Slot.DIFFUSE: reflected, ir.Slot.DIFFUSE_TRANSMISSION: passed}
    return MaterialData(ir.MaterialModel.TRANSLUCENT, inputs | _maps(surface), name=surface.name)


def _body(builder: SceneBuilder, surface: metallic_roughness.Surface, color: Input, lengths: Color, span: Span) -> MaterialData:
    constant = color.value if color.texture < 0 else subsurface.MIDDLE
    scattering, absorption = subsurface.coefficients(color.value, subsurface.radius_of_free_path(lengths, constant))
    inputs = {
        ir.Slot.AMBIENT: color, ir.Slot.DIFFUSE_TRANSMISSION: Input(WHITE), ir.Slot.RADIUS: Input.number(1.0),
        ir.Slot.IOR: surface.ior, ir.Slot.ROUGHNESS: surface.roughness,
    }  # fmt: skip
    medium = builder.medium(MediumData(scattering, absorption), span)
    return MaterialData(ir.MaterialModel.SUBSURFACE, inputs | _maps(surface), name=surface.name, medium=medium)


def _maps(surface: metallic_roughness.Surface) -> dict[ir.Slot, Input]:
    maps = (ir.Slot.NORMAL, surface.normal), (ir.Slot.BUMP, surface.bump)
    return {slot: each for slot, each in maps if each is not None}
