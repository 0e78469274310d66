"""Imports USD materials: UsdPreviewSurface networks with their textures and primvars.

Nodes follow the UsdPreviewSurface Specification, version 2.6.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import UsdShade

from ....lang.diagnostics import Span
from ... import ir
from ...scene import metallic_roughness, partial_coverage
from ...scene.builder import NONE, SceneBuilder
from ...scene.row_records import BLACK, WHITE, Color, Input, MaterialData, TextureData, lambert, nonnegative
from .. import images
from ..common import uv_sets, vertex_numbers
from ..common.replacements import Replacements
from ..materialx.graph import Node
from . import graph_textures, sources
from .assets import Asset, asset, contents
from .audit import Audit
from .shaders import closures, materialx, scattering, slabs
from .shaders.arithmetic import Arithmetic
from .shaders.network import Fit, Graph, Network, Picture, Primvar
from .sources import Sources
from .stage import Opened, Warnings, primvar_mean

DISPLAY_COLOR, DISPLAY_OPACITY = "displayColor", "displayOpacity"
DEFAULT_COLOR: Color = (0.18, 0.18, 0.18)
_WRAPS = {"repeat": ir.Wrap.REPEAT, "clamp": ir.Wrap.CLAMP, "mirror": ir.Wrap.MIRROR, "black": ir.Wrap.BLACK, "useMetadata": ir.Wrap.BLACK}
_WRAPS |= materialx.WRAPS
_CONTEXTS = ("mtlx", "", "arnold")  # render contexts in which a surface is looked for, as usdrecord does
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
_FALLBACKS: dict[str, Any] = {
    "diffuseColor": DEFAULT_COLOR, "emissiveColor": (0.0, 0.0, 0.0), "specularColor": (0.0, 0.0, 0.0), "metallic": 0.0,
    "roughness": 0.5, "ior": 1.5, "opacity": 1.0, "opacityThreshold": 0.0, "useSpecularWorkflow": 0, "clearcoat": 0.0,
    "clearcoatRoughness": 0.01, "occlusion": 1.0, "normal": None,
    "opacityMode": "transparent",
}  # fmt: skip
_NUMBERS = {
    "metallic": "metallic", "roughness": "roughness", "ior": "ior", "coat": "clearcoat", "coat_roughness": "clearcoatRoughness",
    "occlusion": "occlusion",
}  # fmt: skip


@dataclass(slots=True)
class Materials:
    """The materials of one stage; each network is read once and each row created once."""

    opened: Opened
    builder: SceneBuilder
    networks: dict[str, Network | None] = field(default_factory=dict)
    bindings: dict[tuple[str, str], Any] = field(default_factory=dict)
    warnings: Warnings = field(init=False)
    audit: Audit = field(init=False)
    sources: Sources = field(init=False)
    _rows: dict[Any, int] = field(default_factory=dict)  # of networks that read no primvars, by path and fit
    _fit: Fit = field(default_factory=Fit)  # of the row that is being made
    _plain: str = "st"  # the coordinates of its mesh
    _frame: np.ndarray | None = None  # (4, 4) from the geometry of its part to the stage's world
    base: np.ndarray | None = None  # (4, 4) of the stage's world; None inside of prototypes
    replaced: Replacements = field(default_factory=Replacements)

    def __post_init__(self) -> None:
        self.warnings = Warnings(self.opened, self.builder.diagnostics)
        self.audit = Audit(self.warnings)
        self.sources = Sources(self.warnings, self.audit)

    def tell(self, message: str, prim: Any) -> None:
        """Emits a warning, once for each message."""
        self.warnings.tell(message, prim)

    def bound(self, prim: Any) -> Network | None:
        """The network bound to a prim, by purpose full, then preview, then all-purpose. None if absent or unsupported."""
        api, material = UsdShade.MaterialBindingAPI(prim), None
        for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview):
            candidate, relation = api.ComputeBoundMaterial(purpose)  # of this purpose, else the all-purpose one
            if candidate:
                material = candidate
                if _purpose(str(relation.GetName())) == purpose:
                    break
        if not material:
            for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview, UsdShade.Tokens.allPurpose):
                missing = api.GetDirectBinding(purpose).GetMaterialPath()
                if not missing.isEmpty and not prim.GetStage().GetPrimAtPath(missing):
                    self.tell(f"the material {missing} does not exist: its prims show their displayColor", prim)
                    break
            return None if (row := self.replaced.row()) == NONE else Network("", "", {}, row)
        path = str(material.GetPath())
        if (row := self.replaced.row(str(material.GetPrim().GetName()), path)) != NONE:
            return Network(path, "", {}, row)
        if path not in self.networks:
            self.networks[path] = self._network(material)
        return self.networks[path]

    def _network(self, material: Any) -> Network | None:
        prim = material.GetPrim()
        shader = next((source for source in (material.ComputeSurfaceSource(c)[0] for c in _CONTEXTS) if source), None)
        if not shader:
            others = [o.GetBaseName() for o in material.GetSurfaceOutputs() if o.HasConnectedSource()]
            what = f"only surfaces that are not drawn ({', '.join(others)})" if others else "no surface"
            self.tell(f"the material has {what}: its prims show their displayColor", prim)
            return None
        kind = shader.GetIdAttr().Get()
        if slabs.needs(shader, kind, self.sources.source):
            arithmetic = Arithmetic(self.sources.graphs)
            mapped = slabs.surface(shader, kind, self.sources.source, arithmetic, lambda message: self.tell(message, shader.GetPrim()))
            return Network(str(prim.GetPath()), str(prim.GetName()), {**mapped, "displacement": 0.0})
        if kind in materialx.MODELS:
            mapped = materialx.surface(shader, kind, self.sources.source, lambda message: self.tell(message, shader.GetPrim()))
            mapped["opacity"], mapped["opacityThreshold"] = slabs.coverage(shader, self.sources.source)
            return Network(str(prim.GetPath()), str(prim.GetName()), {**_FALLBACKS, **mapped, "displacement": 0.0})
        if closures.reads(shader, str(kind)):
            node = self.sources.graphs.node(shader)
            read = closures.Closures(self.sources.graphs, self._slabs, lambda message: self.tell(message, shader.GetPrim())).read(node)
            return Network(str(prim.GetPath()), str(prim.GetName()), {**read, "displacement": 0.0})
        if kind == scattering.GRAPH:
            graph = scattering.Graph(self.sources.source, lambda message: self.tell(message, shader.GetPrim()))
            return Network(str(prim.GetPath()), str(prim.GetName()), {**_FALLBACKS, **graph.read(shader), "displacement": 0.0})
        if kind not in materialx.PREVIEW:
            self.tell(f"the surface shader `{kind}` is not drawn: its prims show their displayColor", prim)
            return None
        inputs = {name: self.sources.source(shader.GetInput(name), fallback) for name, fallback in _FALLBACKS.items()}
        self.audit.shader(shader.GetPrim(), kind)
        moved, filled = material.ComputeDisplacementSource()[0], material.ComputeVolumeSource()[0]
        for name, source in (("displacement", moved), ("volume", filled)):
            if source and source.GetPath() != shader.GetPath():
                self.tell(f"the {name} of materials by another shader is not drawn", prim)
        moves = moved and moved.GetPath() == shader.GetPath()
        displacement = shader.GetInput("displacement")
        inputs["displacement"] = self.sources.source(displacement, 0.0) if moves else 0.0
        if not moves and not moved and self.sources.source(displacement, 0.0) != 0.0:
            self.tell("the displacement of this material is not drawn: its outputs:displacement is not connected", prim)
        return Network(str(prim.GetPath()), str(prim.GetName()), inputs)

    def _slabs(self, node: Node) -> dict[str, Any] | None:
        """The inputs of OpenPBR of a surface shader in a mixture; None, with a warning, for one that is not drawn."""
        shader = UsdShade.Shader(node.place)
        if node.definition not in slabs.PARTS:
            self.tell(f"the surface shader `{node.definition}` is not drawn: the others of its mixture are", node.place)
            return None
        arithmetic = Arithmetic(self.sources.graphs)
        return slabs.surface(shader, node.definition, self.sources.source, arithmetic, lambda message: self.tell(message, node.place))

    # --- rows ---

    def without_negatives(self, color: Color, prim: Any, what: str) -> Color:
        """A colour with negative components clamped to 0, with a warning."""
        if min(color) >= 0:
            return color
        self.tell(f"{what} has a negative component, which counts as 0", prim)
        return nonnegative(color)

    def matt_light(self, color: Color, radiance: Color, name: str) -> int:
        """The row of a mesh light's material: diffuse, with the light's radiance as emission."""
        inputs = {ir.Slot.AMBIENT: Input(color), ir.Slot.DIFFUSE: Input(color), ir.Slot.EMISSION: Input(radiance)}
        return self.builder.material(MaterialData(inputs=inputs, name=name))

    def plain(self, color: Color, opacity: float, name: str, ramp: bool = False) -> int:
        """The row for a prim without a material: diffuse, in its displayColor. With `ramp`, its opacity is its u."""
        share = Input.number(1.0, vertex_numbers.texture(self.builder)) if ramp else Input.number(opacity)
        return self.builder.material(partial_coverage.with_opacity(lambert(color, name=name), share))

    def row(self, network: Network, prim: Any, fit: Fit, frame: np.ndarray) -> int:
        """The row of a network for a part of a prim, whose primvars it may read. `frame` (4, 4) places its geometry."""
        if network.row != NONE:
            return network.row
        self._frame = None if self.base is None else np.linalg.solve(self.base, frame)
        if any(isinstance(source, Primvar) for source in network.inputs.values()):
            return self._row(network, prim, fit)
        means = [primvar_mean(prim, name, self.opened.time)[0] for name in network.primvars]
        place = self._frame.tobytes() if network.in_world and self._frame is not None else b""
        maps = tuple((name, None if map_ is None else map_.tobytes()) for name, map_ in fit.maps.items())
        read = tuple(None if mean is None else np.asarray(mean).tobytes() for mean in means)
        key = (network.path, fit.colored, fit.number, fit.tiles, maps, place, read)
        if key not in self._rows:
            self._rows[key] = self._row(network, prim, fit)
        return self._rows[key]

    def _row(self, network: Network, prim: Any, fit: Fit) -> int:
        i, self._fit, self._plain = network.inputs, fit, next(iter(network.varnames), "st")
        span = Span(f"{self.opened.name}<{network.path}>")
        if slabs.KEY in i:
            reader, metres, arithmetic = _Reader(self, prim), self.opened.meters_per_unit, Arithmetic(self.sources.graphs)
            maps = reader.maps(i) if i[slabs.KEY] is True else {}
            rows = slabs.Rows(reader, arithmetic, network.name, span, metres, maps, prim, reader.tell)
            threshold = min(max(self._mean_of(i.get("opacityThreshold", 0.0), 0.0, prim), 0.0), 1.0)
            return rows.row({**i, "base_color": network.white} if fit.colored else i, self._opacity(i["opacity"], prim), threshold)
        maps = self._normals(i["normal"], prim)
        if ir.Slot.FLAKE_SIZE in maps:
            self.tell("flakes are drawn on surfaces of OpenPBR and standard_surface alone", prim)
        diffuse = self._color(network.white if fit.colored else i["diffuseColor"], DEFAULT_COLOR, prim)
        specular = None
        if int(self._mean_of(i["useSpecularWorkflow"], 0.0, prim)):
            specular = self._color(i["specularColor"], (0.0, 0.0, 0.0), prim)
        threshold = min(max(self._mean_of(i["opacityThreshold"], 0.0, prim), 0.0), 1.0)
        numbers = {name: self._number(i[key], float(_FALLBACKS[key]), prim) for name, key in _NUMBERS.items()}
        numbers["occlusion"] = replace(numbers["occlusion"], value=nonnegative(numbers["occlusion"].value))
        surface = metallic_roughness.Surface(
            diffuse, specular=specular, emissive=self._color(i["emissiveColor"], (0.0, 0.0, 0.0), prim),
            opacity=self._opacity(i["opacity"], prim), threshold=threshold,
            highlights_stay=threshold <= 0 and str(i["opacityMode"]) != "presence",
            normal=maps.get(ir.Slot.NORMAL), bump=maps.get(ir.Slot.BUMP),
            sheen=self._color(i.get("sheenColor", BLACK), BLACK, prim),
            sheen_roughness=self._number(i.get("sheenRoughness", 0.0), 0.0, prim), transmission=0.0, name=network.name, **numbers,
        )  # fmt: skip
        if not i.keys() & {"subsurface", "transmissionColor"}:
            return self.builder.material(metallic_roughness.material(surface), span)
        lengths = tuple(self.opened.meters_per_unit * length for length in i.get("subsurfaceRadius", WHITE))
        body = i.get("subsurface", 0.0), self._color(i.get("subsurfaceColor", WHITE), WHITE, prim), lengths
        sheet = self._color(i["transmissionColor"], BLACK, prim) if "transmissionColor" in i else None
        thin = bool(i.get("thinWalled", False))
        return scattering.row(self.builder, surface, body, sheet, thin, span, lambda message: self.tell(message, prim))

    def _graph(self, graph: Graph, count: int, prim: Any) -> int:
        """The row of a graph's texture of 1 or 3 numbers, or NONE."""
        return graph_textures.row(self._host(prim), graph, count, self.opened.span(graph.node.place))

    def _host(self, prim: Any) -> graph_textures.FileHost:
        return graph_textures.FileHost(self.builder, self.warnings, self._fit, _WRAPS, prim, self._plain, self._frame)

    def _color(self, source: Any, fallback: Color, prim: Any) -> Input:
        if isinstance(source, Graph):
            return Input(WHITE, row) if (row := self._graph(source, 3, prim)) != NONE else Input(fallback)
        if isinstance(source, Picture):
            texture, value = self._texture(source)
            return Input(WHITE, texture) if texture != NONE else Input(value)
        resolved = self._primvar(source, prim) if isinstance(source, Primvar) else source
        if not np.isfinite(sources.floats(resolved)).all():
            self.tell("a colour of this prim's material is not finite: its default is drawn", prim)
        return Input(self.without_negatives(sources.rgb(resolved, fallback), prim, "a colour of this prim's material"))

    def _normals(self, source: Any, prim: Any) -> dict[ir.Slot, Input]:
        """The slots of a normal map, a map of heights, or flakes; none for absent ones."""
        if not isinstance(source, Graph):
            normal = self._normal(source, prim)
            return {} if normal is None else {ir.Slot.NORMAL: normal}
        bent = graph_textures.bent(self._host(prim), source, self.opened.span(source.node.place))
        slots = dict(bent.flakes)
        if bent.normal != NONE:
            slots[ir.Slot.NORMAL] = Input((*bent.strength, 1.0), bent.normal)
        if bent.bump != NONE:
            slots[ir.Slot.BUMP] = Input.number(1.0, bent.bump)
        return slots

    def _coat_normal(self, source: Any, prim: Any) -> dict[ir.Slot, Input]:
        """The slot of a coat with a normal of its own."""
        if source is None:
            return {}
        slots = {} if isinstance(source, str) else self._normals(source, prim)
        if slots.keys() - {ir.Slot.NORMAL}:
            self.tell("heights and flakes of a coat are not drawn: it is smooth", prim)
        return {ir.Slot.COAT_NORMAL: slots.get(ir.Slot.NORMAL, slabs.SMOOTH_COAT)}

    def _normal(self, source: Any, prim: Any) -> Input | None:
        """A normal map; None if its image is missing. Without scale and bias, values 0 to 1 are read as −1 to 1."""
        if not isinstance(source, Picture):
            if isinstance(source, Primvar):
                self.tell("a `normal` of UsdPreviewSurface from a primvar is not drawn", prim)
                return None
            return self._constant_normal(sources.floats(source))
        gain, bias, _ = self._levels(source)
        texture, _ = self._texture(source, color=False, raw=True)
        if texture == NONE:
            return None
        if gain[:3] == (1.0,) * 3 and bias[:3] == (0.0,) * 3:
            message = "the normal map has no scale of 2 and bias of -1: it is read as if it had"
            self.tell(message, source.shader.GetPrim())
            texture = self.builder.with_levels(texture, (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0))
        return Input((source.strength, source.strength, 1.0), texture)

    def _constant_normal(self, normal: np.ndarray) -> Input | None:
        """A normal map of one texel; None for the surface's own normal."""
        if normal.shape != (3,) or not np.isfinite(normal).all() or np.allclose(normal, (0, 0, 1)):
            return None
        texel = np.append(normal, 1.0).astype(np.float32).reshape(1, 1, 4)
        image = self.builder.shared(("normal", texel.tobytes()), lambda: self.builder.image(texel, "normal"))
        return Input((1.0, 1.0, 1.0), self.builder.texture(TextureData(ir.TextureKind.IMAGE, image)))

    def _opacity(self, source: Any, prim: Any) -> Input:
        """The opacity: of a texture whose image is missing, its node's fallback."""
        if isinstance(source, Graph):
            return Input.number(1.0, row) if (row := self._graph(source, 1, prim)) != NONE else Input.number(1.0)
        if isinstance(source, Picture):
            texture, _ = self._texture(source)
            fallback = self._levels(source)[2][_CHANNELS.get(source.output, 0)]
            return Input.number(1.0, texture) if texture != NONE else Input.number(fallback)
        if isinstance(source, Primvar) and source.name == self._fit.number:
            return Input.number(1.0, vertex_numbers.texture(self.builder))
        return Input.number(max(self._mean_of(source, 1.0, prim), 0.0))

    def _number(self, source: Any, fallback: float, prim: Any) -> Input:
        """A number, the channel of a connected texture, or the primvar that is the mesh's u."""
        if isinstance(source, Graph):
            return Input.number(1.0, row) if (row := self._graph(source, 1, prim)) != NONE else Input.number(fallback)
        if isinstance(source, Primvar) and source.name == self._fit.number and fallback <= 1.0:
            return Input.number(1.0, vertex_numbers.texture(self.builder))
        if not isinstance(source, Picture):
            return Input.number(self._mean_of(source, fallback, prim))
        texture, _ = self._texture(source, color=False)
        if texture != NONE:
            return Input.number(1.0, texture)
        return Input.number(float(self._levels(source)[2][_CHANNELS.get(source.output, 0)]))

    def _mean_of(self, source: Any, fallback: float, prim: Any) -> float:
        """A number that must be constant over the surface."""
        if isinstance(source, Graph):
            self.tell(f"a texture stands where one number is wanted: its default is drawn (`{source.node.definition}`)", prim)
            return fallback
        if isinstance(source, Picture):
            self.tell(f"a picture stands where one number is wanted: its fallback is drawn (`{source.shader.GetPath().name}`)", prim)
            return float(self._levels(source)[2][_CHANNELS.get(source.output, 0)])
        if isinstance(source, Primvar):
            source = self._primvar(source, prim)
        try:
            value = float(np.mean(np.array(source, dtype=np.float64)))
        except (TypeError, ValueError):
            return fallback
        if math.isfinite(value):
            return value
        self.tell("a number of this prim's material is not finite: its default is drawn", prim)
        return fallback

    def _primvar(self, source: Primvar, prim: Any) -> Any:
        """A primvar's constant value on a prim; its mean, with a warning, if it varies."""
        mean, count = primvar_mean(prim, source.name, self.opened.time)
        if count > 1:
            self.tell(f"the primvar `{source.name}` varies over the surface: its mean is drawn", prim)
        return source.fallback if mean is None else mean

    def _texture(self, picture: Picture, color: bool = True, raw: bool = False) -> tuple[int, Color]:
        """A texture's row: a colour, a number, or `raw` data. NONE and the node's fallback if the image is missing."""
        missing = self._levels(picture)[2]
        map_ = self._fit.maps.get(picture.varname, uv_sets.PLAIN)
        if map_ is None:
            node = picture.shader.GetPath().name
            reason = f"`{picture.varname}` is absent, or no {uv_sets.MOST_PARTS} affine maps lead to it from the first picture's primvar"
            self.tell(f"the picture `{node}` is left out, and its fallback drawn: {reason}", picture.shader.GetPrim())
            return NONE, (missing[0], missing[1], missing[2])
        file = self._picture(picture)
        if file is None:
            return NONE, (missing[0], missing[1], missing[2])
        unread = tuple((v - b) / g if g else 0.0 for g, b, v in zip(*self._levels(picture), strict=True))  # becomes the fallback
        try:
            row = file.row(self.builder, self._space(picture), color, self.opened.span(picture.shader.GetPrim()), unread)
        except images.ImageError as failure:
            self.builder.diagnostics.warning(failure.message, self.opened.span(picture.shader.GetPrim()), failure.hint)
            return NONE, (missing[0], missing[1], missing[2])
        frame = picture.frame if map_ is uv_sets.PLAIN else sources.rows(np.array(picture.frame) @ map_)
        mapping = self._mapping(picture, file, frame, _CHANNELS.get(picture.output, -1 if color or raw else 0))
        return self.builder.texture(replace(mapping, image=row), self.opened.span(picture.shader.GetPrim())), WHITE

    def _space(self, picture: Picture) -> str:
        written = self.sources.text(picture.shader, "sourceColorSpace")
        return materialx.color_space(picture.shader, written, self.builder.files.colors, self.tell)

    def _mapping(self, picture: Picture, file: Asset, frame: Any, channel: int) -> TextureData:
        """Wrap modes, frame, channel, gain and bias of a picture, without its image."""
        gain, bias, _ = self._levels(picture)
        plain = "useMetadata" if "UVTexture" in str(picture.shader.GetIdAttr().Get()) else "periodic"
        wrap_u, wrap_v = (_WRAPS.get(self.sources.text(picture.shader, key) or plain, ir.Wrap.BLACK) for key in ("wrapS", "wrapT"))
        if file.tiles is not None:
            wrap_u, wrap_v, frame = ir.Wrap.CLAMP, ir.Wrap.CLAMP, file.tiles.frame(frame)
        if channel >= 0:
            gain, bias = (gain[channel],) * 4, (bias[channel],) * 4
        return TextureData(
            ir.TextureKind.IMAGE, wrap_u=wrap_u, wrap_v=wrap_v, channel=channel, frame=frame, gain=gain[:3], bias=bias[:3],
            nearest=self.sources.text(picture.shader, "filtertype") == "closest",
        )  # fmt: skip

    def heights(self, network: Network, prim: Any) -> float | tuple[TextureData, np.ndarray]:
        """The displacement of a network: a number, or a picture's mapping and its texels (h, w, 4). 0 where it cannot be read."""
        source = network.inputs["displacement"]
        if not isinstance(source, Picture):
            return self._mean_of(source, 0.0, prim)
        file = self._picture(source)
        if file is None or file.tiles is not None:
            if file is not None:
                self.tell("the displacement of UDIM tiles is not drawn", source.shader.GetPrim())
            return 0.0
        try:
            space = self._space(source)
            decoded = images.read(contents(file.path), Path(file.path).name, "linear" if space == "auto" else space, color=False)
        except (images.ImageError, OSError) as failure:
            self.tell(str(failure), source.shader.GetPrim())
            return 0.0
        decoded.warn(Path(file.path).name, self.builder.diagnostics, self.opened.span(source.shader.GetPrim()))
        return self._mapping(source, file, source.frame, _CHANNELS.get(source.output, 0)), decoded.texels

    def _levels(self, picture: Picture) -> tuple[Any, Any, Any]:
        """Scale, bias and fallback of a UsdUVTexture, four floats each."""
        defaults = {"scale": (1.0,) * 4, "bias": (0.0,) * 4, "fallback": (0.0, 0.0, 0.0, 1.0)}
        levels = {k: self.sources.value(picture.shader.GetInput(k), v) for k, v in defaults.items()}
        if plain := picture.shader.GetInput("default"):
            levels["fallback"] = (*np.ravel(self.sources.value(plain, (0.0, 0.0, 0.0))), 0.0, 0.0, 1.0)[:4]
        scale, bias, fallback = (tuple(map(float, v)) if len(v) == 4 else defaults[k] for k, v in levels.items())
        return tuple(v * picture.gain for v in scale), tuple(v * picture.gain + picture.bias for v in bias), fallback

    def file(self, picture: Picture) -> Asset | None:
        """The file of a picture, with all its tiles."""
        return asset(self.sources.value(picture.shader.GetInput("file"), None), self.warnings, picture.shader.GetPrim())

    def _picture(self, picture: Picture) -> Asset | None:
        return None if (file := self.file(picture)) is None else file.among(self._fit.tiles)


@dataclass(frozen=True, slots=True)
class _Reader:
    """Inputs of the rows of slabs of a prim."""

    materials: Materials
    prim: Any

    @property
    def builder(self) -> SceneBuilder:
        return self.materials.builder

    def color(self, source: Any, fallback: Color) -> Input:
        return self.materials._color(source, fallback, self.prim)

    def number(self, source: Any, fallback: float) -> Input:
        return self.materials._number(source, fallback, self.prim)

    def constant(self, source: Any, fallback: float) -> float:
        return self.materials._mean_of(source, fallback, self.prim)

    def maps(self, inputs: Mapping[str, Any]) -> dict[ir.Slot, Input]:
        maps = self.materials._normals(inputs[slabs.NORMAL], self.prim)
        return maps | self.materials._coat_normal(inputs.get(slabs.COAT_NORMAL), self.prim)

    def tell(self, message: str) -> None:
        self.materials.tell(message, self.prim)


def _purpose(relation: str) -> str:
    """The purpose in the name of a binding, `material:binding[:PURPOSE]` or `material:binding:collection[:PURPOSE]:NAME`."""
    parts = relation.split(":")[2:]
    if parts[:1] == ["collection"]:
        return parts[1] if len(parts) == 3 else ""
    return parts[0] if parts else ""
