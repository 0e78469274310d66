"""Medium stack of rays: Beer-Lambert absorption and nested dielectrics.

A ray carries the media around it, up to four, seven bits each in one integer. Media are numbered by priority. Where shapes overlap, the
medium of the highest number fills the volume; a boundary that does not change it is ignored (Schmidt and Budge 2002, Simple Nested
Dielectrics in Ray Traced Images). So wine may overlap its glass, without a gap of air. The indices at a boundary are those of the highest
number on each side. Only scenes with glass that absorbs or has a priority, or with media, compile this; elsewhere the stack is None, which
is a type. Media that scatter or emit light, and those with invisible boundaries, are in `scatter`: medium/free_flight.py takes paths
through them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import subsurface, traits
from ...materials.contract import Lobes
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops, row_gather
from ..medium import bodies, guides, phase, scattering_table, thickness
from ..simd.registration import overload
from ..surface.material_inputs import color_of, number_of
from ..types import Lane, Surface, Tables, Vec
from . import dispersion

IOR, ABSORPTION, PRIORITY = int(ir.Slot.IOR), int(ir.Slot.ABSORPTION), int(ir.Slot.PRIORITY)
AMBIENT, RADIUS = int(ir.Slot.AMBIENT), int(ir.Slot.RADIUS)
BITS = 7
MASK = (1 << BITS) - 1  # also the most media of a scene
DEPTH = 4  # most media of a stack; beyond that, the oldest entry is dropped

F64 = NDArray[np.float64]


class Air(NamedTuple):
    """A scene without absorption and priorities."""


class Media(NamedTuple):
    """The media of a scene; row 0 is air."""

    number: NDArray[np.int64]  # (materials,) the medium that a material bounds, 0: none
    index: F64  # (media + 1,) index of refraction
    absorbed: F64  # (media + 1, 4) absorption coefficients per metre, and 0
    scatter: Any = scattering_table.NoScattering()  # or scattering_table.Scattering


def media(tables: ir.Tables, general: bool = False, around: tuple[int, ...] = ()) -> Media | Air:
    """Return the media of a scene; without any Air, with `general` air alone.

    If there are more than MASK, those of lowest priority become air. `around` are materials whose insides hold the camera, the outermost
    first.
    """
    values, column = tables.materials.values, tables.materials.medium
    glass, used = traits.has(tables, Lobes.GLASS), traits.used(tables)
    special = (values[:, ABSORPTION].max(axis=1, initial=0.0) > 0.0) | (values[:, PRIORITY, 0] > 0.0) | (column >= 0)
    fog = np.flatnonzero(tables.media.everywhere)[:1]
    if not (used & special).any() and not len(fog):
        return Media(np.zeros(len(glass), np.int64), np.ones(1), np.zeros((1, 4))) if general else Air()
    rows = np.flatnonzero((glass | (column >= 0)) & used)
    ranks = np.maximum(values[rows, PRIORITY, 0], np.where(column[rows] >= 0, np.append(tables.media.priority, 0.0)[column[rows]], 0.0))
    rows = rows[_order(tables, rows, ranks)]
    inside = np.where(column[rows] >= 0, column[rows], len(tables.media.priority) + rows)  # materials around one medium share a number
    first = 1 + len(fog)  # fog has the lowest priority
    kinds = list(dict.fromkeys(inside.tolist()))[-MASK + len(fog) :]
    numbers = {kind: first + k for k, kind in enumerate(kinds)}
    number = np.zeros(len(glass), np.int64)
    number[rows] = [numbers.get(kind, 0) for kind in inside.tolist()]
    index, absorbed, media_rows = np.ones(first + len(kinds)), np.zeros((first + len(kinds), 4)), np.full(first + len(kinds), -1)
    for row in rows[number[rows] > 0].tolist():
        index[number[row]] = values[row, IOR, 0] if glass[row] else index[number[row]]
        absorbed[number[row], :3], media_rows[number[row]] = values[row, ABSORPTION], column[row]
    media_rows[1:first] = fog
    record = Media(number, index, absorbed)
    if not traits.participates(tables):
        absorbed[:, :3] += np.concatenate([tables.media.absorption, np.zeros((1, 3))])[media_rows]
        return record
    clear = traits.invisible(tables)
    aimed = np.zeros(first + len(kinds), bool)
    aimed[1:first] = aimed[number[clear & used]] = True
    outside = 0
    for entry in (*([1] if len(fog) else []), *(int(number[row]) for row in around)):
        outside = int(push(np.int64(outside), np.int64(entry)))
    scatter = scattering_table.build(tables, media_rows, (clear, aimed), absorbed, outside, general)
    varying = _bodies(tables, number, len(media_rows), around, general)
    led = guides.build(scatter.extinction, scatter.scattering, _thickness(tables, media_rows, number, aimed), general)
    return record._replace(scatter=scatter._replace(bodies=varying, guides=led))


def _order(tables: ir.Tables, rows: NDArray[np.int64], ranks: F64) -> NDArray[np.int64]:
    """The order of materials by priority. Of equal ones media with invisible boundaries come first, the largest before the others.

    So glass, bodies and smaller media in a box of haze are seen, in whatever order they are written.
    """
    clear, instances = traits.invisible(tables)[rows], tables.instances
    bounds, matrix = tables.geometries.bounds[instances.geometry], tables.transforms.matrix[instances.transform]
    with np.errstate(invalid="ignore"):
        volumes = np.abs(np.prod(bounds[:, 1] - bounds[:, 0], axis=1) * np.linalg.det(matrix[:, :, :3]))
    volumes = np.nan_to_num(volumes, nan=np.inf, posinf=np.inf)
    sizes = np.array([volumes[instances.material == row].max(initial=0.0) for row in rows])
    return np.lexsort((np.where(clear, -sizes, 0.0), ~clear, ranks))


def _thickness(tables: ir.Tables, rows: NDArray[np.int64], number: NDArray[np.int64], aimed: NDArray[np.bool_]) -> F64:
    """(n,) thickness in metres of the media `rows` whose walks may be guided, 0 of others; see guides.py.

    These scatter evenly, have one density and colour, and a boundary that light does not pass straight.
    """
    media, first = tables.media, np.maximum(rows, 0)
    may = (rows >= 0) & ~aimed
    if not may.any():
        return np.zeros(len(rows))
    may &= ~media.everywhere[first] & (media.density[first] < 0) & (media.draine[first, 3] == 0.0)
    may &= (np.abs(media.anisotropy[first]) < phase.EVEN) & (media.emission[first].max(axis=1) == 0.0)
    may[number[traits.varying_bodies(tables)]] = False
    lengths = np.zeros(len(rows))
    lengths[may] = thickness.of_media(tables, rows[may])
    return lengths


def _bodies(tables: ir.Tables, number: NDArray[np.int64], count: int, around: tuple[int, ...], general: bool) -> Any:
    """The bodies whose colour or radius varies, by the number of their medium."""
    m, record = tables.materials, bodies.none(count, general)
    varies = np.flatnonzero(traits.varying_bodies(tables) & (number > 0)).tolist()
    if not varies:
        return record
    radius, start = np.zeros((count, 4)), np.ones(4)
    for row in varies:
        radius[number[row], :3] = subsurface.radius(tables, row)
    for row in around:
        if row in varies:
            start = np.append(m.values[row, AMBIENT], m.values[row, RADIUS, 0])
    return bodies.Bodies(radius, start)


def is_used(tables: Any) -> bool:
    """Whether tables of this Numba type have media."""
    field = tables.field("materials.media") if isinstance(tables, HandleType) else None
    return field is not None and field[1] != ()


def scatters(tables: Any) -> bool:
    """Whether tables of this Numba type have media that scatter or emit light, or with invisible boundaries."""
    record = tables.field("materials.media.scatter") if is_used(tables) else None
    return record is not None and record[1] != ()


def scattering(tables: Tables) -> Any:
    """The scattering_table.Scattering of a scene; None without one."""
    record = getattr(getattr(tables.materials, "media", None), "scatter", None)
    return record or None


@overload(scattering)
def _scattering_in_kernels(tables):
    if scatters(tables):
        return lambda tables: tables.materials.media.scatter
    return lambda tables: None


def guides_of(tables: Tables) -> Any:
    """The guides.Guides of a scene; None without thick bodies."""
    return getattr(scattering(tables), "guides", None) or None


@overload(guides_of)
def _guides_in_kernels(tables):
    record = tables.field("materials.media.scatter.guides") if scatters(tables) else None
    if record is None or record[1] == ():
        return lambda tables: None
    return lambda tables: tables.materials.media.scatter.guides


def initial_stack(tables: Tables, like: Lane) -> Any:
    """Return the stack of camera rays; None in scenes without media."""
    if not isinstance(getattr(tables.materials, "media", None), Media):
        return None
    return ops.int_like(like, 0 if scattering(tables) is None else int(scattering(tables).outside[0]))


@overload(initial_stack)
def _outside_in_kernels(tables, like):
    if scatters(tables):
        return lambda tables, like: ops.int_like(like, tables.materials.media.scatter.outside[0])
    if is_used(tables):
        return lambda tables, like: ops.int_like(like, 0)
    return lambda tables, like: None


def initial_body(tables: Tables, like: Lane) -> Any:
    """Return the bodies.Body of camera rays; None in scenes without bodies of varying colour."""
    record = getattr(scattering(tables), "bodies", None)
    return tuple(ops.full_like(like, start) for start in record.start.tolist()) if record else None


@overload(initial_body)
def _body_in_kernels(tables, like):
    record = tables.field("materials.media.scatter.bodies") if scatters(tables) else None
    if record is None or record[1] == ():
        return lambda tables, like: None

    def start(tables, like):
        first = tables.materials.media.scatter.bodies.start
        zero = 0.0 * like
        return zero + first[0], zero + first[1], zero + first[2], zero + first[3]

    return start


# --- stack operations -----------------------------------------------------------------------------------------------------


@helper
def top(inside: Lane) -> Lane:
    """Return the number of the medium that fills the volume."""
    highest = inside & MASK
    for k in range(1, DEPTH):
        highest = ops.maximum(highest, (inside >> (BITS * k)) & MASK)
    return highest


@helper
def remove(inside: Lane, number: Lane) -> Lane:
    """Remove one entry of a medium."""
    remaining, removed = inside & 0, number < 0
    for k in range(DEPTH):
        entry = (inside >> (BITS * k)) & MASK
        out = ops.not_(removed) & (entry == number) & (number > 0)
        shifted = ops.where(removed, entry << (BITS * max(k - 1, 0)), entry << (BITS * k))
        remaining = remaining | ops.where(out, 0, shifted)
        removed = removed | out
    return remaining


@helper
def push(inside: Lane, number: Lane) -> Lane:
    """Push a medium."""
    return ((inside << BITS) & ((1 << (BITS * DEPTH)) - 1)) | number


# --- boundaries and absorption ------------------------------------------------------------------------------------------


@helper
def _relative_ior(inside: Lane, default: Lane, tables: Tables, point: Surface, component: Any) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return default
    number = ops.to_int(table.number[point.material])
    remaining = remove(inside, number)
    outer = ops.where(point.front, top(inside), top(remaining))
    real = number > outer
    beside = default / dispersion.index_of_medium(component, table.index[outer], tables, outer)
    return ops.where(number > 0, ops.where(real, beside, 1.0), default)


@helper
def _is_ignored(inside: Lane, default: Lane, tables: Tables, point: Surface) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return default
    number = ops.to_int(table.number[point.material])
    outer = ops.where(point.front, top(inside), top(remove(inside, number)))
    return (number > 0) & (number <= outer)


@helper
def _cross_boundary(inside: Lane, default: Any, tables: Tables, point: Surface, direction: Vec) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return inside
    number = ops.to_int(table.number[point.material])
    through = (ops.dot(direction, point.geometric) < 0.0) & (number > 0)
    return ops.where(through, ops.where(point.front, push(inside, number), remove(inside, number)), inside)


@helper
def _attenuate(inside: Lane, default: Vec, tables: Tables, distance: Lane) -> Vec:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1 or scattering(tables) is not None:  # there, flights attenuate
        return default
    number = top(inside)
    if ops.not_(ops.any_lane(number > 0)):
        return default
    far = ops.where(number > 0, distance, 0.0)
    red, green, blue = row_gather.three_at(table.absorbed, number, 0)
    return (
        default[0] * ops.exp(ops.maximum(-red * far, -80.0)), default[1] * ops.exp(ops.maximum(-green * far, -80.0)),
        default[2] * ops.exp(ops.maximum(-blue * far, -80.0)),
    )  # fmt: skip


@helper
def _enter_body(body: Any, default: Any, tables: Tables, point: Surface, inside: Lane, direction: Vec) -> Any:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    number = ops.to_int(table.number[point.material])
    enters = (ops.dot(direction, point.geometric) < 0.0) & point.front & (number > 0) & (top(inside) == number)
    enters = enters & (table.scatter.bodies.radius[number, 0] > 0.0)
    if ops.not_(ops.any_lane(enters)):
        return body
    r, g, b = color_of(tables, point, AMBIENT)
    return bodies.choose((r, g, b, number_of(tables, point, RADIUS)), body, enters)


enter_body = specialize_if_present(_enter_body)
"""(body of a ray, None, tables, point, stack of the ray that leaves it, its direction) → body: that of the point where it enters one."""
# Each takes the stack of a ray, the result in scenes without media, and:
relative_ior = specialize_if_present(_relative_ior)  # (tables, point, dispersion.Component) → relative index at a boundary of index `plain`
is_ignored = specialize_if_present(_is_ignored)  # (tables, point) → whether a boundary is ignored
cross_boundary = specialize_if_present(_cross_boundary)  # (tables, point, direction) → stack of a ray that leaves a surface
attenuate = specialize_if_present(_attenuate)  # (tables, distance) → `plain` attenuated over a distance in metres
