"""Rough glass: facets that reflect and refract, on both sides of a surface, with all the light that bounces between them kept.

Walter, Marschner, Li, Torrance 2007, Microfacet Models for Refraction through Rough Surfaces, with Smith's height-correlated
shadowing for both; facets are drawn as they are seen. What one meeting loses comes back as a matt lobe on either side (Kulla and Conty
2017): of the share 1 − E(μₒ) that the viewer's side loses, x goes through, in such parts that light may go either way. As everywhere
here radiance is not scaled by the square of the index. E is tabled for each such material, from outside and from inside.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler import plan as planner
from . import gather, lanes, microfacet
from .handles import HandleType
from .inputs import number_of
from .kernels import HELPER, helper, if_there
from .microfacet import LEAST
from .records import Lane, Surface, Tables, Vec

GLASS = int(ir.MaterialModel.GLASS)
ROUGHNESS, IOR = int(ir.Slot.ROUGHNESS), int(ir.Slot.IOR)
COLUMNS, ROWS = 24, 16  # of the tables: square roots of cosines evenly, and of roughness α
NODES = 24
SAME = 1e-3  # indices whose ratio is nearer to 1 than this bend nothing: what is between them is clear

F64 = NDArray[np.float64]


class Clear(NamedTuple):
    """No glass is rough."""


class Tabled(NamedTuple):
    """Tables as kernels read them."""

    of: NDArray[np.int64]  # (materials,) which of the tables is a material's
    each: F64  # (k · 2 · ROWS · COLUMNS, 4) 1 − E of a column and of the next, from outside, then from inside; 0, 0
    mean: F64  # (k · 2 · ROWS, 4) mean of 1 − E on this side and on the other; what goes through of what is lost here; 0


class Frost(NamedTuple):
    """Rough glass at a point, from the side it is seen from."""

    here: Lane  # bool
    alpha: Lane
    ratio: Lane  # index of the other side over that of this one
    tint: Vec  # what goes through is multiplied by it
    row: Lane  # of Tabled.each: this side
    other: Lane  # the other side
    table: Any


def tables_of(tables: ir.Tables) -> Tabled | Clear:
    """What kernels read of a scene's rough glass."""
    m = tables.materials
    rough = (m.model == GLASS) & ((m.values[:, ROUGHNESS, 0] > 0.0) | (m.textures[:, ROUGHNESS] >= 0))
    if not (rough & planner.used_materials(tables)).any():
        return Clear()
    indices, of = np.unique(np.where(rough, m.values[:, IOR, 0], 1.5), return_inverse=True)
    made = [_table(float(index)) for index in indices]
    return Tabled(of.ravel().astype(np.int64), np.concatenate([t[0] for t in made]), np.concatenate([t[1] for t in made]))


def is_rough(tables: ir.Tables) -> bool:
    """Whether some glass may be rough."""
    return isinstance(tables_of(tables), Tabled)


def at(tables: Tables, surface: Surface, ior: Lane, tint: Vec) -> Frost | None:
    """The rough glass of a surface where it is; None in scenes without any. `ior` is inside over outside."""
    return _at(tables, surface, ior, tint) if isinstance(getattr(tables.materials, "frosted", None), Tabled) else None


@overload(at, jit_options=HELPER)
def _at_in_kernels(tables, surface, ior, tint):
    found = tables.field("materials.frosted") if isinstance(tables, HandleType) else None
    if found is not None and found[1] != ():
        return lambda tables, surface, ior, tint: _at(tables, surface, ior, tint)
    return lambda tables, surface, ior, tint: None


@helper
def _at(tables: Tables, surface: Surface, ior: Lane, tint: Vec) -> Frost:
    materials: Any = tables.materials
    roughness = lanes.clip(number_of(tables, surface, ROUGHNESS), 0.0, 1.0)
    alpha = roughness * roughness
    ratio = lanes.where(surface.front, ior, 1.0 / ior)
    here = (materials.model[surface.material] == GLASS) & (alpha >= microfacet.SHARP) & (lanes.absolute(ratio - 1.0) > SAME)
    first = lanes.to_int(materials.frosted.of[surface.material]) * (2 * ROWS)
    inner = lanes.where(surface.front, 0, ROWS)
    alpha = lanes.maximum(alpha, microfacet.SHARP)
    return Frost(here, alpha, lanes.where(here, ratio, 1.5), tint, first + inner, first + (ROWS - inner), materials.frosted)


# --- lost and found again ------------------------------------------------------------------------------------------------


@helper
def _lost(frost: Frost, row: Lane, cosine: Lane) -> Lane:
    """1 − E under a cosine, on the side whose rows begin at `row`."""
    place = lanes.sqrt(frost.alpha) * (ROWS - 1.0)
    below = lanes.minimum(lanes.floor_int(place), ROWS - 2)
    column = lanes.sqrt(lanes.clip(cosine, 0.0, 1.0)) * (COLUMNS - 1.0)
    left = lanes.minimum(lanes.floor_int(column), COLUMNS - 2)
    x, y = column - lanes.to_float(left), place - lanes.to_float(below)
    one = gather.four_at(frost.table.each, (row + below) * COLUMNS + left)
    two = gather.four_at(frost.table.each, (row + below + 1) * COLUMNS + left)
    return lanes.lerp(lanes.lerp(one[0], one[1], x), lanes.lerp(two[0], two[1], x), y)


@helper
def _means(frost: Frost) -> tuple[Lane, Lane, Lane]:
    """(mean of what is lost on this side, on the other, share of it that goes through)."""
    place = lanes.sqrt(frost.alpha) * (ROWS - 1.0)
    below = lanes.minimum(lanes.floor_int(place), ROWS - 2)
    y = place - lanes.to_float(below)
    one, two = gather.four_at(frost.table.mean, frost.row + below), gather.four_at(frost.table.mean, frost.row + below + 1)
    return lanes.lerp(one[0], two[0], y), lanes.lerp(one[1], two[1], y), lanes.lerp(one[2], two[2], y)


# --- two directions ------------------------------------------------------------------------------------------------------


@helper
def reflectance(cosine: Lane, ratio: Lane) -> Lane:
    """Fresnel's law for unpolarised light that meets a boundary to an index `ratio` times as large (Walter et al., equation 22)."""
    square = ratio * ratio - 1.0 + cosine * cosine
    g = lanes.sqrt(lanes.maximum(square, 0.0))
    a, b = (g - cosine) / (g + cosine), (cosine * (g + cosine) - 1.0) / (cosine * (g - cosine) + 1.0)
    return lanes.where(square > 0.0, lanes.minimum(0.5 * a * a * (1.0 + b * b), 1.0), 1.0)


@helper
def both(frost: Frost, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    """(π f cos, density with which `_drawn` takes it) for light from either side."""
    cos_out = lanes.clip(lanes.dot(normal, to_viewer), LEAST, 1.0)
    cosine = lanes.dot(normal, to_light)
    above = cosine > 0.0
    cos_in = lanes.clip(lanes.absolute(cosine), LEAST, 1.0)
    bent = lanes.where(above, 1.0, frost.ratio)
    half = lanes.normalize(lanes.add(to_viewer, lanes.scale(to_light, bent)))
    half = lanes.scale(half, lanes.sign_of(lanes.dot(half, normal)))
    out, into = lanes.dot(half, to_viewer), lanes.dot(half, to_light)
    strength = lanes.where((out > 0.0) & ((into > 0.0) == above), microfacet.spread(half, normal, frost.alpha), 0.0)
    turned = reflectance(lanes.clip(out, LEAST, 1.0), frost.ratio)
    whole = out + frost.ratio * into
    squeezed = frost.ratio * frost.ratio * lanes.absolute(into) / lanes.maximum(whole * whole, 1e-20)
    per_solid = lanes.where(above, 0.25 * turned, (1.0 - turned) * lanes.absolute(out) * squeezed)
    single = 4.0 * math.pi * cos_in * strength * microfacet.visible(cos_out, cos_in, frost.alpha) * per_solid
    seen = 2.0 * strength / (cos_out + _reach(cos_out, frost.alpha)) * per_solid
    lost = _lost(frost, frost.row, cos_out)
    mean, mean_other, through = _means(frost)
    lost_in = lanes.where(above, _lost(frost, frost.row, cos_in), _lost(frost, frost.other, cos_in))
    side = lanes.where(above, 1.0 - through, through)
    again = lost * lost_in * side / lanes.maximum(lanes.where(above, mean, mean_other), LEAST)
    total = single + cos_in * again
    density = (1.0 - lost) * seen + lost * side * cos_in * (1.0 / math.pi)
    one = 0.0 * total + 1.0
    return lanes.scale(lanes.where3(above, (one, one, one), frost.tint), total), density


@helper
def _reach(cosine: Lane, alpha: Lane) -> Lane:
    square = alpha * alpha
    return lanes.sqrt(square + (1.0 - square) * cosine * cosine)


@helper
def _drawn(frost: Frost, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane]:
    """(a direction, whether it lies on the side that it was meant for): `which` from 0 to 1 chooses what happens to the light."""
    cos_out = lanes.clip(lanes.dot(normal, to_viewer), LEAST, 1.0)
    lost = _lost(frost, frost.row, cos_out)
    through = _means(frost)[2]
    half = microfacet.facet(normal, to_viewer, frost.alpha, u, v)
    out = lanes.clip(lanes.dot(half, to_viewer), LEAST, 1.0)
    turned = reflectance(out, frost.ratio)
    again = which < lost
    mirrors = which - lost < turned * (1.0 - lost)
    arriving = lanes.negate(to_viewer)
    eta = 1.0 / frost.ratio
    bent = lanes.sqrt(lanes.maximum(1.0 - eta * eta * (1.0 - out * out), 0.0))
    refracted = lanes.normalize(lanes.add(lanes.scale(arriving, eta), lanes.scale(half, eta * out - bent)))
    single = lanes.where3(mirrors, lanes.reflect(arriving, half), refracted)
    height = lanes.sqrt(lanes.maximum(1.0 - u, 0.0))
    flat, turn = lanes.sqrt(lanes.clip(u, 0.0, 1.0)), 2.0 * math.pi * v
    s, t = lanes.basis(normal)
    passes = which >= lost * (1.0 - through)
    spread = lanes.in_basis(s, t, normal, flat * lanes.cos(turn), flat * lanes.sin(turn), lanes.where(passes, -height, height))
    direction = lanes.where3(again, spread, single)
    above = lanes.dot(direction, normal) > 0.0
    return direction, above == lanes.where(again, lanes.not_(passes), mirrors)


# --- what materials ask --------------------------------------------------------------------------------------------------


@helper
def _reflected(frost: Frost, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    return lanes.where3(frost.here, both(frost, normal, to_light, to_viewer)[0], plain)


@helper
def _shared(frost: Frost, plain: tuple[Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    share, density = both(frost, normal, to_light, to_viewer)
    return lanes.where3(frost.here, share, plain[0]), lanes.where(frost.here, density, plain[1])


@helper
def _draw(frost: Frost, plain: tuple[Vec, Lane], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane]:
    direction, sound = _drawn(frost, normal, to_viewer, u, v, lanes.clip(which, 0.0, 1.0))
    return lanes.where3(frost.here, direction, plain[0]), lanes.where(frost.here, sound, plain[1])


@helper
def _onward(frost: Frost, plain: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Vec]:
    direction, sound = _drawn(frost, normal, to_viewer, u, v, which)
    share, density = both(frost, normal, direction, to_viewer)
    factor = lanes.where(sound & (density > 0.0), 1.0 / (math.pi * lanes.where(density > 0.0, density, 1.0)), 0.0)
    return lanes.where3(frost.here, direction, plain[0]), lanes.where3(frost.here, lanes.scale(share, factor), plain[1])


@helper
def _one(frost: Frost, plain: Lane) -> Lane:
    return lanes.where(frost.here, 1.0, plain)


@helper
def _also(frost: Frost, plain: Lane) -> Lane:
    return plain | frost.here


@helper
def _fine(frost: Frost, plain: Lane, most: float) -> Lane:
    return plain | (frost.here & (frost.alpha <= most))


@helper
def _bends(frost: Frost, plain: Lane) -> Lane:
    return lanes.where(frost.here, 1.0 / frost.ratio, plain)


# Each takes the frost, what it would be without, and: the normal, a direction to the light, one to the viewer.
reflected = if_there(_reflected)  # π f cos
shared = if_there(_shared)  # (the same, density with which `draw` takes it)
draw = if_there(_draw)  # (a direction, whether it counts): normal, viewer, u, v, and which part, from 0 to 1
onward = if_there(_onward)  # (a direction, its π f cos over π times its density)
one = if_there(_one)  # 1 where there is rough glass
also = if_there(_also)  # or there is rough glass
is_fine = if_there(_fine)  # or there is glass of a roughness up to: α
eta = if_there(_bends)  # index of this side over that of the other


# --- making the tables ---------------------------------------------------------------------------------------------------


def _table(index: float) -> tuple[F64, F64]:
    """(each, mean) of a glass of this index."""
    cosine = np.linspace(0.0, 1.0, COLUMNS) ** 2
    alpha = np.maximum(np.linspace(0.0, 1.0, ROWS) ** 2, 1e-4)
    mu, a = np.meshgrid(np.maximum(cosine, 1e-4), alpha)
    lost = np.stack([1.0 - integral(mu, a, ratio) for ratio in (index, 1.0 / index)])
    lost = np.clip(lost, 0.0, 1.0)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    at = 0.5 * (nodes + 1.0)
    means = np.array([[np.interp(np.sqrt(at), np.sqrt(cosine), row) @ (weights * at) for row in side] for side in lost])
    clear = [float(np.sum(weights * at * (1.0 - np.asarray(reflectance(at, np.full(64, r)))))) for r in (index, 1.0 / index)]
    # Light may go either way: x_out · mean_out = index² · x_in · mean_in; x is about what Fresnel's law lets through, and at most 1.
    with np.errstate(all="ignore"):
        inward, outward = clear[0] * means[1] / means[0], np.full(ROWS, clear[1])
        inward = np.where(means[0] > 1e-9, inward, clear[0])
    scale = np.minimum(1.0, 1.0 / np.maximum(inward, outward))
    through = np.stack([inward * scale, outward * scale])
    each = np.stack([lost, np.concatenate([lost[..., 1:], lost[..., -1:]], axis=-1), 0 * lost, 0 * lost], axis=-1)
    mean = np.stack([means, means[::-1], through, 0 * means], axis=-1)
    return np.ascontiguousarray(each.reshape(-1, 4)), np.ascontiguousarray(mean.reshape(-1, 4))


def integral(cosine: Any, alpha: Any, ratio: float, nodes: int = NODES) -> F64:
    """E by quadrature over the facets that are seen: what one meeting sends on, to either side."""
    u, turn = np.meshgrid((np.arange(nodes) + 0.5) / nodes, (np.arange(nodes) + 0.5) / nodes, indexing="ij")
    mu, a = (x[..., None, None] for x in np.broadcast_arrays(np.asarray(cosine, float), np.asarray(alpha, float)))
    zero = 0.0 * (mu + u)
    viewer = (np.sqrt(1.0 - mu * mu) + zero, zero, mu + zero)
    up = (zero, zero, zero + 1.0)
    half = microfacet.facet(up, viewer, a + zero, u + zero, turn + zero)
    out = np.clip(lanes.dot(half, viewer), LEAST, 1.0)
    turned = reflectance(out, ratio + zero)

    def hidden(c: Any) -> Any:
        c = np.clip(np.abs(c), 1e-9, 1.0)
        return 0.5 * (np.sqrt(1.0 + a * a * (1.0 - c * c) / (c * c)) - 1.0)

    mirrored = 2.0 * out * half[2] - mu
    bent = np.sqrt(np.maximum(1.0 - (1.0 - out * out) / ratio**2, 0.0))
    refracted = -mu / ratio + (out / ratio - bent) * half[2]
    near = 1.0 + hidden(mu)
    back = np.where(mirrored > 0, turned * near / (near + hidden(mirrored)), 0.0)
    on = np.where(refracted < 0, (1.0 - turned) * near / (near + hidden(refracted)), 0.0)
    return (back + on).mean(axis=(-2, -1))
