"""OpenPBR Surface 1.1: slabs of fuzz, coat, metal and dielectric. Its element has the names and the defaults of the specification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import NOTHING
from ..compiler.scene.row_records import BLACK, WHITE, Color, Input, MaterialData, MediumData, as_color, scale_color
from ..lang.schema.argument_types import Arg, Entry
from . import losses, subsurface
from .arguments import SURFACE
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow
from .glass import KHRONOS, MOST_DISPERSION

MODEL = ir.MaterialModel.OPENPBR
Slot = ir.Slot
DARKEST = 1e-6  # least component of a colour inside: 0 has infinite absorption
NUMBERS: Mapping[str, tuple[ir.Slot, float, float | None, str]] = {
    "base_weight": (Slot.BASE_WEIGHT, 1.0, None, "factor of the base colour"),
    "base_metalness": (Slot.METALLIC, 0.0, 1.0, "0: dielectric, 1: metal"),
    "base_diffuse_roughness": (Slot.DIFFUSE_ROUGHNESS, 0.0, 1.0, "roughness of the diffuse base: 0 as Lambert, 1 as dust"),
    "specular_weight": (Slot.SPECULAR_WEIGHT, 1.0, 1.0, "factor of the reflectance of the base at normal incidence"),
    "specular_roughness": (Slot.ROUGHNESS, 0.3, 1.0, "0: polished, 1: fully rough"),
    "specular_ior": (Slot.IOR, 1.5, None, "index of refraction of the dielectric base"),
    "specular_roughness_anisotropy": (Slot.ANISOTROPY, 0.0, 1.0, "0: round highlights, 1: lines along the tangent"),
    "specular_rotation": (Slot.ROTATION, 0.0, None, "turns from the surface's u to the tangent: 0.25 is a right angle"),
    "coat_weight": (Slot.COAT, 0.0, 1.0, "weight of the clear coat"),
    "coat_roughness": (Slot.COAT_ROUGHNESS, 0.0, 1.0, "roughness of the coat, which also roughens the base"),
    "coat_ior": (Slot.COAT_IOR, 1.6, None, "index of refraction of the coat"),
    "coat_roughness_anisotropy": (Slot.COAT_ANISOTROPY, 0.0, 1.0, "anisotropy of the coat's highlight"),
    "coat_rotation": (Slot.COAT_ROTATION, 0.0, None, "turns from the surface's u to the tangent of the coat"),
    "coat_darkening": (Slot.COAT_DARKENING, 1.0, 1.0, "how much the coat darkens and saturates the base by light that it sends back"),
    "fuzz_weight": (Slot.FUZZ, 0.0, 1.0, "weight of the fuzz of fibres or dust over all"),
    "fuzz_roughness": (Slot.FUZZ_ROUGHNESS, 0.5, 1.0, "roughness of the fuzz"),
    "transmission_weight": (Slot.TRANSMISSION_WEIGHT, 0.0, 1.0, "share of the dielectric that light passes, as glass"),
    "subsurface_weight": (Slot.SUBSURFACE_WEIGHT, 0.0, 1.0, "share of the opaque dielectric that light scatters in"),
    "thin_film_weight": (Slot.FILM, 0.0, 1.0, "weight of a thin film on the base, under the coat: soap, oil, oxide"),
    "thin_film_thickness": (Slot.FILM_THICKNESS, 0.5, None, "thickness of the film in micrometres"),
    "thin_film_ior": (Slot.FILM_IOR, 1.4, None, "index of refraction of the film"),
}
"""Arguments that are numbers: slot, default, maximum, meaning."""
COLORS: Mapping[str, tuple[ir.Slot, float, str]] = {
    "base_color": (Slot.DIFFUSE, 0.8, "colour of the diffuse base; of metals, their reflectance at normal incidence"),
    "specular_color": (Slot.SPECULAR, 1.0, "of metals the tint at grazing angles; of dielectrics the tint of the highlight"),
    "coat_color": (Slot.COAT_COLOR, 1.0, "colour of white light that has passed the coat twice"),
    "fuzz_color": (Slot.FUZZ_COLOR, 1.0, "colour of the fuzz"),
    "transmission_color": (Slot.TRANSMISSION_COLOR, 1.0, "colour after `transmission_depth`; without a depth, tint of what passes"),
    "subsurface_color": (Slot.SUBSURFACE_COLOR, 0.8, "share of the light that leaves a thick body of it"),
}
"""Arguments that are colours: slot, default, meaning."""
_ORDER = (
    "base_color", "base_weight", "base_metalness", "base_diffuse_roughness", "specular_weight", "specular_color", "specular_roughness",
    "specular_ior", "specular_roughness_anisotropy", "specular_rotation", "coat_weight", "coat_color", "coat_roughness", "coat_ior",
    "coat_roughness_anisotropy", "coat_rotation", "coat_darkening", "fuzz_weight", "fuzz_color", "fuzz_roughness",
    "transmission_weight", "transmission_color", "subsurface_weight", "subsurface_color", "thin_film_weight", "thin_film_thickness",
    "thin_film_ior",
)  # fmt: skip


def data(inputs_by_slot: Mapping[ir.Slot, Input], **more: Any) -> MaterialData:
    """A row from inputs by slot; those that are missing have the default of the specification."""
    inputs = {slot: Input.number(default) for slot, default, _, _ in NUMBERS.values()}
    inputs |= {slot: Input((grey, grey, grey)) for slot, grey, _ in COLORS.values()}
    return MaterialData(MODEL, inputs | dict(inputs_by_slot), **more)


_CLEAR: Mapping[ir.Slot, float] = {
    Slot.TRANSMISSION_WEIGHT: 1.0, Slot.THIN_WALLED: 0.0, Slot.METALLIC: 0.0, Slot.ANISOTROPY: 0.0, Slot.COAT: 0.0, Slot.FUZZ: 0.0,
    Slot.FILM: 0.0, Slot.SPECULAR_WEIGHT: 1.0, Slot.SPECULAR: 1.0, Slot.EMISSION: 0.0,
}  # fmt: skip
"""Inputs of slabs that are glass and nothing else."""


def simplified(row: MaterialData) -> MaterialData:
    """Glass in place of slabs that are nothing else: it has dispersion and priorities, and takes less time."""
    for slot, value in _CLEAR.items():
        entry = row.inputs.get(slot, Input.number(0.0))
        if entry.texture >= 0 or any(component != value for component in entry.value[: 3 if slot in _COLORED else 1]):
            return row
    inputs = {slot: entry for slot, entry in row.inputs.items() if slot in _OF_GLASS}
    inputs |= {Slot.TRANSMISSION: row.inputs[Slot.TRANSMISSION_COLOR], Slot.PRIORITY: Input.number(0.0), Slot.ABSORPTION: Input(BLACK)}
    return replace(row, model=ir.MaterialModel.GLASS, inputs=inputs)


_COLORED = (Slot.SPECULAR, Slot.EMISSION)
_OF_GLASS = (Slot.IOR, Slot.ROUGHNESS, Slot.DISPERSION, Slot.NORMAL, Slot.BUMP, Slot.OPACITY)


def _lower(arguments: Arguments) -> MaterialData:
    color = arguments.color("emission_color")
    inputs = {slot: arguments.number(name) for name, (slot, *_) in NUMBERS.items()}
    inputs |= {slot: arguments.color(name) for name, (slot, *_) in COLORS.items()}
    inputs[Slot.EMISSION] = Input(scale_color(color.value, arguments.args["emission_luminance"]), color.texture)
    inputs[Slot.THIN_WALLED] = Input.number(float(arguments.args["geometry_thin_walled"]))
    if (normal := _coat_normal(arguments)) is not None:
        inputs[Slot.COAT_NORMAL] = normal
    if arguments.args["geometry_thin_walled"]:
        _thin_walled(arguments)
        inputs[Slot.SUBSURFACE_ANISOTROPY] = Input.number(arguments.args["subsurface_scatter_anisotropy"])
        return _with_dispersion(arguments, data(inputs))
    row = simplified(data(inputs, medium=_medium(arguments, inputs)))
    return _with_dispersion(arguments, row)


def _with_dispersion(arguments: Arguments, row: MaterialData) -> MaterialData:
    scale, abbe = arguments.args["transmission_dispersion_scale"], arguments.args["transmission_dispersion_abbe_number"]
    if scale == 0.0:
        return row
    if row.model != ir.MaterialModel.GLASS:
        message = "openpbr: `transmission_dispersion_scale` counts in glass alone: `transmission_weight: 1` without film, coat or fuzz"
        arguments.error(message, "leave it out, or leave out the others")
        return row
    return replace(row, inputs={**row.inputs, Slot.DISPERSION: Input.number(min(KHRONOS * scale / abbe, MOST_DISPERSION))})


def _coat_normal(arguments: Arguments) -> Input | None:
    """The normal of a coat that has its own, else None."""
    picture, smooth = arguments.args["geometry_coat_normal"], arguments.args["geometry_coat_smooth"]
    if picture is not None and smooth:
        arguments.error("openpbr: `geometry_coat_normal` and `geometry_coat_smooth` are given at once", "leave out one of them")
    return arguments.normals(picture) if picture is not None else (SMOOTH_COAT if smooth else None)


SMOOTH_COAT = Input((0.0, 0.0, 1.0))  # of COAT_NORMAL, without a texture
INSIDE = (("transmission_depth", 0.0), ("transmission_scatter", (0.0, 0.0, 0.0)), ("transmission_scatter_anisotropy", 0.0))


def _is_set(entry: Input) -> bool:
    return entry.texture >= 0 or entry.value[0] > 0.0


def _thin_walled(arguments: Arguments) -> None:
    """Report arguments of an inside, which a thin wall has not."""
    for name, default in INSIDE:
        if arguments.args[name] != default:
            arguments.error(f"openpbr: `{name}` is that of an inside, and a thin wall has none", f"leave out `{name}`")


def _medium(arguments: Arguments, inputs: dict[ir.Slot, Input]) -> int:
    """The row of the medium inside, -1 without; with errors for what has no effect."""
    clear, spread = _is_set(inputs[Slot.TRANSMISSION_WEIGHT]), _is_set(inputs[Slot.SUBSURFACE_WEIGHT])
    if clear and spread:
        message = "openpbr: `transmission_weight` and `subsurface_weight` are both above 0, and a shape is filled by one medium"
        arguments.error(message, "leave out one of them, or give `geometry_thin_walled: true`")
        return -1
    if clear and arguments.args["transmission_depth"] > 0.0:
        return _murky(arguments, inputs)
    for name, default in reversed(INSIDE):
        if arguments.args[name] != default:
            needed = "`transmission_depth`" if clear else "`transmission_weight`"
            arguments.error(f"openpbr: `{name}` has no effect without {needed}", f"give {needed}, or leave out `{name}`")
            return -1
    return _body(arguments, inputs) if spread else -1


def _murky(arguments: Arguments, inputs: dict[ir.Slot, Input]) -> int:
    """What absorbs white light to `transmission_color` in `transmission_depth`, and scatters `transmission_scatter` of it."""
    color, depth = inputs[Slot.TRANSMISSION_COLOR], arguments.args["transmission_depth"]
    if color.texture >= 0:
        arguments.error("openpbr: `transmission_color` is that of the inside, which has one colour", "leave out `transmission_depth`")
        return -1
    inputs[Slot.TRANSMISSION_COLOR] = Input(WHITE)
    extinction = -np.log(np.maximum(np.array(color.value), DARKEST)) / depth
    scattering = np.array(arguments.args["transmission_scatter"]) / depth
    absorption = np.maximum(extinction - scattering, 0.0) if np.all(extinction >= scattering) else extinction - scattering
    absorption = absorption - min(float(absorption.min()), 0.0)
    anisotropy = arguments.args["transmission_scatter_anisotropy"]
    return arguments.medium(MediumData(as_color(scattering), as_color(absorption), anisotropy=anisotropy))


def _body(arguments: Arguments, inputs: dict[ir.Slot, Input]) -> int:
    """The medium of a body of `subsurface_color`."""
    color, lengths = inputs[Slot.SUBSURFACE_COLOR], arguments.args["subsurface_radius"]
    if color.texture >= 0:
        hint = "use subsurface(…), whose colour takes pictures, in a blend(…)"
        arguments.error("openpbr: `subsurface_color` of a solid body is one colour", hint)
        return -1
    anisotropy = arguments.args["subsurface_scatter_anisotropy"]
    red, green, blue = (lengths * max(share, 1e-4) for share in arguments.args["subsurface_radius_scale"])
    coat = [inputs[slot] for slot in (Slot.COAT, Slot.COAT_IOR, Slot.COAT_DARKENING)]
    shown = color.value if any(each.texture >= 0 for each in coat) else darkened(color.value, *(each.value[0] for each in coat))
    scattering, absorption = subsurface.of_free_path(shown, (red, green, blue), anisotropy)
    return arguments.medium(MediumData(scattering, absorption, anisotropy=anisotropy))


def _argument(name: str) -> Arg:
    keyword = name != "base_color"
    if name in COLORS:
        _, grey, meaning = COLORS[name]
        return Arg(name, "color_map", (grey, grey, grey), meaning, keyword=keyword)
    slot, default, most, meaning = NUMBERS[name]
    if slot in (Slot.IOR, Slot.COAT_IOR, Slot.FILM_IOR):
        return Arg(name, "number_map", default, meaning, above=0.0, keyword=True)
    least = None if slot in (Slot.ROTATION, Slot.COAT_ROTATION) else 0.0
    return Arg(name, "number_map", default, meaning, minimum=least, maximum=most, keyword=True)


def _phase(name: str, meaning: str) -> Arg:
    return Arg(name, "number", 0.0, f"mean cosine {meaning}: -1 back, 1 forward", above=-1.0, below=1.0, keyword=True)


ELEMENTS = (
    Element(
        Entry(
            "openpbr",
            "material",
            "OpenPBR Surface 1.1: a mix of metal, glass, body and diffuse base under a thin film, a coat and fuzz",
            (
                *map(_argument, _ORDER),
                Arg("transmission_depth", "length", 0.0, "length that `transmission_color` refers to; 0: none", minimum=0.0, keyword=True),
                Arg("transmission_scatter", "color", (0.0, 0.0, 0.0), "colour that it scatters over `transmission_depth`", keyword=True),
                _phase("transmission_scatter_anisotropy", "of light that the inside scatters"),
                Arg(
                    "transmission_dispersion_scale", "number", 0.0, "strength of the dispersion of glass; 1: of this Abbe number",
                    minimum=0.0, maximum=1.0, keyword=True,
                ),
                Arg("transmission_dispersion_abbe_number", "number", 20.0, "Abbe number: diamond 55, flint 36", above=0.0, keyword=True),
                Arg("subsurface_radius", "length", 0.01, "mean free path of light in a body", above=0.0, keyword=True),
                Arg("subsurface_radius_scale", "color", (1.0, 0.5, 0.25), "factors of the radius in red, green and blue", keyword=True),
                _phase("subsurface_scatter_anisotropy", "of light that a body scatters; of a thin wall, its share that passes"),
                Arg("geometry_thin_walled", "bool", False, "a wall without an inside: light passes straight or diffusely", keyword=True),
                Arg(
                    "geometry_coat_normal", "texture", None, "a normal map of the coat alone, which `normal_map` then leaves as it is",
                    keyword=True,
                ),
                Arg(
                    "geometry_coat_smooth", "bool", False, "the coat lies smoothly over a base with a `normal_map`, as varnish does",
                    keyword=True,
                ),
                Arg("emission_luminance", "luminance", 0.0, "nit where `emission_color` is 1", minimum=0.0, keyword=True),
                Arg("emission_color", "color_map", (1.0, 1.0, 1.0), "colour of the light that it emits", keyword=True),
                *SURFACE,
            ),
            example="sphere(1, material: openpbr(#a02818, specular_roughness: 0.2, coat_weight: 1))",
        ),
        _lower,
    ),
)
LOBES, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.SLABS, Slot.DIFFUSE, None, False
SLOTS = (
    *(slot for slot, *_ in NUMBERS.values()), *(slot for slot, *_ in COLORS.values()), Slot.EMISSION, Slot.THIN_WALLED,
    Slot.SUBSURFACE_ANISOTROPY, Slot.FLAKE_SIZE, Slot.FLAKE_TILT, Slot.FLAKE_COVERAGE, Slot.FLAKE_SEED, Slot.COAT_NORMAL,
)  # fmt: skip
LOBE = facets = None


def _number(row: Any, slot: ir.Slot) -> float:
    return float(row.value(slot)[0])


def _color(row: Any) -> Input:
    """The base colour times its weight."""
    color = row.input(Slot.DIFFUSE)
    return Input(scale_color(color.value, _number(row, Slot.BASE_WEIGHT)), color.texture)


def _roughness(row: Any) -> Input:
    """The roughness of the base; where it has flakes, that of all flakes together, as they look from far."""
    rough = row.input(Slot.ROUGHNESS)
    if _number(row, Slot.FLAKE_SIZE) == 0.0 or rough.texture >= 0 or row.texture(Slot.FLAKE_TILT) >= 0:
        return rough
    return Input.number(min((_number(row, Slot.ROUGHNESS) ** 4 + _number(row, Slot.FLAKE_TILT) ** 4) ** 0.25, 1.0))


def darkened(color: Color, weight: float, coat_ior: float, darkening: float) -> Color:
    """The colour of a body below a coat, by which it is darker for what the coat reflects back: OpenPBR Surface 1.1, Coat darkening."""
    square = max(coat_ior, 1.0) ** 2
    back = 1.0 - (1.0 - ((coat_ior - 1.0) / (coat_ior + 1.0)) ** 2) / square
    share = min(max(weight, 0.0), 1.0) * min(max(darkening, 0.0), 1.0)
    r, g, b = (c * (1.0 - share + share * (1.0 - back) / (1.0 - c * back)) for c in color)
    return r, g, b


def below_coat(ior: float, weight: float, coat_ior: float) -> float:
    """The index of a base whose highlight below a coat is that of `ior` below air: what models without OpenPBR's coat say."""
    return ior * (1.0 + min(max(weight, 0.0), 1.0) * (max(coat_ior, 1.0) - 1.0))


def _ior_below_air(row: Any) -> Input:
    """The inverse of `below_coat`: the index, at least 1, that gives the highlight of the base below air."""
    if row.texture(Slot.IOR) >= 0 or row.texture(Slot.COAT) >= 0 or row.texture(Slot.COAT_IOR) >= 0:
        return row.ior
    ratio = _number(row, Slot.IOR) / below_coat(1.0, _number(row, Slot.COAT), _number(row, Slot.COAT_IOR))
    return Input.number(max(ratio, 1.0 / ratio))


def _report(row: Any, *carried: ir.Slot) -> None:
    """Report each input that is set and that the format lacks."""
    if _number(row, Slot.FLAKE_SIZE) > 0.0:
        row.cannot(losses.FLAKES)
    plain = {slot: (value, value, value) for slot, value, _ in COLORS.values()}
    plain |= {slot: (default, 0.0, 0.0) for slot, default, *_ in NUMBERS.values()}
    parts = {Slot.COAT: COAT, Slot.FUZZ: FUZZ, Slot.FILM: FILM}
    if row.value(Slot.COAT_NORMAL)[2] > 0.0 and Slot.COAT_NORMAL not in carried and _number(row, Slot.COAT) > 0.0:
        row.cannot(losses.COAT_NORMAL)
    parts |= {Slot.TRANSMISSION_WEIGHT: (Slot.TRANSMISSION_COLOR,), Slot.SUBSURFACE_WEIGHT: (Slot.SUBSURFACE_COLOR,)}
    for name, slot in {name: slot for name, (slot, *_) in {**NUMBERS, **COLORS}.items()}.items():
        owner = next((weight for weight, slots in parts.items() if slot in slots), None)
        if slot in carried or (owner is not None and _number(row, owner) == 0.0 and row.texture(owner) < 0):
            continue
        numbers = row.value(slot)[:1] if name in NUMBERS else row.value(slot)
        if row.texture(slot) >= 0 or not np.allclose(numbers, plain[slot][: len(numbers)]):
            row.cannot(losses.argument(name))


COAT = (Slot.COAT_COLOR, Slot.COAT_ROUGHNESS, Slot.COAT_IOR, Slot.COAT_ANISOTROPY, Slot.COAT_ROTATION, Slot.COAT_DARKENING)
FUZZ, FILM = (Slot.FUZZ_COLOR, Slot.FUZZ_ROUGHNESS), (Slot.FILM_THICKNESS, Slot.FILM_IOR)
_BASE = (Slot.DIFFUSE, Slot.BASE_WEIGHT, Slot.METALLIC, Slot.ROUGHNESS)


def surface(row: SurfaceRow) -> Exported:
    """A metallic–roughness surface with a coat, and with fuzz as sheen; glass, where all light passes it."""
    carried = (Slot.IOR, Slot.COAT, Slot.COAT_ROUGHNESS, Slot.FUZZ, Slot.FUZZ_COLOR, Slot.FUZZ_ROUGHNESS)
    if _number(row, Slot.TRANSMISSION_WEIGHT) == 1.0 and row.texture(Slot.TRANSMISSION_WEIGHT) < 0:
        _report(row, *carried, *_BASE, Slot.TRANSMISSION_WEIGHT, Slot.TRANSMISSION_COLOR)
        return Exported(row.surface(row.input(Slot.TRANSMISSION_COLOR), NOTHING, _roughness(row), row.ior), 1.0)
    _report(row, *_BASE, *carried)
    fuzz, weight = row.input(Slot.FUZZ_COLOR), _number(row, Slot.FUZZ)
    if weight > 0.0:
        row.note(losses.FUZZ)
    return Exported(
        row.surface(
            _color(row), row.input(Slot.METALLIC), _roughness(row), _ior_below_air(row), emissive=row.input(Slot.EMISSION),
            coat=row.input(Slot.COAT), coat_roughness=row.input(Slot.COAT_ROUGHNESS),
            coat_normal=row.input(Slot.COAT_NORMAL) if row.value(Slot.COAT_NORMAL)[2] > 0.0 else None,
            sheen=Input(scale_color(fuzz.value, weight), fuzz.texture), sheen_roughness=row.input(Slot.FUZZ_ROUGHNESS),
        )
    )  # fmt: skip


def mitsuba(row: MitsubaRow) -> Any:
    """Mitsuba's `principled`, whose diffuse base and coat are others."""
    row.cannot("`openpbr` is carried as Mitsuba's `principled`, whose diffuse base and coat are others")
    _report(row, *_BASE, Slot.IOR, Slot.COAT, Slot.COAT_ROUGHNESS, Slot.ANISOTROPY)
    eta, coat = float(np.clip(_number(row, Slot.IOR), 1.01, 2.0)), _number(row, Slot.COAT)
    inputs = (
        row.color("base_color", Slot.DIFFUSE, _number(row, Slot.BASE_WEIGHT)), row.number("roughness", Slot.ROUGHNESS),
        row.number("metallic", Slot.METALLIC), row.number("anisotropic", Slot.ANISOTROPY),
        row.constant("clearcoat_gloss", 1.0 - _number(row, Slot.COAT_ROUGHNESS)),
    )  # fmt: skip
    return row.two_sided(row.bsdf("principled", *inputs, eta=eta, clearcoat=coat))


def povray(row: PovrayRow) -> Finish:
    """A diffuse base beside a mirror of the same colour, weighted by `base_metalness`."""
    metal = float(np.clip(_number(row, Slot.METALLIC), 0.0, 1.0))
    row.cannot(losses.FACETS, "lambert(…), phong(…) or mirror(…) are")
    _report(row, *_BASE, Slot.IOR)
    if row.value(Slot.EMISSION).max() > 0:
        row.cannot(losses.EMISSION)
    words = [f"diffuse {row.numeral(1.0 - metal)}", f"ambient rgb <{row.vector((1.0 - metal) * row.ambient)}>"]
    if metal > 0.0 and row.bounces > 0:
        words.append(f"reflection {{ rgb {row.numeral(metal)} metallic 1 }}")
    return Finish(Slot.DIFFUSE, " ".join(words))
