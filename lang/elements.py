"""The evaluator's output: elements with checked arguments, in plain Python values and base units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .diagnostics import Span

Color = tuple[float, float, float]  # scene-linear Rec.709
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Euler:
    """Rotations about the fixed x, then y, then z axis, in radians."""

    angles: Vector


@dataclass(frozen=True, slots=True)
class AxisAngle:
    """A rotation about `axis` (of any length but 0) by `angle` radians, counter-clockwise seen from the tip of the axis."""

    axis: Vector
    angle: float


@dataclass(frozen=True, slots=True)
class Quaternion:
    """A rotation; normalised when used."""

    x: float
    y: float
    z: float
    w: float


Rotation = Euler | AxisAngle | Quaternion


@dataclass(frozen=True, slots=True)
class Falloff:
    """`polynomial`: 1/(a + b·d + c·d²), d in metres. `ramp`: 1 up to a metres, then linear to 0 at b metres."""

    kind: str  # "polynomial" | "ramp"
    coefficients: Vector


@dataclass(slots=True, eq=False)
class Element:
    """One element: a shape, light, material, texture, camera, block or setting. Never changed once it is made.

    kind      its name in the schema ("sphere", "blinn_phong", "point", "group", …)
    args      every argument of its schema entry by name: given, default, or None.
              Lengths in metres, angles in radians, times in seconds, light quantities in their SI unit;
              colours linear (r, g, b); points, sizes and directions tuples of floats; materials, media and
              textures are Elements; coefficients and emission of media (r, g, b) per metre; formulas are formula_graph.Formula.
    given     names of the arguments that the scene gives (the others have defaults)
    children  for blocks and solids
    scope     dotted path of the parts that make it, for default names ("gear.rim")
    trace     the chain of calls that makes it, innermost first
    photometric  whether any light quantity was written with a unit
    weight    number of elements in it and of itself, with repetitions
    category  that of its schema entry ("shape", "solid", "block", "light", "material", "medium", "texture", "camera", "fog",
              "setting", "meter")
    Elements compare by identity: one `let` constant used twice is one element.
    """

    kind: str
    args: Mapping[str, Any]
    span: Span
    given: frozenset[str] = frozenset()
    children: tuple[Element, ...] = ()
    scope: str = ""
    trace: tuple[tuple[str, Span], ...] = ()
    photometric: bool = False
    weight: int = 1
    category: str = ""

    @property
    def calls(self) -> tuple[tuple[str, Span], ...]:
        """The chain of calls, innermost first, from the one outside of the library."""
        calls = self.trace
        if self.span.in_library:
            while calls and calls[0][1].in_library:
                calls = calls[1:]
        return calls

    @property
    def place(self) -> Span:
        """The place for messages: that of the element, or for an element of the library that of the call from outside."""
        calls = self.calls if self.trace and self.span.in_library else ()
        return calls[0][1] if calls else self.span

    @property
    def call(self) -> Span:
        """The place of the outermost call that makes it, or its own."""
        return self.trace[-1][1] if self.trace else self.span


@dataclass(frozen=True, slots=True)
class ParamInfo:
    """A `param` of the scene, for sliders, sweeps and `inspect`. Values are in the units of the file."""

    name: str
    type: str
    value: Any
    default: Any
    range: tuple[float, float] | tuple[Any, ...] | None
    doc: str
    unit: str
    span: Span


@dataclass(frozen=True, slots=True)
class Document:
    """An evaluated scene: placed elements, cameras, settings and params."""

    name: str
    elements: tuple[Element, ...]  # shapes, lights and blocks, in the order placed
    cameras: tuple[Element, ...]
    settings: Mapping[str, Element]  # "render", "animate", "fog"
    params: tuple[ParamInfo, ...]
    sources: Mapping[str, str] = field(default_factory=dict)  # displayed file name -> text, for diagnostics
    files: tuple[str, ...] = ()  # every file read by path, for `watch`
    names_length: bool = True  # whether the scene's own file has a unit of length: a number's, or by `unit`
