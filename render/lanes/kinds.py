"""Numba types of kernel values: FLOAT, INT, MASK and VEC, WIDTH lanes of 64 bits each."""

from __future__ import annotations

from typing import Any

from numba import types

from .. import simd

WIDTH = simd.WIDTH64  # lanes of a kernel value


def lane_type(kind: str) -> Any:
    """Numba type of WIDTH lanes of 64 bits of a kind: "f" float, "i" int, "m" mask; a scalar type if WIDTH is 1."""
    if WIDTH > 1:
        return simd.Vector(kind, 64, WIDTH)
    return {"f": types.float64, "i": types.int64, "m": types.boolean}[kind]


FLOAT: Any = lane_type("f")
INT: Any = lane_type("i")
MASK: Any = lane_type("m")
VEC: Any = types.UniTuple(FLOAT, 3)
