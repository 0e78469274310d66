"""Tapes of formulas as functions of the language."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ... import ir
from ...formula.opcodes import Op, arity
from ...formula.tape import INPUTS
from ...texture_graph.opcodes import is_graph
from . import words

MOST = 4000  # characters of a formula

_FUNCTIONS = {
    Op.ABS: "abs", Op.SQRT: "sqrt", Op.HYPOT: "hypot", Op.MIN: "min", Op.MAX: "max", Op.EXP: "exp", Op.LOG: "log", Op.SIN: "sin",
    Op.COS: "cos", Op.TAN: "tan", Op.ASIN: "asin", Op.ACOS: "acos", Op.ATAN: "atan", Op.ATAN2: "atan2", Op.ANGLE: "atan2",
    Op.FLOOR: "floor", Op.CEIL: "ceil", Op.MOD: "mod", Op.SIGN: "sign", Op.NOISE: "noise",
}  # fmt: skip
_TEXTS: dict[Op, Callable[..., str]] = {
    Op.COPY: lambda a: a, Op.ADD: lambda a, b: f"({a} + {b})", Op.SUBTRACT: lambda a, b: f"({a} - {b})",
    Op.MULTIPLY: lambda a, b: f"({a} * {b})", Op.DIVIDE: lambda a, b: f"({a} / {b})", Op.NEGATE: lambda a: f"(-{a})",
    Op.SQUARE: lambda a: f"({a}) ^ 2", Op.CUBE: lambda a: f"({a}) ^ 3", Op.POWER: lambda a, b: f"({a}) ^ ({b})",
    Op.CHOOSE: lambda a, b, c: f"(if {a} <= 0 then {b} else {c})",
}  # fmt: skip


def pattern(tables: ir.Tables, tape: int, gain: tuple[float, float, float]) -> str | None:
    """`pattern(…)` of a tape (a row); None of one that a formula does not say, or that is too long for it."""
    t, pools = tables.tapes, tables.pools
    first, start = int(t.first[tape]), int(t.first_constant[tape])
    code = pools.code[first : first + int(t.count[tape])]
    constants = pools.constants[start : start + int(t.constant_count[tape])]
    results = t.results[tape, : int(t.result_count[tape])].tolist()
    if is_graph(np.asarray(code), results):
        return None
    texts = _texts(np.asarray(code), constants.tolist())
    if texts is None:
        return None
    values = [_operand(name, texts, constants.tolist()) for name in results]
    if len(values) == 1 and len(set(gain)) == 1:
        values = [_times(values[0], gain[0])]
    else:
        values = [_times(value, factor) for value, factor in zip(values * (3 // len(values)), gain, strict=True)]
    body = values[0] if len(values) == 1 else f"rgb({', '.join(values)})"
    return f"pattern(|x, y, z| {body})" if len(body) <= MOST else None


def _times(text: str, factor: float) -> str:
    return text if factor == 1.0 else f"{words.number(factor)} * ({text})"


def _texts(code: np.ndarray, constants: list[float]) -> list[str] | None:
    texts: list[str] = []
    for op, *operands in code.tolist():
        names = [_operand(name, texts, constants) for name in operands[: arity(op)]]
        if op in _TEXTS:
            texts.append(_TEXTS[Op(op)](*names))
        elif op in _FUNCTIONS:
            texts.append(f"{_FUNCTIONS[Op(op)]}({', '.join(names)})")
        else:
            return None
        if len(texts[-1]) > MOST:
            return None
    return texts


def _operand(name: int, texts: list[str], constants: list[float]) -> str:
    if name < 0:
        value = constants[~name]
        return f"({words.number(value)})" if value < 0 else words.number(value)
    return "xyz"[name] if name < INPUTS else texts[name - INPUTS]
