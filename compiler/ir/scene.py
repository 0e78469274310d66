"""Scene: the tables with names, source positions and settings beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, overload

from ...lang.diagnostics import Span
from .tables import I32, I64, Tables


@dataclass(frozen=True, slots=True)
class Settings:
    """Render settings of a scene or of the command line; None: not set."""

    size: tuple[int, int] | None = None
    backend: str | None = None
    samples: int | None = None
    error: float | None = None
    budget: float | None = None
    bounces: int | None = None
    seed: int | None = None
    filter: str | None = None
    background: str | tuple[float, float, float] | None = None  # "sky", "transparent" or a linear colour
    crop: tuple[int, int, int, int] | None = None
    aov: tuple[str, ...] | None = None
    exposure: float | None = None
    view: str | None = None
    white: float | str | None = None  # kelvin, or "auto"
    bloom: float | None = None  # share of the light that the lens scatters
    working_space: str | None = None  # lang.color_spaces.WORKING
    ocio: str | None = None  # a configuration of OpenColorIO: a file, or ocio://…
    display: str | None = None  # of that configuration, as the next
    look: str | None = None
    camera: str | None = None
    threads: int | None = None
    denoise: bool | None = None
    tolerance: float | None = None  # largest error of a tessellated outline, in pixels

    def over(self, other: Settings) -> Settings:
        """These settings; those of `other` where they are None."""
        merged = {f.name: getattr(self, f.name) if getattr(self, f.name) is not None else getattr(other, f.name) for f in fields(self)}
        return Settings(**merged)


class CopyNames(Sequence[str]):
    """Names of many instances: `stem[id]`, or the stem alone where the id is negative. They are made when they are asked for."""

    def __init__(self, stems: Sequence[str], rows: I32, ids: I64) -> None:
        """`rows` (n,) are those of the stems, `ids` (n,)."""
        self._stems, self._rows, self._ids = stems, rows, ids

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> CopyNames: ...
    def __getitem__(self, index: int | slice) -> str | CopyNames:
        if isinstance(index, slice):
            return CopyNames(self._stems, self._rows[index], self._ids[index])
        stem, number = str(self._stems[int(self._rows[index])]), int(self._ids[index])
        return stem if number < 0 else f"{stem}[{number}]"


@dataclass(frozen=True, slots=True)
class Names:
    """Names of rows, one each; the groups of lights."""

    geometries: tuple[str, ...] = ()
    instances: Sequence[str] = ()
    materials: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    attributes: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # of lights, "" without one; () if no light has one


@dataclass(frozen=True, slots=True)
class Spans:
    """For each row of a table, (source, line, column, end line, end column); `sources` are names of files.

    Tables: geometries, instances, materials, textures, lights, cameras; "calls" are the outermost calls that make the instances;
    settings has at most one row. Line 0: the whole file or prim;
    source -1: unknown.
    """

    sources: tuple[str, ...] = ()
    rows: Mapping[str, I32] = field(default_factory=dict)  # table -> (n, 5)

    def get(self, table: str, row: int) -> Span | None:
        """The source position of a row; None if unknown."""
        rows = self.rows.get(table)
        if rows is None or not 0 <= row < len(rows):
            return None
        source, *place = rows[row].tolist()
        return Span(self.sources[source], *place) if 0 <= source < len(self.sources) else None


@dataclass(frozen=True, slots=True)
class Meter:
    """A light meter: a rectangle that receives light, a point, or the surface of objects. Pictures do not show it."""

    name: str
    frame: tuple[tuple[float, ...], ...]  # 4 rows of 4: right-handed, without scale; it receives light from +y
    size: tuple[float, float] = (0.0, 0.0)  # metres along x and z; 0: a point
    cells: tuple[int, int] = (1, 1)  # along x and z
    on: tuple[str, ...] = ()  # patterns of names of instances whose surface it is; () for a rectangle or a point
    back: bool = False  # of a surface: its inside
    place: Span | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene for validation, planning and rendering. Immutable: arrays are not writable."""

    name: str
    tables: Tables
    names: Names = Names()
    spans: Spans = Spans()
    settings: Settings = Settings()
    photometric: bool = False  # some light has a photometric unit: exposure is metered
    duration: float | None = None  # seconds, from animate(…)
    fps: float = 24.0
    defaults: tuple[str, ...] = ()  # elements added by default ("camera", "sun", "sky"), for explain
    files: tuple[str, ...] = ()  # every file read, for watch
    params: tuple[Any, ...] = ()  # lang.elements.ParamInfo, for inspect and sliders
    meters: tuple[Meter, ...] = ()  # light meters, for measure
    is_wide: bool = False  # some image has colours beyond Rec.709, with negative components
