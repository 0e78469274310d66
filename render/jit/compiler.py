"""Compiles kernels with Numba: registers recorded overloads, links helpers, adds the entry function, emits object code.

Only a process that compiles imports this module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core import config, cpu, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.funcdesc import default_mangler
from numba.core.registry import cpu_target
from numba.core.typing.context import Context
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template
from numba.extending import overload

from ..simd import (  # noqa: F401 - define kernels' functions
    constructors,
    denormals,
    elementary,
    functions,
    gather_scatter,
    memory,
    operators,
    registration,
    shuffles,
    target,
    vector_indexing,
)
from . import fragments, lto, numba_patches, numba_types, prebuilt
from .kernel_file import Code
from .value_types import NONE, ValueType

numba_patches.install_patches()
_FLAGS: Any = {
    "error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "boundscheck": target.CHECKED,
}  # fmt: skip
_registered = 0  # of registration.RECORDS


CONVENTION = "i32 (double*, {i8*, i32, i8*, i8*, i32}**, i8*, i8*, i64, i64, double*, i64, i64, i8, double)"
"""LLVM type of a kernel (array of float64, boolean, float64) → float64: how kernels call each other, also those of `prebuilt`."""


def convention(target_context: Any) -> str:
    """The type that this version of Numba gives a kernel as in CONVENTION."""
    kinds = types.Array(types.float64, 1, "C"), types.boolean, types.float64
    return str(target_context.call_conv.get_function_type(types.float64, kinds))


def _symbol(name: str, kinds: Any, *, abi_tags: Any = (), uid: Any = None) -> str:
    """The symbol of a function: of a fragment with its unique digest, else Numba's."""
    return f"{name}.{uid}" if isinstance(uid, str) else default_mangler(name, kinds, abi_tags=abi_tags, uid=uid)


@cache
def _contexts() -> dict[str, Any]:
    """Numba's contexts for the target machine of kernels, apart from those of other users of Numba in this process.

    Raises RuntimeError for a version of Numba whose kernels cannot call those that come with the package.
    """
    before = config.CPU_NAME, config.CPU_FEATURES  # pyright: ignore[reportAttributeAccessIssue]
    config.CPU_NAME, config.CPU_FEATURES = target.LEVEL.cpu, target.LEVEL.features  # pyright: ignore[reportAttributeAccessIssue]
    try:
        typing_context = Context()
        target_context = cpu.CPUContext(typing_context, "cpu")
        target_context.mangler = _symbol  # pyright: ignore[reportAttributeAccessIssue]
    finally:
        config.CPU_NAME, config.CPU_FEATURES = before  # pyright: ignore[reportAttributeAccessIssue]
    if prebuilt.folder() is not None and convention(target_context) != CONVENTION:
        raise RuntimeError(f"kernels that Numba {numba.__version__} compiles cannot call those of this package: install another Numba")
    return {"_toplevel_typing_context": typing_context, "_toplevel_target_context": target_context}


@contextmanager
def _for_kernels() -> Iterator[None]:
    """Hold Numba's lock and let it compile for the target machine of kernels."""
    with global_compiler_lock:
        ours, attributes = _contexts(), vars(cpu_target)
        before = {name: attributes[name] for name in ours if name in attributes}
        attributes.update(ours)
        try:
            yield
        finally:
            for name in ours:
                del attributes[name]
            attributes.update(before)


def register() -> None:
    """Register with Numba the functions that were recorded since the last call."""
    global _registered
    while _registered < len(registration.RECORDS):
        kind, arguments = registration.RECORDS[_registered]
        _registered += 1
        _REGISTER[kind](*arguments)


def _register_overload(function: Any, choose: Any, strict: bool, inline: bool, allocates: bool, separate: bool) -> None:
    pipeline = lto.SeparateFragment if separate else lto.Fragment
    options = {**_FLAGS, "forceinline": inline, "pipeline_class": pipeline, "_nrt": allocates}
    overload(function, jit_options=options, strict=strict)(choose)  # pyright: ignore[reportArgumentType]


def _register_intrinsic(record: registration.Intrinsic) -> None:
    template = make_intrinsic_template(record, record.definition, record.definition.__name__)
    infer(template)
    infer_global(record, types.Function(template))  # pyright: ignore[reportCallIssue]


_REGISTER: dict[str, Callable[..., None]] = {
    "overload": _register_overload, "intrinsic": _register_intrinsic, "operator": operators.define,
}  # fmt: skip


def callee(function: Callable[..., Any]) -> Any:
    """Numba type of a kernel that another kernel calls by its name: its code is compiled into the caller."""
    return types.Dispatcher(_dispatcher(function))


@cache
def _dispatcher(function: Callable[..., Any]) -> Any:
    """Numba's dispatcher of a function, which its type does not keep alive."""
    return njit(**_FLAGS, pipeline_class=lto.Fragment)(function)


class SeparateHelper:
    """A helper that a kernel calls and that is emitted apart from it. `symbol` names its function, and its code for all processes."""

    def __init__(self, library: Any) -> None:
        self._library = library
        self.symbol: str = library.symbol

    def emit(self) -> tuple[Code, list[SeparateHelper]]:
        """(its object code, the separate helpers that it calls). The code does not name their files."""
        with global_compiler_lock:
            code, linked = lto.emit_separately(self._library)
        return Code("", self.symbol, NONE, linked.undefined, code), list(map(SeparateHelper, linked.separate))


def compile_kernel(function: Callable[..., Any], kinds: tuple[ValueType, ...], folder: Path) -> tuple[Code, list[SeparateHelper]]:
    """(a function's code for arguments of these types, the separate helpers that it calls), with the fragments of a folder.

    The code does not name the files of helpers. Raises Numba's errors for other code.
    """
    with _for_kernels():
        fragments.STORE.open(folder)
        library, described, result = _lower(function, kinds)
        code = library.emit()
        fragments.STORE.save()
    linked = library.linked
    return Code(numba_types.ENTRY, described.llvm_func_name, result, linked.undefined, code), list(map(SeparateHelper, linked.separate))


def assembly(function: Callable[..., Any], kinds: tuple[ValueType, ...]) -> str:
    """The assembly code of a kernel."""
    with _for_kernels():
        library = _lower(function, kinds)[0]
        library.link()
        return library.get_asm_str()


def _lower(function: Callable[..., Any], kinds: tuple[ValueType, ...]) -> tuple[lto.Whole, Any, ValueType]:
    """A kernel's library with its entry, not yet linked; its descriptor; the type of its result."""
    register()
    dispatcher: Any = njit(**_FLAGS, pipeline_class=lto.Kernel)(function)
    compiled = dispatcher._compiler.compile(tuple(map(numba_types.to_numba, kinds)), None)
    result = numba_types.from_numba(compiled.signature.return_type)
    code, descriptor = attrgetter("library", "fndesc")(compiled)
    numba_types.add_entry(cpu_target.target_context, code, descriptor, kinds, result)
    return code, descriptor, result
