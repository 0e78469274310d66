"""Graphs of BSDFs and mixtures of surface shaders as slabs of OpenPBR: layers merge where OpenPBR has them, mixtures are blends.

A dielectric over a diffuse base is its specular, over another surface its coat; sheen is fuzz. Definitions: MaterialX Physically Based
Shading Nodes 1.39.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...materialx import library
from ...materialx.graph import Node, Port
from ...materialx.physical import NARROWEST
from . import conty_kulla, scattering, schlick, slabs
from .arithmetic import Arithmetic, is_zero, numbers
from .graphs import OWN_NORMAL, Graphs
from .network import Graph

MOST_NODES = 64
DEFAULT_SLAB = {**slabs.DEFAULTS, slabs.NORMAL: None}
BLACK_SLAB = {**DEFAULT_SLAB, "base_color": (0.0,) * 3, "specular_weight": 0.0, "specular_ior": 1.5}
SURFACES = ("ND_surface", "ND_surface_unlit")
JOINED = ("ND_mix_surfaceshader", "ND_dot_surfaceshader", "ND_convert_")  # beginnings of the definitions of surfaces made of others
_WEIGHTS = ("specular_weight", "fuzz_weight", "transmission_weight", "subsurface_weight", "coat_weight")
_TOPS = ("dielectric", "schlick", "sheen")
Tell = Callable[[str], None]
Shaders = Callable[[Node], Mapping[str, Any] | None]
"""The inputs of OpenPBR of a surface shader, as standard_surface; None, with a warning, for one that is not drawn."""


def reads(shader: Any, kind: str) -> bool:
    """Whether a surface shader is read here."""
    return kind.startswith(JOINED) or (kind in SURFACES and not (kind == scattering.GRAPH and scattering.is_plain(shader)))


@dataclass(frozen=True, eq=False)
class Slab:
    """One surface of slabs. `kind` is that of its only lobe, or "layers"."""

    inputs: dict[str, Any]
    kind: str


@dataclass(frozen=True, eq=False)
class Mixed:
    """Two surfaces, of which the second has a share."""

    first: Slab | Mixed
    second: Slab | Mixed
    share: Any


Tree = Slab | Mixed


class Closures:
    """Reads the BSDFs of one surface. `shaders` reads those that are no graph of BSDFs."""

    def __init__(self, graphs: Graphs, shaders: Shaders, tell: Tell) -> None:
        self._graphs, self._shaders, self._tell, self._count = graphs, shaders, tell, 0
        self._arithmetic = Arithmetic(graphs)

    def read(self, node: Node) -> dict[str, Any]:
        """The inputs of a surface: ND_surface, ND_surface_unlit, or a mixture of surface shaders."""
        tree, opacity = self._shader(node) or (Slab(dict(BLACK_SLAB), "none"), 1.0)
        leaves = leaves_of(tree)
        flat = {f"{k} {name}": source for k, leaf in enumerate(leaves) for name, source in leaf.inputs.items()}
        flat |= {f"share {k}": share for k, share in enumerate(_shares(tree))}
        return {**flat, slabs.KEY: tree, "normal": None, "opacity": opacity}

    # --- surface shaders ----------------------------------------------------------------------------------------------------

    def _shader(self, node: Node | None) -> tuple[Tree, Any] | None:
        """(BSDFs and emission, opacity) of a surface shader; None where nothing of it is drawn."""
        if node is None or self._is_too_many():
            return None
        kind = node.definition
        if kind.startswith(SURFACES):
            return self._surface(node)
        if kind == "ND_mix_surfaceshader":
            below, above = (self._shader(_source_of(node.inputs.get(name))) for name in ("bg", "fg"))
            if below is None or above is None:
                return below or above
            return self._mixed_shaders(below, above, self._source(node, "mix", 0.0), node)
        if kind == "ND_dot_surfaceshader":
            return self._shader(_source_of(node.inputs.get("in")))
        defined = library.definition(kind)
        if kind.startswith(JOINED) and defined is not None and defined.graph is not None:
            return self._shader(_source_of(next(iter(library.instance(node, defined).values()), None)))
        inputs = self._shaders(node)
        if inputs is None:
            return None
        slab = {**DEFAULT_SLAB, **inputs}
        return Slab(slab, "layers"), slab.pop("opacity", 1.0)

    def _surface(self, node: Node) -> tuple[Tree, Any]:
        """Those of ND_surface or ND_surface_unlit."""
        if node.definition.startswith("ND_surface_unlit"):
            tree: Tree = Slab(dict(BLACK_SLAB), "none")
            emission = self._emitted(node, "emission_color", "emission")
            if not is_zero(self._source(node, "transmission", 0.0)):
                self._tell(f"the input `transmission` of {node.definition} is not drawn")
        else:
            tree, emission = self._tree(node.inputs.get("bsdf")) or Slab(dict(BLACK_SLAB), "none"), self._edf(node.inputs.get("edf"))
        if self._source(node, "thin_walled", False):
            tree = _each(tree, lambda slab: Slab({**slab.inputs, "geometry_thin_walled": True}, slab.kind))
        if emission is not None:
            tree = _each(tree, lambda slab: Slab({**slab.inputs, "emission": emission}, slab.kind))
        return tree, self._source(node, "opacity", 1.0)

    def _mixed_shaders(self, below: tuple[Tree, Any], above: tuple[Tree, Any], share: Any, node: Node) -> tuple[Tree, Any]:
        """A mixture of surfaces, each with an opacity: of what is there, that of the second one has the share s o₂ / o."""
        (first, low), (second, high) = below, above
        part, values = numbers(share), [numbers(low), numbers(high)]
        if all(value is not None and np.all(value == 1.0) for value in values):
            return self._mixed(first, second, share) or first, 1.0
        opacity = self._arithmetic.mix(low, high, share, node.place, color=False)
        if part is None or values[0] is None or values[1] is None:
            self._tell("surfaces of different opacities that a texture mixes are drawn with the mean opacity")
            return self._mixed(first, second, share) or first, opacity
        s, o = float(np.clip(part.mean(), 0.0, 1.0)), [float(value.mean()) for value in values if value is not None]
        total = (1.0 - s) * o[0] + s * o[1]
        return self._mixed(first, second, s * o[1] / total if total > 0.0 else s) or first, total

    def _is_too_many(self) -> bool:
        """Counts a node; True, with a warning, beyond the limit."""
        self._count += 1
        if self._count == MOST_NODES + 1:
            self._tell(f"more than {MOST_NODES} BSDFs feed each other: the others are not drawn")
        return self._count > MOST_NODES

    # --- inputs -------------------------------------------------------------------------------------------------------------

    def _source(self, node: Node, name: str, default: Any) -> Any:
        port = node.inputs.get(name)
        if port is None:
            defined = library.definition(node.definition)
            port = defined.inputs.get(name) if defined else None
        if port is None or (port.source is None and port.value is None):
            return default
        if default is None and port.source is not None and port.source.definition == OWN_NORMAL:
            return None
        return port.value if port.source is None else self._graphs.source(port.source, port.output, default)

    def _color(self, node: Node, name: str, default: Any) -> Any:
        """A colour times the weight of its BSDF."""
        return self._arithmetic.times(self._source(node, name, default), self._source(node, "weight", 1.0), node.place)

    def _emitted(self, node: Node, color: str, weight: str) -> Any:
        product = self._arithmetic.times(self._source(node, color, (1.0,) * 3), self._source(node, weight, 1.0), node.place)
        return None if is_zero(product) else product

    def _edf(self, port: Port | None) -> Any:
        """The radiance of uniform_edf, through products, sums and mixtures."""
        node = port.source if port else None
        if node is None or self._is_too_many():
            return None
        if node.definition == "ND_uniform_edf":
            return self._source(node, "color", (1.0,) * 3)
        if node.definition.startswith("ND_multiply_edf"):
            inner = self._edf(node.inputs.get("in1"))
            return None if inner is None else self._arithmetic.times(inner, self._source(node, "in2", 1.0), node.place)
        if node.definition == "ND_generalized_schlick_edf":
            self._tell("an emission that changes with the angle is drawn as that along the normal")
            inner = self._edf(node.inputs.get("base"))
            return None if inner is None else self._arithmetic.times(inner, self._source(node, "color0", (1.0,) * 3), node.place)
        if node.definition in ("ND_add_edf", "ND_mix_edf"):
            is_sum = node.definition == "ND_add_edf"
            first, second = (self._edf(node.inputs.get(name)) or (0.0,) * 3 for name in (("in1", "in2") if is_sum else ("bg", "fg")))
            if is_sum:
                return self._arithmetic.apply("ND_add_color3", first, node.place, in1=first, in2=second)
            return self._arithmetic.mix(first, second, self._source(node, "mix", 0.0), node.place)
        self._tell(f"the emission `{node.definition}` is not drawn")
        return None

    def _facets(self, node: Node, slab: dict[str, Any], rough: str, turned: str) -> None:
        """Roughness and anisotropy from two α, or from the node that makes them."""
        port = node.inputs.get("roughness")
        maker = port.source if port else None
        if maker is not None and maker.definition == "ND_roughness_anisotropy":
            slab[rough], anisotropy = self._source(maker, "roughness", 0.0), numbers(self._source(maker, "anisotropy", 0.0))
            if anisotropy is None:
                self._tell("an anisotropy that varies is drawn as none")
            elif anisotropy > 0.0:
                slab[turned] = min(float(anisotropy), NARROWEST)
            return
        alpha = self._source(node, "roughness", (0.05, 0.05))
        values = numbers(alpha)
        if values is None:
            slab[rough] = self._arithmetic.apply("ND_sqrt_float", 0.3, node.place, **{"in": self._first(alpha, node)})
            return
        along, across = max(np.broadcast_to(values, 2)), min(np.broadcast_to(values, 2))
        narrow = 1.0 - across / along if along > 0.0 else 0.0
        slab[rough] = math.sqrt(along * math.sqrt((1.0 + (1.0 - narrow) ** 2) / 2.0))
        slab[turned] = float(narrow)

    def _first(self, source: Any, node: Node) -> Any:
        return self._arithmetic.apply("ND_extract_vector2", 0.05, node.place, **{"in": source}, index=0.0)

    # --- BSDFs --------------------------------------------------------------------------------------------------------------

    def _tree(self, port: Port | None) -> Tree | None:
        node = port.source if port else None
        if node is None or self._is_too_many():
            return None
        kind = node.definition
        if kind == "ND_layer_bsdf":
            return self._layer(self._tree(node.inputs.get("top")), self._tree(node.inputs.get("base")), node)
        if kind == "ND_layer_vdf":
            return self._inside(self._tree(node.inputs.get("top")), node.inputs.get("base"))
        if kind == "ND_mix_bsdf":
            return self._mixed(self._tree(node.inputs.get("bg")), self._tree(node.inputs.get("fg")), self._source(node, "mix", 0.0))
        if kind == "ND_add_bsdf":
            return self._sum(self._tree(node.inputs.get("in1")), self._tree(node.inputs.get("in2")), node)
        if kind in ("ND_multiply_bsdfF", "ND_multiply_bsdfC"):
            inner, factor = self._tree(node.inputs.get("in1")), self._source(node, "in2", 1.0)
            return None if inner is None else _each(inner, lambda slab: self._scaled(slab, factor, node))
        return self._lobe(node, kind)

    def _lobe(self, node: Node, kind: str) -> Tree | None:
        slab = dict(BLACK_SLAB)
        slab[slabs.NORMAL] = self._source(node, "normal", None) if node.inputs.get("normal") else None
        weight = self._source(node, "weight", 1.0)
        if not is_zero(thickness := self._source(node, "thinfilm_thickness", 0.0)):
            slab |= slabs.film(thickness, self._source(node, "thinfilm_ior", 1.5), self._arithmetic, node.place)
        if kind in ("ND_oren_nayar_diffuse_bsdf", "ND_burley_diffuse_bsdf"):
            rough = self._source(node, "roughness", 0.0) if "oren" in kind else 0.0
            return Slab({**slab, "base_color": self._color(node, "color", (0.18,) * 3), "base_diffuse_roughness": rough}, "diffuse")
        if kind == "ND_translucent_bsdf":
            return Slab({**slab, "translucent": self._color(node, "color", (1.0,) * 3)}, "translucent")
        if kind == "ND_subsurface_bsdf":
            radius = self._source(node, "radius", (1.0,) * 3)
            slab |= {"subsurface_weight": weight, "subsurface_color": self._source(node, "color", (0.18,) * 3), "subsurface_radius": 1.0}
            slab["subsurface_scatter_anisotropy"] = self._source(node, "anisotropy", 0.0)
            return Slab({**slab, "subsurface_radius_scale": radius}, "diffuse")
        if kind == "ND_sheen_bsdf":
            color, rough = self._source(node, "color", (1.0,) * 3), self._source(node, "roughness", 0.3)
            of_fuzz = conty_kulla.of_mode(str(self._source(node, "mode", "")), rough, weight, self._arithmetic, node.place)
            return Slab({**slab, **of_fuzz, "fuzz_color": color}, "sheen")
        if kind == "ND_conductor_bsdf":
            self._facets(node, slab, "specular_roughness", "specular_roughness_anisotropy")
            f0, tint = self._metal(node)
            slab |= {"base_metalness": 1.0, "base_color": f0, "specular_color": tint, "specular_weight": weight}
            return Slab(slab, "conductor")
        if kind == "ND_dielectric_bsdf":
            return self._dielectric(node, slab, self._source(node, "ior", 1.5), self._source(node, "tint", (1.0,) * 3), weight)
        if kind == "ND_generalized_schlick_bsdf":
            return self._schlick(node, slab, weight)
        defined = library.definition(kind)
        if defined is not None and defined.graph is not None:
            return self._tree(next(iter(library.instance(node, defined).values()), None))
        self._tell(f"the shader `{kind}` is not drawn: the other BSDFs of its surface are")
        return None

    def _metal(self, node: Node) -> tuple[Any, Any]:
        """(reflectance at normal incidence, tint at 81.8°) of a conductor."""
        port = node.inputs.get("ior")
        maker = port.source if port else None
        if maker is not None and maker.definition == "ND_artistic_ior":
            base = self._source(maker, "reflectivity", (0.944, 0.776, 0.373))
            edge = self._source(maker, "edge_color", (0.998, 0.981, 0.751))
            fixed = numbers(base), numbers(edge)
            return base, (1.0,) * 3 if fixed[0] is None or fixed[1] is None else slabs.edge_tint(*fixed)
        n, k = (numbers(self._source(node, name, d)) for name, d in (("ior", (0.183, 0.421, 1.373)), ("extinction", (3.424, 2.346, 1.770))))
        if n is None or k is None:
            self._tell("an index of refraction of a conductor that varies is drawn as that of gold")
            n, k = np.array((0.183, 0.421, 1.373)), np.array((3.424, 2.346, 1.770))
        return slabs.tint_of(n, k)

    def _dielectric(self, node: Node, slab: dict[str, Any], ior: Any, tint: Any, weight: Any) -> Slab:
        self._facets(node, slab, "specular_roughness", "specular_roughness_anisotropy")
        mode = str(self._source(node, "scatter_mode", "R"))
        slab |= {"specular_ior": ior, "specular_weight": weight, "specular_color": tint}
        if mode == "R":
            return Slab(slab, "dielectric")
        return Slab({**slab, "transmission_weight": weight, "transmission_color": tint}, "transmission")

    def _schlick(self, node: Node, slab: dict[str, Any], weight: Any) -> Slab:
        """Reflectances at normal and grazing incidence, and between them."""
        f0, edge = self._source(node, "color0", (1.0,) * 3), self._source(node, "color82", (1.0,) * 3)
        grazing, exponent = self._source(node, "color90", (1.0,) * 3), self._source(node, "exponent", 5.0)
        if str(self._source(node, "scatter_mode", "R")) != "R":
            values = numbers(f0)
            if not schlick.is_plain(grazing, exponent):
                self._tell(f"the inputs `color90` and `exponent` of {node.definition} are drawn as white and 5 where light passes")
            grey = 0.04 if values is None else float(np.clip(values.mean(), 0.0, 0.9))
            return self._dielectric(node, slab, (1.0 + math.sqrt(grey)) / (1.0 - math.sqrt(grey)), (1.0,) * 3, weight)
        self._facets(node, slab, "specular_roughness", "specular_roughness_anisotropy")
        slab |= {"base_metalness": 1.0, "base_color": f0, "specular_color": edge, "specular_weight": weight}
        if not schlick.is_plain(grazing, exponent):
            fit = schlick.fitted(f0, edge, grazing, exponent)
            if fit is None:
                self._tell(f"the inputs `color90` and `exponent` of {node.definition} are drawn as white and 5 beside textures")
            else:
                slab |= {
                    "base_color": fit.color,
                    "specular_color": fit.tint,
                    "specular_weight": self._arithmetic.times(weight, fit.scale, None),
                }
                if fit.error > schlick.VISIBLE:
                    self._tell(f"the reflectance of {node.definition} is drawn within {fit.error:.2f}: its `exponent` or `color90`")
        return Slab({**slab, schlick.KEY: (f0, schlick.is_plain(grazing, exponent), weight)}, "schlick")

    # --- combinations -------------------------------------------------------------------------------------------------------

    def _mixed(self, first: Tree | None, second: Tree | None, share: Any) -> Tree | None:
        first, second = first or Slab(dict(BLACK_SLAB), "none"), second or Slab(dict(BLACK_SLAB), "none")
        value = numbers(share)
        if value is not None and float(value) in (0.0, 1.0):
            return second if value else first
        return Mixed(first, second, share)

    def _layer(self, top: Tree | None, base: Tree | None, node: Node) -> Tree | None:
        if top is None or base is None:
            return top or base
        if isinstance(top, Mixed):
            return replace(top, first=self._layer(top.first, base, node), second=self._layer(top.second, base, node))
        if isinstance(base, Mixed):
            return replace(base, first=self._layer(top, base.first, node), second=self._layer(top, base.second, node))
        return self._merged(top, base, node)

    def _merged(self, top: Slab, base: Slab, node: Node) -> Tree:
        t, b = top.inputs, base.inputs
        if top.kind not in _TOPS:
            if top.kind != "none":
                self._tell(f"a {top.kind} BSDF over another one hides it")
            return top if top.kind != "none" else base
        if top.kind == "sheen":
            return Slab({**b, **{name: t[name] for name in ("fuzz_weight", "fuzz_color", "fuzz_roughness")}}, "layers")
        ior, tint, weight = t["specular_ior"], t["specular_color"], t["specular_weight"]
        if top.kind == "schlick":
            color, is_plain, weight = t[schlick.KEY]
            if not is_plain:
                self._tell("the inputs `color90` and `exponent` of a generalized_schlick_bsdf over another BSDF are drawn as white and 5")
            f0 = numbers(color)
            grey = 0.04 if f0 is None else float(np.clip(f0.max(), 1e-4, 0.9))
            ior = (1.0 + math.sqrt(grey)) / (1.0 - math.sqrt(grey))
            tint = (1.0,) * 3 if f0 is None else tuple(np.broadcast_to(f0 / grey, 3).tolist())
        rough, turned = t["specular_roughness"], t["specular_roughness_anisotropy"]
        bare = base.kind == "transmission" or (is_zero(b["base_metalness"]) and is_zero(b["specular_weight"]) and "translucent" not in b)
        films = {name: t[name] for name in ("thin_film_weight", "thin_film_thickness", "thin_film_ior")}
        if bare:
            if not is_same(t[slabs.NORMAL], b[slabs.NORMAL]):
                self._tell("a highlight whose normal is not that of the diffuse BSDF below it has that of the latter")
            changes = {**films, "specular_ior": ior, "specular_color": tint, "specular_weight": weight, "specular_roughness": rough,
                       "specular_roughness_anisotropy": turned}  # fmt: skip
        else:
            if not is_zero(films["thin_film_weight"]):
                self._tell("a thin film on a coat is not drawn")
            changes = {"coat_weight": weight, "coat_ior": ior, "coat_color": (1.0,) * 3, "coat_roughness": rough,
                       "coat_roughness_anisotropy": turned, "coat_darkening": 0.0}  # fmt: skip
            changes["specular_ior"] = slabs.under_coat({**b, **changes})
            if not is_same(t[slabs.NORMAL], b[slabs.NORMAL]):
                changes[slabs.COAT_NORMAL] = slabs.SMOOTH if t[slabs.NORMAL] is None else t[slabs.NORMAL]
        return Slab({**b, **changes}, "layers")

    def _inside(self, tree: Tree | None, port: Port | None) -> Tree | None:
        """A medium inside of a dielectric: its absorption alone is drawn."""
        node = port.source if port else None
        if node is None or not isinstance(tree, Slab):
            return tree
        absorption = numbers(self._source(node, "absorption", (0.0,) * 3))
        if absorption is None or not is_zero(self._source(node, "scattering", (0.0,) * 3)):
            self._tell(f"of the medium `{node.definition}` only a constant absorption is drawn")
        if absorption is None:
            return tree
        color = tuple(np.exp(-np.broadcast_to(absorption, 3)).tolist())
        return Slab({**tree.inputs, "transmission_color": color, "transmission_depth": 1.0}, tree.kind)

    def _sum(self, first: Tree | None, second: Tree | None, node: Node) -> Tree | None:
        """Two BSDFs beside each other: a highlight lies over the other one, diffuse colours add up."""
        if first is None or second is None:
            return first or second
        if isinstance(first, Slab) and isinstance(second, Slab):
            if first.kind in _TOPS and second.kind not in _TOPS:
                return self._merged(first, second, node)
            if second.kind in _TOPS:
                return self._merged(second, first, node)
            if first.kind == second.kind == "diffuse" and is_zero(first.inputs["subsurface_weight"]):
                color = self._arithmetic.apply(
                    "ND_add_color3", (0.0,) * 3, node.place, in1=first.inputs["base_color"], in2=second.inputs["base_color"])  # fmt: skip
                return Slab({**second.inputs, "base_color": color}, "diffuse")
        peaks = [max(map(_peak, leaves_of(tree))) for tree in (first, second)]
        total = sum(peaks)
        if total <= 0.0:
            return first
        if total > 1.0 + 1e-6:
            self._tell("a sum of BSDFs of several kinds that may reflect more light than there is is drawn as their mixture")
        grown = [
            tree if peak <= 0.0 else _each(tree, partial(self._scaled, factor=min(total, 1.0) / peak, node=node))
            for tree, peak in zip((first, second), peaks, strict=True)
        ]
        return self._mixed(grown[0], grown[1], peaks[1] / total)

    def _scaled(self, slab: Slab, factor: Any, node: Node) -> Slab:
        """A slab that reflects more or less: colours times a factor, weights times its mean."""
        values = numbers(factor)
        grey = factor if values is None else float(values.mean())
        inputs, is_grey = dict(slab.inputs), values is not None and float(np.ptp(values)) == 0.0
        is_metal = not is_zero(inputs["base_metalness"])
        for name in ("base_color", "translucent"):
            if name in inputs and not (is_metal and is_grey):
                inputs[name] = self._arithmetic.times(inputs[name], factor, node.place)
        for name in _WEIGHTS:
            if not is_zero(inputs[name]) and not (name == "specular_weight" and is_metal and not is_grey):
                inputs[name] = self._arithmetic.times(inputs[name], grey, node.place)
        if schlick.KEY in inputs:
            color, is_plain, weight = inputs[schlick.KEY]
            inputs[schlick.KEY] = (color, is_plain, self._arithmetic.times(weight, grey, node.place))
        return Slab(inputs, slab.kind)


def _peak(slab: Slab) -> float:
    """The greatest of the numbers of a slab that `_scaled` multiplies, 1 for textures: what it may grow by is 1 over it."""
    inputs, is_metal = slab.inputs, not is_zero(slab.inputs["base_metalness"])
    names = [*_WEIGHTS]
    names += [] if is_metal else ["base_color", *(name for name in ("translucent",) if name in inputs)]
    values = [numbers(inputs[name]) for name in names]
    return max(1.0 if value is None else float(value.max()) for value in values)


def is_same(first: Any, second: Any) -> bool:
    """Whether two sources are one."""
    if isinstance(first, Graph) and isinstance(second, Graph):
        return first.node is second.node and (first.output, first.gain, first.bias) == (second.output, second.gain, second.bias)
    return first is second or (type(first) is type(second) and not isinstance(first, Graph) and bool(np.all(first == second)))


def _source_of(port: Port | None) -> Node | None:
    return port.source if port else None


def _each(tree: Tree, change: Callable[[Slab], Slab]) -> Tree:
    if isinstance(tree, Slab):
        return change(tree)
    return Mixed(_each(tree.first, change), _each(tree.second, change), tree.share)


def leaves_of(tree: Tree) -> list[Slab]:
    return [tree] if isinstance(tree, Slab) else leaves_of(tree.first) + leaves_of(tree.second)


def _shares(tree: Tree) -> list[Any]:
    return [] if isinstance(tree, Slab) else [tree.share, *_shares(tree.first), *_shares(tree.second)]
