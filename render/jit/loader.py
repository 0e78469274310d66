"""Loads object code into the process and calls it."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import llvmlite.binding as llvm

from ..simd import target
from .kernel_file import Code
from .value_types import ValueType

_ENTRY = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)  # releases Python's lock


_process = ctypes.CDLL(None)


class KernelError(RuntimeError):
    """A kernel ended with an error status, such as memory that ran out."""


def target_machine(opt: int = 2) -> Any:
    """LLVM's target machine of kernels."""
    _initialize()
    machine = llvm.Target.from_triple(llvm.get_process_triple())
    return machine.create_target_machine(cpu=target.LEVEL.cpu, features=target.LEVEL.features, opt=opt, jit=True, codemodel="jitdefault")


@cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


def load_object(code: bytes) -> Any:
    """An engine that holds object code; get_function_address(name) finds a function. The code is kept as long as the engine.

    Raises RuntimeError on a machine that does not run code of this level.
    """
    target.check_host()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target_machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


_defined: dict[str, Any] = {}  # engines of separate helpers, by symbol


def is_defined(symbol: str) -> bool:
    """Whether the function of a separate helper is loaded."""
    return symbol in _defined


def define(helper: Code) -> None:
    """Load a separate helper, whose callees are loaded, for the kernels that are loaded after it."""
    engine = _defined[helper.function] = load_object(helper.code)
    llvm.add_symbol(helper.function, engine.get_function_address(helper.function))


def has_symbols(code: Code) -> bool:
    """Whether this process defines the symbols that the code needs."""
    return all(hasattr(_process, name) or llvm.address_of_symbol(name) is not None for name in code.needs)


class NotLoaded(NamedTuple):
    """A kernel that was compiled for another machine: callers are compiled with the type of its result."""

    result: ValueType


class Loaded:
    """A kernel's code for one signature. `address` is for calls by other kernels, `result` the type of its result."""

    def __init__(self, name: str, kinds: tuple[ValueType, ...], code: Code, from_disk: bool) -> None:
        self.name, self.kinds, self.result, self.from_disk = name, kinds, code.result, from_disk
        self._engine = load_object(code.code)
        self.address: int = self._engine.get_function_address(code.function)
        self._entry = _ENTRY(self._engine.get_function_address(code.entry))
        self._arguments = struct.Struct("".join(kind.format for kind in kinds))
        self._returned = struct.Struct(code.result.format)

    def __call__(self, arguments: tuple[Any, ...]) -> Any:
        """Run the kernel. Raises KernelError where it ends with an error."""
        return self.bind(arguments)()

    def bind(self, arguments: tuple[Any, ...]) -> Callable[[], Any]:
        """A call with these arguments, packed once for many runs; arrays and handles must outlive it."""
        words: list[Any] = []
        for kind, value in zip(self.kinds, arguments, strict=True):
            kind.pack(value, words)
        size = self._arguments.size
        block = ctypes.create_string_buffer(self._arguments.pack(*words), max(size + self._returned.size, 1))

        def run() -> Any:
            status = self._entry(ctypes.addressof(block))
            if status:
                raise KernelError(f"the kernel {self.name} ended with status {status}")
            return self.result.unpack(iter(self._returned.unpack_from(block, size)))

        return run
