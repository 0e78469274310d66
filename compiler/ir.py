"""The IR: a scene as flat tables of contiguous numpy arrays, rows joined by index. Front ends fill it, backends read it.

Every table is a NamedTuple of arrays with one row an entry, so that Numba kernels take a table, or all of them
(`Tables`), as it is. Nothing in a table points outside of the tables: names, spans and settings stand beside them in `Scene`.

Conventions: right-handed, y up, metres, radians, scene-linear Rec.709. Index columns are int32 and -1 means none.
Triangles are counter-clockwise from outside. Image row 0 is the top row; v = 0 is the bottom of an image.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lang.diagnostics import Span

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]


class Kind(IntEnum):
    """Numbers with names. Columns are compared with them: where nothing says how, numpy takes three times as long to find that out."""

    __array_ufunc__ = np.ndarray.__array_ufunc__


class GeometryKind(Kind):
    """What a geometry is, in its own frame. `parameters` hold the numbers named, in this order."""

    MESH = 0  # a range of triangles
    SPHERE = 1  # radius; about the origin. Ellipsoids are spheres under a transform
    BOX = 2  # half x, half y, half z; about the origin
    PLANE = 3  # y = 0, endless, normal +y
    RECTANGLE = 4  # half x, half z; in y = 0, normal +y
    DISK = 5  # radius; in y = 0, normal +y
    CYLINDER = 6  # radius, half height, capped (0/1); axis y, about the origin
    CONE = 7  # radius at -h, radius at +h, half height h, capped (0/1); axis y, about the origin
    TORUS = 8  # radius R, tube r; axis y, about the origin
    CAPSULE = 9  # radius, half height of the cylinder; axis y, about the origin
    QUADRIC = 10  # A … J, then half x, y, z of the box that cuts it (inf: endless)
    FORMULA = 11  # sheet (0/1: a solid where its tape is ≤ 0), x, y, z and radius of the ball that cuts it (0: none), largest coordinate


PARAMETERS = 13  # columns of Geometries.parameters


class Interpolation(Kind):
    """How an attribute's values belong to a mesh; `first + index` is the value's row."""

    CONSTANT = 0  # one value
    FACE = 1  # one a triangle (spread from polygons at import)
    VERTEX = 2  # one a vertex
    CORNER = 3  # one a triangle corner: 3 · triangle + corner


class MaterialModel(Kind):
    LAMBERT = 0
    PHONG = 1
    BLINN_PHONG = 2
    MIRROR = 3
    GLASS = 4
    EMISSIVE = 5
    PRINCIPLED = 6  # UsdPreviewSurface, metallic workflow
    PRINCIPLED_SPECULAR = 7  # the same, specular workflow
    METAL = 8  # microfacets of a metal, whose reflectance SPECULAR and EDGE give
    BLEND = 9  # WEIGHT of the second of two materials, the rest of the first


class Shading(Kind):
    SMOOTH = 0  # normals interpolated, light computed at the point ("phong")
    GOURAUD = 1  # light computed at vertices, colours interpolated
    FLAT = 2  # the face's own normal


class Slot(Kind):
    """Material inputs that take a constant or a texture; the value is the column of Materials.textures."""

    AMBIENT = 0  # k_a, colour; of principled ones occlusion, a number
    DIFFUSE = 1  # k_d, colour
    SPECULAR = 2  # k_s, colour; of metals and the specular workflow reflectance along the normal
    SHININESS = 3  # n, number
    REFLECTION = 4  # k_r, colour (mirror's colour)
    TRANSMISSION = 5  # k_t, colour (glass's colour)
    IOR = 6  # number
    EMISSION = 7  # radiance, colour
    OPACITY = 8  # number from 0, not there, to 1
    ROUGHNESS = 9  # number; its square is the microfacets' α
    METALLIC = 10  # number
    EDGE = 11  # colour: what is left of Schlick's reflectance at 81.8°
    COAT = 12  # number: how much of a clear coat
    COAT_ROUGHNESS = 13  # number
    NORMAL = 14  # the normal along u, along v and outwards; a texture's only
    BUMP = 15  # height in metres; a texture's only
    ABSORPTION = 16  # colour, natural logarithm per metre of what glass absorbs; no texture
    PRIORITY = 17  # number: of glass that overlaps other glass the higher one is there; no texture
    WEIGHT = 18  # number: of a blend's second material


SLOTS = len(Slot)


class TextureKind(Kind):
    IMAGE = 0
    CHECKER = 1
    STRIPES = 2
    FORMULA = 3  # a tape of the point in the thing's own frame: one result is grey, three are red, green and blue


class Mapping_(Kind):
    """How a surface point finds texture coordinates. p is the point in the geometry's own frame."""

    UV = 0  # the surface's own coordinates (mesh attribute, or the shape's parametrisation)
    LATLONG = 1  # longitude and latitude of p
    PROJECTED = 2  # the course's u = x/|p|, v = y/|p|
    BOX = 3  # the picture on each side of p's bounding box, by the side the normal faces
    NET = 4  # one picture of a box's unfolded net (a cross of 4 by 3 cells) on its six sides


class Wrap(Kind):
    REPEAT = 0
    CLAMP = 1
    MIRROR = 2
    BLACK = 3


class LightKind(Kind):
    POINT = 0
    SPOT = 1
    DIRECTIONAL = 2
    SUN = 3
    SKY = 4
    DOME = 5
    AMBIENT = 6
    RECTANGLE = 7
    DISK = 8
    SPHERE = 9


class FalloffKind(Kind):
    INVERSE_SQUARE = 0
    POLYNOMIAL = 1  # 1 / (a + b d + c d²)
    RAMP = 2  # 1 up to a, then linear to 0 at b


class Projection(Kind):
    PERSPECTIVE = 0
    ORTHOGRAPHIC = 1
    PANORAMIC = 2  # all around: longitude across the picture, latitude down it


class Fit(Kind):
    """Which extent of a camera is kept when the picture's aspect differs from the film's."""

    VERTICAL = 0
    HORIZONTAL = 1


class Visibility(Kind):
    """Bits of Instances.visible."""

    CAMERA = 1  # primary rays
    SHADOW = 2  # blocks light
    REFLECTION = 4  # reflected, refracted and diffuse rays


class Transforms(NamedTuple):
    """Object to world. Row 0 is the identity."""

    matrix: F64  # (n, 3, 4)
    inverse: F64  # (n, 3, 4)
    flips: Bool  # (n,) determinant < 0
    first_key: I32  # (n,) row of Keys; -1: it does not move
    keys: I32  # (n,) how many, evenly from the first opening of a shutter to the last closing; matrix and inverse are the moment's


class Keys(NamedTuple):
    """Transforms that move, taken apart: matrix = [R S | move]; between two keys moves and stretches go straight and turns evenly."""

    move: F64  # (n, 3)
    turn: F64  # (n, 4) unit quaternion x, y, z, w of R; at most half a turn from the one before
    stretch: F64  # (n, 3, 3) S


class Pools(NamedTuple):
    """The numbers that geometries and attributes are ranges of."""

    positions: F32  # (v, 3) relative to the mesh's origin
    triangles: I32  # (t, 3) rows of positions
    values: F32  # (k,) attribute values, flat
    loops: I32  # (l, 2) first corner, corner count: outlines and holes
    corners: I32  # (c,) rows of positions
    code: I32  # (r, 4) rows of tapes: operation (tapes.Op) and operands
    constants: F64  # (q,) numbers of tapes


class Attributes(NamedTuple):
    """Named data of meshes (names in Scene.names): values[first + width · index + k]."""

    interpolation: I32  # (n,) Interpolation
    width: I32  # (n,)
    first: I64  # (n,) into Pools.values
    count: I32  # (n,) how many values (not floats)


class Tapes(NamedTuple):
    """Formulas, see tapes.py. Operands count within a tape: 0, 1, 2 are x, y, z; 3 + i is row i's value; ~k constant k."""

    first: I64  # (n,) row of Pools.code
    count: I32  # (n,)
    first_constant: I64  # (n,)
    constant_count: I32  # (n,)
    results: I32  # (n, 4) the values that are its results
    result_count: I32  # (n,)


class Polygons(NamedTuple):
    """Faces as they were before they were cut into triangles. Meshes of triangles alone have none."""

    first_loop: I32  # (n,) the outline; holes follow
    loop_count: I32  # (n,)
    first_triangle: I32  # (n,) rows of Pools.triangles
    triangle_count: I32  # (n,)


class Geometries(NamedTuple):
    kind: I32  # (n,) GeometryKind
    parameters: F64  # (n, PARAMETERS)
    bounds: F64  # (n, 2, 3) lowest and highest corner in its own frame; ±inf when endless
    origin: F64  # (n, 3) added to a mesh's positions; 0 for other kinds
    first_vertex: I32  # (n,)
    vertex_count: I32  # (n,)
    first_triangle: I32  # (n,)
    triangle_count: I32  # (n,)
    first_polygon: I32  # (n,)
    polygon_count: I32  # (n,) 0: each triangle is a face of its own
    normals: I32  # (n,) row of Attributes or -1 (faces' own normals)
    uvs: I32  # (n,) row of Attributes or -1
    colors: I32  # (n,) row of Attributes or -1; multiplies k_d (and k_a)
    tape: I32  # (n,) row of Tapes of a FORMULA, else -1


class Instances(NamedTuple):
    """A geometry placed in the world."""

    geometry: I32
    transform: I32
    material: I32
    light: I32  # row of Lights it is the shape of, or -1
    visible: I32  # Visibility bits


class Materials(NamedTuple):
    model: I32  # (n,) MaterialModel
    shading: I32  # (n,) Shading
    normalized: Bool  # (n,)
    threshold: F64  # (n,) above 0: there where the opacity is at least this, and elsewhere not at all; 0: as much there as it says
    values: F64  # (n, SLOTS, 3) constants; numbers stand in column 0. 1 under a texture
    textures: I32  # (n, SLOTS) row of Textures, whose value multiplies the constant, or -1
    textured: Bool  # (n,) whether any slot has one, or a blend's parts have
    first: I32  # (n,) rows of the materials that a BLEND is of, lower than its own; -1
    second: I32


class Textures(NamedTuple):
    """value = gain · texel + bias, texel from the image or the two colours; uv' = frame · (u, v, 1)."""

    kind: I32
    mapping: I32  # Mapping_
    wrap_u: I32  # Wrap
    wrap_v: I32
    nearest: Bool  # no interpolation between texels
    image: I32  # row of Images or -1
    tape: I32  # row of Tapes of a FORMULA, else -1
    channel: I32  # -1: colour; 0-3: this channel for r, g and b
    frame: F64  # (n, 2, 3)
    size: F64  # (n,) a checker's or stripes' cell along the surface in metres; 0: 8 cells over u and over v
    color_a: F64  # (n, 3)
    color_b: F64  # (n, 3)
    gain: F64  # (n, 3)
    bias: F64  # (n, 3)


class Images(NamedTuple):
    first: I64  # (n,) row of texels
    width: I32
    height: I32
    texels: F32  # (m, 4) linear r, g, b, a; row-major from the top left


class Lights(NamedTuple):
    """`color` is strength times colour: intensity W/sr-like for POINT and SPOT, irradiance facing it for DIRECTIONAL and
    SUN, radiance for the rest. Area lights' frames are those of RECTANGLE, DISK and SPHERE geometries (shining to +y)."""

    kind: I32
    color: F64  # (n, 3)
    position: F64  # (n, 3) POINT, SPOT
    direction: F64  # (n, 3) unit; where a SPOT looks, where DIRECTIONAL and SUN light comes from
    transform: I32  # (n,) frame of area lights and domes (world = transform · local)
    size: F64  # (n, 2) half x, half z of RECTANGLE; radius in column 0 of DISK and SPHERE
    cos_cone: F64  # (n,) where a spot ends
    cos_full: F64  # (n,) inside it a spot is at full strength (smoothstep of the cosine between)
    angle: F64  # (n,) angular radius of a SUN
    falloff: I32  # (n,) FalloffKind
    coefficients: F64  # (n, 3)
    image: I32  # (n,) dome's picture or -1
    instance: I32  # (n,) the area light's visible shape, or -1
    shadows: Bool  # (n,)


class Cameras(NamedTuple):
    """Looks down -z of its transform, y up in the picture."""

    projection: I32
    transform: I32
    extent: F64  # (n,) tan of half the field of view, or half the extent in metres, along `fit`; of panoramas half their height, π/2
    fit: I32  # Fit
    aspect: F64  # (n,) width / height it was made for; 0: any
    near: F64  # 0: at the eye; below 0, of orthographic ones: also what lies so far behind it
    far: F64  # inf: none
    shift: F64  # (n, 2) share of the picture's width and height
    exposure: F64  # (n,) ev, NaN when not said
    opening: F64  # (n,) seconds from the scene's moment to where the shutter opens
    shutter: F64  # (n,) seconds it is open; keys go from the first opening of all cameras to the last closing
    lens: F64  # (n,) radius of the aperture in metres; 0: a pinhole
    focus: F64  # (n,) depth of the plane in focus, where there is a lens


class Tables(NamedTuple):
    """All that kernels need, in one value."""

    transforms: Transforms
    keys: Keys
    pools: Pools
    attributes: Attributes
    polygons: Polygons
    tapes: Tapes
    geometries: Geometries
    instances: Instances
    materials: Materials
    textures: Textures
    images: Images
    lights: Lights
    cameras: Cameras


@dataclass(frozen=True, slots=True)
class Settings:
    """What a scene or the command line asks of a render; None: not said."""

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
    camera: str | None = None
    threads: int | None = None
    denoise: bool | None = None
    tolerance: float | None = None  # pixels that a tessellated shape may be off its true outline

    def over(self, other: Settings) -> Settings:
        """These settings where said, else those of `other`."""
        merged = {f.name: getattr(self, f.name) if getattr(self, f.name) is not None else getattr(other, f.name) for f in fields(self)}
        return Settings(**merged)


@dataclass(frozen=True, slots=True)
class Names:
    """Names of rows, one each."""

    geometries: tuple[str, ...] = ()
    instances: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    attributes: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # of lights, "" of those in none; () if all are


@dataclass(frozen=True, slots=True)
class Spans:
    """For each row of a table, (source, line, column, end line, end column); `sources` are the names to show.

    Tables: geometries, instances, materials, textures, lights, cameras; and settings, of one row where the scene has any. Line 0: the
    whole file or prim; source -1: not known.
    """

    sources: tuple[str, ...] = ()
    rows: Mapping[str, I32] = field(default_factory=dict)  # table -> (n, 5)

    def at(self, table: str, row: int) -> Span | None:
        """Where a row comes from, or None if nobody said."""
        rows = self.rows.get(table)
        if rows is None or not 0 <= row < len(rows):
            return None
        source, *place = rows[row].tolist()
        return Span(self.sources[source], *place) if 0 <= source < len(self.sources) else None


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene ready to be validated, planned and drawn. Immutable: arrays are not writable."""

    name: str
    tables: Tables
    names: Names = Names()
    spans: Spans = Spans()
    settings: Settings = Settings()
    photometric: bool = False  # some light value had a unit: exposure is metered
    duration: float | None = None  # seconds, from animate(…)
    fps: float = 24.0
    defaults: tuple[str, ...] = ()  # what was added because it was missing ("camera", "sun", "sky"), for explain
    files: tuple[str, ...] = ()  # every file read, for watch
    params: tuple[Any, ...] = ()  # lang.elements.ParamInfo, for inspect and sliders


_FLOAT64 = {
    "matrix", "inverse", "parameters", "bounds", "origin", "frame", "size", "color_a", "color_b", "gain", "bias", "color", "position",
    "direction", "cos_cone", "cos_full", "angle", "coefficients", "extent", "aspect", "near", "far", "shift", "exposure",
    "threshold", "move", "turn", "stretch", "opening", "shutter", "constants", "lens", "focus",
}  # fmt: skip
_FLOAT32 = {"positions", "texels"}
_INT64 = {"first", "first_constant"}
_BOOL = {"flips", "normalized", "nearest", "shadows", "textured"}
_SHAPE: dict[tuple[str, str], tuple[int, ...]] = {
    ("transforms", "matrix"): (3, 4),
    ("transforms", "inverse"): (3, 4),
    ("keys", "move"): (3,),
    ("keys", "turn"): (4,),
    ("keys", "stretch"): (3, 3),
    ("pools", "positions"): (3,),
    ("pools", "triangles"): (3,),
    ("pools", "loops"): (2,),
    ("pools", "code"): (4,),
    ("tapes", "results"): (4,),
    ("geometries", "parameters"): (PARAMETERS,),
    ("geometries", "bounds"): (2, 3),
    ("geometries", "origin"): (3,),
    ("materials", "values"): (SLOTS, 3),
    ("materials", "textures"): (SLOTS,),
    ("textures", "frame"): (2, 3),
    ("textures", "color_a"): (3,),
    ("textures", "color_b"): (3,),
    ("textures", "gain"): (3,),
    ("textures", "bias"): (3,),
    ("images", "texels"): (4,),
    ("lights", "color"): (3,),
    ("lights", "position"): (3,),
    ("lights", "direction"): (3,),
    ("lights", "size"): (2,),
    ("lights", "coefficients"): (3,),
    ("cameras", "shift"): (2,),
}
TABLES: dict[str, type] = {
    "transforms": Transforms, "keys": Keys, "pools": Pools, "attributes": Attributes, "polygons": Polygons, "tapes": Tapes,
    "geometries": Geometries, "instances": Instances, "materials": Materials, "textures": Textures, "images": Images,
    "lights": Lights, "cameras": Cameras,
}  # fmt: skip


def among(column: np.ndarray, kinds: Iterable[int]) -> np.ndarray:
    """Which numbers of a column are one of a few; np.isin takes several times as long."""
    found = np.zeros(np.shape(column), bool)
    for kind in kinds:
        found |= column == kind
    return found


@cache
def column_type(table: str, column: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """The dtype of a column and the shape of one row of it."""
    if table == "materials" and column == "values":
        kind: type = np.float64
    elif table == "pools" and column == "values":
        kind = np.float32
    elif table == "materials" and column == "first":
        kind = np.int32
    else:
        named = ((np.float64, _FLOAT64), (np.float32, _FLOAT32), (np.int64, _INT64), (np.bool_, _BOOL))
        kind = next((t for t, names in named if column in names), np.int32)
    return np.dtype(kind), _SHAPE.get((table, column), ())


def table_of(table: str, columns: Mapping[str, Any]) -> Any:
    """A table from lists or arrays by column name, checked for row shape, made contiguous, typed and read-only."""
    return _filled(table, columns) if columns else _without_rows(table)


@cache
def _without_rows(table: str) -> Any:
    return _filled(table, {})


def _filled(table: str, columns: Mapping[str, Any]) -> Any:
    made = {}
    for column in TABLES[table]._fields:  # type: ignore[attr-defined]
        dtype, shape = column_type(table, column)
        array = np.ascontiguousarray(np.asarray(columns.get(column, ()), dtype=dtype).reshape((-1, *shape)))
        array = array.view()
        array.flags.writeable = False
        made[column] = array
    return TABLES[table](**made)


def empty_tables() -> Tables:
    """Tables without a row (but the identity transform)."""
    identity = np.eye(3, 4)[None]
    made = {name: table_of(name, {}) for name in TABLES}
    made["transforms"] = table_of("transforms", {"matrix": identity, "inverse": identity, "flips": [False], "first_key": [-1], "keys": [0]})
    return Tables(**made)
