"""Gradients of values as further values of the same graph, without operations that jump.

Where a rule divides by a length, `floor` replaces smaller lengths. The derivative of a minimum changes over a width of `floor` from that
of one operand to that of the other. Noise and steps count as constants.
"""

from __future__ import annotations

from typing import NamedTuple

from ..formula.graph import Graph
from ..formula.opcodes import STEPS, Op, arity
from ..formula.tape import INPUTS

Term = tuple[float, int | None]
"""A factor and a value: their product; the factor alone where the value is None."""

ZERO: Term = (0.0, None)


class Gradient(NamedTuple):
    """Components along x, y and z, over the value `over`, or over 1."""

    along: tuple[Term, ...]
    over: int | None = None


CONSTANT = Gradient((ZERO, ZERO, ZERO))


class Gradients:
    """The gradients of the values of a graph."""

    def __init__(self, graph: Graph, floor: float) -> None:
        self.graph, self.floor = graph, floor
        self._known = {k: Gradient(tuple((1.0, None) if k == n else ZERO for n in range(3))) for k in range(INPUTS)}

    def gradient_of(self, name: int) -> Gradient:
        """The gradient of a value."""
        if name < 0:
            return CONSTANT
        waiting = [name]
        while waiting:
            row = self.graph.rows[waiting[-1] - INPUTS] if waiting[-1] >= INPUTS else (Op.COPY, 0, 0, 0)
            missing = [used for used in row[1 : 1 + arity(row[0])] if used >= 0 and used not in self._known]
            if missing and waiting[-1] not in self._known:
                waiting += missing
                continue
            name = waiting.pop()
            if name not in self._known:
                self._known[name] = self._rule(Op(row[0]), name, row[1 : 1 + arity(row[0])])
        return self._known[name]

    def dot(self, first: Gradient, second: Gradient) -> Gradient:
        """The scalar product, as the first component of a gradient."""
        products = [self._product(p, q) for p, q in zip(first.along, second.along, strict=True)]
        return Gradient((self._sum(products), ZERO, ZERO), self._over(first.over, second.over))

    def value(self, term: Term, over: int | None = None) -> int:
        """The value of a component."""
        factor, name = term
        value = self.graph.constant(factor) if name is None else self.graph.scale(name, factor)
        return value if over is None or not factor else self.graph.op(Op.DIVIDE, value, over)

    def at_least(self, name: int, least: float) -> int:
        return self.graph.op(Op.MAX, name, self.graph.constant(least))

    def scaled(self, gradient: Gradient, by: int) -> Gradient:
        """A gradient times a value."""
        term: Term = (1.0, by) if by >= 0 else (self.graph.constants[~by], None)
        return Gradient(tuple(self._product(p, term) for p in gradient.along), gradient.over)

    def sum(self, *gradients: Gradient) -> Gradient:
        """The sum of gradients."""
        used = [g for g in gradients if any(factor for factor, _ in g.along)]
        if len(used) < 2:
            return used[0] if used else CONSTANT
        over = used[0].over
        if any(g.over != over for g in used):
            used, over = [self._divided(g) for g in used], None
        return Gradient(tuple(self._sum([g.along[k] for g in used]) for k in range(3)), over)

    def _divided(self, gradient: Gradient) -> Gradient:
        if gradient.over is None:
            return gradient
        return Gradient(tuple((1.0, self.value(term, gradient.over)) if term[0] else ZERO for term in gradient.along))

    def _quotient(self, gradient: Gradient, by: int) -> Gradient:
        return Gradient(gradient.along, self._over(gradient.over, by))

    def _over(self, first: int | None, second: int | None) -> int | None:
        return second if first is None else first if second is None else self.graph.multiply(first, second)

    def _product(self, first: Term, second: Term) -> Term:
        (a, p), (b, q) = first, second
        if not a * b:
            return ZERO
        return a * b, q if p is None else p if q is None else self.graph.multiply(p, q)

    def _sum(self, terms: list[Term]) -> Term:
        number = sum(factor for factor, name in terms if name is None)
        parts = [(factor, name) for factor, name in terms if name is not None and factor]
        if not parts:
            return number, None
        shared = parts[0][0] if all(factor == parts[0][0] for factor, _ in parts) else 1.0
        total = self.graph.linear([(factor / shared, name) for factor, name in parts], number / shared)
        return shared, total

    # --- rules ---

    def _rule(self, op: Op, name: int, used: tuple[int, ...]) -> Gradient:
        g, turns = self.graph, [self.gradient_of(operand) for operand in used]
        match op:
            case Op.COPY | Op.ADD:
                return self.sum(*turns)
            case Op.SUBTRACT:
                return self.sum(turns[0], self._times(turns[1], -1.0))
            case Op.NEGATE:
                return self._times(turns[0], -1.0)
            case Op.MULTIPLY:
                return self.sum(self.scaled(turns[0], used[1]), self.scaled(turns[1], used[0]))
            case Op.DIVIDE:
                return self._quotient(self.sum(turns[0], self._times(self.scaled(turns[1], name), -1.0)), used[1])
            case Op.ABS:
                side = g.op(Op.MIN, g.scale(used[0], 1.0 / self.floor), g.constant(1.0))
                return self.scaled(turns[0], self.at_least(side, -1.0))
            case Op.SQUARE:
                return self._times(self.scaled(turns[0], used[0]), 2.0)
            case Op.CUBE:
                return self._times(self.scaled(turns[0], g.op(Op.SQUARE, used[0])), 3.0)
            case Op.SQRT:
                return self._times(self._quotient(turns[0], self.at_least(name, self.floor)), 0.5)
            case Op.HYPOT:
                along = self.sum(self.scaled(turns[0], used[0]), self.scaled(turns[1], used[1]))
                return self._quotient(along, self.at_least(name, self.floor))
            case Op.MIN | Op.MAX:
                return self._mixed(turns, self._ramp(*(used if op == Op.MAX else used[::-1])))
            case Op.CHOOSE:
                pairs = zip(self._divided(turns[1]).along, self._divided(turns[2]).along, strict=True)
                return Gradient(tuple((1.0, g.op(Op.CHOOSE, used[0], self.value(p), self.value(q))) for p, q in pairs))
            case Op.ARC | Op.QUARTER_ARC:
                return self._arc(used, turns)
            case Op.MOD:
                return turns[0]
            case Op.NOISE:
                return CONSTANT
        return CONSTANT if op in STEPS else self._elementary(op, name, used, turns)

    def _elementary(self, op: Op, name: int, used: tuple[int, ...], turns: list[Gradient]) -> Gradient:
        g, a = self.graph, used[0]
        match op:
            case Op.EXP:
                return self.scaled(turns[0], name)
            case Op.LOG:
                return self._quotient(turns[0], a)
            case Op.POWER:
                return self.scaled(turns[0], g.multiply(used[1], g.power(a, g.offset(used[1], -1.0))))
            case Op.SIN:
                return self.scaled(turns[0], g.op(Op.COS, a))
            case Op.COS:
                return self._times(self.scaled(turns[0], g.op(Op.SIN, a)), -1.0)
            case Op.TAN:
                return self.scaled(turns[0], g.offset(g.op(Op.SQUARE, name), 1.0))
            case Op.ATAN:
                return self._quotient(turns[0], g.offset(g.op(Op.SQUARE, a), 1.0))
            case Op.ASIN | Op.ACOS:
                root = g.op(Op.SQRT, self.at_least(g.linear([(-1.0, g.op(Op.SQUARE, a))], 1.0), 0.0))
                return self._times(self._quotient(turns[0], self.at_least(root, 1e-6)), 1.0 if op == Op.ASIN else -1.0)
        square = g.add(g.op(Op.SQUARE, a), g.op(Op.SQUARE, used[1]))  # ATAN2, ANGLE
        across = self.sum(self.scaled(turns[0], used[1]), self._times(self.scaled(turns[1], a), -1.0))
        return self._quotient(across, self.at_least(square, self.floor * self.floor))

    def _times(self, gradient: Gradient, factor: float) -> Gradient:
        return Gradient(tuple((factor * f, name) for f, name in gradient.along), gradient.over)

    def _ramp(self, a: int, b: int) -> int:
        """0 where a is the smaller one, 1 where it is the larger one."""
        g = self.graph
        share = g.linear([(1.0 / self.floor, g.subtract(a, b))], 0.5)
        return g.op(Op.MAX, g.op(Op.MIN, share, g.constant(1.0)), g.constant(0.0))

    def _mixed(self, turns: list[Gradient], share: int) -> Gradient:
        if all(not any(factor for factor, _ in turn.along) for turn in turns):
            return CONSTANT
        return self.sum(self.scaled(turns[0], share), self.scaled(turns[1], self.graph.linear([(-1.0, share)], 1.0)))

    def _arc(self, used: tuple[int, ...], turns: list[Gradient]) -> Gradient:
        """u ∇a + v ∇b over its length, for unit gradients of the operands: u and v are proportional to the parts of the shortest vector.

        Where both operands are negative, twice the larger one's magnitude is added to both, which leaves their order.
        """
        g, (a, b) = self.graph, used[:2]
        zero = g.constant(0.0)
        cosine = used[2] if len(used) > 2 else zero
        lift = g.scale(g.op(Op.MAX, g.op(Op.NEGATE, g.op(Op.MAX, a, b)), zero), 2.0)
        p, q = g.add(a, lift), g.add(b, lift)
        u, v = (g.op(Op.MAX, g.subtract(first, g.multiply(cosine, second)), zero) for first, second in ((p, q), (q, p)))
        square = g.add(g.op(Op.SQUARE, u), g.op(Op.SQUARE, v))
        if g.number(cosine) != 0.0:
            square = g.add(square, g.scale(g.multiply(cosine, g.multiply(u, v)), 2.0))
        length = g.op(Op.SQRT, self.at_least(square, self.floor**2))
        return self._quotient(self.sum(self.scaled(turns[0], u), self.scaled(turns[1], v)), length)
