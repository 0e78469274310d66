"""Light tree: selection of one emitter in proportion to a bound of its contribution (pbrt BVHLightSampler).

Each node bounds the positions of its emitters (a ball around their box), their directions (a cone of axes, and the angle that light
spreads off them) and their total power: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting".
In scenes with many emitters, the bound includes the cosine at the surface. The tree is complete and split at medians of the widest of
six dimensions, three of position and three of axis. Children need no links: those of node k are 2k and 2k + 1, and an emitter's leaf
number encodes the path to it. Distant emitters are kept in a list beside it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..simd.registration import overload
from ..types import Lane, Vec

TOPS = 8  # subtrees whose importances are all evaluated, before descending into one
COLUMNS = 12  # of a node: center, squared radius, axis, cosine and sine of the cone of axes, cosine of the spread, power, padding
SLACK = 1e-4  # rounding error of cosines
TINY = 1e-30


class NoLevels(NamedTuple):
    """All leaves are among the first subtrees."""


class Levels(NamedTuple):
    """The subtrees have levels."""

    levels: int


class Tree(NamedTuple):
    """A light tree and the distant emitters."""

    far: NDArray[np.float64]  # (f,) power of the distant emitters, the first f rows
    nodes: NDArray[np.float64]  # (2 leaves, COLUMNS) node 1 is the root, node 0 unused
    rows: NDArray[np.int32]  # (leaves,) rows of emitters; -1: an empty leaf
    leaf: NDArray[np.int32]  # (emitters,) leaf of each; 0 for distant ones
    tops: int  # nodes `tops` … 2 · tops - 1 are the roots of the subtrees; 0: no tree
    below: Any  # Shallow or Deep


class Bounds(NamedTuple):
    """Bounds of emitters or nodes, (n, …) each."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    axis: NDArray[np.float64]  # unit
    spread: NDArray[np.float64]  # half angle of the cone of axes in radians; π: all directions
    edge: NDArray[np.float64]  # radians from an axis to the end of emission
    power: NDArray[np.float64]


def build(far: NDArray[np.float64], near: Bounds, general: bool = False) -> Tree:
    """Build a light tree; rows of emitters `near` follow the distant ones. With `general` it has Levels, of which there may be 0."""
    count, no_levels = len(near.power), Levels(0) if general else NoLevels()
    if not count:
        nothing = np.zeros(1, np.int32)
        return Tree(np.ascontiguousarray(far, float), np.zeros((1, COLUMNS)), nothing, np.zeros(len(far), np.int32), 0, no_levels)
    levels = max(count - 1, 0).bit_length()
    leaves = 1 << levels
    order = _order(near, leaves)
    rows = np.where(order >= 0, order + len(far), -1).astype(np.int32)
    leaf = np.zeros(len(far) + count, np.int32)
    leaf[rows[order >= 0]] = np.flatnonzero(order >= 0)
    layers = [_leaf_bounds(near, order)]
    while len(layers[-1].power) > 1:
        layers.append(_parent_bounds(layers[-1]))
    nodes = np.concatenate([np.zeros((1, COLUMNS)), *(_node_columns(layer) for layer in reversed(layers))])
    top = min(levels, TOPS.bit_length() - 1)
    below = Levels(levels - top) if levels > top else no_levels
    return Tree(np.ascontiguousarray(far, float), nodes, rows, leaf, 1 << top, below)


def _order(near: Bounds, leaves: int) -> NDArray[np.int64]:
    """(leaves,) emitter of each leaf, -1 for none: recursive median splits along the widest dimension."""
    count = len(near.power)
    middle = 0.5 * (near.low + near.high)
    size = max(float(np.ptp(middle, axis=0).max()), TINY)
    shared = np.where((near.spread < math.pi)[:, None], near.axis, 0.0)
    places = np.concatenate([middle, 0.25 * size * shared], axis=1)
    # Empty leaves come last in each part.
    order = np.concatenate([np.arange(count), np.full(leaves - count, -1)])
    width = leaves
    while width > 1:
        parts = order.reshape(-1, width)
        exists = parts >= 0
        emitter_places = places[np.maximum(parts, 0)]
        low = np.where(exists[..., None], emitter_places, np.inf).min(axis=1)
        high = np.where(exists[..., None], emitter_places, -np.inf).max(axis=1)
        widest = np.argmax(np.where(np.isfinite(low), high - low, 0.0), axis=1)
        along = np.take_along_axis(emitter_places, widest[:, None, None], axis=2)[..., 0]
        ranked = np.argsort(np.where(exists, along, np.inf), axis=1, kind="stable")
        parts = np.take_along_axis(parts, ranked, axis=1)
        # Both halves get equally many emitters.
        have = (parts >= 0).sum(axis=1)
        first = -(-have // 2)
        column = np.arange(width)[None]
        half = width // 2
        source = np.where(column < half, np.where(column < first[:, None], column, width), first[:, None] + column - half)
        source = np.where((column >= half) & (source >= have[:, None]), width, source)
        padded = np.concatenate([parts, np.full((len(parts), 1), -1)], axis=1)
        order = np.take_along_axis(padded, np.minimum(source, width), axis=1).ravel()
        width = half
    return order


def _leaf_bounds(near: Bounds, order: NDArray[np.int64]) -> Bounds:
    """The bounds of leaves; empty ones have no power and an empty box."""
    exists, k = order >= 0, np.maximum(order, 0)
    low, high = np.where(exists[:, None], near.low[k], np.inf), np.where(exists[:, None], near.high[k], -np.inf)
    return Bounds(low, high, near.axis[k], np.where(exists, near.spread[k], 0.0), near.edge[k], np.where(exists, near.power[k], 0.0))


def _parent_bounds(layer: Bounds) -> Bounds:
    """The bounds of the parents of node pairs."""
    a, b = (Bounds(*(column[k::2] for column in layer)) for k in (0, 1))
    axis, spread = _cones(a, b)
    return Bounds(
        np.minimum(a.low, b.low), np.maximum(a.high, b.high), axis, spread,
        np.where(a.power <= 0, b.edge, np.where(b.power <= 0, a.edge, np.maximum(a.edge, b.edge))), a.power + b.power,
    )  # fmt: skip


def _cones(a: Bounds, b: Bounds) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(axis, spread) of the smallest cones around two each; nodes without power are ignored."""
    between = np.arccos(np.clip(np.sum(a.axis * b.axis, axis=1), -1.0, 1.0))
    wide = 0.5 * (a.spread + between + b.spread)
    turn = wide - a.spread
    normal = np.cross(a.axis, b.axis)
    length = np.linalg.norm(normal, axis=1)
    tangent = np.cross(normal / np.maximum(length, TINY)[:, None], a.axis)
    axis = a.axis * np.cos(turn)[:, None] + tangent * np.sin(turn)[:, None]
    wide = np.where((wide >= math.pi) | (length < 1e-12), math.pi, wide)
    for outer, inner in ((a, b), (b, a)):
        holds = (np.minimum(between + inner.spread, math.pi) <= outer.spread) | (inner.power <= 0)
        axis, wide = np.where(holds[:, None], outer.axis, axis), np.where(holds, outer.spread, wide)
    return axis / np.maximum(np.linalg.norm(axis, axis=1), TINY)[:, None], wide


def _node_columns(layer: Bounds) -> NDArray[np.float64]:
    powered = layer.power > 0
    low, high = (np.where(powered[:, None], side, 0.0) for side in (layer.low, layer.high))
    radius2 = np.sum((0.5 * (high - low)) ** 2, axis=1)
    cosine = np.where(layer.spread >= math.pi, -1.0, np.cos(layer.spread))
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    columns = (0.5 * (low + high), radius2, layer.axis, cosine, sine, np.cos(layer.edge), layer.power, np.zeros(len(powered)))
    return np.column_stack(columns)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def choose(tree: Tree, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    """(row of an emitter, its probability) for each lane, by one random number; probability 0 where no emitter reaches the point.

    `facing` is the normal there, 0 for surfaces lit from both sides, or None to ignore the surface, see `facing`.
    """
    most = _total_importance(tree, position, facing) * u
    chosen, upto, mine, before = ops.int_like(u, 0), 0.0 * u, 0.0 * u, 0.0 * u
    for e in range(len(tree.far)):
        passed = (upto <= most) & (tree.far[e] > 0.0)
        chosen, mine, before = ops.where(passed, e, chosen), ops.where(passed, tree.far[e], mine), ops.where(passed, upto, before)
        upto = upto + tree.far[e]
    for k in range(tree.tops, 2 * tree.tops):
        importance = _importance(tree.nodes, k, position, facing)
        passed = (upto <= most) & (importance > 0.0)
        chosen, mine = ops.where(passed, k + len(tree.far), chosen), ops.where(passed, importance, mine)
        before = ops.where(passed, upto, before)
        upto = upto + importance
    chance = ops.where(mine > 0.0, mine / ops.maximum(upto, TINY), 0.0)
    near = (chosen >= len(tree.far)) & (mine > 0.0)  # without light, no row has been found
    if tree.tops > 0 and ops.any_lane(near):
        remainder = ops.clip((most - before) / ops.maximum(mine, TINY), 0.0, 1.0)
        node = ops.where(near, chosen - len(tree.far), tree.tops)
        node, share = _descend(tree, tree.below, node, position, facing, remainder)
        row = tree.rows[node - len(tree.rows)]
        chosen = ops.where(near, ops.maximum(row, 0), chosen)
        chance = ops.where(near, ops.where(row >= 0, chance * share, 0.0), chance)
    return chosen, chance


@helper
def chance(tree: Tree, row: Lane, position: Vec, facing: Any) -> Lane:
    """Return the probability that `choose` returns a row at a point."""
    near = row >= len(tree.far)
    mine = 0.0 * position[0]
    for e in range(len(tree.far)):
        mine = ops.where(row == e, tree.far[e], mine)
    if tree.tops > 0 and ops.any_lane(near):
        importance = _path_importance(tree, tree.below, ops.where(near, tree.leaf[ops.where(near, row, 0)], 0), position, facing)
        mine = ops.where(near, importance, mine)
    return mine / ops.maximum(_total_importance(tree, position, facing), TINY)


@helper
def _total_importance(tree: Tree, position: Vec, facing: Any) -> Lane:
    total = 0.0 * position[0]
    for e in range(len(tree.far)):
        total = total + tree.far[e]
    for k in range(tree.tops, 2 * tree.tops):
        total = total + _importance(tree.nodes, k, position, facing)
    return total


@helper
def _weigh_by_cosine(facing: Vec, importance: Lane, away: Vec, inverse: Lane, cos_ball: Lane, sin_ball: Lane, inside: Lane) -> Lane:
    """Importance times the greatest cosine at the surface over a node's ball."""
    cosine = ops.clip(-ops.dot(away, facing) * inverse, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    most = ops.where((cosine >= cos_ball) | inside, 1.0, cosine * cos_ball + sine * sin_ball)
    share = ops.where(most >= -SLACK, ops.maximum(most, SLACK), 0.0)
    return importance * ops.where(ops.dot(facing, facing) > 0.5, share, 1.0)


_with_cosine = specialize_if_present(_weigh_by_cosine)


@helper
def _importance(nodes: Any, k: Lane, position: Vec, facing: Any) -> Lane:
    """Return a node's importance: power over squared distance, times the greatest cosines."""
    x, y, z, radius2, axis_x, axis_y, axis_z, cos_axes = row_gather.eight_at(nodes, k, 0)
    sin_axes, cos_edge, power = row_gather.three_at(nodes, k, 8)
    away = (position[0] - x, position[1] - y, position[2] - z)
    squared = ops.dot(away, away)
    near = ops.maximum(squared, ops.maximum(radius2, TINY))
    inverse = ops.rsqrt(ops.maximum(squared, TINY))
    cosine = ops.clip(ops.dot(away, (axis_x, axis_y, axis_z)) * inverse, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    # The angle to the cone of axes, reduced by the angle of the node's ball.
    within = cosine >= cos_axes
    off = ops.where(within, 1.0, cosine * cos_axes + sine * sin_axes)
    off_sine = ops.where(within, 0.0, sine * cos_axes - cosine * sin_axes)
    sin_ball2 = ops.minimum(radius2 / near, 1.0)
    cos_ball, sin_ball = ops.sqrt(1.0 - sin_ball2), ops.sqrt(sin_ball2)
    off = ops.where((off >= cos_ball) | (squared <= radius2), 1.0, off * cos_ball + off_sine * sin_ball)
    shining = off >= cos_edge - SLACK
    importance = ops.where(shining, power * ops.maximum(off, SLACK) / near, 0.0)
    return _with_cosine(facing, importance, away, inverse, cos_ball, sin_ball, squared <= radius2)


def _descend(tree: Tree, below: Any, node: Lane, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    """(node of a leaf sampled below `node`, its probability)."""
    return _descend_levels(tree, below.levels, node, position, facing, u) if isinstance(below, Levels) else (node, 1.0 + 0.0 * u)


@overload(_descend)
def _descend_in_kernels(tree, below, node, position, facing, u):
    if below.layout:
        return lambda tree, below, node, position, facing, u: _descend_levels(tree, below.levels, node, position, facing, u)
    return lambda tree, below, node, position, facing, u: (node, 1.0 + 0.0 * u)


@helper
def _descend_levels(tree: Tree, levels: int, node: Lane, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    share = 1.0 + 0.0 * u
    for _ in range(levels):
        left, right = _importance(tree.nodes, 2 * node, position, facing), _importance(tree.nodes, 2 * node + 1, position, facing)
        first = _left_probability(left, right)
        to_left = u < first
        mine = ops.where(to_left, first, 1.0 - first)
        u = ops.clip(ops.where(to_left, u, u - first) / ops.maximum(mine, TINY), 0.0, 1.0)
        share = share * mine
        node = 2 * node + ops.where(to_left, 0, 1)
    return node, share


@helper
def _left_probability(left: Lane, right: Lane) -> Lane:
    """The probability of the left child; one half if both importances are 0."""
    both = left + right
    return ops.where(both > 0.0, left / ops.maximum(both, TINY), 0.5)


def _path_importance(tree: Tree, below: Any, leaf: Lane, position: Vec, facing: Any) -> Lane:
    """The importance of the subtree of a leaf, times the probability of the leaf in it."""
    return _climb(tree, below.levels if isinstance(below, Levels) else 0, leaf, position, facing)


@overload(_path_importance)
def _path_importance_in_kernels(tree, below, leaf, position, facing):
    if below.layout:
        return lambda tree, below, leaf, position, facing: _climb(tree, below.levels, leaf, position, facing)
    return lambda tree, below, leaf, position, facing: _importance(tree.nodes, leaf + tree.tops, position, facing)


@helper
def _climb(tree: Tree, levels: int, leaf: Lane, position: Vec, facing: Any) -> Lane:
    node = leaf + len(tree.rows)
    share = 1.0 + 0.0 * position[0]
    for _ in range(levels):
        to_left = (node & 1) == 0
        parent = node >> 1
        left, right = _importance(tree.nodes, 2 * parent, position, facing), _importance(tree.nodes, 2 * parent + 1, position, facing)
        first = _left_probability(left, right)
        share = share * ops.where(to_left, first, 1.0 - first)
        node = parent
    return share * _importance(tree.nodes, node, position, facing)


def facing(below: Any, normal: Vec, both: Lane) -> Any:
    """Return `facing` for `choose`: the normal, 0 for surfaces lit from `both` sides and in trees of 0 levels, None for trees without."""
    return _normal_or_zero(below, normal, both) if isinstance(below, Levels) else None


@overload(facing)
def _facing_in_kernels(below, normal, both):
    if below.layout:
        return lambda below, normal, both: _normal_or_zero(below, normal, both)
    return lambda below, normal, both: None


@helper
def _normal_or_zero(below: Any, normal: Vec, both: Lane) -> Vec:
    zero = 0.0 * normal[0]
    return ops.where3(both | (below.levels == 0), (zero, zero, zero), normal)
