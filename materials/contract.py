"""What the module of a material holds. Its inputs are the slots of ir.Materials, each a constant times a texture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import Flag, auto
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import Surface
from ..compiler.scene.row_records import BLACK, Color, Input, MaterialData, MediumData
from ..lang.schema.argument_types import Entry

F64 = np.ndarray
Lane = Any
Vec = tuple[Lane, Lane, Lane]


class Lobes(Flag):
    """What a material may scatter light by; see traits.py."""

    CLASSIC = auto()  # diffuse and Phong lobes, mirror and transmission, by the inputs k_d, k_s, k_r and k_t
    MIRROR = auto()  # a perfect mirror alone
    GLASS = auto()  # reflection and refraction by Fresnel's equations, polished or rough
    FACETS = auto()  # microfacets
    BASE = auto()  # a diffuse base under microfacets
    EMISSION = auto()  # emission alone
    SLABS = auto()  # slabs of OpenPBR
    PARTS = auto()  # those of its two parts


class Arguments(Protocol):
    """The arguments of an element, as inputs of a material."""

    args: Mapping[str, Any]

    def color(self, name: str) -> Input:
        """A colour, or a texture of colours."""
        ...

    def number(self, name: str) -> Input:
        """A number, or a texture of numbers."""
        ...

    def normals(self, element: Any) -> Input:
        """A normal map, of an argument that is a texture."""
        ...

    def error(self, message: str, hint: str = "") -> None: ...

    def medium(self, medium: MediumData) -> int:
        """The row of the medium inside."""
        ...

    def part(self, name: str) -> int:
        """The row of an argument that is a material; with errors for what no part of another material has."""
        ...

    @property
    def shading(self) -> ir.Shading:
        """By the argument `shading`."""
        ...


class Element(NamedTuple):
    """An element of the language that makes the material."""

    entry: Entry
    lower: Callable[[Arguments], MaterialData]


class FacetInputs(NamedTuple):
    """Inputs of microfacets at points, in lanes."""

    color: Vec  # DIFFUSE, times the mesh's colours
    specular: Vec
    edge: Vec
    ior: Lane  # above 0
    metallic: Lane  # 0 to 1, as the others
    transmission: Lane
    coat: Lane


class Facets(NamedTuple):
    """Microfacets over a diffuse base, in lanes."""

    base: Vec  # its reflectance
    f0: Vec  # reflectance at normal incidence
    bend: Vec  # factor of the dip before the grazing angle; see render/material/microfacet.py
    coat: Lane  # weight of a clear coat


class Exported(NamedTuple):
    """A metallic–roughness surface, its transmission and its absorption."""

    surface: Surface
    transmission: float = 0.0  # 1: glass
    absorption: Color = BLACK  # per metre
    diffuse_transmission: Input | None = None  # of a thin sheet
    body: bool = False  # light scatters inside of it; the surface is that of its colour
    medium: MediumData | None = None  # inside of its shapes


class Row(Protocol):
    """The row of a material that is exported. Losses are reported at its place."""

    def value(self, slot: ir.Slot) -> F64:
        """(3,) the constant of an input."""
        ...

    def texture(self, slot: ir.Slot) -> int:
        """The texture of an input that the format carries, or -1."""
        ...

    def input(self, slot: ir.Slot) -> Input:
        """Both."""
        ...

    @property
    def normalized(self) -> bool:
        """Whether its highlight conserves energy."""
        ...

    def cannot(self, message: str, hint: str = "") -> None:
        """Report a loss."""
        ...

    def note(self, message: str) -> None:
        """Report another form."""
        ...


class SurfaceRow(Row, Protocol):
    """A row that is exported as a metallic–roughness surface."""

    def surface(self, diffuse: Input, metallic: Input, roughness: Input, ior: Input, **more: Any) -> Surface:
        """A surface with the row's name, maps and opacity."""
        ...

    @property
    def ior(self) -> Input:
        """The index of refraction, without its texture."""
        ...


class MitsubaRow(Row, Protocol):
    """A row that is exported as a BSDF of Mitsuba. Nodes are XML elements."""

    def bsdf(self, kind: str, *children: Any, **parameters: Any) -> Any: ...

    def two_sided(self, bsdf: Any) -> Any: ...

    def color(self, name: str, slot: ir.Slot, scale: float = 1.0) -> Any:
        """A colour, a bitmap or a checkerboard."""
        ...

    def reflectance(self, name: str, scale: float = 1.0) -> Any:
        """The diffuse colour; of a mesh with colours, theirs."""
        ...

    def number(self, name: str, slot: ir.Slot) -> Any:
        """A number or a bitmap."""
        ...

    def alpha(self) -> Any:
        """The width of microfacets by ROUGHNESS."""
        ...

    def constant(self, name: str, number: float) -> Any: ...

    def rgb(self, name: str, color: Any) -> Any: ...

    def parts(self) -> Sequence[Any]:
        """The BSDFs of both parts of a blend."""
        ...

    def reports_colors(self) -> None:
        """Report that colours of a mesh are lost."""
        ...


class PovrayRow(Row, Protocol):
    """A row that is exported as a pigment and a finish of POV-Ray."""

    bounces: int
    ambient: F64  # (3,) radiance of ambient lights

    def numeral(self, value: float) -> str: ...

    def vector(self, values: Any) -> str: ...


class Finish(NamedTuple):
    """A material of POV-Ray."""

    pigment: ir.Slot | None  # the input of its colour, with its texture; None: black
    words: str  # of its finish
    interior: str = ""
    filters: bool = False  # whether light that passes has the colour of the pigment


class Lobe(Protocol):
    """The module of a lobe, beside those of materials. Its functions are lane helpers.

    `inputs` are the colours of SLOTS; numbers are in the first component. Directions are unit vectors away from
    the surface. Test the albedo and the density as tests/render/material does.
    """

    SLOTS: tuple[ir.Slot, ...]
    THROUGH: bool
    """Whether it scatters light to the other side of the surface."""

    def value(self, inputs: Any, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
        """π f |cos|; without THROUGH 0 where the light is below the surface."""
        ...

    def density(self, inputs: Any, normal: Vec, to_light: Vec, to_viewer: Vec) -> Lane:
        """The solid angle density of `sample`."""
        ...

    def sample(self, inputs: Any, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> Vec:
        """A direction to the light, by two numbers from 0 to 1."""
        ...

    def albedo(self, inputs: Any, normal: Vec, to_viewer: Vec) -> Vec:
        """About the share of light that it reflects: how many samples it gets beside other lobes."""
        ...


class Material(Protocol):
    """The module of a material. What is None stands for "it has none"; each name must be there."""

    MODEL: ir.MaterialModel
    ELEMENTS: tuple[Element, ...]
    LOBES: Lobes
    SLOTS: tuple[ir.Slot, ...]
    """The inputs that it reads, without those of all materials: OPACITY, NORMAL and BUMP."""
    COLOR: ir.Slot | None
    """The input that shows its colour in the channel `albedo`, and where a format has one colour alone; None: that of its parts."""
    REFLECTANCE: ir.Slot | None
    """Of microfacets, the input that is their reflectance at normal incidence; None: it follows from IOR and METALLIC."""
    HALF_VECTOR: bool  # its Phong lobe is about the half vector, not about the mirrored direction
    LOBE: Lobe | None
    """A module of the contract `Lobe`: a lobe beside its classic ones."""
    facets: Callable[[FacetInputs], Facets] | None
    """Its microfacets. A lane helper: kernels compile it."""
    surface: Callable[[SurfaceRow], Exported] | None
    """Its metallic–roughness surface, in glTF and USD; None: its parts have one."""
    mitsuba: Callable[[MitsubaRow], Any]
    """Its BSDF in Mitsuba."""
    povray: Callable[[PovrayRow], Finish] | None
    """Its finish in POV-Ray; None: that of the part which counts more."""
