"""Common parts of the exporters: the export result with its losses, transforms, cameras, triangles and textures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...lang.diagnostics import Diagnostic
from .. import ir
from ..io.replace_file import replace_file
from ..ir.light_links import CASTERS, EVERYTHING
from ..plan import scene_facts

BLACK = np.zeros(3)
F64 = NDArray[np.float64]


class Shell(NamedTuple):
    """The surface of an instance as triangles, in its own frame; counter-clockwise from outside."""

    positions: F64  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    normals: F64 | None = None  # (n, 3)
    uvs: F64 | None = None  # (n, 2)
    metric: F64 | None = None  # (m, 2) metres in the instance's frame per unit of u and of v, on each triangle
    colors: F64 | None = None  # (n, 3) linear


Tessellate = Callable[[int], tuple[F64, NDArray[np.int32], F64, F64, F64]]
"""Tessellates an instance (a row) whose shape a format lacks: positions, triangles, normals, uvs, metric as in Shell."""


DEFAULT = "default"  # the name of the material of surfaces without one


@dataclass(eq=False)
class Export:
    """An exported scene: the main file's content, and the other files by name.

    `found` has a warning with a fix for each feature that the format lacks, and a note for each feature in another form.
    """

    scene: ir.Scene
    text: str = ""
    data: bytes = b""  # of a binary format, in place of the text
    files: dict[str, bytes] = field(default_factory=dict)
    found: list[Diagnostic] = field(default_factory=list)
    triangles: int = 0
    deviation: float = 0.0  # metres: largest distance of the triangles from the true surface

    def cannot(self, message: str, table: str = "", row: int = -1, hint: str = "") -> None:
        """Report a loss, once."""
        self._say("warning", message, table, row, hint)

    def without_opacity(self) -> None:
        """Report the materials whose opacity is lost."""
        used = self.scene.tables.instances.material
        for row in np.unique(used[scene_facts.partial(self.scene.tables)[used]]):
            self.cannot("opacity is not carried: the surface is opaque there", "materials", int(row))

    def without_links(self) -> None:
        """Report the lights whose links are lost."""
        lights = self.scene.tables.lights
        for row in np.flatnonzero((lights.receivers != EVERYTHING) | (lights.blockers != CASTERS)).tolist():
            self.cannot("`receivers` and `blockers` are not carried: the light lights every object, and each casts shadows", "lights", row)

    @property
    def lights(self) -> list[int]:
        """The rows of lights that shine, without those added to a scene that has none: other programs have their own."""
        lights = self.scene.tables.lights
        return [row for row in np.flatnonzero(lights.color.max(axis=1, initial=0.0) > 0).tolist() if self.scene.spans.at("lights", row)]

    def tessellated(self, kind: ir.GeometryKind, instance: int, triangles: int, tolerance: float) -> None:
        """Report that a shape is exported as triangles, unless the triangles are exact."""
        if kind not in (ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE):
            self.note(f"a {kind.name.lower()} is carried as {triangles} triangles, {tolerance:g} pixels off at most", "instances", instance)

    def carried(self, texture: int) -> int:
        """A row of Textures; -1, with a report, for a texture defined by formulas."""
        if texture >= 0 and self.scene.tables.textures.kind[texture] == ir.TextureKind.FORMULA:
            self.cannot("a pattern is not carried: it is white", "textures", texture)
            return -1
        return texture

    def note(self, message: str, table: str = "", row: int = -1) -> None:
        """Report a feature exported in another form, once."""
        self._say("note", message, table, row, "")

    def save(self, path: Path) -> None:
        """Write the main file to `path` and the other files beside it. Raises OSError."""
        for name, data in self.files.items():
            replace_file(path.parent / name, data)
        replace_file(path, self.data or self.text.encode())

    @property
    def lost(self) -> list[str]:
        """The features that the format lacks, each with its place; empty for a faithful export."""
        return [f"{d.span}: {d.message}" if d.span else d.message for d in self.found if d.severity == "warning"]

    def _say(self, severity: str, message: str, table: str, row: int, hint: str) -> None:
        said = Diagnostic(severity, message, self.scene.spans.at(table, row) if table else None, hint)
        if said not in self.found:
            self.found.append(said)


def number(value: float) -> str:
    """A number as text that reads back as the same float32, and nearly the same float64."""
    return f"{float(value) + 0.0:.12g}"  # + 0: −0 becomes 0


def numbers(values: Any, separator: str = ", ") -> str:
    return separator.join(number(v) for v in np.asarray(values, np.float64).ravel())


# --- transforms ----------------------------------------------------------------------------------------------------------


def world(tables: ir.Tables, instance: int) -> F64:
    """(4, 4) object-to-world matrix of an instance."""
    return square(tables.transforms.matrix[tables.instances.transform[instance]])


def square(matrix: Any) -> F64:
    """A (3, 4) transform as (4, 4)."""
    full = np.eye(4)
    full[:3] = matrix
    return full


def frame_along(axis: F64) -> F64:
    """(3, 3) rotation from +z to a unit axis."""
    side = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(side, axis)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def even_scale(matrix: F64) -> float | None:
    """The scale factor of a uniformly scaling transform (4, 4) or (3, 4); else None."""
    linear = matrix[:3, :3]
    gram = linear.T @ linear
    square_scale = float(np.trace(gram)) / 3.0
    if np.abs(gram - square_scale * np.eye(3)).max() > 1e-9 * square_scale:
        return None
    return math.sqrt(square_scale)


def mean_scale(matrix: F64) -> float:
    """The mean length of a transform's axes: the scale factor applied to texture cells."""
    return float(np.linalg.norm(matrix[:3, :3], axis=0).mean())


def reach(tables: ir.Tables) -> tuple[F64, float]:
    """(center, radius) of a bounding sphere of all bounded instances, the camera and the lights."""
    points = [square(tables.transforms.matrix[row])[:3, 3] for row in tables.cameras.transform.tolist()]
    for i, g in enumerate(tables.instances.geometry.tolist()):
        low, high = tables.geometries.bounds[g]
        if np.isfinite([low, high]).all():
            corners = np.array([[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
            points += list((corners @ world(tables, i).T)[:, :3])
    lamps = np.isin(tables.lights.kind, (ir.LightKind.POINT, ir.LightKind.SPOT))
    points += list(tables.lights.position[lamps])
    cloud = np.array(points)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-3)


# --- the camera ----------------------------------------------------------------------------------------------------------


class Eye(NamedTuple):
    """A camera in world space. A point of the picture is `position + forward + x right + y up` (perspective), x and y in -1…1."""

    position: F64
    right: F64  # from the picture's center to its right edge, at distance 1; orthographic: in metres
    up: F64
    forward: F64  # unit
    shift: F64  # (2,) of the center, in half pictures: in units of `right` and `up`
    perspective: bool
    regular: bool  # right, up and forward are orthogonal, and the frame has one scale


def eye(scene: ir.Scene, camera: int, size: tuple[int, int]) -> Eye:
    """The camera (a row) for a picture of `size` pixels."""
    cameras, tables = scene.tables.cameras, scene.tables
    aspect, extent = size[0] / size[1] * float(cameras.pixel_aspect[camera]), float(cameras.extent[camera])
    half = (extent, extent / aspect) if cameras.fit[camera] == ir.Fit.HORIZONTAL else (extent * aspect, extent)
    matrix = tables.transforms.matrix[cameras.transform[camera]]
    x, y, z = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    perspective = bool(cameras.projection[camera] == ir.Projection.PERSPECTIVE)
    long = float(np.linalg.norm(z))
    if perspective:
        x, y = x / long, y / long
    angles = np.abs([x @ y, x @ z / long, y @ z / long])
    regular = bool(angles.max() < 1e-9 * float(x @ x) and abs(float(x @ x) - float(y @ y)) < 1e-9 * float(x @ x))
    return Eye(matrix[:, 3], x * half[0], y * half[1], -z / long, 2.0 * cameras.shift[camera], perspective, regular)


class PlacedCamera(NamedTuple):
    """A camera as formats of scene files have it: it looks along −z of a frame without scale."""

    name: str
    seen: Eye
    half: tuple[float, float]  # half of the picture's width and height at distance 1; orthographic: in metres
    frame: F64  # (4, 4) to the world


def placed_camera(out: Export, row: int, size: tuple[int, int]) -> PlacedCamera | None:
    """The camera (a row) for a picture of `size` pixels; None, with a report, for a panoramic one."""
    scene = out.scene
    if scene.tables.cameras.projection[row] not in (ir.Projection.PERSPECTIVE, ir.Projection.ORTHOGRAPHIC):
        out.cannot("panoramic cameras are not carried", "cameras", row)
        return None
    seen = eye(scene, row, size)
    if not seen.regular:
        out.cannot("the camera's frame is stretched or sheared: not carried", "cameras", row)
    half = float(np.linalg.norm(seen.right)), float(np.linalg.norm(seen.up))
    frame = np.eye(4)
    frame[:3] = np.stack([seen.right / half[0], seen.up / half[1], -seen.forward, seen.position], axis=1)
    names = scene.names.cameras
    return PlacedCamera((names[row] if row < len(names) else "") or "camera", seen, half, frame)


def report_planes(out: Export, row: int) -> None:
    """A report for a camera (a row) with clipping planes."""
    if out.scene.tables.cameras.planes[row].any():
        out.cannot("clipping planes are not carried", "cameras", row)


# --- triangles -----------------------------------------------------------------------------------------------------------


def mesh(tables: ir.Tables, g: int) -> Shell:
    """A MESH geometry with normals (flipped to its faces' side), coordinates and colours, indexed where possible."""
    geometries, pools = tables.geometries, tables.pools
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    start, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
    triangles = pools.triangles[first : first + count] - np.int32(start)
    positions = pools.positions[start : start + vertices].astype(np.float64) + geometries.origin[g]
    rows = [int(column[g]) for column in (geometries.normals, geometries.uvs, geometries.colors)]
    by_vertex = all(row < 0 or tables.attributes.interpolation[row] == ir.Interpolation.VERTEX for row in rows)
    corner = [None if row < 0 else at_corners(tables, row, triangles) for row in rows]
    normals = corner[0]
    if normals is not None:
        face = np.cross(*(positions[triangles[:, k]] - positions[triangles[:, 0]] for k in (1, 2)))
        away = np.einsum("mkc,mc->mk", normals, face) < 0.0
        by_vertex = by_vertex and not away.any()
        normals = np.where(away[..., None], -normals, normals)
    metric = metric_of(positions, triangles, corner[1]) if corner[1] is not None else np.ones((count, 2))
    if by_vertex:
        normals, uvs, colors = (None if row < 0 else _by_vertex(tables, row) for row in rows)
        return Shell(positions, triangles, normals, uvs, metric, colors)
    flat = [None if values is None else values.reshape(3 * count, -1) for values in (normals, corner[1], corner[2])]
    return Shell(positions[triangles].reshape(-1, 3), _corner_numbers(count), flat[0], flat[1], metric, flat[2])


def at_corners(tables: ir.Tables, row: int, triangles: NDArray[np.int32]) -> F64:
    """Values (triangles, 3, width) of an attribute at the corners of triangles (local vertex numbers)."""
    attributes, count = tables.attributes, len(triangles)
    how, width, first = attributes.interpolation[row], int(attributes.width[row]), int(attributes.first[row])
    if how == ir.Interpolation.CONSTANT:
        index = np.zeros((count, 3), np.int64)
    elif how == ir.Interpolation.FACE:
        index = np.repeat(np.arange(count)[:, None], 3, axis=1)
    else:
        index = triangles if how == ir.Interpolation.VERTEX else np.arange(3 * count).reshape(-1, 3)
    values = tables.pools.values[first : first + width * int(attributes.count[row])].reshape(-1, width)
    return values[index].astype(np.float64)


def _by_vertex(tables: ir.Tables, row: int) -> F64:
    first, width = int(tables.attributes.first[row]), int(tables.attributes.width[row])
    count = int(tables.attributes.count[row])
    return tables.pools.values[first : first + width * count].reshape(-1, width).astype(np.float64)


def _corner_numbers(count: int) -> NDArray[np.int32]:
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def metric_of(positions: F64, triangles: NDArray[np.int32], uvs: F64) -> F64:
    """(m, 2) metres per unit of u and of v on each triangle; 1 for degenerate coordinates. uvs: (m, 3, 2)."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    d1, d2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    det = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
    safe = np.where(det == 0.0, 1.0, det)[:, None]
    du = np.linalg.norm((d2[:, 1:] * e1 - d1[:, 1:] * e2) / safe, axis=1)
    dv = np.linalg.norm((d1[:, :1] * e2 - d2[:, :1] * e1) / safe, axis=1)
    return np.where(det[:, None] == 0.0, 1.0, np.stack([du, dv], axis=1))


def plane(x: float, z: float, radius: float) -> Shell:
    """An infinite plane as a square grid about (x, z) that ends 10⁵ `radius` away; u = x and v = -z as on the plane.

    The grid spacing grows with distance, so that coordinates near the center keep their precision in float32.
    """
    steps = radius * 10.0 ** np.arange(1, 6)
    line = np.concatenate([-steps[::-1], [0.0], steps])
    n = len(line)
    gz, gx = np.meshgrid(line + z, line + x, indexing="ij")
    positions = np.stack([gx.ravel(), np.zeros(n * n), gz.ravel()], axis=1)
    row, column = (k.ravel() for k in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = row * n + column
    quads = np.stack([a, a + n, a + n + 1, a + 1], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    normals = np.tile([0.0, 1.0, 0.0], (n * n, 1))
    return Shell(positions, triangles, normals, positions[:, [0, 2]] * [1.0, -1.0], np.ones((len(triangles), 2)))


def divided(shell: Shell) -> Shell:
    """The shell with three vertices for each triangle."""
    corner = shell.triangles.ravel()
    positions, normals, uvs, colors = (None if v is None else v[corner] for v in (shell.positions, shell.normals, shell.uvs, shell.colors))
    assert positions is not None
    return Shell(positions, _corner_numbers(len(shell.triangles)), normals, uvs, shell.metric, colors)


def flip(shell: Shell) -> Shell:
    """The shell with reversed winding, for a mirroring frame."""
    return shell._replace(triangles=np.ascontiguousarray(shell.triangles[:, ::-1]))


# --- textures ------------------------------------------------------------------------------------------------------------


def texture_matrix(tables: ir.Tables, row: int) -> F64:
    """(3, 3) matrix from a surface's u, v to the texture's s, t."""
    frame = np.eye(3)
    frame[:2] = tables.textures.frame[row]
    return frame


def with_cells(tables: ir.Tables, row: int, shell: Shell, scale: float) -> Shell:
    """`shell` with coordinates in cells of a checker or stripes, one unit a cell. `scale` is the shell's scale to world."""
    count = len(shell.triangles)
    uvs = np.zeros((count, 3, 2)) if shell.uvs is None else shell.uvs[shell.triangles]
    frame = texture_matrix(tables, row)
    st = uvs @ frame[:2, :2].T + frame[:2, 2]
    size = float(tables.textures.size[row])
    metric = np.ones((count, 2)) if shell.metric is None else shell.metric
    cells = st * (metric[:, None, :] * scale / size if size > 0.0 else 8.0)
    if tables.textures.kind[row] == ir.TextureKind.STRIPES:
        cells[..., 1] = 0.5
    corner = shell.triangles.ravel()
    normals, colors = (None if v is None else v[corner] for v in (shell.normals, shell.colors))
    return Shell(shell.positions[corner], _corner_numbers(count), normals, cells.reshape(-1, 2), metric, colors)


def cell_colors(tables: ir.Tables, row: int, constant: F64) -> tuple[F64, F64]:
    """The two colours of a checker or stripes as values of a material's input."""
    textures = tables.textures
    pair = []
    for color in (textures.color_a[row], textures.color_b[row]):
        channel = int(textures.channel[row])
        texel = color if channel < 0 else np.full(3, color[channel] if channel < 3 else 1.0)
        pair.append(constant * (textures.gain[row] * texel + textures.bias[row]))
    return pair[0], pair[1]


def picture(tables: ir.Tables, row: int, constant: F64) -> NDArray[np.float32]:
    """(height, width, 3) pixels of an image texture as values of a material's input: gain, bias and constant applied."""
    textures, images = tables.textures, tables.images
    image = int(textures.image[row])
    texels = pixels(images, image)
    channel = int(textures.channel[row])
    color = texels[..., :3] if channel < 0 else np.repeat(texels[..., channel : channel + 1], 3, axis=2)
    return (constant * (textures.gain[row] * color + textures.bias[row])).astype(np.float32)


def pixels(images: ir.Images, image: int) -> NDArray[np.float32]:
    """(height, width, 4) linear pixels of an image, from the top."""
    first, width, height = int(images.first[image]), int(images.width[image]), int(images.height[image])
    return images.texels[first : first + width * height].reshape(height, width, 4)


def follows_uv(tables: ir.Tables, row: int, kind: int) -> bool:
    """Whether a texture uses the surface's own u, v on a kind of shape (two more mappings equal it on spheres and boxes)."""
    mapping = tables.textures.mapping[row]
    same = (ir.TextureMapping.LATLONG, ir.GeometryKind.SPHERE), (ir.TextureMapping.BOX, ir.GeometryKind.BOX)
    return bool(mapping == ir.TextureMapping.UV) or (mapping, kind) in same
