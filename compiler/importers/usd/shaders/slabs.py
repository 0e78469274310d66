"""Surface shaders as slabs of OpenPBR: open_pbr_surface, standard_surface and disney_principled; and the rows of slabs.

Sources: MaterialX 1.39's graphs of these shaders; Gulbrandsen, "Artist Friendly Metallic Fresnel", JCGT 2014, for metals by an
edge colour.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from .....lang.diagnostics import Span
from .....materials import openpbr, subsurface
from .....materials.glass import KHRONOS
from .... import ir
from ....scene import partial_coverage
from ....scene.builder import SceneBuilder
from ....scene.row_records import BLACK, WHITE, Color, Input, MaterialData, MediumData, as_color, scale_color
from ...materialx.physical import NARROWEST
from . import conty_kulla, directions
from .arithmetic import Arithmetic, is_zero, numbers
from .shader_inputs import DEFAULTS, DEPENDENT, EXTRA, GLTF, MORE_THAN_PRINCIPLED, OPEN, PARTS, PREVIEW, SHADERS, THIN

Slot = ir.Slot
Tell = Callable[[str], None]
KEY, NORMAL = "slabs", "normal"  # of Network.inputs: a surface of slabs; its normal
_COAT = "geometry_coat_normal"
_OPAQUE = {"transmission_weight": 0.0, "subsurface_weight": 0.0}
_INDICES = {  # of refraction, with the weights of what they change
    "specular_ior": ("specular_weight", "transmission_weight", "subsurface_weight"), "coat_ior": ("coat_weight",),
    "thin_film_ior": ("thin_film_weight",),
}  # fmt: skip
_DARKENS = {"coat_weight": 0.0, "coat_ior": 1.6, "coat_darkening": 1.0}  # inputs of a coat that darken a body, with their defaults
_EDGE = 1.0 / 7.0  # cosine of 81.8°, where F82 is defined
_SHEEN_ROUGHNESS = 0.3  # of disney_principled
_COAT_GLOSS = 0.25  # share of a clear coat of disney_principled


def surface(shader: Any, kind: str, source: Callable[[Any, Any], Any], arithmetic: Arithmetic, tell: Tell) -> dict[str, Any]:
    """The inputs of OpenPBR that a surface shader gives. A warning names every other authored input."""
    names, place = PARTS[kind], shader.GetPrim()
    inputs = dict(DEFAULTS)
    inputs |= {name: source(shader.GetInput(written), default) for name, (written, default) in names.items() if name != _COAT}
    inputs["base_color"] = arithmetic.times(inputs["base_color"], inputs.pop("base_weight"), place)
    inputs["base_weight"] = 1.0
    if kind == "ND_disney_principled":
        _disney(shader, inputs, source, arithmetic)
    elif names is GLTF:
        _gltf(shader, inputs, source, arithmetic)
    elif names is PREVIEW:
        inputs |= {"emission_luminance": 1.0, "coat_ior": 1.5, "coat_darkening": 0.0}
    elif names is not OPEN:
        _standard(inputs, arithmetic, place)
    else:
        angles = {name: directions.angle(shader.GetInput(target)) for name, target in directions.TURNED.items()}
        inputs |= {name: arithmetic.times(source(angle, 0.0), 1.0 / 360.0, place) for name, angle in angles.items() if angle}
    used = {written for written, _ in names.values()} | EXTRA.get(kind, set())
    for shader_input in shader.GetInputs():
        name = str(shader_input.GetBaseName())
        if name not in used and not _without_effect(shader, name, shader_input, source):
            tell(f"the input `{name}` of {kind} is not drawn")
    if names is not OPEN:
        inputs["specular_ior"] = under_coat(inputs)
        if not is_zero(inputs["fuzz_weight"]):
            inputs |= conty_kulla.fuzz(inputs["fuzz_roughness"], inputs["fuzz_weight"], arithmetic, place)
    if not is_zero(inputs["emission_luminance"]):
        inputs["emission"] = arithmetic.times(inputs["emission_color"], inputs["emission_luminance"], place)
    inputs |= {COAT_NORMAL: _coat_normal(shader, names, inputs, source)}
    inputs |= {KEY: True, NORMAL: inputs.pop("geometry_normal"), "opacity": _mean(inputs.pop("geometry_opacity"))}
    return inputs


def under_coat(inputs: Mapping[str, Any]) -> Any:
    """The index of a base whose highlight is that of its own index below air, as all models but OpenPBR have it below a coat."""
    ior, coat, weight = (numbers(inputs[name]) for name in ("specular_ior", "coat_ior", "coat_weight"))
    if ior is None or coat is None or weight is None or not is_zero(inputs["transmission_weight"]):
        return inputs["specular_ior"]
    return openpbr.below_coat(float(ior.mean()), float(weight.mean()), float(coat.mean()))


def _coat_normal(shader: Any, names: Mapping[str, tuple[str, Any]], inputs: dict[str, Any], source: Callable[[Any, Any], Any]) -> Any:
    """The source of the normal of the coat; SMOOTH without one over a base with one, None where it is that of the base."""
    written, base = names.get(_COAT, ("", None))[0], inputs["geometry_normal"]
    if not written or is_zero(inputs["coat_weight"]):
        return None
    shader_input, below = shader.GetInput(written), shader.GetInput(names["geometry_normal"][0])
    if not shader_input or not shader_input.HasConnectedSource() or directions.is_of_surface(shader_input):
        return None if base is None else SMOOTH
    is_same = below and below.GetRawConnectedSourcePaths() == shader_input.GetRawConnectedSourcePaths()
    return None if is_same else source(shader_input, None)


COAT_NORMAL, SMOOTH, SMOOTH_COAT = "coat normal", "smooth", openpbr.SMOOTH_COAT  # of Network.inputs; a source of it; its input
GLTF_NAMES = {name for name, _ in GLTF.values()} | EXTRA["ND_gltf_pbr_surfaceshader"] | {"tangent", "clearcoat_normal"}


def needs(shader: Any, kind: str, source: Callable[[Any, Any], Any]) -> bool:
    """Whether a surface shader is read as slabs: one of glTF where `principled` does not have what it sets."""
    if kind != "ND_gltf_pbr_surfaceshader":
        return kind in SHADERS
    normals = (source(shader.GetInput(name), None) for name in ("normal", "clearcoat_normal"))
    if not is_zero(source(shader.GetInput("clearcoat"), 0.0)) and any(normal is not None for normal in normals):
        return True
    for name in MORE_THAN_PRINCIPLED:
        plain = 1.0 if name.startswith("specular") else 0.0
        value = numbers(source(shader.GetInput(name), plain))
        if value is None or (value != plain).any():
            return True
    return False


def coverage(shader: Any, source: Callable[[Any, Any], Any]) -> tuple[Any, float]:
    """(opacity, threshold) of gltf_pbr."""
    mode = numbers(source(shader.GetInput("alpha_mode"), 0))
    cutoff = numbers(source(shader.GetInput("alpha_cutoff"), 0.5))
    number = 0 if mode is None else int(mode)
    alpha = source(shader.GetInput("alpha"), 1.0)
    return (1.0 if number == 0 else alpha), (float(0.5 if cutoff is None else cutoff) if number == 1 else 0.0)


def _is_white(color: Any) -> bool:
    values = numbers(color)
    return values is not None and bool((values >= 1.0).all())


def _mean(opacity: Any) -> Any:
    values = numbers(opacity)
    return opacity if values is None else float(values.mean())


def _without_effect(shader: Any, name: str, shader_input: Any, source: Callable[[Any, Any], Any]) -> bool:
    """Whether an input has its value without effect, or the weight of its part is 0."""
    if name in _DIRECTIONS:
        return not shader_input.HasConnectedSource() or directions.is_of_surface(shader_input) or directions.angle(shader_input) is not None
    value = numbers(source(shader_input, None))
    for part, weights in DEPENDENT.items():
        if name.startswith(part):
            written = [shader.GetInput(weight) for weight in weights.split()]
            if not any(each and not is_zero(source(each, 0.0)) for each in written):
                return True
    return name in ("coat_affect_roughness", "transmission_extra_roughness") and value is not None and not value.any()


_DIRECTIONS = ("tangent", "geometry_tangent", "geometry_coat_tangent", "coat_normal", "geometry_coat_normal", "clearcoat_normal")


def film(thickness: Any, ior: Any, arithmetic: Arithmetic, place: Any) -> dict[str, Any]:
    """The thin film of a thickness in nanometres."""
    weight = 0.0 if is_zero(thickness) else 1.0
    return {"thin_film_weight": weight, "thin_film_thickness": arithmetic.times(thickness, 0.001, place), "thin_film_ior": ior}


def _standard(inputs: dict[str, Any], arithmetic: Arithmetic, place: Any) -> None:
    """What standard_surface and OpenPBR say differently: films, dispersion, anisotropy, and the edge colour of metals."""
    inputs |= film(inputs["thin_film_thickness"], inputs["thin_film_ior"], arithmetic, place)
    inputs["transmission_dispersion_scale"] = 0.0 if is_zero(inputs["transmission_dispersion_abbe_number"]) else 1.0
    for rough, turned in (("specular_roughness", "specular_roughness_anisotropy"), ("coat_roughness", "coat_roughness_anisotropy")):
        r, a = numbers(inputs[rough]), numbers(inputs[turned])
        if r is not None and a is not None and a.ndim == 0 and 0.0 < a <= 1.0:
            narrow = min(float(a), NARROWEST)
            aspect = math.sqrt(1.0 - narrow)
            alpha = min(float(r.mean()) ** 2 / aspect, 1.0)  # along the tangent
            inputs[rough] = math.sqrt(min(alpha * math.sqrt((1.0 + (1.0 - narrow) ** 2) / 2.0), 1.0))
            inputs[turned] = narrow
    metal, base, edge = (numbers(inputs[name]) for name in ("base_metalness", "base_color", "specular_color"))
    if metal is not None and float(metal.mean()) >= 1.0 and base is not None and edge is not None:
        weight = numbers(inputs["specular_weight"])
        if weight is not None:
            inputs["specular_color"], inputs["specular_weight"] = edge_tint(base, edge * weight), 1.0


def artistic_ior(reflectivity: Any, edge: Any) -> tuple[np.ndarray, np.ndarray]:
    """(n, k) of a metal by its reflectance and the colour of its edge (Gulbrandsen 2014)."""
    r, g = np.clip(np.broadcast_to(reflectivity, 3), 0.0, 0.99), np.broadcast_to(edge, 3)
    root = np.sqrt(r)
    n = np.asarray((1.0 - r) / (1.0 + r) * g + (1.0 + root) / (1.0 - root) * (1.0 - g))
    return n, np.sqrt(np.maximum((r * (n + 1.0) ** 2 - (n - 1.0) ** 2) / (1.0 - r), 0.0))


def conductor(n: Any, k: Any, cosine: float) -> np.ndarray:
    """The reflectance of a metal by Fresnel's equations."""
    n, k = np.asarray(n, np.float64), np.asarray(k, np.float64)
    sine2 = 1.0 - cosine * cosine
    t = n * n - k * k - sine2
    a2b2 = np.sqrt(t * t + 4.0 * n * n * k * k)
    a = np.sqrt(np.maximum(0.5 * (a2b2 + t), 0.0))
    s = (a2b2 - 2.0 * a * cosine + cosine * cosine) / (a2b2 + 2.0 * a * cosine + cosine * cosine)
    p = s * (cosine**2 * a2b2 - 2.0 * a * cosine * sine2 + sine2**2) / (cosine**2 * a2b2 + 2.0 * a * cosine * sine2 + sine2**2)
    return 0.5 * (s + p)


def tint_of(n: Any, k: Any) -> tuple[Color, Color]:
    """(reflectance at normal incidence, tint at 81.8° over Schlick's) of a metal."""
    f0 = conductor(n, k, 1.0)
    schlick = f0 + (1.0 - f0) * (1.0 - _EDGE) ** 5
    return as_color(np.clip(np.broadcast_to(f0, 3), 0, 1)), as_color(np.clip(np.broadcast_to(conductor(n, k, _EDGE) / schlick, 3), 0, 1))


def edge_tint(reflectivity: Any, edge: Any) -> Color:
    """The specular colour of OpenPBR for a metal of standard_surface."""
    return tint_of(*artistic_ior(reflectivity, edge))[1]


def _gltf(shader: Any, inputs: dict[str, Any], source: Callable[[Any, Any], Any], arithmetic: Arithmetic) -> None:
    """What gltf_pbr and OpenPBR say differently. Without a thickness it is a thin wall."""
    place, fuzz = shader.GetPrim(), numbers(inputs["fuzz_color"])
    inputs["thin_film_thickness"] = arithmetic.times(inputs["thin_film_thickness"], 0.001, place)
    inputs["specular_rotation"] = arithmetic.times(inputs["specular_rotation"], 0.5 / math.pi, place)
    inputs["fuzz_weight"] = 1.0 if fuzz is None else float(fuzz.max())
    inputs["fuzz_roughness"] = arithmetic.times(inputs["fuzz_roughness"], inputs["fuzz_roughness"], place)
    if fuzz is not None and fuzz.max() > 0.0:
        inputs["fuzz_color"] = tuple((fuzz / fuzz.max()).tolist())
    inputs |= {"coat_ior": 1.5, "coat_darkening": 0.0}
    if is_zero(source(shader.GetInput("thickness"), 0.0)):
        inputs |= {THIN: True, "transmission_depth": 0.0, "transmission_color": inputs["base_color"]}
    elif is_zero(inputs["transmission_depth"]):
        inputs["transmission_color"] = inputs["base_color"]
    inputs["geometry_opacity"], inputs["opacityThreshold"] = coverage(shader, source)


def _disney(shader: Any, inputs: dict[str, Any], source: Callable[[Any, Any], Any], arithmetic: Arithmetic) -> None:
    """What disney_principled and OpenPBR say differently."""
    place, base = shader.GetPrim(), inputs["base_color"]
    specular, gloss = (numbers(source(shader.GetInput(name), value)) for name, value in (("specular", 0.5), ("clearcoatGloss", 1.0)))
    root = math.sqrt(min(max(0.08 * float(0.5 if specular is None else specular), 0.0), 0.99))
    inputs["specular_ior"] = (1.0 + root) / (1.0 - root)
    if not is_zero(inputs["transmission_weight"]):
        inputs["specular_ior"] = source(shader.GetInput("ior"), 1.5)
        inputs["transmission_color"] = base
    inputs["fuzz_color"] = arithmetic.mix((1.0,) * 3, base, source(shader.GetInput("sheenTint"), 0.5), place)
    inputs["coat_weight"] = arithmetic.times(inputs["coat_weight"], _COAT_GLOSS, place)
    inputs["coat_roughness"] = math.sqrt(0.1 + (0.001 - 0.1) * float(1.0 if gloss is None else gloss))
    inputs |= {"coat_ior": 1.5, "coat_darkening": 0.0, "subsurface_color": base, "fuzz_roughness": _SHEEN_ROUGHNESS}


# --- rows ---------------------------------------------------------------------------------------------------------------


class Reader(Protocol):
    """Inputs of rows from sources."""

    @property
    def builder(self) -> SceneBuilder: ...

    def color(self, source: Any, fallback: Color) -> Input: ...

    def number(self, source: Any, fallback: float) -> Input: ...

    def constant(self, source: Any, fallback: float) -> float: ...

    def maps(self, inputs: Mapping[str, Any]) -> Mapping[ir.Slot, Input]:
        """The normal maps and heights of a surface, and the normal of its coat."""
        ...


@dataclass(slots=True)
class Rows:
    """The rows of one surface of slabs. `metres` is the length of a unit of the stage."""

    reader: Reader
    arithmetic: Arithmetic
    name: str
    span: Span
    metres: float
    maps: Mapping[ir.Slot, Input] = field(default_factory=dict)  # of normals and heights
    place: Any = None
    tell: Tell = lambda message: None

    def row(self, inputs: Mapping[str, Any], opacity: Input, threshold: float = 0.0) -> int:
        """The row of a surface, with its opacity."""
        tree = inputs[KEY]
        surface = self._surface(inputs) if tree is True else self._tree(tree)
        return self.reader.builder.material(partial_coverage.with_opacity(surface, opacity, threshold), self.span)

    def _tree(self, tree: Any) -> MaterialData:
        """The surface of a graph of BSDFs (closures.Tree)."""
        if hasattr(tree, "share"):
            return self._blend(self._tree(tree.first), self._tree(tree.second), tree.share)
        leaf = replace(self, maps=self.reader.maps(tree.inputs))
        if "translucent" in tree.inputs:
            black = Input(BLACK)
            sheet = {Slot.AMBIENT: black, Slot.DIFFUSE: black}
            sheet[Slot.DIFFUSE_TRANSMISSION] = self.reader.color(tree.inputs["translucent"], WHITE)
            return MaterialData(ir.MaterialModel.TRANSLUCENT, {**sheet, **leaf.maps}, name=self.name)
        return leaf._surface(tree.inputs)

    def _surface(self, inputs: Mapping[str, Any]) -> MaterialData:
        """Slabs, and what fills the shape: glass, or a body that scatters light.

        Glass with dispersion is a material of its own, and so is a body whose colour has a texture.
        """
        for name, weights in _INDICES.items():
            value, default = numbers(inputs[name]), openpbr.NUMBERS[name][1]
            if value is not None and not value.min() > 0.0:
                if not all(is_zero(inputs[weight]) for weight in weights):
                    self.tell(f"the input `{name}` is not above 0: {default:g} is drawn")
                inputs = {**inputs, name: default}
        solid = not inputs[THIN]
        clear, spread = (not is_zero(inputs[name]) and solid for name in ("transmission_weight", "subsurface_weight"))
        if clear and self._dispersion(inputs) > 0.0:
            return self._blend(self._slabs({**inputs, **_OPAQUE}), self._glass(inputs), self._of_dielectric(inputs, "transmission_weight"))
        if clear and spread:
            self.tell("a surface that passes light is drawn without its subsurface: a shape is filled by one medium")
            return self._slabs({**inputs, "subsurface_weight": 0.0}, self._murky(inputs))
        if not spread:
            return self._slabs(inputs, self._murky(inputs) if clear else -1)
        color = self.reader.color(inputs["subsurface_color"], WHITE)
        if color.texture < 0:
            return self._slabs(inputs, self._medium(inputs, color))
        for name, part in (("coat_weight", "clear coat"), ("fuzz_weight", "sheen"), ("thin_film_weight", "thin film")):
            if not is_zero(inputs[name]):
                self.tell(f"the {part} over a body whose colour has a texture is drawn on the rest of the surface alone")
        return self._blend(self._slabs({**inputs, **_OPAQUE}), self._body(inputs, color), self._of_dielectric(inputs, "subsurface_weight"))

    def _of_dielectric(self, inputs: Mapping[str, Any], name: str) -> Any:
        """A weight times the share of the surface that is no metal."""
        return self.arithmetic.times(inputs[name], self.arithmetic.less(inputs["base_metalness"], self.place), self.place)

    def _slabs(self, inputs: Mapping[str, Any], medium: int = -1) -> MaterialData:
        slots = {
            slot: self._share(self.reader.number(inputs[name], default), high) for name, (slot, default, high, _) in openpbr.NUMBERS.items()
        }
        slots |= {slot: self.reader.color(inputs[name], (grey, grey, grey)) for name, (slot, grey, _) in openpbr.COLORS.items()}
        if max(slots[Slot.SPECULAR].value) > 1.0:
            self.tell("a specular colour above 1 counts as 1")
        if "emission" in inputs:
            if not is_zero(inputs["coat_weight"]) and not _is_white(inputs["coat_color"]):
                self.tell("light that is emitted below a coat is drawn without the colour of the coat")
            slots[Slot.EMISSION] = self.reader.color(inputs["emission"], BLACK)
        if inputs[THIN]:
            slots[Slot.THIN_WALLED] = Input.number(1.0)
            anisotropy = self.reader.constant(inputs["subsurface_scatter_anisotropy"], 0.0)
            slots[Slot.SUBSURFACE_ANISOTROPY] = Input.number(min(max(anisotropy, -1.0), 1.0))
        elif self._depth(inputs) > 0.0:
            slots[Slot.TRANSMISSION_COLOR] = Input(WHITE)
        return openpbr.simplified(openpbr.data({**slots, **self.maps}, name=self.name, medium=medium))

    def _depth(self, inputs: Mapping[str, Any]) -> float:
        return self.reader.constant(inputs["transmission_depth"], 0.0) * self.metres

    def _murky(self, inputs: Mapping[str, Any]) -> int:
        """The medium of glass with a depth: it leaves the transmission colour of white light, and scatters some of it."""
        depth = self._depth(inputs)
        if not depth > 0.0:
            return -1
        color, spread = numbers(inputs["transmission_color"]), numbers(inputs["transmission_scatter"])
        if color is None or spread is None:
            self.tell("a transmission colour with a depth is drawn only as one colour: white is drawn")
        color = np.ones(3) if color is None else np.clip(np.broadcast_to(color, 3), openpbr.DARKEST, 1.0)
        scattering = np.zeros(3) if spread is None else np.maximum(np.broadcast_to(spread, 3), 0.0) / depth
        absorption = -np.log(color) / depth - scattering
        absorption = absorption - min(float(absorption.min()), 0.0)
        anisotropy = min(max(self.reader.constant(inputs["transmission_scatter_anisotropy"], 0.0), -0.99), 0.99)
        return self.reader.builder.medium(MediumData(as_color(scattering), as_color(absorption), anisotropy=anisotropy), self.span)

    def _medium(self, inputs: Mapping[str, Any], color: Input) -> int:
        """The medium of a body, whose lengths are mean free paths; those of one whose colour has a texture are those of a colour of ½."""
        anisotropy = min(max(self.reader.constant(inputs["subsurface_scatter_anisotropy"], 0.0), -0.99), 0.99)
        lengths = self._lengths(inputs)
        if color.texture < 0:
            coat = [self.reader.constant(inputs[name], default) for name, default in _DARKENS.items()]
            scattering, absorption = subsurface.of_free_path(openpbr.darkened(color.value, *coat), lengths, anisotropy)
        else:
            scattering, absorption = subsurface.coefficients(color.value, subsurface.radius_of_free_path(lengths))
            scattering = scale_color(scattering, 1.0 / (1.0 - anisotropy))
        return self.reader.builder.medium(MediumData(scattering, absorption, anisotropy=anisotropy), self.span)

    def _share(self, number: Input, most: float | None) -> Input:
        """A number from 0, up to `most`; a texture's factor is not clamped."""
        if number.texture >= 0:
            return number
        return Input.number(max(number.value[0], 0.0) if most is None else min(max(number.value[0], 0.0), most))

    def _blend(self, first: MaterialData, second: MaterialData, share: Any) -> MaterialData:
        weight = self._share(self.reader.number(share, 0.0), 1.0)
        if weight.texture < 0 and weight.value[0] >= 1.0:
            if Slot.EMISSION in first.inputs and first.inputs[Slot.EMISSION].value != BLACK:
                self.tell("the emission of a surface that passes or scatters all light is not drawn")
            return second
        builder = self.reader.builder
        parts = builder.material(first, self.span), builder.material(second, self.span)
        medium = second.medium if second.medium >= 0 else first.medium
        return MaterialData(ir.MaterialModel.BLEND, {Slot.WEIGHT: weight}, first=parts[0], second=parts[1], name=self.name, medium=medium)

    def _glass(self, inputs: Mapping[str, Any]) -> MaterialData:
        """Glass that splits light: with a depth its colour is that of light after so many units, else that of what passes a surface."""
        depth, color = self._depth(inputs), self.reader.color(inputs["transmission_color"], WHITE)
        absorption = BLACK
        if depth > 0.0 and color.texture < 0:
            absorption = as_color(-math.log(min(max(c, openpbr.DARKEST), 1.0)) / depth + 0.0 for c in color.value)
            color = Input(WHITE)
        slots = {
            Slot.TRANSMISSION: color, Slot.IOR: self.reader.number(inputs["specular_ior"], 1.5), Slot.ABSORPTION: Input(absorption),
            Slot.ROUGHNESS: self._share(self.reader.number(inputs["specular_roughness"], 0.3), 1.0), Slot.PRIORITY: Input.number(0.0),
            Slot.DISPERSION: Input.number(self._dispersion(inputs)),
        }  # fmt: skip
        return MaterialData(ir.MaterialModel.GLASS, {**slots, **self.maps}, name=self.name)

    def _dispersion(self, inputs: Mapping[str, Any]) -> float:
        """20 over the Abbe number, by the scale; 0 of thin walls, which bend no light."""
        scale = self.reader.constant(inputs["transmission_dispersion_scale"], 0.0)
        abbe = self.reader.constant(inputs["transmission_dispersion_abbe_number"], 20.0)
        return KHRONOS / abbe * max(scale, 0.0) if abbe > 0.0 and not inputs[THIN] else 0.0

    def _body(self, inputs: Mapping[str, Any], color: Input) -> MaterialData:
        """A body whose colour has a texture."""
        slots = {
            Slot.AMBIENT: color, Slot.DIFFUSE_TRANSMISSION: Input(WHITE), Slot.RADIUS: Input.number(1.0),
            Slot.IOR: self.reader.number(inputs["specular_ior"], 1.5),
            Slot.ROUGHNESS: self._share(self.reader.number(inputs["specular_roughness"], 0.3), 1.0),
        }  # fmt: skip
        medium = self._medium(inputs, color)
        return MaterialData(ir.MaterialModel.SUBSURFACE, {**slots, **self.maps}, name=self.name, medium=medium)

    def _lengths(self, inputs: Mapping[str, Any]) -> Color:
        parts = []
        for name in ("subsurface_radius", "subsurface_radius_scale"):
            values = numbers(inputs[name])
            if values is None or values.shape not in ((), (3,)):
                self.tell(f"the input `{name}` is drawn only as a number: its default is drawn")
                values = np.array(DEFAULTS[name], np.float64)
            parts.append(np.broadcast_to(values, 3))
        return as_color(max(length, 1e-9) for length in (parts[0] * parts[1] * self.metres).tolist())
