"""Writes materials as UsdPreviewSurface with UsdUVTexture pictures (UsdPreviewSurface 2.6)."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, UsdShade

from ....materials import losses
from ....materials.contract import Exported
from ... import ir
from ...scene.row_records import DEFAULT_MATERIAL, Color, Input, as_color, scale_color
from ..baking.patterns import Baked
from ..export import Export
from ..surfaces import surface_of
from ..texture_sets import TextureSets
from .graphs import is_graph
from .open_pbr import Networks, set_name

_WRAPS = {ir.Wrap.REPEAT: "repeat", ir.Wrap.CLAMP: "clamp", ir.Wrap.MIRROR: "mirror", ir.Wrap.BLACK: "black"}
_TYPES = {
    "color": (Sdf.ValueTypeNames.Color3f, "rgb"), "number": (Sdf.ValueTypeNames.Float, "r"), "normal": (Sdf.ValueTypeNames.Normal3f, "rgb"),
}  # fmt: skip


_SLOT = ir.Slot
PICTURED = frozenset(_SLOT) - {
    _SLOT.NORMAL,
    _SLOT.COAT_NORMAL,
    _SLOT.BUMP,
    _SLOT.WEIGHT,
    _SLOT.RADIUS,
    _SLOT.ROTATION,
    _SLOT.COAT_ROTATION,
    _SLOT.SHININESS,
    _SLOT.SHEEN,
    _SLOT.SHEEN_ROUGHNESS,
    _SLOT.DIFFUSE_TRANSMISSION,
}
"""Inputs that have a picture in UsdPreviewSurface or open_pbr_surface."""


class _Everything(frozenset[str]):
    """Losses that a network of MaterialX beside the surface carries: all of them."""

    def __contains__(self, loss: object) -> bool:
        return True


EVERYTHING = _Everything()


class Written(NamedTuple):
    """A material of the stage, the sets of texture coordinates that its pictures use, and what it does with colours of meshes."""

    material: Any
    sets: TextureSets
    tint: Color | None = None  # a factor of the colours of meshes, which the material shows


class Materials:
    """The materials of the stage, each written once."""

    def __init__(self, out: Export, stage: Any, parent: str, name: str, png: Callable[..., bytes], baked: Baked) -> None:
        self._baked, self._with_graphs = baked.coordinates, with_graphs(baked)
        self.out, self.stage, self.tables, self._png = out, stage, out.scene.tables, png
        self._parent, self._name = parent, name
        self._written: dict[tuple[int, bool], Written] = {}
        self._files: dict[tuple[int, str], str] = {}
        self._networks = Networks(self._with_graphs, stage, self._file)

    def written(self, row: int, tinted: bool = False) -> Written:
        """The material of a row; if `tinted`, for meshes with colours, which are in their primvar displayColor."""
        key = (row, tinted)
        if key not in self._written:
            slabs = None if tinted else self._networks.slabs(row)
            carried = frozenset() if slabs is None else EVERYTHING
            sets, exported = TextureSets(self.tables, self._baked), surface_of(self.out, row, carried, self._has_graph)
            diffuse = exported.surface.diffuse
            if tinted and diffuse.texture >= 0:
                self.out.cannot("the mesh's colours are carried beside its material, which has a texture", "materials", row)
            plain = exported.surface.name == DEFAULT_MATERIAL  # of a mesh without a material, colours are written as they were read
            factor = (1.0, 1.0, 1.0) if plain else as_color(diffuse.value)
            tint = factor if tinted and diffuse.texture < 0 else None
            material = self._material(exported, row, sets, tinted, tint is not None, slabs is not None)
            self._written[key] = Written(material, sets, tint)
            if slabs is not None:
                self._networks.write(material, str(material.GetPath()), row, slabs, sets)
            elif not tinted and self._has_patterns(row):
                of_graphs = surface_of(self._with_graphs, row, carried, self._has_graph)
                self._networks.write_preview(material, str(material.GetPath()), row, of_graphs, sets, opacity_of(of_graphs))
        return self._written[key]

    def _material(self, exported: Exported, row: int, sets: TextureSets, tinted: bool, by_colors: bool, carried: bool) -> Any:  # fmt: skip
        s, path = exported.surface, f"{self._parent}/material{row}{'_colors' if tinted else ''}"
        material = UsdShade.Material.Define(self.stage, path)
        if s.name != f"material{row}":
            material.GetPrim().SetDisplayName(s.name)
        shader = UsdShade.Shader.Define(self.stage, f"{path}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        inputs: list[tuple[str, str, Input | None]] = [
            ("diffuseColor", "color", s.diffuse), ("metallic", "number", s.metallic), ("roughness", "number", s.roughness),
            ("emissiveColor", "color", s.emissive), ("occlusion", "number", s.occlusion), ("ior", "number", s.ior),
            ("specularColor", "color", s.specular), ("normal", "normal", s.normal),
        ]  # fmt: skip
        if s.coat.value[0] > 0:
            inputs += [("clearcoat", "number", s.coat), ("clearcoatRoughness", "number", s.coat_roughness)]
        if any(s.sheen.value) and not carried:
            self.out.cannot(losses.SHEEN, "materials", row)
        if s.specular is not None:
            shader.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
        if exported.diffuse_transmission is not None and not carried:
            self.out.cannot(losses.DIFFUSE_TRANSMISSION, "materials", row)
        if exported.body and not carried:
            self.out.cannot(losses.SUBSURFACE, "materials", row)
        if exported.transmission > 0 and not carried:
            self.out.cannot(losses.REFRACTION, "materials", row)
        presence = s.opacity != Input.number(1.0)
        inputs.append(("opacity", "number", opacity_of(exported)))
        if s.threshold > 0:
            shader.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(s.threshold)
        elif presence:
            shader.CreateInput("opacityMode", Sdf.ValueTypeNames.Token).Set("presence")
        for name, kind, slot in inputs:
            if by_colors and name == "diffuseColor":
                self._colors(shader, path)
            elif slot is not None:
                self._input(shader, path, name, kind, slot, sets)
        return material

    def _has_graph(self, texture: int) -> bool:
        return is_graph(self.tables, texture)

    def _has_patterns(self, row: int) -> bool:
        """Whether a material has a pattern that a graph says."""
        return any(map(self._has_graph, self._with_graphs.scene.tables.materials.textures[row].tolist()))

    def _colors(self, shader: Any, path: str) -> None:
        """The diffuse colour as that of the mesh."""
        reader = UsdShade.Shader.Define(self.stage, f"{path}/colors")
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(reader.ConnectableAPI(), "result")

    def _input(self, shader: Any, path: str, name: str, kind: str, value: Input, sets: TextureSets) -> None:
        type_, output = _TYPES[kind]
        slot = shader.CreateInput(name, type_)
        if value.texture >= 0 and self.tables.textures.kind[value.texture] == ir.TextureKind.FORMULA:
            value = Input(scale_color(value.value, TYPICAL))  # its graph is in the network of MaterialX
        if value.texture < 0:
            slot.Set(value.value[0] if kind == "number" else Gf.Vec3f(*value.value))
            return
        number, colored = sets.add(value.texture), name in ("diffuseColor", "emissiveColor", "specularColor")
        reader = UsdShade.Shader.Define(self.stage, f"{path}/st{number}")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(set_name(number))
        picture = UsdShade.Shader.Define(self.stage, f"{path}/{name}")
        picture.CreateIdAttr("UsdUVTexture")
        picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(self._file(value.texture, kind, colored, sets))
        picture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB" if colored else "raw")
        picture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        cells, textures = sets.has_cells(value.texture), self.tables.textures
        for axis, wrap in (("wrapS", textures.wrap_u), ("wrapT", textures.wrap_v)):
            mode = "repeat" if cells else _WRAPS[ir.Wrap(int(wrap[value.texture]))]
            picture.CreateInput(axis, Sdf.ValueTypeNames.Token).Set(mode)
        scale = (2.0, 2.0, 2.0) if kind == "normal" else value.value if kind == "color" else (value.value[0],) * 3
        picture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale, 1.0))
        if kind == "normal":
            picture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
            if value.value[0] != 1.0:
                self.out.cannot(losses.NORMAL_STRENGTH, "textures", value.texture)
        slot.ConnectToSource(picture.ConnectableAPI(), output)

    def _file(self, row: int, kind: str, colored: bool, sets: TextureSets) -> str:
        """The name of a picture's file, written once."""
        key = (row, "color" if colored else kind)
        if key not in self._files:
            pixels: NDArray[np.float32] = sets.pixels(row)
            name = f"{self._name}.{len(self.out.files)}.png"
            if sets.has_cells(row):
                pixels = pixels.repeat(CELL, axis=0).repeat(CELL, axis=1)
            self.out.files[name] = self._png(0.5 * pixels + 0.5 if kind == "normal" else pixels, color=colored)
            self._files[key] = f"./{name}"
        return self._files[key]


def with_graphs(baked: Baked) -> Export:
    """The scene whose baked materials have formulas in place of pictures, where nodes of MaterialX express them."""
    tables = baked.out.scene.tables
    values, textures = tables.materials.values.copy(), tables.materials.textures.copy()
    for row, source in baked.sources.items():
        for slot in PICTURED:
            if is_graph(tables, int(textures[source, slot])):
                values[row, slot], textures[row, slot] = values[source, slot], textures[source, slot]
    materials = tables.materials._replace(values=values, textures=textures)
    return replace(baked.out, scene=replace(baked.out.scene, tables=tables._replace(materials=materials)))


TYPICAL = 0.5  # that stands for a pattern where there are no graphs


def opacity_of(exported: Exported) -> Input:
    """The opacity of a surface; of glass it stands for what passes."""
    s = exported.surface
    if s.opacity != Input.number(1.0):
        return s.opacity
    return Input.number(min(1.0 - s.transmission, 1.0 - exported.transmission))


CELL = 16  # texels of the side of a cell: UsdUVTexture interpolates
