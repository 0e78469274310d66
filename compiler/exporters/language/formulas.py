"""Tapes of formulas and of texture graphs as functions of the language; values that are used again are lets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ....lang.formula_graph import PATTERN_INPUTS
from ...formula.opcodes import Op
from ...formula.tape import INPUTS, Tape, X, Y, Z
from ...texture_graph.opcodes import CHANNELS, STREAMS, arity
from ...texture_graph.opcodes import Op as GraphOp
from . import words

MOST = 100_000  # characters of a formula
_LINE = 100  # characters of a value, from which it is a let

_IF, _SUM, _PRODUCT, _NEGATION, _POWER, _ATOM = range(6)  # how tightly the parts of a text bind

_FUNCTIONS = {
    Op.ABS: "abs", Op.SQRT: "sqrt", Op.HYPOT: "hypot", Op.MIN: "min", Op.MAX: "max", Op.EXP: "exp", Op.LOG: "log", Op.SIN: "sin",
    Op.COS: "cos", Op.TAN: "tan", Op.ASIN: "asin", Op.ACOS: "acos", Op.ATAN: "atan", Op.ATAN2: "atan2", Op.ANGLE: "atan2",
    Op.FLOOR: "floor", Op.CEIL: "ceil", Op.MOD: "mod", Op.SIGN: "sign", Op.NOISE: "noise", GraphOp.PERLIN2: "perlin",
    GraphOp.PERLIN3: "perlin", GraphOp.CELL1: "cellnoise", GraphOp.CELL2: "cellnoise", GraphOp.CELL3: "cellnoise",
}  # fmt: skip
_COLORS = {
    GraphOp.PERLIN2_R: ("perlin_color", "r"), GraphOp.PERLIN2_G: ("perlin_color", "g"), GraphOp.PERLIN2_B: ("perlin_color", "b"),
    GraphOp.PERLIN3_R: ("perlin_color", "r"), GraphOp.PERLIN3_G: ("perlin_color", "g"), GraphOp.PERLIN3_B: ("perlin_color", "b"),
    GraphOp.CELL4_0: ("cellnoise_color", "r"), GraphOp.CELL4_1: ("cellnoise_color", "g"), GraphOp.CELL4_2: ("cellnoise_color", "b"),
}  # fmt: skip
_NAMES = dict(zip((X, Y, Z, *STREAMS), PATTERN_INPUTS[-1], strict=True))


class Text(NamedTuple):
    """An expression, and how tightly its outermost operation binds."""

    text: str
    binds: int = _ATOM

    def within(self, level: int) -> str:
        """The text, in parentheses where it binds less tightly than `level`."""
        return self.text if self.binds >= level else f"({self.text})"


Levels = Sequence[tuple[float, float]]
"""(gain, bias) of each channel."""
Pictures = Callable[[int, bool], str]
"""The name of the image of a row of Textures, of its alpha channel or of its colours."""


def pattern(tape: Tape, levels: Levels, pictures: Pictures) -> str | None:
    """`pattern(…)` of a tape; None for one that a formula does not say, or that is too long for it."""
    writer = _Writer(tape, pictures)
    if not writer.write():
        return None
    values, names = [writer.operand(name) for name in tape.results], writer.parameters()
    if len(values) == 1 and len(set(levels)) == 1:
        values = [_levelled(values[0], *levels[0])]
    else:
        values = [_levelled(value, *level) for value, level in zip(values * (3 // len(values)), levels, strict=True)]
    body = values[0].text if len(values) == 1 else f"rgb({', '.join(_channel(value, names[0]) for value in values)})"
    if writer.lets:
        body = "\n".join(["{", *writer.lets, body, "}"])
    return f"pattern(|{', '.join(names)}| {body})" if len(body) <= MOST else None


def _levelled(value: Text, gain: float, bias: float) -> Text:
    if gain != 1.0:
        value = Text(f"{words.number(gain)} * {value.within(_NEGATION)}", _PRODUCT)
    return value if bias == 0.0 else _sum("+", value, _constant(bias))


def _channel(value: Text, parameter: str) -> str:
    """A channel of rgb(…), which refuses constants below 0: the least of such a one and 0 times a parameter."""
    return f"min({value.text}, 0 * {parameter})" if value.binds == _NEGATION and value.text[1].isdigit() else value.text


def _constant(number: float) -> Text:
    return Text(words.number(number), _NEGATION if number < 0.0 else _ATOM)


def _sum(sign: str, a: Text, b: Text) -> Text:
    if b.binds in (_NEGATION, _PRODUCT) and b.text.startswith("-"):  # a + −b is a − b, to the bit
        sign, b = "-" if sign == "+" else "+", Text(b.text[1:], b.binds)
    return Text(f"{a.within(_SUM)} {sign} {b.within(_PRODUCT)}", _SUM)


class _Writer:
    """The lets of one tape."""

    def __init__(self, tape: Tape, pictures: Pictures) -> None:
        self.tape, self.pictures = tape, pictures
        self.lets: list[str] = []
        self._texts: list[Text] = []
        self._calls: dict[str, str] = {}  # names of lets by the call of a colour
        self._read: set[str] = set()
        self._taken: set[str] = set()  # by pictures
        self._numbers: Counter[str] = Counter()
        names = [name for op, *operands in tape.code.tolist() for name in operands[: arity(op)]]
        self._uses = Counter([*names, *tape.results])

    def parameters(self) -> tuple[str, ...]:
        """The fewest parameters that have all inputs."""
        return next(names for names in (PATTERN_INPUTS[1], PATTERN_INPUTS[0], *PATTERN_INPUTS[2:]) if self._read <= {*names})

    def write(self) -> bool:
        """Write the values of all rows; False, if one is not said."""
        rows = self.tape.code.tolist()
        for row, (op, *operands) in enumerate(rows):
            if op == GraphOp.CHANNEL:
                continue
            if op == GraphOp.LOOK_UP:
                self._texts += self._texel(row, *operands)
                continue
            text = self._operation(op, operands[: arity(op)])
            if text is None:
                return False
            is_let = text.binds < _ATOM or "(" in text.text
            if is_let and (self._uses[INPUTS + row] > 1 or len(text.text) > _LINE):
                text = Text(self._let(_label(op), text.text))
            self._texts.append(text)
        return sum(map(len, self.lets)) <= MOST

    def operand(self, name: int) -> Text:
        """The text of a value."""
        if name < 0:
            return _constant(float(self.tape.constants[~name]))
        if name in _NAMES:
            self._read.add(_NAMES[name])
            return Text(_NAMES[name])
        return self._texts[name - INPUTS]

    def _let(self, label: str, text: str) -> str:
        """The name of a new let."""
        while True:
            self._numbers[label] += 1
            name = f"{label}_{self._numbers[label]}"
            if name not in self._taken:
                break
        self.lets.append(f"let {name} = {text}")
        return name

    def _texel(self, row: int, s: int, t: int, constant: int) -> list[Text]:
        """Red, green, blue and alpha of a picture."""
        picture, uses = int(self.tape.constants[~constant]), [self._uses[INPUTS + row + k] for k in range(CHANNELS)]
        place = f"({self.operand(s).text}, {self.operand(t).text})"
        color, alpha = "", "0"
        if any(uses[:3]):
            color = self._picture(picture, False) + place
            color = self._let("texel", color) if sum(uses[:3]) > 1 else color
        if uses[3]:
            alpha = self._picture(picture, True) + place
            alpha = self._let("alpha", alpha) if uses[3] > 1 else alpha
        return [*(Text(f"{color}.{channel}") for channel in "rgb"), Text(alpha)]

    def _picture(self, row: int, alpha: bool) -> str:
        name = self.pictures(row, alpha)
        self._taken.add(name)
        return name

    def _operation(self, op: int, names: Sequence[int]) -> Text | None:
        """The text of a row; None for one that the language does not say."""
        operands = self._operands(op, names)
        listed = ", ".join(operand.text for operand in operands)
        if op in _FUNCTIONS:
            return Text(f"{_FUNCTIONS[op]}({listed})")
        if op in _COLORS:
            function, channel = _COLORS[GraphOp(op)]
            call = f"{function}({listed})"
            if call not in self._calls:
                self._calls[call] = self._let("cell" if function.startswith("cell") else "noise", call)
            return Text(f"{self._calls[call]}.{channel}")
        return _ARITHMETIC[op](*operands) if op in _ARITHMETIC else None

    def _operands(self, op: int, names: Sequence[int]) -> list[Text]:
        """The texts of operands. What is undefined of constants, which the language refuses, has 0 times the position in them."""
        operands = [self.operand(name) for name in names]
        divides_by_zero = op in (Op.DIVIDE, Op.MOD) and names[1] < 0 and float(self.tape.constants[~names[1]]) == 0.0
        if divides_by_zero or all(name < 0 for name in names):
            last = operands[-1]
            operands[-1] = Text(f"0 * {self.operand(X).text} + {last.within(_PRODUCT)}", _SUM)
        return operands


def _label(op: int) -> str:
    """A name for values of an operation."""
    if op >= GraphOp.PERLIN2:
        return "cell" if op >= GraphOp.CELL1 else "noise"
    return _LABELS.get(Op(op), Op(op).name.lower())


_LABELS = {
    Op.ADD: "sum", Op.SUBTRACT: "difference", Op.MULTIPLY: "product", Op.DIVIDE: "quotient", Op.NEGATE: "negative", Op.CHOOSE: "choice",
    Op.ANGLE: "angle", Op.ATAN2: "angle", Op.SQRT: "root",
}  # fmt: skip
_ARITHMETIC: dict[int, Callable[..., Text]] = {
    Op.COPY: lambda a: a,
    Op.ADD: lambda a, b: _sum("+", a, b),
    Op.SUBTRACT: lambda a, b: _sum("-", a, b),
    Op.MULTIPLY: lambda a, b: Text(f"{a.within(_PRODUCT)} * {b.within(_NEGATION)}", _PRODUCT),
    Op.DIVIDE: lambda a, b: Text(f"{a.within(_PRODUCT)} / {b.within(_NEGATION)}", _PRODUCT),
    Op.NEGATE: lambda a: Text(f"-{a.within(_POWER)}", _NEGATION),
    Op.SQUARE: lambda a: Text(f"{a.within(_ATOM)} ^ 2", _POWER),
    Op.CUBE: lambda a: Text(f"{a.within(_ATOM)} ^ 3", _POWER),
    Op.POWER: lambda a, b: Text(f"{a.within(_ATOM)} ^ {b.within(_ATOM)}", _POWER),
    Op.CHOOSE: lambda a, b, c: Text(f"if {a.within(_SUM)} <= 0 then {b.within(_SUM)} else {c.text}", _IF),
}
