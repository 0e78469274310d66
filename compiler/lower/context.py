"""Protocol of the lowering driver: what lowering of shapes, lights, materials and cameras uses of it."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...lang.elements import Element
from ...lang.formula_graph import Formula
from ..formula.tape import Tape
from ..io.sandbox import Files
from ..scene.builder import SceneBuilder
from ..scene.row_records import Piece


class MaterialRows(Protocol):
    """Rows of materials and pictures; -1, or None, after a diagnostic."""

    def row(self, element: Element) -> int:
        """The row of a material element."""
        ...

    def inside_of_parts(self, element: Element, first: int, second: int) -> int:
        """The medium inside of a blend of two rows; -1 without one."""
        ...

    def image(self, element: Element, name: str, space: str, color: bool) -> int:
        """The row of the picture file `name`."""
        ...

    def pattern_tape(self, element: Element, formula: Formula, color: bool, unit: float, what: str = "pattern") -> Tape | None:
        """The tape of a pattern, or of a density; `what` is its name in messages."""
        ...


class Context(Protocol):
    """The state of lowering one document."""

    builder: SceneBuilder
    photometric: bool  # whether a light has a photometric unit
    centered: dict[Any, int]  # geometries of shapes.CENTERED by kind and measures
    generated: dict[tuple[object, ...], list[Piece]]  # shapes made so far, by what their form depends on

    @property
    def files(self) -> Files: ...

    @property
    def tolerance(self) -> float | None:
        """The largest distance of triangles from their surfaces, in the frame of the element; None: the default of its kind."""
        ...

    def scaled(self, matrix: np.ndarray) -> AbstractContextManager[None]:
        """A block whose elements are in the frame of a matrix."""
        ...

    @property
    def materials(self) -> MaterialRows: ...

    def error(self, element: Element, message: str, hint: str = "") -> None: ...

    def warn(self, element: Element, message: str, hint: str = "") -> None: ...

    def beyond(self, element: Element) -> bool:
        """Whether an element has a number that is too big; reports it."""
        ...

    def refuse(self, element: Element, message: str, hint: str = "") -> list[Piece]:
        """Report an error; no pieces."""
        ...

    def is_shape(self, element: Element) -> bool: ...

    def pieces(self, element: Element) -> list[Piece]:
        """The geometries of a shape."""
        ...

    def block(self, element: Element) -> np.ndarray | None:
        """The transform (4, 4) of a block; None for other elements."""
        ...

    def folder(self, element: Element) -> Path | None:
        """The folder of the source of an element, which its file names are relative to."""
        ...

    def material_rows(self, element: Element) -> tuple[tuple[str, int], ...]:
        """The rows of the materials that replace those of a file, by their names in it."""
        ...

    def mesh_file(self, element: Element) -> list[Piece]:
        """The geometries of a mesh file."""
        ...
