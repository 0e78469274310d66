"""What the module of a shape holds. `p` is a row of Geometries.parameters: the shape's measures in the order of MEASURES."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..lang.schema.argument_types import Entry
from .surfaces import Tessellation

Point = tuple[int, int, int]
"""Three values of a tape."""
Lane = Any
Vec = tuple[Lane, Lane, Lane]


class ShapeError(ValueError):
    """Arguments of an element that make no shape: the message, and a hint."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class Measure(NamedTuple):
    """One column of a shape's parameters."""

    name: str
    above: float | None = None  # limits, in metres where it is a length
    minimum: float | None = None
    may_be_infinite: bool = False


class Frame(NamedTuple):
    """Where the shape of an element is, in the frame of the element."""

    center: Sequence[float]
    normal: Sequence[float] | None = None  # the direction of the shape's y axis
    stretch: Sequence[float] | None = None  # factors along the axes


class Element(NamedTuple):
    """An element of the language that makes the shape. Both functions take its arguments, and raise ShapeError."""

    entry: Entry
    parameters: Callable[[Mapping[str, Any]], tuple[float, ...]]
    frame: Callable[[Mapping[str, Any]], Frame] | None = None  # None: about its argument `center`


class Emitting(NamedTuple):
    """How light samples find an emissive shape; see render/light/emitter_table.py."""

    form: str  # "rectangle", "disk", "sphere", "box", "tube" (the side of a closed cylinder), "cone", "torus" or "capsule"
    size: tuple[float, ...]  # half edges; the radius, twice; radii of a cone at the bottom and the top, of a torus' ring and tube
    half: float = 0.0  # half the length along the y axis, without the ends of a capsule
    closed: bool = True  # a tube or cone has caps


class MitsubaShape(NamedTuple):
    """A shape of Mitsuba: a plugin under a transform, or with a radius (metres) and named points."""

    plugin: str
    matrix: np.ndarray | None = None  # (4, 4)
    radius: float = 0.0
    points: Mapping[str, Sequence[float]] = {}


class Mitsuba(NamedTuple):
    """The shapes of Mitsuba for one of ours, under the transforms that they allow."""

    transforms: str  # "any", "orthogonal": axes stay at right angles, or "even": scaled evenly
    shapes: tuple[MitsubaShape, ...]


class Text(Protocol):
    """How POV-Ray writes numbers and vectors."""

    def number(self, value: float) -> str: ...
    def vector(self, values: Any) -> str: ...


class Shape(Protocol):
    """The module of a shape. What is None stands for "it has none"; each name must be there."""

    KIND: ir.GeometryKind
    ELEMENTS: tuple[Element, ...]
    MEASURES: tuple[Measure, ...]
    EXACT: bool  # its triangles are the surface
    FLAT: bool  # in the plane y = 0, normal +y
    WRAPS: bool  # its triangles cross a seam of u, where their vertices must be doubled
    OPEN: tuple[str, str]  # why its triangles are not closed where they are not, and how to close them
    USD: Mapping[str, Callable[[Callable[[str], float], str], tuple[float, ...] | None]]
    """For each type of prim: the parameters, by a function of its attributes and its axis; None for those of another shape."""
    has_sense: Callable[[np.ndarray], np.ndarray] | None
    """(n,) whether rows (n, 13) are possible, beyond the limits of MEASURES."""
    support: Callable[[Sequence[float], np.ndarray], float] | None
    """The largest value of a linear form (3,) on the shape; None where its bounds give it, or no closed form does."""
    deviation: Callable[[Sequence[float], Tessellation], float] | None
    """The largest distance (metres) of triangles from the surface; None: by the chords of `circles`."""
    closed_mesh: Callable[[Sequence[float], float], tuple[np.ndarray, np.ndarray, float] | None] | None
    """Points, triangles and deviation of a closed mesh within a tolerance, for the CSG of meshes; None of open shapes."""
    emitting: Callable[[Sequence[float]], Emitting | None] | None
    """How light samples find it; None: only samples of BSDFs do."""
    povray: Callable[[Sequence[float], Text], tuple[str, list[str]]] | None
    """The object of POV-Ray: its name, and the lines of its body."""
    mitsuba: Callable[[Sequence[float]], Mitsuba] | None

    def bounds(self, p: Sequence[float]) -> np.ndarray:
        """(2, 3) bounds in its own frame; ±inf where it does not end."""
        ...

    def hit(self, kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
        """(t, part) of the first hit with t_min < t < t_max; inf without. A lane helper: kernels compile it."""
        ...

    def normal(self, kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
        """The outward normal, of any length. A lane helper."""
        ...

    def uv(
        self, kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane
    ) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
        """((u, v), (metres per u, metres per v)); rho is the distance from the y axis. A lane helper."""
        ...

    def field(self, b: Builder, p: Sequence[float], point: Point) -> int:
        """The tape's value that is at most 0 inside. Raises NoSolid."""
        ...

    def is_closed(self, p: Sequence[float]) -> bool:
        """Whether it encloses a volume."""
        ...

    def circles(self, p: Sequence[float]) -> Sequence[tuple[float, float]]:
        """The circles that chords stand for, those around the y axis first: radius, and its share of a tolerance.

        Empty for exact triangles, and for those that the rasterizer does not draw: it traces a ray for each sample.
        """
        ...

    def triangles(self, p: Sequence[float], tolerance: float) -> Tessellation:
        """Triangles within a tolerance (metres), either way round; see surfaces.py."""
        ...
