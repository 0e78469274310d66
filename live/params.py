"""Params of a scene as controls of the page, and their values written back into the source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..compiler import ir
from ..lang.diagnostics import Diagnostics
from ..lang.elements import ParamInfo
from ..lang.syntax import ast
from ..lang.syntax.parser import parse

STEPS = 200  # of a slider


def controls(scene: ir.Scene) -> list[dict[str, Any]]:
    """A control for each param: its kind (slider, number, color, switch, choice, text), value and limits."""
    return [_control(param) for param in scene.params]


def _control(param: ParamInfo) -> dict[str, Any]:
    about = {"name": param.name, "doc": param.doc, "unit": param.unit, "line": param.span.line, "type": param.type}
    value, allowed = param.value, param.range
    if param.type == "bool":
        return {**about, "kind": "switch", "value": bool(value), "text": _value_text(param, value)}
    if param.type == "color":
        return {**about, "kind": "color", "value": hex_color(value), "text": hex_color(value)}
    if allowed is not None and not _is_interval(allowed):
        choices = [{"label": _label(param, choice), "text": _value_text(param, choice)} for choice in allowed]
        return {**about, "kind": "choice", "value": _label(param, value), "text": _value_text(param, value), "choices": choices}
    if isinstance(value, int | float) and not isinstance(value, bool):
        text = _value_text(param, value)
        if allowed is None:
            return {**about, "kind": "number", "value": value, "text": text, "whole": param.type == "int"}
        low, high = allowed
        step = 1 if param.type == "int" else _round_step((high - low) / STEPS)
        return {**about, "kind": "slider", "value": value, "text": text, "low": low, "high": high, "step": step}
    if isinstance(value, str) and param.type == "string":
        return {**about, "kind": "text", "value": value, "text": value}
    return {**about, "kind": "fixed", "value": _label(param, value), "text": ""}


def _is_interval(allowed: tuple[Any, ...]) -> bool:
    numbers = all(isinstance(end, int | float) and not isinstance(end, bool) for end in allowed)
    return numbers and len(allowed) == 2 and allowed[0] < allowed[1]


def _round_step(most: float) -> float:
    """The greatest of 1, 2 and 5 times a power of ten that is at most `most`, which is above 0."""
    power = 10.0 ** math.floor(math.log10(most))
    return next((factor * power for factor in (5.0, 2.0) if factor * power <= most), power)


def hex_color(channels: Any) -> str:
    """`#rrggbb` of linear channels, clipped to 0..1."""
    codes = [round(255 * min(max(_encode(float(c)), 0.0), 1.0)) for c in channels]
    return "#" + "".join(f"{code:02x}" for code in codes)


def _encode(linear: float) -> float:
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * max(linear, 0.0031308) ** (1 / 2.4) - 0.055


def _label(param: ParamInfo, value: Any) -> str:
    return value if isinstance(value, str) else _value_text(param, value) or str(value)


def _value_text(param: ParamInfo, value: Any) -> str:
    """The value as text of --set; "" if it has none."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return f"{value:.6g}{param.unit}" if param.type != "int" else str(int(value))
    if param.type == "color":
        return hex_color(value)
    return ""


def write_back(text: str, name: str, values: Mapping[str, str]) -> str:
    """The source `text` with the defaults of these params replaced by values, which are texts of --set.

    Raises ValueError if a param is missing from the source or its default cannot be found there.
    """
    tree = parse(text, name, Diagnostics())
    params = {item.name.id: item for item in tree.items if isinstance(item, ast.Param)}
    if missing := next((param for param in values if param not in params), None):
        raise ValueError(f"{name} has no param `{missing}` that can be read")
    starts = [0]
    for line in text.split("\n"):
        starts.append(starts[-1] + len(line) + 1)
    mark = 1 if text.startswith("\ufeff") else 0  # spans do not count it

    def place(line: int, column: int) -> int:
        return starts[line - 1] + column - 1 + (mark if line == 1 else 0)

    for item in sorted((params[param] for param in values), key=lambda item: item.span.line, reverse=True):
        span = item.default.span
        begin, end = place(span.line, span.column), place(span.end_line, span.end_column)
        text = text[:begin] + _source(item, values[item.name.id]) + text[end:]
    return text


def _source(item: ast.Param, value: str) -> str:
    """A value of --set as an expression in the place of the default, without the unit where the default has none."""
    is_string = item.type.id == "string" if item.type else isinstance(item.default, ast.String)
    if is_string:
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"' if not value.lstrip().startswith('"') else value
    return value
