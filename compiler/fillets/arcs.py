"""Unions with fillets where surfaces of different parts meet at an angle: docs/design/fillets.md derives them.

A part's field is a tree of minima and maxima; its leaves are smooth surfaces. Two leaves are joined by an arc where they have a seam: a
place on the surface of the union at which they meet at an angle. All other leaves are joined by a minimum.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from ..formula import numpy_interpreter
from ..formula.builder import Builder
from ..formula.opcodes import ARCS, Op
from ..formula.tape import INPUTS, Tape
from .gradients import Gradients
from .seams import Seams

APART = 2.0  # radii: half of the least distance of faces whose fillets cannot meet
FLOOR = 1e-2  # of the radius: shorter lengths in gradients count as this

EQUAL = 1e-13  # relative difference of equal fields


@dataclass(eq=False)
class Leaf:
    """A smooth surface of a part: its field, and its number; both faces of a slab |u| − h may be one leaf."""

    name: int
    part: int
    numbers: tuple[int, ...]
    slab: Slab | None = None


class Slab(NamedTuple):
    """The field of a slab, its half-thickness, and its faces."""

    name: int
    half: float
    faces: tuple[Leaf, Leaf]


@dataclass(eq=False)
class Choice:
    """A minimum or maximum of trees."""

    op: Op
    children: list[Tree]


Tree = Leaf | Choice


def fillet_union(parts: Sequence[Tape], bounds: Sequence[np.ndarray], radius: float, complement: bool = False) -> Tape:
    """The union of fields, its inner edges filled by arcs of a radius. `bounds` of the parts' surfaces (2, 3) may be infinite.

    With `complement` the parts are negated, and the result again: the intersection, its edges rounded.
    """
    b = Builder()
    fields = [b.inline(tape, (0, 1, 2))[0] for tape in parts]
    if complement:
        fields = [b.op(Op.NEGATE, name) for name in fields]
    leaves: list[Leaf] = []
    trees = [_tree(b, name, k, leaves, radius) for k, name in enumerate(fields)]
    values = [partial(_value, tree) for tree in trees]
    seams = Seams(b, [leaf.name for leaf in leaves], [leaf.part for leaf in leaves], values, bounds, radius)
    blend = _Blend(b, fields, trees, leaves, seams, radius).union()
    return b.finish(b.op(Op.NEGATE, blend) if complement else blend)


@cache
def _samples() -> np.ndarray:
    """(3, 16) points to compare fields, in radii. Made at first use: NumPy's generators take 12 ms to load."""
    return np.random.default_rng(7).normal(size=(3, 16)) * np.geomspace(1, 100, 16)


# --- trees ----------------------------------------------------------------------------------------------------------------


def _tree(b: Builder, name: int, part: int, leaves: list[Leaf], size: float) -> Tree:
    """The tree of a field; appends its leaves. Fields that are equal up to rounding, as of flush faces, are one leaf."""
    leaf_of: dict[int, Leaf] = {}
    samples: list[tuple[np.ndarray, Leaf]] = []

    def leaf(name: int) -> Leaf:
        if name not in leaf_of:
            values = numpy_interpreter.points(b.finish(name), *(size * _samples()))[0]
            close = EQUAL * (abs(values).max() + size)
            same = next((leaf for sample, leaf in samples if abs(sample - values).max() <= close), None)
            if same is None:
                same = Leaf(name, part, (len(leaves),))
                leaves.append(same)
                samples.append((values, same))
            leaf_of[name] = same
        return leaf_of[name]

    def expand(name: int, factor: float, offset: float) -> Tree:
        """The tree of factor · value + offset."""
        op, first, second = b.row(name)
        x, y = (b.number(operand) for operand in (first, second))
        if op == Op.NEGATE:
            return expand(first, -factor, offset)
        if op == Op.ADD and (x is not None or y is not None):
            return expand(second if x is not None else first, factor, offset + factor * (x if x is not None else y or 0.0))
        if op == Op.SUBTRACT and (x is not None or y is not None):
            return expand(second, -factor, offset + factor * x) if x is not None else expand(first, factor, offset - factor * (y or 0.0))
        if op == Op.MULTIPLY and (x or y):
            return expand(second if x else first, factor * (x or y or 0.0), offset)
        if op in (Op.MIN, Op.MAX):
            same = op if factor > 0 else Op.MIN if op == Op.MAX else Op.MAX
            children = [expand(operand, factor, offset) for operand in _operands(b, op, name)]
            inner = [child.children if isinstance(child, Choice) and child.op == same else [child] for child in children]
            return Choice(same, [tree for trees in inner for tree in trees])
        if op == Op.ABS:
            faces = leaf(b.linear([(factor, first)], offset)), leaf(b.linear([(-factor, first)], offset))
            for face in faces:
                face.slab = Slab(b.linear([(factor, name)], offset), abs(offset), faces)
            return Choice(Op.MAX if factor > 0 else Op.MIN, list(faces))
        return leaf(b.linear([(factor, name)], offset))

    return expand(name, 1.0, 0.0) if name >= INPUTS else leaf(name)


def _operands(b: Builder, op: Op, name: int) -> list[int]:
    """The operands of nested minima, or of nested maxima."""
    operands: list[int] = []
    waiting = [name]
    while waiting:
        name = waiting.pop()
        row = b.row(name)
        if row[0] == op:
            waiting += [row[2], row[1]]
        else:
            operands.append(name)
    return operands


def _leaves(tree: Tree) -> Iterable[Leaf]:
    if isinstance(tree, Leaf):
        yield tree
    else:
        for child in tree.children:
            yield from _leaves(child)


def _value(tree: Tree, leaves: np.ndarray) -> np.ndarray:
    """The values of a tree from those of all leaves (leaves, points)."""
    if isinstance(tree, Leaf):
        return leaves[tree.numbers[0]]
    return (np.minimum if tree.op == Op.MIN else np.maximum).reduce([_value(child, leaves) for child in tree.children])


# --- blends ---------------------------------------------------------------------------------------------------------------


class _Blend:
    """A union of trees."""

    def __init__(self, b: Builder, fields: list[int], trees: list[Tree], leaves: list[Leaf], seams: Seams, radius: float) -> None:
        self.b, self.fields, self.leaves, self.seams, self.radius = b, fields, leaves, seams, radius
        self.trees = [self._with_slabs(tree) for tree in trees]
        self.gradients = Gradients(b, FLOOR * radius)
        self._cosines: dict[tuple[int, int], int] = {}

    def _with_slabs(self, tree: Tree) -> Tree:
        """A tree in which two faces of a slab with seams at the same surfaces, too far apart to reach each other, are one leaf."""
        if isinstance(tree, Leaf):
            return tree
        children: dict[int, Tree] = {}
        for child in tree.children:
            slab = child.slab if isinstance(child, Leaf) else None
            if slab and slab.half > APART * self.radius and all(face in tree.children for face in slab.faces) and self._alike(*slab.faces):
                children[id(slab.faces[0])] = Leaf(slab.name, slab.faces[0].part, tuple(face.numbers[0] for face in slab.faces))
            else:
                children[id(child)] = self._with_slabs(child)
        return Choice(tree.op, list(children.values())) if len(children) > 1 else next(iter(children.values()))

    def _alike(self, first: Leaf, second: Leaf) -> bool:
        mine, others = ([self.seams.live(face.numbers[0], leaf.numbers[0]) for leaf in self.leaves] for face in (first, second))
        return mine == others

    def union(self) -> int:
        """The field of the union: the least of its parts, of each pair of them, and of each three at a corner."""
        count = len(self.trees)
        joined = [(k, m) for k, m in combinations(range(count), 2) if self.seams.any(k, m)]
        alone = [name for k, name in enumerate(self.fields) if not any(k in pair for pair in joined)]
        pairs = [self.pair(self.trees[k], self.trees[m]) for k, m in joined]
        corners = [self.corner(*leaves) for leaves in self._corners(joined)]
        names = [*alone, *(name for name in (*pairs, *corners) if name is not None)]
        while len(names) > 1:
            names = [self.b.op(Op.MIN, *names[k : k + 2]) if k + 1 < len(names) else names[k] for k in range(0, len(names), 2)]
        return names[0]

    def pair(self, first: Tree, second: Tree, without: tuple[Leaf, Leaf] | None = None) -> int | None:
        """Two trees joined by arcs at their seams; `without` one pair of leaves, which counts as −∞ there: None if that is the result."""
        covered: set[int] = set()
        names = self._pair(first, second, without, covered)
        return None if names is None else self.b.reduce(Op.MIN, [name for name in names if name not in covered])

    def _pair(self, left: Tree, right: Tree, without: tuple[Leaf, Leaf] | None, covered: set[int]) -> list[int] | None:
        """The values whose minimum is a pair of trees. `covered` are values that one of them never exceeds."""
        has = without is not None and without[0] in _leaves(left) and without[1] in _leaves(right)
        if not has and not self._live(left, right):
            return [*self._lowest(left), *self._lowest(right)]
        if isinstance(left, Leaf) and isinstance(right, Leaf):
            covered |= {left.name, right.name}
            return None if has else [self._arc(left, right)]
        first = isinstance(left, Choice) and not (isinstance(right, Choice) and right.op == Op.MIN != left.op)
        split, partner = (left, right) if first else (right, left)
        assert isinstance(split, Choice)
        values: list[int] = []
        for child in self._merged(split, partner, without):
            under = covered if split.op == Op.MIN else set[int]()
            names = self._pair(*((child, partner) if first else (partner, child)), without, under)
            if split.op == Op.MIN:
                if names is None:
                    return None
                values += names
            elif names is not None:
                values.append(self.b.reduce(Op.MIN, [name for name in names if name not in under]))
        if split.op == Op.MIN:
            return values
        return [self.b.reduce(Op.MAX, values)] if values else None

    def _merged(self, split: Choice, partner: Tree, without: tuple[Leaf, Leaf] | None) -> list[Tree]:
        """The children of a choice; leaves that meet all leaves of another tree alike are one leaf. Blends rise with each operand."""
        alike: dict[Any, list[Tree]] = {}
        for child in split.children:
            key: Any = id(child)
            if without is not None and any(leaf in without for leaf in _leaves(child)):
                pass
            elif not self._live(child, partner):
                key = ()
            elif isinstance(child, Leaf):
                key = tuple(self.cosine(child, leaf) if self._live(child, leaf) else None for leaf in _leaves(partner))
                key = key if all(cosine is None or cosine < 0 for cosine in key) else id(child)
            alike.setdefault(key, []).append(child)
        merged: list[Tree] = []
        for key, group in alike.items():
            first = next(iter(_leaves(group[0])))
            together = len(group) > 1 and (key or split.op == Op.MAX)
            name = self.b.reduce(split.op, self._names(group)) if together else 0
            merged += [Leaf(name, first.part, first.numbers if key else ())] if together else group
        return merged

    def _arc(self, first: Leaf, second: Leaf) -> int:
        """r − |v|: the radius of the fillet less the distance to the nearest place for its centre."""
        return self._within(self.b.op(Op.ARC, self._room(first), self._room(second), self.cosine(first, second)))

    def _room(self, leaf: Leaf) -> int:
        return self._within(leaf.name)

    def _within(self, name: int) -> int:
        return self.b.linear([(-1.0, name)], self.radius)

    def name(self, tree: Tree) -> int:
        """The field of a tree."""
        return tree.name if isinstance(tree, Leaf) else self.b.reduce(tree.op, self._names(tree.children))

    def _lowest(self, tree: Tree) -> list[int]:
        """The values whose minimum is a tree."""
        return self._names(tree.children) if isinstance(tree, Choice) and tree.op == Op.MIN else [self.name(tree)]

    def _names(self, trees: Sequence[Tree]) -> list[int]:
        """The fields of trees; two faces of a slab are one."""
        names = []
        for tree in trees:
            slab = tree.slab if isinstance(tree, Leaf) else None
            names.append(slab.name if slab and all(face in trees for face in slab.faces) else self.name(tree))
        return list(dict.fromkeys(names))

    def _live(self, first: Tree, second: Tree) -> bool:
        return any(self.seams.live(k, m) for p in _leaves(first) for q in _leaves(second) for k in p.numbers for m in q.numbers)

    def cosine(self, first: Leaf, second: Leaf) -> int:
        """The cosine of the angle between two gradients; a constant where it is one."""
        key = min(first.name, second.name), max(first.name, second.name)
        if key not in self._cosines:
            numbers = {self.seams.cosine(k, m) for k in first.numbers for m in second.numbers if self.seams.live(k, m)}
            number = numbers.pop() if len(numbers) == 1 else None
            self._cosines[key] = self.b.constant(number) if number is not None else self._varying(first, second)
        return self._cosines[key]

    def _varying(self, first: Leaf, second: Leaf) -> int:
        gradients = self.gradients
        pair_gradients = [gradients.gradient_of(leaf.name) for leaf in (first, second)]
        product = gradients.dot(*pair_gradients)
        over = product.over
        for leaf, gradient in zip((first, second), pair_gradients, strict=True):
            if not self._is_arc(leaf.name) and not self.seams.unit(leaf.numbers[0]):
                square = gradients.dot(gradient, gradient)
                length = self.b.op(Op.SQRT, gradients.at_least(gradients.value(square.along[0], square.over), FLOOR * FLOOR))
                over = length if over is None else self.b.multiply(over, length)
        return gradients.value(product.along[0], over)

    def _is_arc(self, name: int) -> bool:
        """Whether a value is ± an arc's but for a number: its gradient as a value has length 1."""
        op, first, second = self.b.row(name)
        if op in (Op.ADD, Op.NEGATE):
            return self._is_arc(second if first < 0 else first)
        return op in ARCS

    # --- corners ---

    def _corners(self, joined: list[tuple[int, int]]) -> Iterable[tuple[Leaf, Leaf, Leaf]]:
        """Three leaves of three parts that meet at a corner of the union, the third at right angles to both others."""
        together = [trio for trio in combinations(range(len(self.trees)), 3) if all(pair in joined for pair in combinations(trio, 2))]
        for trio in together:
            for leaves in product(*(list(dict.fromkeys(_leaves(self.trees[k]))) for k in trio)):
                if not all(self._live(p, q) for p, q in combinations(leaves, 2)):
                    continue
                for third in range(3):
                    first, second = (leaf for k, leaf in enumerate(leaves) if k != third)
                    right = all(self.b.number(self.cosine(leaf, leaves[third])) == 0.0 for leaf in (first, second))
                    if right and any(self.seams.corner(numbers) for numbers in product(*(leaf.numbers for leaf in leaves))):
                        yield first, second, leaves[third]
                        break

    def corner(self, first: Leaf, second: Leaf, third: Leaf) -> int:
        """The ball that touches three surfaces, within what each two parts fill elsewhere."""
        b = self.b
        edge = b.op(Op.ARC, self._room(first), self._room(second), self.cosine(first, second))
        ball = self._within(b.op(Op.ARC, edge, self._room(third), b.constant(0.0)))
        ordered = sorted((first, second, third), key=lambda leaf: leaf.part)
        others = [self.pair(self.trees[p.part], self.trees[q.part], (p, q)) for p, q in combinations(ordered, 2)]
        return b.reduce(Op.MAX, [ball, *(name for name in others if name is not None)])
