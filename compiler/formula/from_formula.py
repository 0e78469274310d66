"""Translates formulas, as recorded by lang.formula_graph, to operations of tapes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from ...lang.formula_graph import CHANNELS, PATTERN_OPERATIONS, Formula, Node
from ...lang.input_error import InputError
from . import factor_cancellation, regularize
from .builder import Builder
from .opcodes import Op
from .operation_rows import OperationRows
from .tape import X, Y, Z

_OPCODES = {
    "add": Op.ADD, "subtract": Op.SUBTRACT, "multiply": Op.MULTIPLY, "divide": Op.DIVIDE, "negate": Op.NEGATE, "abs": Op.ABS,
    "sqrt": Op.SQRT, "exp": Op.EXP, "log": Op.LOG, "sin": Op.SIN, "cos": Op.COS, "tan": Op.TAN, "asin": Op.ASIN, "acos": Op.ACOS,
    "atan": Op.ATAN, "atan2": Op.ATAN2, "hypot": Op.HYPOT, "min": Op.MIN, "max": Op.MAX, "floor": Op.FLOOR, "ceil": Op.CEIL,
    "mod": Op.MOD, "sign": Op.SIGN,
}  # fmt: skip
_NEGATED = {"less": "at_least", "at_most": "greater", "greater": "at_most", "at_least": "less"}


class NotASurface(InputError):
    """A formula that defines no surface."""


def add_formula(builder: Builder, formula: Formula, inputs: Sequence[int] = (X, Y, Z), exact: bool = False) -> tuple[int, ...]:
    """The results of a formula; a truth value becomes a field that is at most 0 where it holds.

    Raises NotASurface for an equality of numbers, unless `exact`.
    """
    translator = Translator(builder, formula, inputs)
    return tuple(translator.field(i, exact=exact) if formula.kind == "truth" else translator.number(i) for i in formula.results)


class NodeTranslator(ABC):
    """Translates the nodes of one formula. `inputs` are the values of its parameters."""

    builder: OperationRows

    def __init__(self, formula: Formula, inputs: Sequence[int]) -> None:
        self.formula, self.inputs = formula, inputs
        self.values: list[int | None] = []  # of each node; None: a truth value, translated by `field`
        self._fields: dict[tuple[int, bool, bool], int] = {}
        for node in formula.nodes:  # in order of evaluation, without recursion: formulas may be deep
            self.values.append(self._value(node))

    def number(self, index: int) -> int:
        """The value of a node that is a number."""
        name = self.values[index]
        assert name is not None
        return name

    def _value(self, node: Node) -> int | None:
        b = self.builder
        if node.op == "constant":
            return None if isinstance(node.value, bool) else b.constant(node.value)
        if node.op == "parameter":
            return self.inputs[int(node.value)]
        operands = [self.values[i] for i in node.args]
        if node.op == "select":
            condition, branches = node.args[0], operands[1:]
            return None if None in branches else b.op(Op.CHOOSE, self.field(condition, exact=True), *branches)  # type: ignore[arg-type]
        if any(name is None for name in operands):
            return None
        names: list[int] = operands  # type: ignore[assignment]
        if node.op == "power":
            return b.power(*names)
        if node.op in PATTERN_OPERATIONS:
            return self.of_pattern(node, names)
        if node.op in ("divide", "mod"):
            return self.quotient(*names) if node.op == "divide" else self.remainder(*names)
        if node.op == "round":
            return b.op(Op.FLOOR, b.offset(names[0], 0.5))
        if node.op == "noise":
            return b.op(Op.NOISE, *(names + [b.constant(0.0)] * (3 - len(names))))
        if node.op in ("min", "max", "hypot"):
            return b.reduce(_OPCODES[node.op], names)
        return b.op(_OPCODES[node.op], *names) if node.op in _OPCODES else None

    def compares_truths(self, node: Node) -> bool:
        """Whether a node compares truth values, not numbers."""
        return self.values[node.args[0]] is None

    def field(self, index: int, negated: bool = False, exact: bool = False) -> int:
        """A number that is at most 0 where a truth value holds, and undefined where the operands of its comparison are.

        Where the field is 0 the truth value may be either: whether a solid contains its surface cannot be seen. Steps do not make the
        field 0 over a region. Raises NotASurface for an equality of numbers, which holds on a surface alone, unless `exact`: for
        conditions, which are evaluated at points.
        """
        key = index, negated, exact
        if key not in self._fields:
            self._fields[key] = self._field(self.formula.nodes[index], negated, exact)
        return self._fields[key]

    def _field(self, node: Node, negated: bool, exact: bool) -> int:
        b = self.builder
        if node.op == "constant":
            return b.constant(-1.0 if bool(node.value) != negated else 1.0)
        if node.op == "not":
            return self.field(node.args[0], not negated, exact)
        if node.op in ("and", "or"):
            both = (node.op == "and") != negated
            return b.op(Op.MAX if both else Op.MIN, *(self.field(i, negated, exact) for i in node.args))
        if node.op == "select":
            condition = self.field(node.args[0], exact=True)
            return b.op(Op.CHOOSE, condition, self.field(node.args[1], negated, exact), self.field(node.args[2], negated, exact))
        if node.op in _NEGATED:
            return self.inequality(node, _NEGATED[node.op] if negated else node.op, exact)
        equal = (node.op == "equal") != negated
        if self.compares_truths(node):
            first, second = node.args
            both = b.op(Op.MAX, self.field(first, False, exact), self.field(second, not equal, exact))
            neither = b.op(Op.MAX, self.field(first, True, exact), self.field(second, equal, exact))
            return b.op(Op.MIN, both, neither)
        return self.equality(node, equal, exact)

    # --- operations that differ between tapes ---

    @abstractmethod
    def of_pattern(self, node: Node, names: Sequence[int]) -> int:
        """An operation of PATTERN_OPERATIONS."""

    @abstractmethod
    def quotient(self, a: int, b: int) -> int: ...

    @abstractmethod
    def remainder(self, a: int, b: int) -> int: ...

    @abstractmethod
    def inequality(self, node: Node, relation: str, exact: bool) -> int:
        """The field of `less`, `at_most`, `greater` or `at_least`."""

    @abstractmethod
    def equality(self, node: Node, equal: bool, exact: bool) -> int:
        """The field of the equality of numbers, or with equal=False of its reverse."""


class Translator(NodeTranslator):
    """Translates a formula of the point for surfaces and for textures without pictures."""

    builder: Builder

    def __init__(self, builder: Builder, formula: Formula, inputs: Sequence[int]) -> None:
        self.builder = builder
        super().__init__(formula, inputs)

    def of_pattern(self, node: Node, names: Sequence[int]) -> int:
        use = "a picture is looked up" if node.op in CHANNELS else f"{node.op.partition('_')[0]} has values"
        raise NotASurface(f"{use} in patterns of materials alone", "write noise(x, y, z) here" if node.op not in CHANNELS else "")

    def quotient(self, a: int, b: int) -> int:
        return factor_cancellation.divide(self.builder, a, b)

    def remainder(self, a: int, b: int) -> int:
        return factor_cancellation.remainder(self.builder, a, b)

    def inequality(self, node: Node, relation: str, exact: bool) -> int:
        b = self.builder
        left, right = (self.number(i) for i in node.args)
        strictly = relation in ("less", "greater")
        field = b.less(left, right, strictly) if relation in ("less", "at_most") else b.less(right, left, strictly)
        if not strictly or exact:
            return field
        interior = regularize.regularize(b, field)[0]  # a strict inequality does not hold on sheets
        return b.constant(1.0) if interior is None else interior

    def equality(self, node: Node, equal: bool, exact: bool) -> int:
        b = self.builder
        difference = b.subtract(*(self.number(i) for i in node.args))
        if b.is_integer(difference):
            return b.integer_is_zero(difference) if equal else b.op(Op.NEGATE, b.integer_is_zero(difference))
        if exact:
            distance = b.op(Op.ABS, difference)
            return distance if equal else b.op(Op.CHOOSE, distance, b.constant(1.0), b.constant(-1.0))
        sign = "==" if equal else "!="
        raise NotASurface(
            f"`{sign}` cannot be part of a larger relation: it holds on a surface, which has no inside",
            "write an inequality there, like abs(a - b) <= 0.01",
        )
