"""A tree over lamps: which of many a place looks to for light, in proportion to what each may give there.

Each node bounds the places of its lamps (a ball around their box), where they shine to (a cone of axes, and how far light spreads off
them) and what they give together: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting". Of
many lamps those behind a place, as its normal says, are not asked, and those aside of it seldom. The tree is complete and cut at medians
of the widest of six dimensions, three of the place and three of the axis, so that children need no links: those of node k are 2k and
2k + 1, and a lamp's place among the leaves tells the way to it. Endlessly far lights stand beside it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ..jit.kernel import HELPER, helper, noinline_helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec

TOPS = 8  # subtrees that each place asks one after the other, before it goes down one of them
COLUMNS = 12  # of a node: centre, squared radius, axis, cosine of the cone of axes and its sine, cosine of the spread, power, nothing
SLACK = 1e-4  # by which cosines may be off: what is at the edge of a node's bounds is still asked
TINY = 1e-30


class Shallow(NamedTuple):
    """No more lamps than are asked one after the other."""


class Deep(NamedTuple):
    """There are levels below the tops."""

    levels: int


class Tree(NamedTuple):
    """What places choose among."""

    far: NDArray[np.float64]  # (f,) what the first f rows of emitters, which have no place, give anywhere
    nodes: NDArray[np.float64]  # (2 leaves, COLUMNS) node 1 is the root, node 0 nothing
    rows: NDArray[np.int32]  # (leaves,) rows of emitters; -1 of a leaf without a lamp
    leaf: NDArray[np.int32]  # (emitters,) where each stands among the leaves; of far ones 0
    tops: int  # nodes `tops` … 2 · tops - 1 are asked one after the other; 0: no lamp has a place
    below: Any  # Shallow or Deep


class Bounds(NamedTuple):
    """Of lamps or nodes: (n, …) each."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    axis: NDArray[np.float64]  # unit
    spread: NDArray[np.float64]  # radians that axes stray from it; π: all directions
    edge: NDArray[np.float64]  # radians off an axis where light ends
    power: NDArray[np.float64]


def build(far: NDArray[np.float64], near: Bounds) -> Tree:
    """A tree over lamps; their rows follow those of far ones."""
    count = len(near.power)
    if not count:
        nothing = np.zeros(1, np.int32)
        return Tree(np.ascontiguousarray(far, float), np.zeros((1, COLUMNS)), nothing, np.zeros(len(far), np.int32), 0, Shallow())
    levels = max(count - 1, 0).bit_length()
    leaves = 1 << levels
    order = _order(near, leaves)
    rows = np.where(order >= 0, order + len(far), -1).astype(np.int32)
    leaf = np.zeros(len(far) + count, np.int32)
    leaf[rows[order >= 0]] = np.flatnonzero(order >= 0)
    layers = [_rows_of(near, order)]
    while len(layers[-1].power) > 1:
        layers.append(_joined(layers[-1]))
    nodes = np.concatenate([np.zeros((1, COLUMNS)), *(_node(layer) for layer in reversed(layers))])
    top = min(levels, TOPS.bit_length() - 1)
    below = Deep(levels - top) if levels > top else Shallow()
    return Tree(np.ascontiguousarray(far, float), nodes, rows, leaf, 1 << top, below)


def _order(near: Bounds, leaves: int) -> NDArray[np.int64]:
    """(leaves,) the lamp at each leaf, -1 for none: halves of halves, each cut at the middle of its widest dimension."""
    count = len(near.power)
    middle = 0.5 * (near.low + near.high)
    size = max(float(np.ptp(middle, axis=0).max()), TINY)
    shared = np.where((near.spread < math.pi)[:, None], near.axis, 0.0)
    places = np.concatenate([middle, 0.25 * size * shared], axis=1)
    # What stands at the end of no lamps goes last in each part, so that parts without any are whole.
    order = np.concatenate([np.arange(count), np.full(leaves - count, -1)])
    width = leaves
    while width > 1:
        parts = order.reshape(-1, width)
        there = parts >= 0
        known = places[np.maximum(parts, 0)]
        low = np.where(there[..., None], known, np.inf).min(axis=1)
        high = np.where(there[..., None], known, -np.inf).max(axis=1)
        widest = np.argmax(np.where(np.isfinite(low), high - low, 0.0), axis=1)
        along = np.take_along_axis(known, widest[:, None, None], axis=2)[..., 0]
        ranked = np.argsort(np.where(there, along, np.inf), axis=1, kind="stable")
        parts = np.take_along_axis(parts, ranked, axis=1)
        # As many lamps to one half as to the other.
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


def _rows_of(near: Bounds, order: NDArray[np.int64]) -> Bounds:
    """The bounds of leaves; those without a lamp give nothing and lie nowhere."""
    there, k = order >= 0, np.maximum(order, 0)
    low, high = np.where(there[:, None], near.low[k], np.inf), np.where(there[:, None], near.high[k], -np.inf)
    return Bounds(low, high, near.axis[k], np.where(there, near.spread[k], 0.0), near.edge[k], np.where(there, near.power[k], 0.0))


def _joined(layer: Bounds) -> Bounds:
    """The parents of nodes, two and two."""
    a, b = (Bounds(*(column[k::2] for column in layer)) for k in (0, 1))
    axis, spread = _cones(a, b)
    return Bounds(
        np.minimum(a.low, b.low), np.maximum(a.high, b.high), axis, spread,
        np.where(a.power <= 0, b.edge, np.where(b.power <= 0, a.edge, np.maximum(a.edge, b.edge))), a.power + b.power,
    )  # fmt: skip


def _cones(a: Bounds, b: Bounds) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(axis, spread) of the smallest cones that hold two each; of nodes that give nothing the other's."""
    between = np.arccos(np.clip(np.sum(a.axis * b.axis, axis=1), -1.0, 1.0))
    wide = 0.5 * (a.spread + between + b.spread)
    turn = wide - a.spread
    normal = np.cross(a.axis, b.axis)
    length = np.linalg.norm(normal, axis=1)
    tangent = np.cross(normal / np.maximum(length, TINY)[:, None], a.axis)
    axis = a.axis * np.cos(turn)[:, None] + tangent * np.sin(turn)[:, None]
    wide = np.where((wide >= math.pi) | (length < 1e-12), math.pi, wide)
    for one, other in ((a, b), (b, a)):
        holds = (np.minimum(between + other.spread, math.pi) <= one.spread) | (other.power <= 0)
        axis, wide = np.where(holds[:, None], one.axis, axis), np.where(holds, one.spread, wide)
    return axis / np.maximum(np.linalg.norm(axis, axis=1), TINY)[:, None], wide


def _node(layer: Bounds) -> NDArray[np.float64]:
    there = layer.power > 0
    low, high = (np.where(there[:, None], side, 0.0) for side in (layer.low, layer.high))
    radius2 = np.sum((0.5 * (high - low)) ** 2, axis=1)
    cosine = np.where(layer.spread >= math.pi, -1.0, np.cos(layer.spread))
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    columns = (0.5 * (low + high), radius2, layer.axis, cosine, sine, np.cos(layer.edge), layer.power, np.zeros(len(there)))
    return np.column_stack(columns)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def choose(tree: Tree, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    """(a row of emitters for each lane, how likely it was; 0 where nothing shines to a place), by one number in [0, 1).

    `facing` is the normal there, 0 for what gets light from both sides; None: not asked.
    """
    most = _all(tree, position, facing) * u
    found, upto, mine, before = ops.int_like(u, 0), 0.0 * u, 0.0 * u, 0.0 * u
    for e in range(len(tree.far)):
        here = (upto <= most) & (tree.far[e] > 0.0)
        found, mine, before = ops.where(here, e, found), ops.where(here, tree.far[e], mine), ops.where(here, upto, before)
        upto = upto + tree.far[e]
    for k in range(tree.tops, 2 * tree.tops):
        one = _importance(tree.nodes, k, position, facing)
        here = (upto <= most) & (one > 0.0)
        found, mine = ops.where(here, k + len(tree.far), found), ops.where(here, one, mine)
        before = ops.where(here, upto, before)
        upto = upto + one
    chance = ops.where(mine > 0.0, mine / ops.maximum(upto, TINY), 0.0)
    near = (found >= len(tree.far)) & (mine > 0.0)  # where nothing shines, no row has been found
    if tree.tops > 0 and ops.any_lane(near):
        left = ops.clip((most - before) / ops.maximum(mine, TINY), 0.0, 1.0)
        node = ops.where(near, found - len(tree.far), tree.tops)
        node, share = _descend(tree, tree.below, node, position, facing, left)
        row = tree.rows[node - len(tree.rows)]
        found = ops.where(near, ops.maximum(row, 0), found)
        chance = ops.where(near, ops.where(row >= 0, chance * share, 0.0), chance)
    return found, chance


@helper
def chance(tree: Tree, row: Lane, position: Vec, facing: Any) -> Lane:
    """How likely `choose` takes a row at a place."""
    near = row >= len(tree.far)
    mine = 0.0 * position[0]
    for e in range(len(tree.far)):
        mine = ops.where(row == e, tree.far[e], mine)
    if tree.tops > 0 and ops.any_lane(near):
        found = _way_to(tree, tree.below, ops.where(near, tree.leaf[ops.where(near, row, 0)], 0), position, facing)
        mine = ops.where(near, found, mine)
    return mine / ops.maximum(_all(tree, position, facing), TINY)


@helper
def _all(tree: Tree, position: Vec, facing: Any) -> Lane:
    total = 0.0 * position[0]
    for e in range(len(tree.far)):
        total = total + tree.far[e]
    for k in range(tree.tops, 2 * tree.tops):
        total = total + _importance(tree.nodes, k, position, facing)
    return total


@helper
def _bounded(facing: Vec, plain: Lane, away: Vec, inverse: Lane, cos_ball: Lane, sin_ball: Lane, inside: Lane) -> Lane:
    """Importance times the largest cosine that a node's ball may be seen under."""
    cosine = ops.clip(-ops.dot(away, facing) * inverse, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    most = ops.where((cosine >= cos_ball) | inside, 1.0, cosine * cos_ball + sine * sin_ball)
    share = ops.where(most >= -SLACK, ops.maximum(most, SLACK), 0.0)
    return plain * ops.where(ops.dot(facing, facing) > 0.5, share, 1.0)


_seen_by = specialize_if_present(_bounded)


@helper
def _importance(nodes: Any, k: Lane, position: Vec, facing: Any) -> Lane:
    """About what reaches a place from a node's lamps, at the most: their power over the squared distance, times the largest cosine."""
    away = (position[0] - nodes[k, 0], position[1] - nodes[k, 1], position[2] - nodes[k, 2])
    radius2 = nodes[k, 3]
    squared = ops.dot(away, away)
    near = ops.maximum(squared, ops.maximum(radius2, TINY))
    inverse = ops.rsqrt(ops.maximum(squared, TINY))
    axis = (nodes[k, 4], nodes[k, 5], nodes[k, 6])
    cosine = ops.clip(ops.dot(away, axis) * inverse, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    # Off the cone of axes, then off what else of the node's ball may lie nearer to it.
    cos_axes, sin_axes = nodes[k, 7], nodes[k, 8]
    within = cosine >= cos_axes
    off = ops.where(within, 1.0, cosine * cos_axes + sine * sin_axes)
    off_sine = ops.where(within, 0.0, sine * cos_axes - cosine * sin_axes)
    sin_ball2 = ops.minimum(radius2 / near, 1.0)
    cos_ball, sin_ball = ops.sqrt(1.0 - sin_ball2), ops.sqrt(sin_ball2)
    off = ops.where((off >= cos_ball) | (squared <= radius2), 1.0, off * cos_ball + off_sine * sin_ball)
    shining = off >= nodes[k, 9] - SLACK
    given = ops.where(shining, nodes[k, 10] * ops.maximum(off, SLACK) / near, 0.0)
    return _seen_by(facing, given, away, inverse, cos_ball, sin_ball, squared <= radius2)


def _descend(tree: Tree, below: Any, node: Lane, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    """(the leaf, as a node, that is chosen below one; how likely that was)."""
    return _down(tree, below.levels, node, position, facing, u) if isinstance(below, Deep) else (node, 1.0 + 0.0 * u)


@overload(_descend, jit_options=HELPER)
def _descend_in_kernels(tree, below, node, position, facing, u):
    if below.layout:
        return lambda tree, below, node, position, facing, u: _down_apart(tree, below.levels, node, position, facing, u)
    return lambda tree, below, node, position, facing, u: (node, 1.0 + 0.0 * u)


@helper
def _down(tree: Tree, levels: int, node: Lane, position: Vec, facing: Any, u: Lane) -> tuple[Lane, Lane]:
    share = 1.0 + 0.0 * u
    for _ in range(levels):
        left, right = _importance(tree.nodes, 2 * node, position, facing), _importance(tree.nodes, 2 * node + 1, position, facing)
        first = _first_of(left, right)
        to_left = u < first
        mine = ops.where(to_left, first, 1.0 - first)
        u = ops.clip(ops.where(to_left, u, u - first) / ops.maximum(mine, TINY), 0.0, 1.0)
        share = share * mine
        node = 2 * node + ops.where(to_left, 0, 1)
    return node, share


_down_apart = noinline_helper(_down)


@helper
def _first_of(left: Lane, right: Lane) -> Lane:
    """How likely the first of two is taken; one half where neither gives anything."""
    both = left + right
    return ops.where(both > 0.0, left / ops.maximum(both, TINY), 0.5)


def _way_to(tree: Tree, below: Any, leaf: Lane, position: Vec, facing: Any) -> Lane:
    """The importance of the top above a leaf, times how likely the way from there to the leaf is taken."""
    return _along(tree, below.levels if isinstance(below, Deep) else 0, leaf, position, facing)


@overload(_way_to, jit_options=HELPER)
def _way_in_kernels(tree, below, leaf, position, facing):
    if below.layout:
        return lambda tree, below, leaf, position, facing: _along_apart(tree, below.levels, leaf, position, facing)
    return lambda tree, below, leaf, position, facing: _importance(tree.nodes, leaf + tree.tops, position, facing)


@helper
def _along(tree: Tree, levels: int, leaf: Lane, position: Vec, facing: Any) -> Lane:
    node = leaf + len(tree.rows)
    share = 1.0 + 0.0 * position[0]
    for _ in range(levels):
        to_left = (node & 1) == 0
        parent = node >> 1
        left, right = _importance(tree.nodes, 2 * parent, position, facing), _importance(tree.nodes, 2 * parent + 1, position, facing)
        first = _first_of(left, right)
        share = share * ops.where(to_left, first, 1.0 - first)
        node = parent
    return share * _importance(tree.nodes, node, position, facing)


_along_apart = noinline_helper(_along)


def facing(below: Any, normal: Vec, both: Lane) -> Any:
    """What `choose` takes of a place's normal: 0 where it gets light from `both` sides, None where lamps are few."""
    return _unless_both(normal, both) if isinstance(below, Deep) else None


@overload(facing, jit_options=HELPER)
def _facing_in_kernels(below, normal, both):
    if below.layout:
        return lambda below, normal, both: _unless_both(normal, both)
    return lambda below, normal, both: None


@helper
def _unless_both(normal: Vec, both: Lane) -> Vec:
    zero = 0.0 * normal[0]
    return ops.where3(both, (zero, zero, zero), normal)
