"""Path reuse: the pixels of a group share the light of their paths' second surfaces.

Each first surface of a group of sixteen pixels (sampling/pixel_groups.py) is connected by shadow rays to the second surfaces of all sixteen
paths of a sample number. The balance heuristic combines the sixteen techniques. So indirect light gets sixteen times as many paths, for
less than twice the time. Bekaert, Sbert, Halton 2002, "Accelerating Path Tracing by Re-Using Paths". Diffuse lobes alone are shared
(bsdf.diffuse_part).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from .. import simd
from ..accel import intersect, primitive_hits
from ..jit.kernel import helper, noinline_helper, separate_helper, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, gather3, load3, scatter_add, store3
from ..light import lights
from ..material import bsdf
from ..material.shader import ONLY, Uses
from ..sampling.pixel_groups import GROUP
from ..simd.registration import overload
from ..surface import interaction, normal_map
from ..types import Lane, Tables, Vec
from .ray_queue import as_searched, enters, from_search, pad, queue_up, towards
from .state.path_state import OTHER_RAY, Connection, PathState, Vertex

# Rows of Shared.rows. Of the first surface of a path: its place, normal (0: it shares nothing), geometric normal, diffuse albedo, weight
# of the path, probability of the diffuse lobe, share of this lobe in the density of the BSDF sample.
# Of the second: its place, geometric normal (0: it is not shared), diffuse share of its light sample and of what lies beyond it, light
# of the former. Last, light for this pixel alone.
FIRST, NORMAL, GEOMETRIC, ALBEDO, WEIGHT, CHANCE, RATIO = 0, 3, 6, 9, 12, 15, 16
SECOND, FACING, NEAR, FAR, DIRECT, OWN = 17, 20, 23, 26, 29, 32
COUNT = 35


class Alone(NamedTuple):
    """No path reuse."""


class Shared(NamedTuple):
    """Shared data of a wave's paths, by slot."""

    rows: Any  # (COUNT · ROW,) float
    pairs: Any  # (GROUP · GROUP,) float: weight of each second surface at each first one

    @classmethod
    def of(cls, kind: type) -> Shared:
        """Allocate memory for waves of float32 or float64."""
        rows, pairs = simd.aligned_empty(COUNT * ROW, kind), simd.aligned_empty(GROUP * GROUP, kind)
        rows[:], pairs[:] = 0, 0
        return cls(rows, pairs)


@helper
def _clear(shared: Any, default: Any, n: int) -> Any:
    like = simd.load(shared.rows, 0)
    zero = (0.0 * like, 0.0 * like, 0.0 * like)
    for i in range(0, n, crosslane.width(like)):
        store3(shared.rows, 0, NORMAL, i, zero)
        store3(shared.rows, 0, FACING, i, zero)
        store3(shared.rows, 0, DIRECT, i, zero)
    return default


@helper
def _share_vertex(
    shared: Any, onward: PathState, tables: Tables, uses: Uses, vertex: Vertex, connection: Connection, i: int, slot: Lane, lanes: Lane,
    depth: int,
) -> PathState:  # fmt: skip
    if depth > 1:
        return onward
    point, scattered = vertex.shading.point, vertex.scattered
    albedo, chance = bsdf.diffuse_part(vertex.shading.shader, uses, point.normal, vertex.shading.viewer)
    cosine = ops.maximum(ops.dot(point.normal, scattered.direction), 0.0)
    sampled = ops.where(scattered.density < ONLY, cosine / (math.pi * ops.maximum(scattered.density, lights.TINY)), 0.0)
    if depth == 0:  # slots are those of the lanes
        zero = 0.0 * onward.density
        none, ones = (zero, zero, zero), (zero + 1.0, zero + 1.0, zero + 1.0)
        store3(shared.rows, 0, FIRST, i, interaction.offset_origin_at(point, interaction.shadow_origin(point), point.geometric))
        store3(shared.rows, 0, NORMAL, i, ops.where3(lanes & (ops.largest(albedo) > 0.0), point.normal, none))
        store3(shared.rows, 0, GEOMETRIC, i, point.geometric)
        store3(shared.rows, 0, ALBEDO, i, albedo)
        store3(shared.rows, 0, WEIGHT, i, onward.weight)
        simd.store(shared.rows, CHANCE * ROW + i, chance)
        simd.store(shared.rows, RATIO * ROW + i, sampled)
        return PathState(
            onward.origin, onward.direction, ones, onward.density, onward.straight, onward.inside, onward.phase, onward.facing,
            onward.links,
            onward.near, onward.body, onward.leaving, onward.divided, onward.axis,
        )  # fmt: skip
    lanes = lanes & ops.not_(normal_map.has_map(tables, point))
    lit = ops.maximum(ops.dot(point.normal, connection.direction), 0.0)
    _scatter3(shared, SECOND, slot, ops.along(point.position, point.geometric, point.offset), lanes)
    _scatter3(shared, FACING, slot, point.geometric, lanes)
    _scatter3(shared, NEAR, slot, _ratio(ops.scale(albedo, lit), connection.share), lanes)
    _scatter3(shared, FAR, slot, _ratio(ops.scale(albedo, sampled), scattered.weight), lanes)
    return onward


@helper
def _ratio(part: Vec, total: Vec) -> Vec:
    """A part over the whole, 0 where the whole is 0."""
    return (
        ops.where(total[0] > 0.0, part[0] / ops.maximum(total[0], lights.TINY), 0.0),
        ops.where(total[1] > 0.0, part[1] / ops.maximum(total[1], lights.TINY), 0.0),
        ops.where(total[2] > 0.0, part[2] / ops.maximum(total[2], lights.TINY), 0.0),
    )


@helper
def _scatter3(shared: Any, row: int, slot: Lane, values: Vec, lanes: Lane) -> None:
    for k in range(3):
        simd.scatter(shared.rows, slot + (row + k) * ROW, values[k], lanes)


clear = specialize_if_present(_clear)  # (shared, plain, n): clear the data of the first n paths
share_vertex = specialize_if_present(_share_vertex)  # store surfaces; return the path, with weight 1 after its first surface


def add_light(shared: Any, light: Any, slot: Lane, sent: Vec, mask: Lane, depth: int) -> None:
    """Add light to paths; emission at second surfaces is not shared."""
    raise NotImplementedError


@overload(add_light)
def _add_light_in_kernels(shared, light, slot, sent, mask, depth):
    if not shared.layout:
        return lambda shared, light, slot, sent, mask, depth: scatter_add(light, slot, sent, mask)

    def own(shared, light, slot, sent, mask, depth):
        if depth == 1:  # emission, which the other pixels sample themselves
            weight = gather3(shared.rows, 0, WEIGHT, ops.where(mask, slot, 0))
            scatter_add(shared.rows, slot + OWN * ROW, ops.mul(weight, sent), mask)
        else:
            scatter_add(light, slot, sent, mask)

    return own


@helper
def _separate_light(shared: Any, default: Any, light: Any, n: int, depth: int) -> Any:
    like = simd.load(light, 0)
    zero = (0.0 * like, 0.0 * like, 0.0 * like)
    row = OWN if depth == 0 else DIRECT
    for i in range(0, n, crosslane.width(like)):
        store3(shared.rows, 0, row, i, load3(light, 0, 0, i))
        store3(light, 0, 0, i, zero)
    return default


separate_light = specialize_if_present(_separate_light)
"""(shared, plain, light, n, depth): store the light of light samples apart; light from here on is that of further surfaces."""


@helper
def _combine(shared: Any, default: Any, accel: Any, scene: Any, memory: Any, shadows: bool, n: int) -> Any:
    _combine_groups(accel, scene, memory, shadows, n)
    return default


combine = specialize_if_present(_combine)  # sum up the light of all n paths of a wave


@noinline_helper
def _combine_groups(accel: Any, scene: Any, memory: Any, shadows: bool, n: int) -> None:
    """Add the light of second surfaces to all first surfaces of their groups."""
    rows, pairs, light = memory.shared.rows, memory.shared.pairs, memory.light
    like = simd.load(rows, 0)
    step = crosslane.width(like)
    for i in range(0, n, step):
        _split(rows, light, i)
    for group in range(0, n, GROUP):
        for j in range(GROUP):
            _weigh(accel, scene, memory, shadows, group, j)
        for i in range(0, GROUP, step):
            red, green, blue = 0.0 * like, 0.0 * like, 0.0 * like
            for j in range(GROUP):
                share, second = simd.load(pairs, j * GROUP + i), group + j
                red = ops.fma(share, simd.read(light, second), red)
                green = ops.fma(share, simd.read(light, second + ROW), green)
                blue = ops.fma(share, simd.read(light, second + 2 * ROW), blue)
            shared_light = ops.mul(load3(rows, 0, ALBEDO, group + i), (red, green, blue))
            store3(rows, 0, OWN, group + i, ops.add(load3(rows, 0, OWN, group + i), shared_light))
    for i in range(0, n, step):
        store3(light, 0, 0, i, load3(rows, 0, OWN, i))


@helper
def _split(rows: Any, light: Any, i: int) -> None:
    """Split the light of second surfaces: what the group shares stays in `light`, weighted by the density of its diffuse samples."""
    direct, beyond = load3(rows, 0, DIRECT, i), load3(light, 0, 0, i)
    sampled = simd.load(rows, RATIO * ROW + i)
    facing = load3(rows, 0, FACING, i)
    has_second = facing[0] * facing[0] + facing[1] * facing[1] + facing[2] * facing[2] > 0.5
    diffuse = ops.scale(ops.add(ops.mul(load3(rows, 0, NEAR, i), direct), ops.mul(load3(rows, 0, FAR, i), beyond)), sampled)
    diffuse = ops.where3(has_second, diffuse, (0.0 * sampled, 0.0 * sampled, 0.0 * sampled))
    own_light = ops.sub(ops.mul(load3(rows, 0, WEIGHT, i), ops.add(direct, beyond)), ops.mul(load3(rows, 0, ALBEDO, i), diffuse))
    store3(rows, 0, OWN, i, ops.add(load3(rows, 0, OWN, i), own_light))
    store3(light, 0, 0, i, ops.scale(diffuse, simd.load(rows, CHANCE * ROW + i)))


@separate_helper
def _weigh(accel: Any, scene: Any, memory: Any, shadows: bool, group: int, j: int) -> None:
    """Write the weight of the j-th second surface at each first surface of a group, without its albedo.

    It is the geometric term with visibility, over the group's sum of these, each times the probability of diffuse samples.
    """
    rows, pairs, light = memory.shared.rows, memory.shared.pairs, memory.light
    like = simd.load(rows, 0)
    step, second, total, queued = crosslane.width(like), group + j, 0.0, 0
    place, facing = _read3(rows, SECOND, second), _read3(rows, FACING, second)
    has_second = facing[0] * facing[0] + facing[1] * facing[1] + facing[2] * facing[2] > 0.5
    lit = has_second and simd.read(light, second) + simd.read(light, second + ROW) + simd.read(light, second + 2 * ROW) > 0.0
    for i in range(0, GROUP, step):
        terms = 0.0 * like
        if lit:
            terms = _geometric_term(rows, group + i, place, facing)
            is_own = simd.iota(ops.int_like(like, 0)) == j - i
            tested = (terms > 0.0) & ops.not_(is_own)
            if shadows and ops.any_lane(tested):
                origin = load3(rows, 0, FIRST, group + i)
                direction, reach = towards(origin, place)
                blocked = tested & primitive_hits.blocked(scene.primitives.between, origin, direction, reach)
                terms = ops.where(blocked, 0.0, terms)
                if scene.trees:
                    inside = tested & ops.not_(blocked) & enters(scene, origin, direction, reach)
                    queued += queue_up(memory, queued, group + i, inside)
            terms = ops.where(is_own, ops.maximum(terms, lights.TINY), terms)
        simd.store(pairs, j * GROUP + i, terms)
    if queued > 0:
        pad(memory, queued)
        _trace_queue(accel, memory, place, queued, j * GROUP - group)
    for i in range(0, GROUP, step):
        total += simd.sum_of(simd.load(pairs, j * GROUP + i) * simd.load(rows, CHANCE * ROW + group + i))
    for i in range(0, GROUP, step):
        simd.store(pairs, j * GROUP + i, simd.load(pairs, j * GROUP + i) * (1.0 / max(total, lights.TINY)))


@helper
def _geometric_term(rows: Any, first: int, place: Vec, facing: Vec) -> Lane:
    """The geometric term between first surfaces and a second one: π times the density of hits by diffuse samples."""
    origin, normal, geometric = load3(rows, 0, FIRST, first), load3(rows, 0, NORMAL, first), load3(rows, 0, GEOMETRIC, first)
    way = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
    inverse = 1.0 / ops.maximum(ops.dot(way, way), lights.TINY)
    leaving = ops.where(ops.dot(geometric, way) > 0.0, ops.maximum(ops.dot(normal, way), 0.0), 0.0)
    arriving = ops.maximum(-(way[0] * facing[0] + way[1] * facing[1] + way[2] * facing[2]), 0.0)
    return leaving * arriving * inverse * inverse


def _trace_queue(accel: Any, memory: Any, place: Vec, queued: int, to: int) -> None:
    """Trace the queued rays to a point through the BVH, and clear the pairs of those that are blocked; `to` is the pairs' offset."""
    raise NotImplementedError


@overload(_trace_queue)
def _trace_queue_in_kernels(accel, memory, place, queued, to):
    if accel.field("search") is None:
        return lambda accel, memory, place, queued, to: None

    def ask(accel, memory, place, queued, to):
        rows, wide = memory.shared.rows, simd.load(memory.queue, 0)
        for q in range(0, queued, simd.WIDTH64):
            k = simd.load(memory.queue, q)
            origin = gather3(rows, 0, FIRST, k)
            direction, reach = towards(origin, place)
            ray = as_searched(origin, direction, 0.0 * reach, reach, None)
            hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), OTHER_RAY, True)
            simd.scatter(memory.shared.pairs, k + to, 0.0 * reach, from_search(hit.instance, wide) >= 0)

    return ask


@helper
def _read3(rows: Any, row: int, slot: int) -> Vec:
    first = row * ROW + slot
    return simd.read(rows, first), simd.read(rows, first + ROW), simd.read(rows, first + 2 * ROW)
