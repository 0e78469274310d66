"""Supervisor process: forwards signals to the command, ends it after a grace time, and reports its crash.

Python runs the handler of a signal between two operations of its own. Compilation in LLVM and long calls of libraries are one operation
each. The parent process does nothing but wait, so it acts at once. It ends the child that is still at work after GRACE, and prints the
message for a child that crashed. The status of the child becomes its own.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import sys
import time

from ...lang import file_types

GRACE = 4.0  # seconds from a signal to the end of the command
WRITING = 20.0  # seconds in place of these, if the command is writing what it has
AGAIN = 1.0  # seconds from a second signal to the end of the command
APART = 0.3  # seconds between two signals that count as two; batch systems send one to a process and to its group
_TERMINAL = 0x80  # si_code of a signal that the terminal sends, to both processes
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
_INTERRUPTED = 130
_CRASHES = {
    "SIGSEGV": "an access outside of its memory", "SIGBUS": "an access outside of its memory", "SIGABRT": "a check that failed",
    "SIGFPE": "an impossible division", "SIGILL": "an instruction that this processor lacks",
}  # fmt: skip

_to_parent: int | None = None  # the end of a pipe, in the child


def supervise() -> None:
    """Return in a child process; this process waits for it and ends as it does. Returns at once where the system cannot do so."""
    global _to_parent
    if not hasattr(signal, "sigtimedwait"):  # Windows, macOS
        return
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    ends = {n for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) != signal.SIG_IGN}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*ends, signal.SIGCHLD})
    try:
        from_child, to_parent = os.pipe()
        parent, child = os.getpid(), os.fork()
    except OSError:  # a limit of processes or files
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return
    if child:
        os.close(to_parent)
        os.set_blocking(from_child, False)
        _wait(child, ends, from_child)
    os.close(from_child)
    _to_parent = to_parent
    end_with_parent(parent)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def finishing() -> None:
    """Tell the parent that the command writes what it has, so that it gets more time to end. Does nothing without a parent."""
    if _to_parent is not None:
        os.write(_to_parent, b"w")


def first_process() -> int:
    """The number of the process that the user started: the parent, if there is one."""
    return os.getpid() if _to_parent is None else os.getppid()


def end_with_parent(parent: int) -> None:
    """Let the system end this process with its parent, however that ends. Linux can do so; other systems do nothing."""
    import ctypes

    try:
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, int(signal.SIGKILL))
    except (OSError, AttributeError):  # a system without it
        return
    if os.getppid() != parent:
        os._exit(_INTERRUPTED)


def _wait(child: int, ends: set[signal.Signals], from_child: int) -> None:
    """Pass signals on, end a child that does not end, and exit as it does."""
    first, deadline, extended = 0.0, 0.0, False
    while True:
        timeout = max(0.0, deadline - time.monotonic()) if deadline else 3600.0
        info = signal.sigtimedwait({*ends, signal.SIGCHLD}, timeout)
        if info is not None and info.si_signo == signal.SIGCHLD:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                _exit_as(status, ended=first > 0.0)
        elif info is not None:
            now = time.monotonic()
            if info.si_code != _TERMINAL:
                os.kill(child, info.si_signo)
            if not first:
                first, deadline = now, now + GRACE
            elif now - first > APART:
                deadline = min(deadline, now + AGAIN)
                extended = True
        elif deadline and time.monotonic() >= deadline:
            if not extended and _is_writing(from_child):
                deadline, extended = first + WRITING, True
                continue
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os._exit(_INTERRUPTED)


def _is_writing(from_child: int) -> bool:
    """Whether the child has called `finishing`."""
    try:
        return bool(os.read(from_child, 4096))
    except BlockingIOError:
        return False


def _exit_as(status: int, ended: bool) -> None:
    """Exit with the status of a child, also with the signal that has ended it.

    Libraries may abort at an interrupt: a child that crashes after it was `ended` by the user was interrupted.
    """
    if os.WIFEXITED(status):
        os._exit(os.WEXITSTATUS(status))
    number = os.WTERMSIG(status)
    message = crash_message(number, sys.argv[1:])
    if message and ended:
        os._exit(_INTERRUPTED)
    if message:
        with contextlib.suppress(OSError):  # nobody reads it
            os.write(2, message.encode("utf-8", "surrogateescape"))
    _keep_no_core()
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
    os.kill(os.getpid(), number)
    os._exit(128 + number)


def _keep_no_core() -> None:
    """The child has left one, if wanted."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def crash_message(number: int, arguments: list[str]) -> str:
    """The message about a command that a signal has ended; "" for signals that users send."""
    name = signal.Signals(number).name if number in signal.valid_signals() else f"signal {number}"
    if name == "SIGKILL":
        return (
            "error: the system ended maquette (SIGKILL), as it does when memory is short\n"
            "  a smaller --size, or --memory with less than is free, takes less\n"
        )
    if name not in _CRASHES:
        return ""
    scene = next((each for each in arguments if each.lower().endswith(file_types.OPENED) and os.path.exists(each)), "")
    again = shlex.join(["maquette", *arguments])
    return (
        f"internal error: maquette crashed ({name}: {_CRASHES[name]})\n"
        "This is a bug in maquette, not an error in the scene. To report it, send\n"
        f"  the scene{f' {scene}' if scene else ''}, with the files that it reads\n"
        f"  the output of  MAQUETTE_CHECKED=1 {again}\n"
        "  the output of  maquette doctor\n"
        "MAQUETTE_CHECKED=1 names the line of a wrong access. It compiles kernels first, which takes minutes.\n"
    )

