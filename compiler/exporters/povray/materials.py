"""Exports materials as POV-Ray pigments and finishes. Equations agree, but POV-Ray's highlights have no colour."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....lights import AMBIENT
from ....materials import losses
from ... import ir
from ...plan.plan import Plan
from ...scene import scattering_albedo
from .. import number_text, texture_values
from ..export import Export
from ..media import medium_of
from ..number_text import number
from ..placement import F64
from ..surfaces import MaterialRow


class Look(NamedTuple):
    """Exported material."""

    pigment: str  # PLACE marks the position of its surface mapping
    texture: int  # the texture row of the pigment, or -1
    finish: str
    more: list[str]  # interior lines of the object
    glass: bool


class PovrayRow(MaterialRow):
    """A row as a pigment and a finish."""

    def __init__(self, out: Export, row: int, bounces: int, ambient: F64) -> None:
        super().__init__(out, row)
        self.bounces, self.ambient = bounces, ambient

    def numeral(self, value: float) -> str:
        return number(value)

    def vector(self, values: Any) -> str:
        return number_text.numbers(values)


class Finishes:
    """Finishes of materials, and the images they use."""

    def __init__(self, out: Export, plan: Plan, name: str) -> None:
        self.out, self.plan, self.name, self.tables = out, plan, name, out.scene.tables
        lights = self.tables.lights
        self.ambient = lights.color[ir.is_in(lights.kind, AMBIENT)].sum(axis=0) if len(lights.kind) else np.zeros(3)
        self._pictures: dict[tuple[int, bytes], str] = {}

    def look(self, material: int) -> Look:
        """A material's pigment and finish; of a blend, those of the part that counts more."""
        row = PovrayRow(self.out, material, int(self.plan["bounces"]), self.ambient)
        row.reports_vertex_light()
        if row.module.povray is None:
            row.cannot(losses.BLEND)
            return self.look(int((row.materials.second if row.value(ir.Slot.WEIGHT)[0] > 0.5 else row.materials.first)[material]))
        texture_text = row.module.povray(row)
        for slot in (*row.module.SLOTS, ir.Slot.NORMAL, ir.Slot.BUMP):
            if row.materials.textures[material, slot] >= 0 and slot not in (texture_text.pigment, ir.Slot.AMBIENT):
                row.cannot(losses.texture(slot))
        texture = -1 if texture_text.pigment is None else row.texture(texture_text.pigment)
        inside = " ".join(text for text in (texture_text.interior, self._medium(material)) if text)
        interior = [f"  interior {{ {inside} }}"] if inside else []
        interior += ["  hollow"] if "media" in inside else []
        constant = np.zeros(3) if texture_text.pigment is None else row.value(texture_text.pigment)
        pigment = self._pigment(texture, constant, " filter 1" if texture_text.filters else "")
        return Look(pigment, -1 if texture_text.filters else texture, f"finish {{ {texture_text.words} }}", interior, texture_text.filters)

    def _medium(self, material: int) -> str:
        """The `media` inside of a material. Its light is that of a lamp over 4, as ours are divided by π: scattering is, too."""
        inside = None if self.out.bodies[material] else medium_of(self.out, material)
        if inside is None or max(scattering_albedo.extinction(inside)) <= 0.0:
            return ""
        parts = []
        if max(inside.scattering) > 0.0:
            self.out.cannot(losses.SCATTERS_ONCE, "media", int(self.tables.materials.medium[material]))
            phase, form = ("5", f" eccentricity {number(inside.anisotropy)}") if inside.anisotropy else ("1", "")
            color = number_text.numbers(np.divide(inside.scattering, 4.0))
            parts.append(f"scattering {{ {phase}, rgb <{color}> extinction 4{form} }}")
        if max(inside.absorption) > 0.0:
            parts.append(f"absorption rgb <{number_text.numbers(np.array(inside.absorption))}>")
        return f"media {{ {' '.join(parts)} }}"

    def _pigment(self, row: int, constant: F64, clear: str) -> str:
        """A colour, a checker or an image."""
        if row < 0 or clear:
            return f"rgb <{number_text.numbers(constant)}>{clear}"
        if self.tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._image(row, constant)
        a, b = texture_values.cell_colors(self.tables, row, constant)
        return f"checker rgb <{number_text.numbers(a)}>, rgb <{number_text.numbers(b)}> PLACE"

    def _image(self, row: int, constant: F64) -> str:
        textures = self.tables.textures
        if textures.wrap_u[row] != ir.Wrap.REPEAT or textures.wrap_v[row] != ir.Wrap.REPEAT:
            self.out.cannot("a texture that does not repeat is not carried", "textures", row)
        pixels = texture_values.picture(self.tables, row, constant)
        if pixels.max(initial=0.0) > 1.0:
            self.out.cannot("a texture brighter than 1 is not carried", "textures", row)
        key = (row, constant.tobytes())
        if key not in self._pictures:
            self._pictures[key] = f"{self.name}.{len(self.out.files)}.ppm"
            self.out.files[self._pictures[key]] = ppm(pixels)
        smooth = "" if textures.nearest[row] else " interpolate 2"
        return f'image_map {{ ppm "{self._pictures[key]}" gamma 1.0{smooth} }} PLACE'


def ppm(pixels: np.ndarray) -> bytes:
    """A binary PPM with 16 bits a channel from (height, width, 3) linear pixels from the top, clipped to 0…1."""
    height, width = pixels.shape[:2]
    return f"P6\n{width} {height}\n65535\n".encode() + np.rint(np.clip(pixels, 0.0, 1.0) * 65535.0).astype(">u2").tobytes()
