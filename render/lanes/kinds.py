"""Types of kernel values: FLOAT, INT, MASK and VEC, WIDTH lanes of 64 bits each."""

from __future__ import annotations

from typing import Any

from .. import simd
from ..jit.value_types import BOOL, FLOAT64, INT64, tuple_of, vector

WIDTH = simd.WIDTH64  # lanes of a kernel value


def lane_type(kind: str) -> Any:
    """Type of WIDTH lanes of 64 bits of a kind: "f" float, "i" int, "m" mask; a scalar type if WIDTH is 1."""
    if WIDTH > 1:
        return vector(kind, 64, WIDTH)
    return {"f": FLOAT64, "i": INT64, "m": BOOL}[kind]


FLOAT: Any = lane_type("f")
INT: Any = lane_type("i")
MASK: Any = lane_type("m")
VEC: Any = tuple_of(FLOAT, FLOAT, FLOAT)
