"""Records of a material's surface: for each input a value, a picture or a primvar; and how a part of a mesh uses it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...materialx.graph import Node

_SHARES = (
    "opacity", "roughness", "metallic", "clearcoat", "clearcoatRoughness", "occlusion", "base_metalness", "base_diffuse_roughness",
    "specular_weight", "specular_roughness", "coat_weight", "coat_roughness", "fuzz_weight", "fuzz_roughness", "transmission_weight",
    "subsurface_weight", "thin_film_weight",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How a part of a mesh uses its material."""

    colored: bool = False  # the mesh has vertex colours
    maps: dict[str, np.ndarray | None] = field(default_factory=dict)  # (3, 3) from the part's coordinates to a primvar's; None: unknown
    number: str | None = None  # the primvar that is the mesh's u
    tiles: tuple[int, ...] | None = None  # of UDIM textures in which its faces lie; None: all


@dataclass(frozen=True, slots=True)
class Picture:
    """A connected UsdUVTexture: node, output, primvar of the texture coordinates, and their frame."""

    shader: Any
    output: str
    varname: str
    frame: tuple[tuple[float, float, float], tuple[float, float, float]]
    gain: float = 1.0  # of its values, after the node's own scale and bias
    bias: float = 0.0
    strength: float = 1.0  # of a normal map

    def as_normals(self, strength: float) -> Picture:
        """The picture as a normal map with values from 0 to 1."""
        return replace(self.times(2.0, -1.0), strength=strength)

    def times(self, gain: float, bias: float = 0.0) -> Picture:
        return replace(self, gain=self.gain * gain, bias=self.bias * gain + bias)

    def part(self, output: str) -> Picture:
        """The picture of one channel."""
        return replace(self, output=output)


@dataclass(frozen=True, slots=True)
class Primvar:
    """A primvar read by a material."""

    name: str
    fallback: Any


@dataclass(frozen=True, slots=True, eq=False)
class Graph:
    """An output of a node graph of MaterialX that varies over the surface."""

    node: Node
    output: str
    kind: str  # type of its values
    varnames: tuple[str, ...] = ()  # primvars of texture coordinates that it reads
    primvars: tuple[str, ...] = ()  # other primvars
    numbers: tuple[str, ...] = ()  # those of one number
    factor: str | None = None  # a primvar of colours of which the values are a multiple
    in_world: bool = False  # reads places or directions in the frame of the world
    of_white: bool = False  # with 1 in place of the factor
    gain: float = 1.0
    bias: float = 0.0
    strength: float = 1.0  # of a normal map

    def as_normals(self, strength: float) -> Graph:
        """The values, from 0 to 1, as a normal map."""
        return replace(self.times(2.0, -1.0), strength=strength)

    def times(self, gain: float, bias: float = 0.0) -> Graph:
        return replace(self, gain=self.gain * gain, bias=self.bias * gain + bias)


@dataclass(frozen=True, slots=True)
class Network:
    """A material's surface: for each input of UsdPreviewSurface a value, Picture, Primvar or Graph."""

    path: str
    name: str
    inputs: dict[str, Any]
    row: int = -1  # of the material that replaces it

    @property
    def varnames(self) -> tuple[str, ...]:
        """The primvars of the texture coordinates of its pictures, that of the diffuse one first."""
        sources = self.inputs.values()
        of_pictures = [source.varname for source in sources if isinstance(source, Picture)]
        of_graphs = [name for source in sources if isinstance(source, Graph) for name in source.varnames]
        return tuple(dict.fromkeys(of_pictures + of_graphs))

    @property
    def numbers(self) -> tuple[str, ...]:
        """The primvars of its numbers from 0 to 1."""
        sources = (self.inputs.get(name) for name in _SHARES)
        of_graphs = [name for source in self.inputs.values() if isinstance(source, Graph) for name in source.numbers]
        return tuple(dict.fromkeys([source.name for source in sources if isinstance(source, Primvar)] + of_graphs))

    @property
    def primvars(self) -> tuple[str, ...]:
        """The primvars that its graphs read beside texture coordinates."""
        return tuple({name: None for source in self.inputs.values() if isinstance(source, Graph) for name in source.primvars})

    @property
    def in_world(self) -> bool:
        """Whether a graph reads places or directions in the frame of the world."""
        return any(isinstance(source, Graph) and source.in_world for source in self.inputs.values())

    @property
    def displaced(self) -> bool:
        """Whether it moves the points of meshes."""
        return not isinstance(source := self.inputs.get("displacement", 0.0), float | int) or source != 0.0

    @property
    def color_name(self) -> str | None:
        """The primvar of the diffuse colour, or that of which it is a multiple."""
        source = self.base
        if isinstance(source, Graph):
            return source.factor if source.bias == 0.0 else None
        return source.name if isinstance(source, Primvar) else None

    @property
    def base(self) -> Any:
        """The source of the diffuse colour; None where there are several."""
        return self.inputs.get("diffuseColor", self.inputs.get("base_color"))

    @property
    def white(self) -> Any:
        """The diffuse colour of a mesh whose own colours multiply it."""
        return replace(self.base, of_white=True) if isinstance(self.base, Graph) else (1.0, 1.0, 1.0)
