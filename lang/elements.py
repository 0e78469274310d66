"""What evaluation yields: elements with checked arguments, in plain Python values and base units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .diagnostics import Span

Color = tuple[float, float, float]  # scene-linear Rec.709
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Euler:
    """Turns about the fixed x, then y, then z axis; radians."""

    angles: Vector


@dataclass(frozen=True, slots=True)
class AxisAngle:
    """A turn about `axis` (any length but 0) by `angle` radians, counter-clockwise seen from the axis' tip."""

    axis: Vector
    angle: float


@dataclass(frozen=True, slots=True)
class Quaternion:
    """x, y, z, w; normalised when used."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """One element: a shape, light, material, texture, camera, block or setting.

    kind      its name in the schema ("sphere", "blinn_phong", "point", "group", …)
    args      every argument of its schema entry by name: given, defaulted, or None.
              Lengths in metres, angles in radians, times in seconds, light quantities in their SI unit;
              colours linear (r, g, b); points, sizes and directions tuples of floats; materials and textures
              are Elements; formulas are formula.Formula.
    given     the names that were written out (the rest are defaults)
    children  for blocks and solids
    scope     dotted path of the parts it was made in, for default names ("gear.rim")
    trace     the calls it came through, innermost first
    photometric  whether any light quantity was written with a unit
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


@dataclass(frozen=True, slots=True)
class ParamInfo:
    """A `param` line of the scene as sliders, sweeps and `inspect` want it. Values are in the file's own units."""

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
    """A whole evaluated scene: what is placed (shapes, lights, blocks), cameras, settings and params."""

    name: str
    elements: tuple[Element, ...]  # shapes, lights and blocks, in the order placed
    cameras: tuple[Element, ...]
    settings: Mapping[str, Element]  # "render", "animate"
    params: tuple[ParamInfo, ...]
    sources: Mapping[str, str] = field(default_factory=dict)  # shown file name -> text, for diagnostics
    files: tuple[str, ...] = ()  # every file read by path, for `watch`
