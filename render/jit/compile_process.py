"""Kernels compiled by a process beside this one, which compiles others meanwhile: the first picture waits less for them.

Compiling is Python, of which threads run one at a time. The other process puts a kernel on disk. Who needs it here waits until it is
there, and compiles it where that process ended without.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from importlib import import_module
from typing import Any

import numba
from numba import types

from ..simd import target
from . import function_pointer, kernel

_BEGIN = "import importlib, pickle, sys; sys.path[:], name = pickle.load(sys.stdin.buffer); importlib.import_module(name).serve()"
_PACKAGE = __name__.partition(".")[0]

Key = tuple[Any, tuple[types.Type, ...]]
_under_way: dict[Key, subprocess.Popen[bytes]] = {}
_called: list[subprocess.Popen[bytes]] = []


def compile_in_background(threads: int, made: Any, *given: Any) -> None:
    """Let another process compile a kernel for Numba types, or for values of them, unless it is known or `threads` (0: all) leave no room.

    Worth it where this process has as much to compile before it needs that kernel.
    """
    for key in [key for key, process in _under_way.items() if process.poll() is not None]:
        _close(_under_way.pop(key))
    if len(_under_way) >= _room(threads):
        return
    kinds = tuple(each if isinstance(each, types.Type) else numba.typeof(each) for each in given)
    if (made.py_func, kinds) not in _under_way and not kernel.is_cached(made, kinds) and os.access(kernel.CACHE, os.W_OK):
        loaded = [name for name in list(sys.modules) if name.partition(".")[0] == _PACKAGE and name != "__main__"]
        process = _asked(made.py_func, True, kinds, loaded)
        if process is not None:
            _under_way[made.py_func, kinds] = process


def run_in_background(threads: int, function: Any, *given: Any) -> None:
    """Let another process call a function that puts something on disk which this one makes, too, unless `threads` leave no room."""
    _called[:] = [process for process in _called if process.poll() is None]
    if _room(threads) and os.access(kernel.CACHE, os.W_OK):
        process = _asked(function, False, given, [])
        if process is not None:
            _called.append(process)


def _room(threads: int) -> int:
    """How many processes there may be beside this one."""
    return min(threads or target.cores(), target.cores()) - 1 if sys.executable else 0


def _asked(function: Any, compiles: bool, given: tuple[Any, ...], loaded: list[str]) -> subprocess.Popen[bytes] | None:
    """A process that compiles a kernel for types, or calls a function with what is given; None where none can be started."""
    wanted = str(kernel.CACHE), loaded, function.__module__, function.__qualname__, compiles, given
    try:
        quiet = subprocess.DEVNULL
        process = subprocess.Popen([sys.executable, "-c", _BEGIN], stdin=subprocess.PIPE, stdout=quiet, stderr=quiet)
    except OSError:
        return None
    assert process.stdin is not None
    try:
        process.stdin.write(pickle.dumps((sys.path, __name__)) + pickle.dumps(wanted))
        process.stdin.flush()  # and stays open: where this process ends, the other one sees its end
    except OSError:  # it could not begin
        process.kill()
        _close(process)
        return None
    return process


def wait(function: Any, kinds: Any) -> None:
    """Wait until the other process has compiled a kernel, if one is about to."""
    process = _under_way.pop((function, kinds), None) if _under_way else None
    if process is not None:
        process.wait()
        _close(process)


def _close(process: subprocess.Popen[bytes]) -> None:
    try:
        if process.stdin is not None:
            process.stdin.close()
    except OSError:
        pass  # it ended before it had read all


def serve() -> None:
    """Do what standard input tells of, as that process; it ends with the one that asked."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is for both, and the other one is the one to end
    cache, loaded, module, name, compiles, given = pickle.load(sys.stdin.buffer)

    def watch() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    for each in loaded:  # overloads of what kernels call stand in modules that they need not name
        import_module(each)
    if cache == str(kernel.CACHE):
        found = import_module(module)
        _named(found, name).compile(given) if compiles else getattr(found, name)(*given)
    os._exit(0)


def _named(module: Any, name: str) -> Any:
    """The kernel of a function: it has its name, or is linked (links.Linked), and the function has."""
    found = getattr(module, name)
    if hasattr(found, "py_func"):
        return found
    return next(
        each.kernel for each in vars(module).values() if isinstance(each, function_pointer.KernelPointer) and each.kernel.py_func is found
    )


kernel.CACHE_LOOKUP_HOOKS.append(wait)
