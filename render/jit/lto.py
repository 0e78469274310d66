"""Link-time optimization: helpers stay LLVM fragments, optimized and emitted only as parts of the kernels that call them.

Numba optimizes and emits each function with its callees, and again as a part of each caller. With seven levels of helpers, most of a
kernel's compile time goes into code that never runs.
"""

from __future__ import annotations

import inspect
import json
from contextlib import suppress
from functools import cache
from inspect import iscode
from operator import attrgetter
from typing import Any, NamedTuple

from llvmlite import binding
from numba import _dynfunc  # pyright: ignore[reportAttributeAccessIssue]
from numba.core import cgutils
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, compile_result
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.environment import Environment
from numba.core.funcdesc import FunctionDescriptor
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import signature
from numba.core.untyped_passes import ExtractByteCode
from numba.core.utils import _dynamic_modname

from . import fragments
from .cache_key import NoDigest, digest_of_function
from .numba_types import UnknownType, from_plain, to_plain
from .package_sources import digest


class _Library(JITCodeLibrary):
    """Code that is only linked into other libraries: an unoptimized module and its callees."""

    key = ""  # of a fragment that is kept on disk
    symbol = ""  # of the function of such a fragment
    separate = False  # a fragment that is emitted apart from its callers

    def __init__(self, codegen: Any, name: str) -> None:
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries: list[Any] = []
        self._final_module: Any = None
        self._shared_module: Any = None

    def add_ir_module(self, ir_module: Any) -> None:
        module = binding.parse_assembly(cgutils.normalize_ir_text(str(ir_module)))
        module.data_layout = self._codegen._data_layout
        passes, builder = _passes(self._codegen)
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)
        if self._final_module is None:
            self._final_module = module
        else:
            self._final_module.link_in(module)

    def finalize(self) -> None:
        self._finalized = True

    def module(self) -> Any:
        """The module without its callees."""
        return self._final_module

    def callees(self) -> list[Any]:
        """The libraries of the functions that it calls."""
        return self._linking_libraries

    def _get_module_for_linking(self) -> Any:
        """The module with its callees, for libraries other than `Whole`."""
        if self._shared_module is None:
            module = self._shared_module = binding.parse_assembly("")
            module.name, module.triple, module.data_layout = self.name, self._final_module.triple, self._codegen._data_layout
            _link(module, [self], with_separate=True)
        return self._shared_module


class _Stored(_Library):
    """A fragment that was compiled before."""

    def __init__(self, codegen: Any, fragment: fragments.Fragment) -> None:
        super().__init__(codegen, fragment.symbol)
        self.fragment, self.key, self._finalized = fragment, fragment.key, True
        self.symbol, self.separate = fragment.symbol, fragment.separate

    def module(self) -> Any:
        if self._final_module is None:
            self._final_module = binding.parse_bitcode(self.fragment.code)
        return self._final_module

    def callees(self) -> list[Any]:
        return [_Stored(self._codegen, each) for each in fragments.STORE.callees(self.fragment)]


@cache
def _passes(codegen: Any) -> tuple[Any, Any]:
    """Function passes that simplify a fragment before it is linked."""
    return codegen._function_pass_manager()


class Linked(NamedTuple):
    """The functions that a linked and optimized module declares only, without LLVM's intrinsics."""

    undefined: tuple[str, ...]  # names of those that the process defines
    separate: list[_Library]  # separate fragments


class Whole(JITCodeLibrary):
    """Code of a kernel, with every fragment linked into it once, but for separate ones."""

    linked = Linked((), [])

    def link(self) -> None:
        """Link all fragments into the module and optimize it."""
        libraries, self._linking_libraries = self._linking_libraries, []
        self.linked = _build(self._codegen, self._final_module, libraries)
        self._verify_declare_only_symbols()
        self._finalized = True

    def emit(self) -> bytes:
        """Link, optimize and return object code."""
        self.link()
        return self._codegen._tm.emit_object(self._final_module)


def emit_separately(library: _Library) -> tuple[bytes, Linked]:
    """The object code of a fragment, with all that it calls but separate fragments."""
    module = binding.parse_bitcode(library.module().as_bitcode())
    linked = _build(library.codegen, module, library.callees())
    return library.codegen._tm.emit_object(module), linked


def _build(codegen: Any, module: Any, libraries: list[Any]) -> Linked:
    """Link libraries into a module and optimize it.

    All fragments are inlined first, before stack lifetime markers exist: helpers return parts of their stack memory.
    """
    separate = {library.symbol: library for library in _link(module, libraries)}
    _define_allocation(module)
    for options in ({"opt": 0, "cost": "cheap", "slp_vectorize": False}, {}):
        passes, builder = codegen._module_pass_manager(**options)
        passes.run(module, builder)
    module.verify()
    declared = {each.name for part in (module.functions, module.global_variables) for each in part if each.is_declaration}
    undefined = sorted(name for name in declared - separate.keys() if not name.startswith("llvm."))
    return Linked(tuple(undefined), [library for name, library in separate.items() if name in declared])


def _link(module: Any, libraries: list[Any], with_separate: bool = False) -> list[_Library]:
    """Link libraries and their callees into a module; only called functions stay. Return the separate fragments.

    These are linked only `with_separate`. Linkage changes after linking: LLVM does not link discardable functions that are not called yet.
    """
    defined = {function.name for function in module.functions if not function.is_declaration}
    linked, separate, foreign = dict[Any, _Library](), dict[str, _Library](), dict[Any, None]()
    todo = list(reversed(libraries))
    while todo:
        library = todo.pop()
        if not isinstance(library, _Library):
            foreign[library] = None
        elif library.separate and not with_separate:
            separate[library.key] = library
        elif (library.key or library) not in linked:
            linked[library.key or library] = library
            todo += reversed(library.callees())
    for library in linked.values():
        module.link_in(library.module(), preserve=True)
    for function in module.functions:
        if not function.is_declaration and function.name not in defined:
            function.linkage = "linkonce_odr"
    for library in foreign:
        module.link_in(library._get_module_for_linking(), preserve=True)
    return list(separate.values())


# Numba's reference-counted memory without its library, which a process that only loads kernels does not have. Its structure is
# {reference count, destructor, its argument, data, size}.
_ALLOCATION = """
declare ptr @malloc(i64)
declare void @free(ptr)

define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %step = zext i32 %align to i64
  %room = add i64 %size, 40
  %total = add i64 %room, %step
  %block = call ptr @malloc(i64 %total)
  %none = icmp eq ptr %block, null
  br i1 %none, label %done, label %fill
fill:
  %head = ptrtoint ptr %block to i64
  %behind = add i64 %head, 40
  %last = sub i64 %step, 1
  %up = add i64 %behind, %last
  %rest = urem i64 %up, %step
  %start = sub i64 %up, %rest
  store i64 1, ptr %block
  %destructor = getelementptr i64, ptr %block, i64 1
  store i64 0, ptr %destructor
  %argument = getelementptr i64, ptr %block, i64 2
  store i64 0, ptr %argument
  %data = getelementptr i64, ptr %block, i64 3
  store i64 %start, ptr %data
  %bytes = getelementptr i64, ptr %block, i64 4
  store i64 %size, ptr %bytes
  br label %done
done:
  ret ptr %block
}

define void @NRT_MemInfo_call_dtor(ptr %block) {
  call void @free(ptr %block)
  ret void
}
"""


def _define_allocation(module: Any) -> None:
    """Define the functions of _ALLOCATION in a module that declares them."""
    names = ("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor")
    if not any(function.name in names and function.is_declaration for function in module.functions):
        return
    module.link_in(binding.parse_assembly(_ALLOCATION))
    for name in names:
        module.get_function(name).linkage = "internal"


@register_pass(mutates_CFG=False, analysis_only=True)
class _Register(LoweringPass):
    """Register a fragment for its callers as a function without machine code."""

    _name = "register_fragment"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        lowered = state["cr"]
        described = lowered.fndesc
        name = described.qualname.split(".")[-1]
        code = state["library"]
        function = _dynfunc.make_function(described.lookup_module(), name, "a fragment", 0, lowered.env, (code,))
        state.targetctx.insert_user_function(function, described, [code])
        state["cr"] = lowered._replace(cfunc=function)
        return True


_UNUSED_PASSES = {
    "with_lifting", "rewrite_dynamic_raises", "inline_inlinables", "find_literally", "literal_unroll", "literal_propagation",
    "inline_overloads", "nopython_rewrites", "nopython_supported_feature_validation", "annotate_types", "dump_parfor_diagnostics",
}  # fmt: skip
"""Passes for constructs that fragments do not contain: array expressions, `with` blocks, literal loop unrolling."""
_CLOSURE_PASSES = {"inline_closure_likes", "make_function_op_code_to_jit_function"}


class _FragmentPasses(PassManager):
    """Passes that run without Numba's events, timers and checks of their results."""

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        for step in (pss.run_initialization, pss.run_pass, pss.run_finalizer):
            step(internal_state)


_used = set[str]()  # keys of the fragments that this process has compiled


class Fragment(CompilerBase):
    """Numba's pipeline without the unused passes and without code emission. Fragments on disk are not compiled again."""

    separate = False

    def compile_extra(self, func: Any) -> Any:
        """Compile a helper, or take it from fragments.py."""
        key = _key_of(func, self.state.args, self.state.flags, self.separate)
        stored = fragments.STORE.find(key) if key is not None else None
        if stored is not None:
            return self._take(func, stored)
        identity: Any = FunctionIdentity.from_function(func)
        self.state.func_id = identity
        if key in _used:  # it could not be kept: this is another copy with another symbol
            key = None
        if key is not None:
            _used.add(key)
            identity.unique_id = key
        ExtractByteCode().run_pass(self.state)
        self.state.lifted, self.state.lifted_from = (), None
        result = self._compile_bytecode()
        if key is not None:
            _keep(key, result, self.separate)
        return result

    def _take(self, func: Any, fragment: fragments.Fragment) -> Any:
        """A stored fragment as the result of a compilation."""
        context, kinds, flags = self.state.targetctx, self.state.args, self.state.flags
        kind, library = from_plain(fragment.result), _Stored(context.codegen(), fragment)
        names = tuple(inspect.signature(func).parameters)
        described = FunctionDescriptor(
            True, func.__module__ or _dynamic_modname, func.__qualname__, fragment.symbol, "", None, kind, None, names, (),
            lambda *_, **__: fragment.symbol, kinds, flags.forceinline, flags.noalias, f"env.{fragment.symbol}", func.__globals__,
        )  # fmt: skip
        environment = Environment.from_fndesc(described)
        function = _dynfunc.make_function(described.lookup_module(), func.__name__, "a fragment", 0, environment, (library,))
        context.insert_user_function(function, described, [library])
        return compile_result(
            typing_context=self.state.typingctx, target_context=context, entry_point=function, signature=signature(kind, *kinds),
            objectmode=False, lifted=(), fndesc=described, library=library, environment=environment, metadata={}, reload_init=[],
        )  # fmt: skip

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_compile = True
        self.state["library"] = _Library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        has_closures = any(map(iscode, self.state.func_id.code.co_consts))
        idle = _UNUSED_PASSES if has_closures else _UNUSED_PASSES | _CLOSURE_PASSES
        passes: Any = _FragmentPasses("fragment")
        passes.passes = [each for each in DefaultPassBuilder.define_nopython_pipeline(self.state).passes if each[0].name() not in idle]
        passes.add_pass_after(_Register, NativeLowering)
        passes.finalize()
        return [passes]


class SeparateFragment(Fragment):
    """A fragment that is emitted apart from its callers, if it is kept on disk."""

    separate = True


def _key_of(function: Any, kinds: tuple[Any, ...], flags: Any, separate: bool) -> str | None:
    """The key of a fragment for arguments of these types; None where it depends on more than definitions and types."""
    try:
        options = f"{flags.forceinline} {flags.nrt} {separate}"
        return digest(f"{digest_of_function(function)} {options} {json.dumps(list(map(to_plain, kinds)))}")
    except (NoDigest, UnknownType):
        return None


def _keep(key: str, result: Any, separate: bool) -> None:
    """Keep a compiled fragment, unless it calls one that is not kept, or a file cannot describe its result."""
    library, kind = attrgetter("library", "signature.return_type")(result)
    calls = [each.key for each in library.callees() if isinstance(each, _Library)]
    with suppress(UnknownType):
        result_type = to_plain(kind)
        if all(calls) and from_plain(result_type) == kind:
            symbol = result.fndesc.llvm_func_name
            fragments.STORE.add(fragments.Fragment(key, symbol, result_type, tuple(calls), separate, _own_code(library)))
            library.key, library.symbol, library.separate = key, symbol, separate


def _own_code(library: _Library) -> bytes:
    """The bitcode of a fragment, with the functions of Numba that it calls. Each kernel links those of allocation."""
    code = library.module().as_bitcode()
    others = [each for each in library.callees() if not isinstance(each, _Library) and each.name != "nrt"]
    if not others:
        return code
    module = binding.parse_bitcode(code)
    defined = {function.name for function in module.functions if not function.is_declaration}
    for each in others:
        module.link_in(each._get_module_for_linking(), preserve=True)
    for function in module.functions:
        if not function.is_declaration and function.name not in defined:
            function.linkage = "internal"
    return module.as_bitcode()


class Kernel(CompilerBase):
    """Numba's pipeline with a library that links each fragment once, without code emission."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_compile = True
        self.state["library"] = Whole(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]
