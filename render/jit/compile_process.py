"""Compiles kernels in a second process, so that the first picture waits less.

Compilation is Python code, which does not run in parallel threads. The second process writes a kernel to the disk cache. A caller of that
kernel waits for it, and compiles the kernel itself if the process ends without. A request is plain data in a pipe: names and types in
JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from importlib import import_module
from typing import Any

from ...compiler.io import child_process
from ..simd import target
from . import compile_events, function_pointer, kernel_cache
from .kernel import Kernel
from .value_types import ValueType, from_plain, typeof

_BEGIN = f"from {__name__} import serve\nserve()"
_PACKAGE = __name__.partition(".")[0]

Key = tuple[Any, tuple[ValueType, ...]]
_compiling: dict[Key, subprocess.Popen[bytes]] = {}
_running: list[subprocess.Popen[bytes]] = []


def compile_in_background(threads: int, kernel: Kernel, *arguments: Any) -> None:
    """Compile a kernel in another process for types, or for the types of values.

    Does nothing if the kernel is cached or `threads` (0: all) are busy. It pays if this process compiles as long before it needs the
    kernel.
    """
    if kernel_cache.must_be_compiled():
        return
    for key in [key for key, process in _compiling.items() if process.poll() is not None]:
        _close(_compiling.pop(key))
    if len(_compiling) >= _max_processes(threads):
        return
    kinds = tuple(each if isinstance(each, ValueType) else typeof(each) for each in arguments)
    key = (kernel.py_func, kinds)
    if key not in _compiling and not kernel_cache.is_cached(kernel, kinds) and os.access(kernel_cache.CACHE, os.W_OK):
        loaded = [name for name in list(sys.modules) if name.partition(".")[0] == _PACKAGE and name != "__main__"]
        process = _start(kernel.py_func, True, [kind.plain for kind in kinds], loaded)
        if process is not None:
            _compiling[key] = process


def run_in_background(threads: int, function: Any, *arguments: Any) -> None:
    """Call a function in another process that writes files which this process would write otherwise, unless `threads` are busy.

    The arguments are numbers, strings and lists of them.
    """
    _running[:] = [process for process in _running if process.poll() is None]
    if _max_processes(threads) and os.access(kernel_cache.CACHE, os.W_OK):
        process = _start(function, False, list(arguments), [])
        if process is not None:
            _running.append(process)


def _max_processes(threads: int) -> int:
    """Largest number of processes beside this one."""
    return min(threads or target.cores(), target.cores()) - 1 if sys.executable else 0


def _start(function: Any, compiles: bool, arguments: list[Any], loaded: list[str]) -> subprocess.Popen[bytes] | None:
    """Start a process that compiles a kernel for types, or calls a function; None if it does not start."""
    request = str(kernel_cache.CACHE), loaded, function.__module__, function.__qualname__, compiles, arguments
    try:
        quiet = subprocess.DEVNULL
        process = child_process.start(child_process.python(_BEGIN), stdin=subprocess.PIPE, stdout=quiet, stderr=quiet)
    except OSError:
        return None
    assert process.stdin is not None
    try:
        process.stdin.write(f"{json.dumps(request)}\n".encode())
        process.stdin.flush()  # stays open: its end tells the other process that this one has ended
    except OSError:  # the process failed to start
        process.kill()
        _close(process)
        return None
    return process


def wait(function: Any, kinds: Any) -> None:
    """Wait for the process that compiles a kernel, if there is one."""
    process = _compiling.pop((function, kinds), None) if _compiling else None
    if process is not None:
        if process.poll() is None:
            with compile_events.compiling(f"{function.__module__.partition('.')[2]}~{function.__qualname__}"):
                process.wait()
        _close(process)


def _close(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(OSError):  # the process ended before it had read all
        if process.stdin is not None:
            process.stdin.close()


def serve() -> None:
    """Main function of the second process: execute the request on standard input. It ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both processes; the parent handles it
    cache, loaded, module, name, compiles, arguments = json.loads(sys.stdin.buffer.readline())

    def watch() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    for each in loaded:  # kernels may call overloads from modules that theirs do not import
        import_module(each)
    if cache == str(kernel_cache.CACHE):
        owner = import_module(module)
        if compiles:
            find_kernel(owner, name).load(tuple(map(from_plain, arguments)))
        else:
            getattr(owner, name)(*arguments)
    os._exit(0)


def find_kernel(module: Any, name: str) -> Kernel:
    """The kernel of a function name: the attribute itself, or the kernel of the KernelPointer made of that function."""
    value = getattr(module, name)
    if isinstance(value, Kernel):
        return value
    pointers = (each for each in vars(module).values() if isinstance(each, function_pointer.KernelPointer))
    return next(each.kernel for each in pointers if each.kernel.py_func is value)


kernel_cache.LOOKUP_HOOKS.append(wait)
