"""How helpers compile: as fragments, which are optimized and turned into machine code only as parts of the kernels that call them.

Numba optimizes each function with all it calls and emits it, before a caller takes its code in and does so again: at seven levels
of helpers most of a kernel's compile time goes into code that never runs.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc  # pyright: ignore[reportAttributeAccessIssue]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import NativeLowering


class _Library(JITCodeLibrary):
    """Code that becomes part of other libraries only."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=True)
class _Register(LoweringPass):
    """Make a fragment known to its callers, under a name of its own: a function without code."""

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


class Fragment(CompilerBase):
    """Numba's usual passes, without the end."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_compile = True
        self.state["library"] = _Library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Register, NativeLowering)
        passes.finalize()
        return [passes]
