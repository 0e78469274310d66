"""Places checked as kernels run, where MAQUETTE_CHECKED=1 asks for it: what lies outside of an array ends the process with a message.

Vectors read and write where they are told to, and what lies beside an array often does no harm for weeks. With checks on, pictures are
drawn at about half the speed, and a place outside is told with the line that asked for it. Numba's own checks of indices come with it.
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


def one(builder: Any, made: Any, place: Any, count: int) -> None:
    """Elements place … place + count - 1 of an array must be there."""
    if target.CHECKED and count:
        last = builder.sub(made.nitems, ir.Constant(I64, count))
        _end_if(builder, _outside(builder, place, last), place, made.nitems)


def each(builder: Any, size: Any, index: Value, mask: Any = None, count: int = 1) -> None:
    """So must elements index … index + count - 1 of `size` in each lane, or in those of a mask."""
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
    """The line of a kernel's source that Numba lowers just now, which intrinsics are not told of."""
    frame = sys._getframe(1)
    while frame is not None and frame.f_code.co_name != "lower_inst":
        frame = frame.f_back
    if frame is None:
        return "?"
    found = frame.f_locals["inst"].loc
    return f"{Path(found.filename).name}:{found.line}"
