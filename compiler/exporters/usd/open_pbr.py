"""Materials as MaterialX beside UsdPreviewSurface: open_pbr_surface of slabs, and UsdPreviewSurface with graphs of patterns."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from ....materials import losses, openpbr
from ....materials.contract import Exported
from ... import ir
from ...scene.row_records import Input, as_color
from ..export import Export
from ..material_values import MaterialRow, Slabs, slabs
from ..texture_sets import TextureSets
from .graphs import GraphWriter, is_graph
from .nodes import Nodes, set_input

Slot = ir.Slot
CONTEXT = "mtlx"
_WRAPS = {ir.Wrap.REPEAT: "periodic", ir.Wrap.CLAMP: "clamp", ir.Wrap.MIRROR: "mirror", ir.Wrap.BLACK: "constant"}
_PREVIEW = {
    "diffuseColor": ("diffuse", "color3"), "metallic": ("metallic", "float"), "roughness": ("roughness", "float"),
    "emissiveColor": ("emissive", "color3"), "occlusion": ("occlusion", "float"), "ior": ("ior", "float"),
    "specularColor": ("specular", "color3"), "clearcoat": ("coat", "float"), "clearcoatRoughness": ("coat_roughness", "float"),
}  # fmt: skip
_ROTATIONS = {"specular_rotation": ("geometry_tangent", "specular"), "coat_rotation": ("geometry_coat_tangent", "coat")}


def set_name(number: int) -> str:
    """The primvar of a set of texture coordinates."""
    return f"st{number}" if number else "st"


class Networks:
    """The networks of MaterialX of a stage. `file` is the name of a picture of a texture, by its row, kind and whether it is a colour."""

    def __init__(self, out: Export, stage: Any, file: Callable[..., str]) -> None:
        self.out, self._stage, self._file, self.tables = out, stage, file, out.scene.tables

    def slabs(self, row: int) -> Slabs | None:
        """A row of Materials as slabs; None of one that UsdPreviewSurface is for."""
        return slabs(MaterialRow(self.tables, row))

    def write(self, material: Any, path: str, row: int, described: Slabs, sets: TextureSets) -> None:
        """The network of slabs of a row, as outputs:mtlx:surface of its material."""
        writer = _Network(self, path, row, sets)
        shader = writer.shader("open_pbr", "ND_open_pbr_surface_surfaceshader")
        for name, slot in described.slots.items():
            kind = "color3" if name in openpbr.COLORS else "float"
            if name in _ROTATIONS:
                writer.turn(shader, name, slot)
            elif not writer.is_default(name, slot):
                set_input(shader, name, kind, writer.value(slot, kind))
        for name, value in described.constants.items():
            if name not in ("emission_luminance", "priority") and value is not False:
                kind = "boolean" if isinstance(value, bool) else "color3" if isinstance(value, tuple) else "float"
                set_input(shader, name, kind, value)
        writer.emission(shader)
        writer.geometry(shader, "geometry_normal", "geometry_opacity")
        writer.coat(shader)
        if writer.row.number(Slot.FLAKE_SIZE) > 0.0:
            self.out.cannot(losses.FLAKES, "materials", row)
            writer.roughness_of_flakes(shader)
        for message in described.lost:
            self.out.cannot(message, "materials", row)
        material.CreateSurfaceOutput(CONTEXT).ConnectToSource(shader.ConnectableAPI(), "surface")

    def write_preview(self, material: Any, path: str, row: int, exported: Exported, sets: TextureSets, opacity: Input) -> None:
        """The network of a surface with patterns, which UsdUVTexture has not."""
        writer, s = _Network(self, path, row, sets), exported.surface
        shader = writer.shader("preview", "ND_UsdPreviewSurface_surfaceshader")
        for name, (attribute, kind) in _PREVIEW.items():
            entry = getattr(s, attribute)
            if entry is not None and (name not in ("clearcoat", "clearcoatRoughness") or s.coat.value[0] > 0):
                set_input(shader, name, kind, writer.input(entry, kind))
        set_input(shader, "opacity", "float", writer.input(opacity, "float"))
        if s.threshold > 0:
            set_input(shader, "opacityThreshold", "float", s.threshold)
        if s.specular is not None:
            set_input(shader, "useSpecularWorkflow", "integer", 1)
        writer.geometry(shader, "normal", "")
        material.CreateSurfaceOutput(CONTEXT).ConnectToSource(shader.ConnectableAPI(), "surface")


class _Network:
    """The nodes of one material."""

    def __init__(self, networks: Networks, path: str, row: int, sets: TextureSets) -> None:
        self.out, self.tables, self._sets = networks.out, networks.tables, sets
        self._stage, self._file, self._path = networks._stage, networks._file, f"{path}/{CONTEXT}_"
        self.row = MaterialRow(self.tables, row)
        self.nodes = Nodes(self._stage, self._path)
        self._graphs = GraphWriter(self.tables, self.nodes, sets, lambda row, place: self._image(row, "color", "color3", place))

    def shader(self, name: str, identifier: str) -> Any:
        shader = UsdShade.Shader.Define(self._stage, f"{self._path}{name}")
        shader.CreateIdAttr(identifier)
        shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        return shader

    def is_default(self, name: str, slot: ir.Slot) -> bool:
        """Whether an input has the default of the specification."""
        if self.row.texture(slot) >= 0:
            return False
        if name in openpbr.COLORS:
            return bool((self.row.value(slot) == openpbr.COLORS[name][1]).all())
        return self.row.number(slot) == openpbr.NUMBERS[name][1]

    def value(self, slot: ir.Slot, kind: str) -> Any:
        return self.input(Input(as_color(self.row.value(slot)), self.row.texture(slot)), kind)

    def input(self, entry: Input, kind: str) -> Any:
        """A constant, or the output of the nodes of a texture times it."""
        gain = entry.value if kind == "color3" else (entry.value[0],) * 3
        if entry.texture < 0:
            return gain if kind == "color3" else gain[0]
        if self.tables.textures.kind[entry.texture] == ir.TextureKind.FORMULA:
            if not is_graph(self.tables, entry.texture):
                self.out.carried(entry.texture)
                return gain if kind == "color3" else gain[0]
            return self._graphs.write(entry.texture, kind, gain)
        picture = self.picture(entry.texture, "color" if kind == "color3" else "number", kind)
        if gain == (1.0, 1.0, 1.0):
            return picture
        factor = gain if kind == "color3" else gain[0]
        return self.nodes.add("times", f"ND_multiply_{kind}", kind, in1=(kind, picture), in2=(kind, factor))

    def picture(self, texture: int, use: str, kind: str) -> Any:
        """The output of an image node."""
        number = self._sets.add(texture)
        place = self.nodes.add("uv", "ND_geompropvalue_vector2", "vector2", geomprop=("string", set_name(number)))
        return self._image(texture, use, kind, place)

    def _image(self, texture: int, use: str, kind: str, place: Any) -> Any:
        """The output of an image node at the output of its coordinates."""
        textures, cells = self.tables.textures, self._sets.has_cells(texture)
        modes = ["periodic" if cells else _WRAPS[ir.Wrap(int(wrap[texture]))] for wrap in (textures.wrap_u, textures.wrap_v)]
        path = Sdf.AssetPath(self._file(texture, use, kind == "color3", self._sets))
        ports = {"file": ("filename", path), "texcoord": ("vector2", place)}
        ports |= {"uaddressmode": ("string", modes[0]), "vaddressmode": ("string", modes[1])}
        if textures.nearest[texture]:
            ports["filtertype"] = ("string", "closest")
        output = self.nodes.add("image", f"ND_image_{kind}", kind, **ports)
        if kind == "color3":
            output.GetPrim().GetAttribute("inputs:file").SetColorSpace("srgb_texture")
        return output

    def turn(self, shader: Any, name: str, slot: ir.Slot) -> None:
        """The tangent of a highlight that is turned, as open_pbr_surface has it."""
        target, part = _ROTATIONS[name]
        if self.row.number(slot) != 0.0:
            tangent = self.nodes.add("tangent", "ND_tangent_vector3", "vector3", space=("string", "world"))
            normal = self.nodes.add("normal", "ND_normal_vector3", "vector3", space=("string", "world"))
            amount = self.input(Input.number(360.0 * self.row.number(slot), self.row.texture(slot)), "float")
            ports = {"in": ("vector3", tangent), "amount": ("float", amount), "axis": ("vector3", normal)}
            set_input(shader, target, "vector3", self.nodes.add(f"{part}_tangent", "ND_rotate3d_vector3", "vector3", **ports))

    def roughness_of_flakes(self, shader: Any) -> None:
        """The roughness of all flakes together, as they look from far. That of pictures stays."""
        if self.row.texture(Slot.ROUGHNESS) < 0 and self.row.texture(Slot.FLAKE_TILT) < 0:
            rough, tilt = self.row.number(Slot.ROUGHNESS), self.row.number(Slot.FLAKE_TILT)
            set_input(shader, "specular_roughness", "float", min((rough**4 + tilt**4) ** 0.25, 1.0))

    def emission(self, shader: Any) -> None:
        """Luminance, and the colour that it multiplies."""
        value, texture = self.row.value(Slot.EMISSION), self.row.texture(Slot.EMISSION)
        if not value.max() > 0.0:
            return
        luminance = float(value.max())
        set_input(shader, "emission_luminance", "float", luminance)
        set_input(shader, "emission_color", "color3", self.input(Input(as_color(value / luminance), texture), "color3"))

    def geometry(self, shader: Any, normal: str, opacity: str) -> None:
        """Normal map and opacity; a map of heights is a loss."""
        if opacity and (self.row.texture(Slot.OPACITY) >= 0 or self.row.number(Slot.OPACITY) != 1.0):
            set_input(shader, opacity, "float", self.value(Slot.OPACITY, "float"))
        if opacity and self.row.materials.threshold[self.row.row] > 0.0:
            self.out.cannot(losses.argument("opacity_threshold"), "materials", self.row.row)
        if self.row.texture(Slot.BUMP) >= 0:
            self.out.cannot(losses.BUMP_MAP, "materials", self.row.row, "a normal map is")
        self._normal(shader, normal, Slot.NORMAL)

    def coat(self, shader: Any) -> None:
        """The normal of the coat, where it is not that of the base."""
        if self.row.texture(Slot.COAT_NORMAL) >= 0:
            self._normal(shader, "geometry_coat_normal", Slot.COAT_NORMAL)
            return
        if float(self.row.value(Slot.COAT_NORMAL)[2]) > 0.0:
            node = self.nodes.add("normal", "ND_normal_vector3", "vector3", space=("string", "world"))
            set_input(shader, "geometry_coat_normal", "vector3", node)
        elif self.row.texture(Slot.NORMAL) >= 0 and self.row.number(Slot.COAT) > 0.0 and shader.GetInput("geometry_normal"):
            below = shader.GetInput("geometry_normal").GetConnectedSources()[0]
            if below:
                coat = shader.CreateInput("geometry_coat_normal", Sdf.ValueTypeNames.Float3)
                coat.ConnectToSource(UsdShade.ConnectableAPI(below[0].source.GetPrim()), below[0].sourceName)

    def _normal(self, shader: Any, normal: str, slot: ir.Slot) -> None:
        """A normal map of a slot."""
        texture = self.row.texture(slot)
        if texture >= 0 and not np.isin(self.tables.textures.kind[texture], [ir.TextureKind.IMAGE]):
            self.out.cannot(losses.texture(slot), "materials", self.row.row)
        elif texture >= 0:
            picture = self.picture(texture, "normal", "vector3")
            ports = {"in": ("vector3", picture), "scale": ("float", self.row.number(slot))}
            set_input(shader, normal, "vector3", self.nodes.add("normal_map", "ND_normalmap_float", "vector3", **ports))
