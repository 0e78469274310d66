"""Calls of kernels by address, so that each kernel compiles once and separately.

A direct call makes Numba link the callee's code into the caller's module and optimize it again, at every level of calls. Here the caller
reads an address from a table at run time. `prepare` links the kernels of a picture and writes their addresses to the handles.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from operator import attrgetter
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from .. import simd
from .kernel import kernel


class KernelPointer:
    """A kernel that others call by address: `call(address, (arguments…))` in kernels, `link(types…)` before they run."""

    def __init__(self, function: Any) -> None:
        self.kernel = kernel(function)
        self.call = _call_of(self)

    def link(self, *kinds: types.Type) -> int:
        """Compile the kernel for arguments of these types, or load it from disk; return its address."""
        return compiled_address(self.kernel, *kinds)


@functools.cache
def compiled_address(kernel: Any, *kinds: types.Type) -> int:
    """Compile a kernel for arguments of these types, or load it from disk; return its address."""
    kernel.compile(kinds)
    code, descriptor = attrgetter("library", "fndesc")(kernel.overloads[kinds])
    return code.get_pointer_to_function(descriptor.llvm_func_name)


class DeclaredPointer(KernelPointer):
    """A call signature with declared result type; the address selects the kernel.

    Arguments are passed with their own types, or with the declared types `takes` behind the first argument.
    """

    def __init__(self, result: Sequence[types.Type] | types.Type, takes: Sequence[types.Type] = ()) -> None:
        self.result = result if isinstance(result, types.Type) else types.Tuple(list(result))
        self.takes = tuple(takes)
        self.call = _call_of(self)


class DeclaredKernel(DeclaredPointer):
    """A kernel with declared result type, so that its callers compile without it."""

    def __init__(self, function: Any, result: Sequence[types.Type] | types.Type, takes: Sequence[types.Type] = ()) -> None:
        super().__init__(result, takes)
        self.kernel = kernel(function)


def _call_of(linked: KernelPointer) -> Any:
    def call(typingctx, address, arguments):
        given = tuple(types.unliteral(kind) for kind in arguments.types)
        if isinstance(linked, DeclaredPointer):
            kinds, result = (given[0], *linked.takes) if linked.takes else given, linked.result
            if not _all_fit(given, kinds):
                raise TypingError(f"{given} cannot be passed as {kinds}")
        else:
            kinds = next((known for known in linked.kernel.overloads if _all_fit(given, known)), None)
            if kinds is None:
                raise TypingError(f"{linked.kernel.__name__} was not linked for {given}")
            result = linked.kernel.overloads[kinds].signature.return_type

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            shape = context.call_conv.get_function_type(result, kinds)
            function = builder.inttoptr(args[0], shape.as_pointer())
            parts = zip(cgutils.unpack_tuple(builder, args[1]), sig.args[1].types, kinds, strict=True)
            values = [context.cast(builder, value, kind, wanted) for value, kind, wanted in parts]
            status, value = context.call_conv.call_function(builder, function, result, kinds, values)
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
            return value

        return result(types.int64, arguments), generate

    return intrinsic(call)


def _all_fit(given: Sequence[types.Type], wanted: Sequence[types.Type]) -> bool:
    return len(given) == len(wanted) and all(map(_fits, given, wanted))


def _fits(given: types.Type, wanted: types.Type) -> bool:
    """Return whether a value can be passed: with its own type, or a number that is broadcast to lanes."""
    if isinstance(given, types.BaseTuple) and isinstance(wanted, types.BaseTuple):
        return _all_fit(given.types, wanted.types)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(wanted, simd.Vector):
        return given == wanted or isinstance(given, types.Number | types.Boolean)
    return given == wanted or (isinstance(given, types.Integer) and isinstance(wanted, types.Integer))
