"""Input records of SceneBuilder, one for each kind of row, with defaults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .. import ir
from .link_sets import Links

Color = tuple[float, float, float]
BLACK: Color = (0.0, 0.0, 0.0)
WHITE: Color = (1.0, 1.0, 1.0)
NO_PLANES = ((0.0, 0.0, 0.0, 0.0),) * ir.CLIP_PLANES
PLAIN_FRAME = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
ALL_RAYS = int(ir.Visibility.CAMERA | ir.Visibility.SHADOW | ir.Visibility.REFLECTION)
NO_SHADOW = int(ir.Visibility.CAMERA | ir.Visibility.REFLECTION)


def as_color(values: Iterable[float]) -> Color:
    """Three numbers of any kind as a colour, point or direction."""
    r, g, b = (float(v) for v in values)
    return (r, g, b)


def nonnegative(color: Color) -> Color:
    """A colour with 0 in place of negative components."""
    return (max(color[0], 0.0), max(color[1], 0.0), max(color[2], 0.0))


def scale_color(color: Color, factor: float) -> Color:
    """A colour times a number."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)


def multiply_colors(first: Color, second: Color) -> Color:
    """Two colours, component by component."""
    return (first[0] * second[0], first[1] * second[1], first[2] * second[2])


@dataclass(frozen=True, slots=True, eq=False)
class MeshAttribute:
    """Values (n, width) of a mesh: n is 1 for CONSTANT, triangles for FACE, vertices for VERTEX, 3 · triangles for CORNER.

    The row of a corner is 3 · triangle + corner, relative to the mesh.
    """

    values: np.ndarray
    interpolation: ir.Interpolation = ir.Interpolation.VERTEX


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The polygons of a mesh before triangulation; indices are relative to the mesh."""

    corners: np.ndarray  # (c,) vertices of all loops, one after the other
    loops: np.ndarray  # (l, 2) first corner, corner count
    polygons: np.ndarray  # (n, 4) first loop, loop count (outline, then holes), first triangle, triangle count


@dataclass(frozen=True, slots=True, eq=False)
class MeshData:
    """A mesh. Triangles are counter-clockwise from outside."""

    positions: np.ndarray  # (v, 3) float64, metres, in the mesh's own frame
    triangles: np.ndarray  # (t, 3) int
    normals: MeshAttribute | None = None  # width 3
    uvs: MeshAttribute | None = None  # width 2
    colors: MeshAttribute | None = None  # width 3, linear
    outlines: Outlines | None = None  # None: each triangle is a face of its own
    name: str = ""
    deviation: float = 0.0  # metres: largest distance of its triangles from the surface that they stand for


@dataclass(frozen=True, slots=True)
class Input:
    """A material input: a constant, times a texture if any. Numbers are in the first component."""

    value: Color = WHITE
    texture: int = -1

    @staticmethod
    def number(value: float, texture: int = -1) -> Input:
        return Input((value, 0.0, 0.0), texture)


@dataclass(frozen=True, slots=True)
class MaterialData:
    """Missing inputs are 0; the index of refraction and the opacity are 1."""

    model: ir.MaterialModel = ir.MaterialModel.LAMBERT
    inputs: Mapping[ir.Slot, Input] = field(default_factory=dict)
    shading: ir.Shading = ir.Shading.SMOOTH
    normalized: bool = False
    name: str = ""
    threshold: float = 0.0  # see ir.Materials
    first: int = -1  # material rows of a BLEND
    second: int = -1
    medium: int = -1  # row from SceneBuilder.medium


@dataclass(frozen=True, slots=True)
class MediumData:
    """Columns of ir.Media. `density` is a row from SceneBuilder.texture, `transform` from SceneBuilder.transform."""

    scattering: Color = BLACK
    absorption: Color = BLACK
    emission: Color = BLACK
    anisotropy: float = 0.0
    draine: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    priority: float = 0.0
    everywhere: bool = False
    top: float = math.inf
    falloff: float = 0.0
    density: int = -1
    transform: int = 0
    bounds: tuple[Color, Color] = ((-math.inf, -math.inf, -math.inf), (math.inf, math.inf, math.inf))


@dataclass(frozen=True, slots=True)
class TextureData:
    """Columns of ir.Textures. `image` is a row from SceneBuilder.image."""

    kind: ir.TextureKind
    image: int = -1
    tape: int = -1
    mapping: ir.TextureMapping = ir.TextureMapping.UV
    wrap_u: ir.Wrap = ir.Wrap.REPEAT
    wrap_v: ir.Wrap = ir.Wrap.REPEAT
    nearest: bool = False
    channel: int = -1
    frame: tuple[tuple[float, float, float], tuple[float, float, float]] = PLAIN_FRAME
    size: float = 0.0
    color_a: Color = WHITE
    color_b: Color = BLACK
    gain: Color = WHITE
    bias: Color = BLACK
    slices: int = 0


@dataclass(frozen=True, slots=True)
class LightData:
    """Columns of ir.Lights. `transform` is a row from SceneBuilder.transform."""

    kind: ir.LightKind
    color: Color
    position: Color = BLACK
    direction: Color = (0.0, 1.0, 0.0)
    transform: int = 0
    size: tuple[float, float] = (0.0, 0.0)
    cos_cone: float = -1.0
    cos_full: float = -1.0
    angle: float = 0.0
    falloff: ir.FalloffKind = ir.FalloffKind.INVERSE_SQUARE
    coefficients: Color = BLACK
    image: int = -1
    shadows: bool = True
    links: Links | None = None
    name: str = ""
    group: str = ""  # light group


@dataclass(frozen=True, slots=True)
class CameraData:
    """Columns of ir.Cameras. `transform` is a row from SceneBuilder.transform."""

    transform: int
    extent: float  # tan of half the field of view, or half the width or height in metres, along `fit`
    projection: ir.Projection = ir.Projection.PERSPECTIVE
    fit: ir.Fit = ir.Fit.VERTICAL
    aspect: float = 0.0
    near: float = 0.0
    far: float = math.inf
    shift: tuple[float, float] = (0.0, 0.0)
    exposure: float = math.nan
    opening: float = 0.0
    shutter: float = 0.0
    lens: float = 0.0
    focus: float = 1.0
    pixel_aspect: float = 1.0
    planes: tuple[tuple[float, ...], ...] = NO_PLANES
    name: str = ""


@dataclass(frozen=True, slots=True)
class InstanceData:
    """Rows from the builder; a geometry or transform of -1 makes no instance. `light`: the light that has this shape."""

    geometry: int
    transform: int = 0
    material: int = -1
    light: int = -1
    visible: int = ALL_RAYS
    name: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A geometry of a shape, in the frame of the shape. `material` -1: the shape's.

    `material_name` is what its file calls the material. One that is `chosen` is of the scene, and precedes that of the shape.
    `mixed` makes the row of its material from the shape's row, or -1: of a solid whose parts have materials of their own.
    """

    geometry: int
    matrix: np.ndarray  # (4, 4)
    material: int = -1
    name: str = ""
    mixed: Callable[[int], int] | None = None
    material_name: str = ""
    chosen: bool = False


DEFAULT_MATERIAL = "default"  # the name of the material of surfaces without one


def lambert(albedo: Color, texture: int = -1, name: str = "") -> MaterialData:
    """A diffuse material: k_a = k_d = albedo, times a texture."""
    reflectance = Input(albedo, texture)
    return MaterialData(ir.MaterialModel.LAMBERT, {ir.Slot.AMBIENT: reflectance, ir.Slot.DIFFUSE: reflectance}, name=name)


def default_material() -> MaterialData:
    """The material of surfaces without one: grey."""
    return lambert((0.8, 0.8, 0.8), name=DEFAULT_MATERIAL)
