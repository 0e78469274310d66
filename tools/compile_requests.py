"""Compiles recorded kernels for the target of MAQUETTE_SIMD, which this machine need not run. Argument: the folder of the lists."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from maquette.render.formula import interpreter
from maquette.render.formula.op_codegen import WIDTHS
from maquette.render.jit import compile_process, kernel_cache, requests


def main() -> None:
    for request in requests.recorded(Path(sys.argv[1])):
        for module in request.loaded:
            import_module(module)
        kernel = compile_process.find_kernel(import_module(request.module), request.function)
        kernel_cache.compile_only(kernel, request.kinds)
        print(f"{request.module}.{request.function}", flush=True)
    for program in (*WIDTHS, interpreter.POINT):
        interpreter.code_of(program)


if __name__ == "__main__":
    main()
