"""What the module of a light holds. A light is a row of ir.Lights; its kind says which columns count."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.formula.tape import Tape
from ..lang.elements import Rotation
from ..lang.formula_graph import Formula
from ..lang.schema.argument_types import Entry

F64 = NDArray[np.float64]
Color = tuple[float, float, float]
Lane = Any


class LightError(ValueError):
    """Arguments of an element that make no light: the message, and a hint."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class Form(IntEnum):
    """Where light comes from. Each form has a sampler, a density and an emission of photons in render/light."""

    POINT = 0  # `position`; `color` is intensity in cd along its axis
    DISTANT = 1  # `direction`, within `angle` of it; `color` is the irradiance in lx of a surface that faces it
    RECTANGLE = 2  # the plane y = 0 of its frame, to ±`size`, emits towards +y; `color` is radiance in nit along its axis
    DISK = 3  # the same within the radius `size[0]`
    SPHERE = 4  # within the radius `size[0]`, outwards
    SKY = 5  # all directions; `color` is radiance, a factor of its image where it has one
    AMBIENT = 6  # no direction; `color` is radiance


class Row(NamedTuple):
    """The columns of ir.Lights that an element gives. `strength` times `tint` times `color` is the color.

    `profile` may read `cos_cone` and `cos_full` as numbers of its own: −1 ≤ `cos_cone` ≤ `cos_full` ≤ 1, which `validate` checks.
    """

    kind: ir.LightKind
    strength: float
    tint: Color = (1.0, 1.0, 1.0)
    position: Sequence[float] = (0.0, 0.0, 0.0)
    direction: Sequence[float] = (0.0, 1.0, 0.0)
    frame: np.ndarray | None = None  # (4, 4) to the world
    size: tuple[float, float] = (0.0, 0.0)
    cos_cone: float = -1.0
    cos_full: float = -1.0
    angle: float = 0.0  # radians, at most π/2
    image: int = -1
    color: Color | None = None  # in place of the argument `color`


class Lowering(Protocol):
    """What the functions that lower elements use of the scene. Points and directions of arguments are in the frame of a block."""

    block: np.ndarray  # (4, 4) to the world
    has_unit: bool  # whether a strength of the element has a photometric unit

    def is_given(self, name: str) -> bool:
        """Whether the element has the argument."""
        ...

    def error(self, message: str, hint: str = "") -> None: ...
    def warn(self, message: str, hint: str = "") -> None: ...

    def point(self, point: Any) -> Color:
        """A point in the world."""
        ...

    def direction(self, vector: Any) -> np.ndarray | None:
        """(3,) unit direction in the world; None for 0."""
        ...

    def unit(self, vector: np.ndarray, /) -> np.ndarray | None:
        """(3,) unit vector; None for 0."""
        ...

    def facing(self, position: Sequence[float], direction: Sequence[float], up: Any, /) -> np.ndarray | None:
        """(4, 4) frame whose +y points in a direction; None without a direction."""
        ...

    def rotation(self, turn: Rotation, /) -> np.ndarray: ...

    def rigid(self, matrix: np.ndarray, /) -> tuple[np.ndarray, np.ndarray, bool]:
        """(rigid frame of a matrix, scale along its axes, whether the matrix has no skew)."""
        ...

    def image_file(self, name: str) -> int:
        """The row of an image file; -1 after a diagnostic."""
        ...

    def image(self, key: Any, name: str, make: Callable[[], NDArray[np.float32]]) -> int:
        """The row of an image that is made once for each key."""
        ...

    def pattern(self, formula: Formula) -> Tape | None:
        """The tape of a formula of the direction; None after a diagnostic."""
        ...


class Element(NamedTuple):
    """An element of the language that makes a light. `lower` returns None after a diagnostic, and raises LightError."""

    entry: Entry
    lower: Callable[[Mapping[str, Any], Lowering], Row | None]


class ExportedLight(NamedTuple):
    """A light in world space, scene-linear: cd, lx or nit by its form."""

    row: int
    kind: ir.LightKind
    name: str
    color: F64  # (3,) above 0; of a point at 1 m
    position: F64
    direction: F64  # unit: of a spot to what it lights, of a sun to where its light comes from
    cone: float  # radians: half angle of a spot
    full: float  # radians: half angle of the part of a spot that does not fade
    angle: float  # radians: half angle of a sun
    fades: bool  # by 1/d²; False: not at all
    frame: F64  # (4, 4) of a surface or a sky
    size: F64  # (2,) as Lights.size


class UsdLight(NamedTuple):
    """A prim of UsdLux: its type, its attributes, its intensity over our color, and attributes of ShapingAPI.

    It has the frame of its form: at `position` with +z against `direction`, along the `direction` of a distant light, or `frame`.
    """

    prim: str
    attributes: Mapping[str, Any]
    intensity: float = 1.0
    shaping: Mapping[str, Any] = {}
    loss: str = ""  # what the prim cannot have


class GltfLight(NamedTuple):
    """An entry of KHR_lights_punctual without its color, and a note of what it loses. It has the frame of its form, as UsdLight."""

    entry: Mapping[str, Any]
    note: str = ""


class PovrayLight(NamedTuple):
    """What follows the place and color of a light_source, which stands at `position`, or far away in `direction` and parallel."""

    more: str = ""
    loss: str = ""


class MitsubaLight(NamedTuple):
    """An emitter: its plugin, its parameters, (type of the XML element, value) of vectors by name, and the name of its color."""

    plugin: str
    color: str
    parameters: Mapping[str, Any] = {}
    vectors: Mapping[str, tuple[str, F64]] = {}
    is_turned: bool = False  # it has a transform: at `position`, with +z along `direction`
    texture: np.ndarray | None = None  # an image that shapes it
    loss: str = ""


class Text(Protocol):
    """How POV-Ray writes numbers and vectors."""

    def number(self, value: float) -> str: ...
    def vector(self, values: Any) -> str: ...


class Light(Protocol):
    """The module of a light. What is None stands for "it has none"; each name must be there."""

    KIND: ir.LightKind
    ELEMENTS: tuple[Element, ...]
    FORM: Form
    HAS_ANGLE: bool  # of a distant light: its `angle` counts, and is above 0
    HAS_IMAGE: bool  # of a sky: its radiance is an image
    profile: Callable[[Any, Lane, Lane], Lane] | None
    """(lights, row, cosine) → the share of its intensity or radiance at an angle from its axis. A lane helper: kernels compile it.

    Its axis is `direction`, or the normal of a surface, which has no visible shape then.
    """
    widest: Callable[[ir.Lights, int], float] | None
    """The angle in radians from its axis beyond which `profile` is 0; None: half a turn, or a quarter of a surface."""
    source: Callable[[ir.Lights, int], Mapping[str, float]] | None
    """Arguments of its element beyond those of its form, in SI units and radians, as `convert a.usda a.scene` writes them."""
    usd: Callable[[ExportedLight], UsdLight] | None
    gltf: Callable[[ExportedLight], GltfLight] | None
    povray: Callable[[ExportedLight, Text], PovrayLight] | None
    mitsuba: Callable[[ExportedLight], MitsubaLight] | None
    """An emitter of its own; None: nothing, or that of the shape of a surface, or of the sum of all skies."""
