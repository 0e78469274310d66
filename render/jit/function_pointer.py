"""Calls of kernels by address, so that each kernel compiles once and separately.

A direct call makes Numba link the callee's code into the caller's module and optimize it again, at every level of calls. Here the caller
reads an address from a table at run time. `prepare` links the kernels of a picture and writes their addresses to the handles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .. import simd
from ..simd.registration import cgutils, intrinsic, types, typing_error
from .kernel import Kernel, kernel
from .value_types import ValueType, tuple_of


class KernelPointer:
    """A kernel that others call by address: `call(address, (arguments…))` in kernels, `link(types…)` before they run."""

    def __init__(self, function: Any) -> None:
        self.kernel = kernel(function)
        self.call = _call_of(self)

    def link(self, *kinds: ValueType) -> int:
        """Compile the kernel for arguments of these types, or load it from disk; return its address."""
        return compiled_address(self.kernel, *kinds)


def compiled_address(kernel: Kernel, *kinds: ValueType) -> int:
    """Compile a kernel for arguments of these types, or load it from disk; return its address."""
    return kernel.load(kinds).address


class DeclaredPointer(KernelPointer):
    """A call signature with declared result type; the address selects the kernel.

    Arguments are passed with their own types, or with the declared types `takes` behind the first argument.
    """

    def __init__(self, result: Sequence[ValueType] | ValueType, takes: Sequence[ValueType] = ()) -> None:
        self.result = result if isinstance(result, ValueType) else tuple_of(*result)
        self.takes = tuple(takes)
        self.call = _call_of(self)


class DeclaredKernel(DeclaredPointer):
    """A kernel with declared result type, so that its callers compile without it."""

    def __init__(self, function: Any, result: Sequence[ValueType] | ValueType, takes: Sequence[ValueType] = ()) -> None:
        super().__init__(result, takes)
        self.kernel = kernel(function)


def _call_of(linked: KernelPointer) -> Any:
    def call(typingctx, address, arguments):
        from .numba_types import to_numba

        argument_types = tuple(types.unliteral(kind) for kind in arguments.types)
        if isinstance(linked, DeclaredPointer):
            kinds, result = (argument_types[0], *map(to_numba, linked.takes)) if linked.takes else argument_types, to_numba(linked.result)
            if not _all_fit(argument_types, kinds):
                raise typing_error(f"{argument_types} cannot be passed as {kinds}")
        else:
            signatures = {tuple(map(to_numba, kinds)): loaded for kinds, loaded in linked.kernel.loaded.items()}
            kinds = next((kinds for kinds in signatures if _all_fit(argument_types, kinds)), None)
            if kinds is None:
                raise typing_error(f"{linked.kernel.py_func.__name__} was not linked for {argument_types}")
            result = to_numba(signatures[kinds].result)

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            shape = context.call_conv.get_function_type(result, kinds)
            function = builder.inttoptr(args[0], shape.as_pointer())
            parts = zip(cgutils.unpack_tuple(builder, args[1]), sig.args[1].types, kinds, strict=True)
            values = [context.cast(builder, value, kind, parameter) for value, kind, parameter in parts]
            status, value = context.call_conv.call_function(builder, function, result, kinds, values)
            with cgutils.if_unlikely(builder, status.is_error):
                context.call_conv.return_status_propagate(builder, status)
            return value

        return result(types.int64, arguments), generate

    return intrinsic(call)


def _all_fit(arguments: Sequence[Any], parameters: Sequence[Any]) -> bool:
    return len(arguments) == len(parameters) and all(map(_fits, arguments, parameters))


def _fits(argument: Any, parameter: Any) -> bool:
    """Return whether a value can be passed: with its own type, or a number that is broadcast to lanes."""
    if isinstance(argument, types.BaseTuple) and isinstance(parameter, types.BaseTuple):
        return _all_fit(argument.types, parameter.types)
    if isinstance(parameter, simd.Vector):
        return argument == parameter or isinstance(argument, types.Number | types.Boolean)
    return argument == parameter or (isinstance(argument, types.Integer) and isinstance(parameter, types.Integer))
