"""Plain data as bytes, for other processes: JSON and arrays, and plans in that form. No pickle."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler.plan.decision import Decision, Plan

ALIGNMENT = 64  # bytes, of arrays in a message

Arrays = Mapping[str, NDArray[Any]]


def pack(about: Mapping[str, Any], arrays: Arrays | None = None) -> bytes:
    """Bytes of JSON data and arrays."""
    rows, parts, offset = [], [], 0
    for name, array in (arrays or {}).items():
        array = np.asarray(array)
        rows.append([name, array.dtype.str, list(array.shape)])
        data = np.ascontiguousarray(array).tobytes()
        parts += [data, bytes(-len(data) % ALIGNMENT)]
        offset += len(data) + len(parts[-1])
    head = json.dumps([about, rows], default=_plain).encode()
    head += b" " * (-(8 + len(head)) % ALIGNMENT)
    return b"".join([len(head).to_bytes(8, "little"), head, *parts])


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """(data, arrays) of `pack`; the arrays are read-only views of the message. Raises ValueError for other bytes."""
    size = int.from_bytes(message[:8], "little")
    about, rows = json.loads(message[8 : 8 + size])
    arrays, offset = {}, 8 + size
    for name, kind, shape in rows:
        dtype, count = np.dtype(kind), math.prod(shape)
        if dtype.hasobject:
            raise ValueError(f"an array of {dtype}")
        arrays[name] = np.frombuffer(message, dtype, count, offset).reshape(shape)
        offset += count * dtype.itemsize
        offset += -offset % ALIGNMENT
    return about, arrays


def _plain(value: Any) -> Any:
    """Numpy scalars and arrays for JSON."""
    return value.tolist()


def plan_to(plan: Plan) -> list[list[Any]]:
    """The decisions of a plan: name, value, and whether it was overridden. The number of threads is the worker's own."""
    values = plan.values()
    return [[name, values[name], d.overridden] for name, d in plan.decisions.items() if name != "threads"]


def plan_from(rows: list[list[Any]], threads: int) -> Plan:
    """The plan of `plan_to`, without reasons."""
    decisions = {name: Decision(name, tuples(value), "", overridden=bool(overridden)) for name, value, overridden in rows}
    return Plan({**decisions, "threads": Decision("threads", threads, "")})


def tuples(value: Any) -> Any:
    """JSON lists as tuples."""
    return tuple(map(tuples, value)) if isinstance(value, list) else value
