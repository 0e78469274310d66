"""Writes and reads chart.json: a chart with all its numbers.

Numbers that are not finite are the strings "inf", "-inf" and "nan". All other fields are those of measure/records.py.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Any

from ...compiler.scene.serialize import tuples
from ..records import Answer, Chart, Curve, Point, Setting, Spread

FORMAT = "maquette chart 1"
NON_FINITE = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


class FormatError(Exception):
    """The text is not a chart; the message names the missing or wrong part."""


def dump(chart: Chart) -> str:
    """The chart as JSON. Each setting also has its `arguments`; numbers have all digits."""
    return json.dumps({"format": FORMAT, **_data(chart)}, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read(text: str) -> Chart:
    """The chart of a text. Raises FormatError."""
    try:
        data = json.loads(text)
    except ValueError as error:
        raise FormatError(f"this is not JSON: {error}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FormatError(f"this is not a chart: its `format` is not `{FORMAT}`")
    try:
        whole = {"size": tuple(data["size"]), "curves": _each(_curve, data["curves"]), "front": tuple(data["front"])}
        return _record(Chart, data, **whole, answers=_each(_answer, data.get("answers", ())))
    except (KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"the chart is not whole: {error}") from None


def _data(value: Any) -> Any:
    """Records, mappings, sequences and numbers as JSON values."""
    if isinstance(value, Answer | Chart | Curve | Point | Setting | Spread):
        data = {f.name: _data(getattr(value, f.name)) for f in fields(value)}
        return {**data, "arguments": value.arguments()} if isinstance(value, Setting) else data
    if isinstance(value, Mapping):
        return {str(name): _data(v) for name, v in value.items()}
    if isinstance(value, tuple | list):
        return [_data(v) for v in value]
    if hasattr(value, "item"):  # numpy's scalars
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _record(kind: Any, data: Mapping[str, Any], **read: Any) -> Any:
    """A record of `kind`: the fields of `read`, else those of `data`, else the defaults (files of older versions)."""

    def plain(f: Field[Any]) -> Any:
        return _number(data[f.name]) if str(f.type).startswith("float") else data[f.name]

    present = [f for f in fields(kind) if f.name in data or f.name in read or (f.default is MISSING and f.default_factory is MISSING)]
    return kind(**{f.name: read[f.name] if f.name in read else plain(f) for f in present})


def _number(value: Any) -> Any:
    return NON_FINITE.get(value, value) if isinstance(value, str) else value


def _each(read: Any, items: Any) -> tuple[Any, ...]:
    return tuple(read(item) for item in items)


def _answer(data: Mapping[str, Any]) -> Answer:
    return _record(Answer, data, setting=None if data["setting"] is None else _setting(data["setting"]))


def _curve(data: Mapping[str, Any]) -> Curve:
    return _record(Curve, data, points=_each(_point, data["points"]))


def _point(data: Mapping[str, Any]) -> Point:
    errors = {name: _spread(spread) for name, spread in data["errors"].items()}
    stages = {name: _number(value) for name, value in data["stages"].items()}
    setting, seconds, error = _setting(data["setting"]), _spread(data["seconds"]), _spread(data["error"])
    return _record(Point, data, setting=setting, seconds=seconds, error=error, errors=errors, stages=stages)


def _spread(data: Mapping[str, Any]) -> Spread:
    return _record(Spread, data)


def _setting(data: Mapping[str, Any]) -> Setting:
    options = {name: tuples(value) for name, value in data["options"].items()}
    return _record(Setting, data, value=tuples(data["value"]), options=options)
