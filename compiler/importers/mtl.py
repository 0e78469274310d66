"""Reads MTL material libraries and converts them to materials.

Format: Wavefront's MTL Material Format (Ramey, Rose, Tyerman 1995). Where programs differ from it, these rules hold:

- `d` is opacity and overrides `Tr`. `Tr` is 1 − opacity, but both `Tr 1` and `Tr 0` mean opaque. Some programs (MeshLab among them)
  write opacity there, and nobody writes an invisible material.
- `Ns 0`, or no `Ns`, has no highlight. `Kd 0 0 0` with a `map_Kd` counts as white. Colours are linear; images are sRGB.
- `Pr`, `Pm`, `Pc` and their maps (Exocortex' PBR extension) make a `principled` material.
- `map_bump` is a height in the mesh's unit, times `-bm`. With an image whose channels differ it is a normal map, as many programs
  write; so is `norm`.
- illum 3, 5 and 8 reflect by `Ks`. 4, 6, 7 and 9 with `Ni` above 1 and a black `Kd`, or `Tf`, are glass.
- A partly transparent material that is not glass lets light pass straight, and keeps its highlights and emission. `Tf` tints that light;
  shadows are as dark as its darkest colour.
- `map_d` is an opacity map, mostly for cut-outs: its alpha if present, else its first channel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...lang import text_encoding
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..io.sandbox import FileError, Files
from ..scene import metallic_roughness, partial_coverage
from ..scene.builder import NONE, SceneBuilder
from ..scene.row_records import BLACK, WHITE, Color, Input, MaterialData, TextureData, nonnegative, scale_color
from . import images, mesh_tables, obj_lexer
from .common import file_names, number_text

REFLECTING = (3, 5, 8)
REFRACTING = (4, 6, 7, 9)
DEFAULT_KD: Color = (0.8, 0.8, 0.8)
_COLORS = {"Ka", "Kd", "Ks", "Ke", "Tf"}
_NUMBERS = {"Ns", "Ni", "d", "Tr", "illum", "sharpness", "Pr", "Pm", "Pc", "Pcr", "Ps"}
_MAPS = {"map_Ka": "Ka", "map_Kd": "Kd", "map_Ks": "Ks", "map_Ke": "Ke", "map_Ns": "Ns", "map_d": "d", "map_opacity": "d",
         "map_bump": "bump", "map_Bump": "bump", "bump": "bump", "norm": "norm", "map_Kn": "norm", "map_Pr": "Pr", "map_Pm": "Pm",
         "map_RMA": "RMA", "map_ORM": "ORM"}  # fmt: skip
_SHEEN_ROUGHNESS = Input.number(0.3)  # Ps has none of its own: that of `principled`
_PBR = {"Pr", "Pm", "Pc", "RMA", "ORM"}
DATA = -2
_PACKED = {"RMA": {"Pr": 0, "Pm": 1}, "ORM": {"Pr": 1, "Pm": 2}}  # channel of each input in a packed map
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1, "-type": 1, "-bm": 1, "-boost": 1, "-mm": 2}
_VECTOR_OPTIONS = ("-s", "-o", "-t")
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3, "l": -1, "z": -1}


@dataclass(slots=True)
class MapReference:
    """Image reference of a map_… line. uv' = scale · uv + offset; value = gain · texel + base."""

    file: str
    span: Span
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False
    channel: int = -1
    base: float = 0.0
    gain: float = 1.0
    height: float = 1.0  # -bm of a bump map


@dataclass(slots=True)
class MtlMaterial:
    """One material of a library, with its lines by keyword."""

    name: str
    span: Span
    folder: Path | None
    colors: dict[str, Color] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, MapReference] = field(default_factory=dict)

    @property
    def opacity(self) -> float:
        """Opacity by the rules for `d` and `Tr` in the module docstring."""
        opaque = self.numbers.get("d", 1.0 if self.numbers.get("Tr", 0.0) in (0.0, 1.0) else 1.0 - self.numbers["Tr"])
        return min(max(opaque, 0.0), 1.0)


def parse(data: bytes, file: str, folder: Path | None, diagnostics: Diagnostics) -> dict[str, MtlMaterial]:
    """The materials of a library by name. A malformed line is a warning; the rest of the material counts."""
    text = text_encoding.decode_any(data).replace("\x1a", "").replace("\r\n", "\n").replace("\r", "\n")
    materials: dict[str, MtlMaterial] = {}
    current: MtlMaterial | None = None
    warned: set[str] = set()
    for number, line in enumerate(text.split("\n"), 1):
        words = line.split(maxsplit=1)
        if not words or words[0].startswith("#"):
            continue
        keyword, rest = words[0], words[1].strip() if len(words) > 1 else ""
        start = line.index(keyword) + 1
        span = Span(file, number, start, number, len(line.rstrip()) + 1)
        if keyword == "newmtl":
            rest = obj_lexer.without_comment(rest)
            current = materials[rest] = MtlMaterial(rest, span, folder)
            continue
        message = "" if current is not None else f"`{keyword}` stands before the first `newmtl`"
        message = message or _line(current, keyword, rest, span)  # type: ignore[arg-type]
        if message and message not in warned:
            warned.add(message)
            diagnostics.warning(message, span)
    return materials


def _line(material: MtlMaterial, keyword: str, rest: str, span: Span) -> str:
    """Applies one line to a material. Returns an error message, or ""."""
    numbers = number_text.plain(rest.split("#")[0].encode())
    plain = numbers.text.decode()
    if keyword in _COLORS:
        color = _color(plain)
        if color is None:
            return f"`{keyword}` needs three numbers (spectra and CIE XYZ are not read)"
        material.colors[keyword] = nonnegative(color)
        if min(color) < 0:
            return f"material `{material.name}`: `{keyword}` has a negative component, which counts as 0"
        return numbers.warning
    elif keyword in _NUMBERS:
        number = _number(plain.replace("-halo", "").strip())
        if number is None:
            return f"`{keyword}` needs a number"
        material.numbers[keyword] = number
        return "`d -halo` is drawn without the halo" if "-halo" in plain else numbers.warning
    elif keyword in _MAPS:
        reference, problem = map_reference(rest, span)
        if reference is not None:
            material.maps[_MAPS[keyword]] = reference
        return f"`{keyword}`: {problem}" if problem else ""
    elif mesh_tables.MTL.find(keyword) is None:
        return f"MTL has no keyword `{keyword[:40]}`: the line is left out"
    return mesh_tables.MTL.report(f"`{keyword}`", keyword)


def _number(text: str) -> float | None:
    """A finite number; None for other text. An option of a map may have a decimal comma."""
    try:
        value = float(text.replace(",", ".", 1))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _color(text: str) -> Color | None:
    numbers = [_number(w) for w in text.split()]
    if len(numbers) == 1:
        numbers *= 3
    if len(numbers) < 3 or any(n is None for n in numbers[:3]):
        return None
    return (float(numbers[0] or 0), float(numbers[1] or 0), float(numbers[2] or 0))


def map_reference(text: str, span: Span) -> tuple[MapReference | None, str]:
    """Parses a map_… line: (reference with options and file name, error message or ""). File names may contain blanks."""
    reference = MapReference("", span)
    problem = ""
    while text.startswith("-"):
        words = text.split()
        option = words[0]
        count = _OPTIONS.get(option, 0)
        if option in _VECTOR_OPTIONS:
            count = next((k for k in range(3) if k + 1 >= len(words) or _number(words[k + 1]) is None), 3)
        if not count or len(words) <= count + 1:
            return None, f"no file name follows the option `{option}`" if count else f"the option `{option}` is not known"
        problem = problem or _option(reference, option, words[1 : count + 1])
        text = text.split(maxsplit=count + 1)[-1]
    reference.file = text.strip().strip('"')
    return (reference, problem) if reference.file else (None, "no file name")


def _option(reference: MapReference, option: str, words: list[str]) -> str:
    numbers = [_number(w) for w in words]
    if option in ("-s", "-o", "-mm", "-t", "-bm", "-boost") and any(n is None for n in numbers):
        return f"the option `{option}` needs numbers"
    values = [n or 0.0 for n in numbers]
    if option == "-s":
        reference.scale = (values[0], values[1] if len(values) > 1 else 1.0)
    elif option == "-o":
        reference.offset = (values[0], values[1] if len(values) > 1 else 0.0)
    elif option == "-mm":
        reference.base, reference.gain = values
    elif option == "-clamp":
        reference.clamp = words[0] == "on"
    elif option == "-imfchan":
        reference.channel = _CHANNELS.get(words[0], -1)
    elif option == "-bm":
        reference.height = values[0]
    elif words != ["off"] and any(n != 0 for n in numbers):
        return mesh_tables.MTL_OPTIONS.report(f"the option `{option}`", option)
    return ""


def row(material: MtlMaterial, builder: SceneBuilder, files: Files, diagnostics: Diagnostics) -> int:
    """The builder's row of a material. An unreadable image is a warning; its colour is used alone."""

    def texture(key: str, color: bool = True, channel: int = NONE) -> int:
        reference = material.maps.get(key)
        return -1 if reference is None else picture_row(reference, material.folder, color, channel, builder, files, diagnostics)

    data = _data(material, texture, builder)
    _tell_filter(material, data, diagnostics)
    return builder.material(data, material.span)


def _tell_filter(m: MtlMaterial, data: MaterialData, diagnostics: Diagnostics) -> None:
    """Messages on a coloured `Tf` of a see-through surface that is not glass."""
    r, g, b = m.colors.get("Tf", WHITE)
    if m.opacity == 1.0 or data.model == ir.MaterialModel.GLASS or (r, g, b) == WHITE:
        return
    if data.model not in (ir.MaterialModel.LAMBERT, ir.MaterialModel.BLINN_PHONG):
        diagnostics.warning(f"the `Tf` of material `{m.name}` is not drawn beside keys of the PBR extension: light passes white", m.span)
    elif ir.Slot.TRANSMISSION in data.inputs:
        diagnostics.note(f"the shadow of material `{m.name}` is grey: it is as dark as that of the darkest colour of its `Tf`", m.span)


def _data(m: MtlMaterial, texture: Callable[..., int], builder: SceneBuilder) -> MaterialData:
    inputs = _maps(m, texture, builder)
    illum = int(m.numbers.get("illum", 2))
    opacity, ior = Input.number(m.opacity), m.numbers.get("Ni", 1.0)
    if "d" in m.maps:
        map_d = texture("d", color=False)
        channel = builder.alpha_of(map_d) if m.maps["d"].channel < 0 else NONE
        opacity = Input.number(m.opacity, channel if channel != NONE else map_d)
    map_kd = texture("Kd")
    kd = m.colors.get("Kd", WHITE if map_kd >= 0 else DEFAULT_KD)
    if map_kd >= 0 and kd == BLACK:
        kd = WHITE
    holes = Input.number(1.0, opacity.texture)  # of glass and mirrors, whose `d` is another thing
    ka = m.colors.get("Ka", kd)
    ks = m.colors.get("Ks", BLACK)
    tint = m.colors.get("Tf", WHITE)
    if illum in REFRACTING and ior > 1.0 and (kd == BLACK or "Tf" in m.colors) and (m.opacity < 1.0 or kd == BLACK):
        inputs |= {ir.Slot.TRANSMISSION: Input(tint), ir.Slot.IOR: Input.number(ior)}
        return partial_coverage.with_opacity(MaterialData(ir.MaterialModel.GLASS, inputs, name=m.name), holes)
    if illum in REFLECTING and kd == BLACK and ks != BLACK:
        mirror = MaterialData(ir.MaterialModel.MIRROR, inputs | {ir.Slot.REFLECTION: Input(ks, texture("Ks"))}, name=m.name)
        return partial_coverage.with_opacity(mirror, holes)
    emissive = metallic_roughness.DARK
    if "Ke" in m.colors or "Ke" in m.maps:
        map_ke = texture("Ke")
        ke = m.colors.get("Ke", WHITE)
        emissive = Input(WHITE if map_ke >= 0 and ke == BLACK else ke, map_ke)
    if not _PBR.isdisjoint({*m.numbers, *m.maps}) or m.numbers.get("Ps", 0.0) > 0:
        return _principled(m, texture, Input(kd, map_kd), emissive, opacity, inputs)
    inputs[ir.Slot.DIFFUSE] = Input(kd, map_kd)
    map_ka = texture("Ka")
    inputs[ir.Slot.AMBIENT] = Input(ka, map_ka if map_ka >= 0 else map_kd)
    if emissive != metallic_roughness.DARK:
        inputs[ir.Slot.EMISSION] = emissive
    model = ir.MaterialModel.LAMBERT
    if illum >= 2 and m.numbers.get("Ns", 0.0) > 0 and (ks != BLACK or "Ks" in m.maps):
        model = ir.MaterialModel.BLINN_PHONG
        inputs[ir.Slot.SPECULAR] = Input(ks, texture("Ks"))
        inputs[ir.Slot.SHININESS] = Input.number(m.numbers["Ns"], texture("Ns", color=False))
    if illum in REFLECTING and ks != BLACK:
        model = ir.MaterialModel.BLINN_PHONG
        inputs[ir.Slot.REFLECTION] = Input(ks, texture("Ks"))
    data = partial_coverage.passing(MaterialData(model, inputs, name=m.name), opacity, tint)
    return replace(data, model=ir.MaterialModel.BLINN_PHONG) if ir.Slot.TRANSMISSION in data.inputs else data


def _principled(
    m: MtlMaterial, texture: Callable[..., int], diffuse: Input, emissive: Input, opacity: Input, inputs: dict[ir.Slot, Input]
) -> MaterialData:
    """A material with keys of the PBR extension."""

    def number(key: str, plain: float) -> Input:
        packed, channel = next(((name, parts[key]) for name, parts in _PACKED.items() if name in m.maps and key in parts), (key, -1))
        row = texture(packed, color=False, channel=channel)
        return Input.number(m.numbers.get(key, 1.0 if row >= 0 else plain), row)

    sheen = min(max(m.numbers.get("Ps", 0.0), 0.0), 1.0)
    surface = metallic_roughness.Surface(
        diffuse, number("Pm", 0.0), number("Pr", 0.5), Input.number(m.numbers.get("Ni", 1.5)), None, emissive, number("Pc", 0.0),
        number("Pcr", 0.01), opacity=opacity, highlights_stay=True, normal=inputs.get(ir.Slot.NORMAL),
        bump=inputs.get(ir.Slot.BUMP), sheen=Input(scale_color(WHITE, sheen)), sheen_roughness=_SHEEN_ROUGHNESS, name=m.name,
    )  # fmt: skip
    return metallic_roughness.material(surface)


def _maps(m: MtlMaterial, texture: Callable[..., int], builder: SceneBuilder) -> dict[ir.Slot, Input]:
    """Normal and bump maps of a material."""
    for key in ("norm", "bump"):
        row = texture(key, color=False)
        if row >= 0 and (key == "norm" or builder.channels_differ(row)):
            normal_map = texture(key, color=False, channel=DATA)
            return {ir.Slot.NORMAL: Input(WHITE, builder.with_levels(normal_map, scale_color(WHITE, 2.0), scale_color(WHITE, -1.0)))}
        if row >= 0:
            return {ir.Slot.BUMP: Input.number(m.maps[key].height, row)}
    return {}


def picture_row(
    reference: MapReference, folder: Path | None, color: bool, channel: int, builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> int:
    """The texture row of an image reference: a colour, a channel, or all channels as DATA.

    The channel is that of the file (`-imfchan`), else `channel`.
    """
    if folder is None:
        diagnostics.warning(f"the picture `{reference.file}` is not read: its mesh has no folder", reference.span)
        return -1
    try:
        picture = images.row(builder, file_names.find(reference.file, folder, files, "picture"), color=color, span=reference.span)
    except (FileError, images.ImageError) as failure:
        diagnostics.warning(failure.message, reference.span, failure.hint)
        return -1
    wrap = ir.Wrap.CLAMP if reference.clamp else ir.Wrap.REPEAT
    frame = ((reference.scale[0], 0.0, reference.offset[0]), (0.0, reference.scale[1], reference.offset[1]))
    if channel == NONE or reference.channel >= 0:
        channel = reference.channel if reference.channel >= 0 or color else 0
    data = TextureData(
        ir.TextureKind.IMAGE, picture, wrap_u=wrap, wrap_v=wrap, channel=max(channel, -1), frame=frame,
        gain=scale_color(WHITE, reference.gain), bias=scale_color(WHITE, reference.base),
    )  # fmt: skip
    return builder.texture(data, reference.span)
