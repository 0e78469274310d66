"""Optional bounds checks in kernels (MAQUETTE_CHECKED=1): an access outside of an array ends the process with a message.

Vector accesses are unchecked by default, and an error may stay unnoticed for weeks. With checks on, rendering takes about twice the time,
and the message names the source line of the access. The setting also enables Numba's own index checks.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba.core import cgutils

from . import llvm_expr as v
from . import target
from .llvm_expr import I32, I64, Value


def check_range(builder: Any, array: Any, place: Any, count: int) -> None:
    """Check that elements place … place + count − 1 lie in an array."""
    if target.CHECKED and count:
        last = builder.sub(array.nitems, ir.Constant(I64, count))
        _end_if(builder, _outside(builder, place, last), place, array.nitems)


def check_lanes(builder: Any, size: Any, index: Value, mask: Any = None, count: int = 1) -> None:
    """Check elements index … index + count − 1 against `size` in each lane, or in the lanes of a mask."""
    if not target.CHECKED:
        return
    places, last = index.to("i", 64).raw, builder.sub(size, ir.Constant(I64, count))
    for k in range(index.lanes):
        place = builder.extract_element(places, ir.Constant(I32, k))
        outside = _outside(builder, place, last)
        if mask is not None:
            outside = builder.and_(outside, builder.extract_element(mask, ir.Constant(I32, k)))
        _end_if(builder, outside, place, size)


def _outside(builder: Any, place: Any, last: Any) -> Any:
    return builder.or_(builder.icmp_signed("<", place, ir.Constant(I64, 0)), builder.icmp_signed(">", place, last))


def _end_if(builder: Any, outside: Any, place: Any, size: Any) -> None:
    with cgutils.if_unlikely(builder, outside):
        cgutils.printf(builder, f"{_line()}: place %lld of %lld\n", place, size)
        v.call(builder, "fflush", I32, [ir.Constant(ir.IntType(8).as_pointer(), None)])
        v.call(builder, "abort", ir.VoidType(), [])


def _line() -> str:
    """File name and line of the kernel statement that Numba is lowering, found in its stack frame."""
    frame = sys._getframe(1)
    while frame is not None and frame.f_code.co_name != "lower_inst":
        frame = frame.f_back
    if frame is None:
        return "?"
    location = frame.f_locals["inst"].loc
    return f"{Path(location.filename).name}:{location.line}"
