"""seccomp: from now on this process makes only the system calls of a list (kernel documentation userspace-api/seccomp_filter).

The list has what a renderer needs: files, memory, threads, time, signals to itself. There are no programs, processes, sockets, changes
of permissions, times and attributes, nor memory that is shared with other processes. The filter holds for all threads, and cannot be
removed. It inspects arguments in registers alone: paths are Landlock's part.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Iterable, Iterator
from typing import NamedTuple

# names and numbers on x86-64 and aarch64; 0: there is none
_ALWAYS = """
read 0 63, write 1 64, readv 19 65, writev 20 66, pread64 17 67, pwrite64 18 68, preadv 295 69, pwritev 296 70, preadv2 327 286,
pwritev2 328 287, close 3 57, close_range 436 436, lseek 8 62, stat 4 0, fstat 5 80, lstat 6 0, newfstatat 262 79, statx 332 291,
access 21 0, faccessat 269 48, faccessat2 439 439, readlink 89 0, readlinkat 267 78, getcwd 79 17, getdents 78 0, getdents64 217 61,
statfs 137 43, fstatfs 138 44, mkdir 83 0, mkdirat 258 34, rmdir 84 0, unlink 87 0, unlinkat 263 35, rename 82 0, renameat 264 38,
renameat2 316 276, umask 95 166, memfd_create 319 279, flock 73 32, fsync 74 82, fdatasync 75 83, ftruncate 77 46, fallocate 285 47,
fadvise64 221 223, readahead 187 213, sync_file_range 277 84, sendfile 40 71, copy_file_range 326 285, pipe 22 0, pipe2 293 59,
dup 32 23, dup2 33 0, dup3 292 24, poll 7 0, ppoll 271 73, select 23 0, pselect6 270 72, epoll_create 213 0, epoll_create1 291 20,
epoll_ctl 233 21, epoll_wait 232 0, epoll_pwait 281 22, epoll_pwait2 441 441, eventfd 284 0, eventfd2 290 19,
mmap 9 222, munmap 11 215, mremap 25 216, mprotect 10 226, msync 26 227, madvise 28 233, mincore 27 232, mlock 149 228,
mlock2 325 284, munlock 150 229, brk 12 214, mbind 237 235, get_mempolicy 239 236, set_mempolicy 238 237, membarrier 324 283,
map_shadow_stack 453 453, mseal 462 462,
rt_sigaction 13 134, rt_sigprocmask 14 135, rt_sigreturn 15 139, rt_sigpending 127 136, rt_sigtimedwait 128 137,
rt_sigsuspend 130 133, sigaltstack 131 132, restart_syscall 219 128, pause 34 0, alarm 37 0, setitimer 38 103, getitimer 36 102,
timer_create 222 107, timer_settime 223 110, timer_gettime 224 108, timer_getoverrun 225 109, timer_delete 226 111,
sched_yield 24 124, sched_getaffinity 204 123, sched_getparam 143 121, sched_getscheduler 145 120, sched_get_priority_max 146 125,
sched_get_priority_min 147 126, getcpu 309 168, nanosleep 35 101, clock_nanosleep 230 115, clock_gettime 228 113,
clock_getres 229 114, gettimeofday 96 169, time 201 0, times 100 153, getrusage 98 165, getrlimit 97 163, sysinfo 99 179,
uname 63 160, getrandom 318 278, getpid 39 172, gettid 186 178, getppid 110 173, getpgrp 111 0, getpgid 121 155, getsid 124 156,
getuid 102 174, geteuid 107 175, getgid 104 176, getegid 108 177, getresuid 118 148, getresgid 120 150, getgroups 115 158,
futex 202 98, futex_waitv 449 449, futex_wake 454 454, futex_wait 455 455, futex_requeue 456 456, set_robust_list 273 99, rseq 334 293,
set_tid_address 218 96, arch_prctl 158 0, exit 60 93, exit_group 231 94, wait4 61 260, waitid 247 95
"""
_OPEN, _OPENAT, _IOCTL, _FCNTL, _PRCTL, _CLONE = (2, 0), (257, 56), (16, 29), (72, 25), (157, 167), (56, 220)
_KILL, _TGKILL, _PRLIMIT = (62, 129), (234, 131), (302, 261)
_FIRST_NEW = 424  # numbers from here on are the same everywhere, and the C library does without them where the system has none

_ARCHITECTURES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}  # column of the numbers above, AUDIT_ARCH
_X32 = 0x40000000  # bit of the numbers of x86-64's second interface
_ACCESS = 0x203  # of open: O_ACCMODE and O_TRUNC
_OPENS = (0, 1, 2, 0x201, 0x202)  # without an access mode of 3, and O_TRUNC of a file that is opened for reading
_IOCTLS = (0x5401, 0x802C542A, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)  # TCGETS, TCGETS2, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX
_SETFL, _ASYNC = 4, 0x2000  # fcntl's F_SETFL, O_ASYNC
_FCNTLS = (0, 1, 2, 3, 5, 6, 7, 36, 37, 38, 1030, 1031, 1032, 1033, 1034)  # duplicates, flags, locks, sizes of pipes, seals
_PRCTLS = (15, 16, 51, 56, 0x53564D41)  # PR_SET_NAME, PR_GET_NAME, PR_SVE_GET_VL, PR_GET_TAGGED_ADDR_CTRL, PR_SET_VMA
_CLONE_THREAD, _CLONE_NEW = 0x00010000, 0x7E020080  # a thread of this process; new namespaces

_LOAD, _AND, _EQUAL, _ABOVE, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x54, 0x15, 0x25, 0x35, 0x45, 0x06  # BPF
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
_ALLOW, _ERRNO, _KILL_PROCESS = 0x7FFF0000, 0x00050000, 0x80000000
_SET_MODE_FILTER, _TSYNC, _GET_ACTION_AVAIL = 1, 1, 2
_SECCOMP = (317, 277)


class Step(NamedTuple):
    """One BPF instruction. A jump skips `yes` or `no` instructions."""

    code: int
    value: int
    yes: int = 0
    no: int = 0


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_char_p))


def missing() -> str:
    """Why this system cannot filter system calls; "" where it can."""
    if platform.machine() not in _ARCHITECTURES or sys.maxsize < 1 << 32 or not sys.platform.startswith("linux"):
        return f"system calls can be filtered on Linux on x86-64 and aarch64, and not on {platform.system()} on {platform.machine()}"
    action = ctypes.c_uint32(_KILL_PROCESS)
    column, _ = _ARCHITECTURES[platform.machine()]
    if ctypes.CDLL(None, use_errno=True).syscall(_SECCOMP[column], _GET_ACTION_AVAIL, 0, ctypes.byref(action)):
        return f"this system does not filter system calls (seccomp: {os.strerror(ctypes.get_errno())}), which Linux 4.14 or newer does"
    return ""


def restrict() -> None:
    """Forbid all system calls that are not in the list, to all threads. Raises OSError.

    The process has given up new privileges, as landlock.restrict does.
    """
    if why := missing():
        raise OSError(why)
    column, _ = _ARCHITECTURES[platform.machine()]
    steps = list(program(platform.machine(), os.getpid()))
    packed = b"".join(struct.pack("HBBI", step.code, step.yes, step.no, step.value) for step in steps)
    loaded = _Program(len(steps), packed)
    libc = ctypes.CDLL(None, use_errno=True)
    failed = libc.syscall(_SECCOMP[column], _SET_MODE_FILTER, _TSYNC, ctypes.byref(loaded))
    if failed:
        raise OSError(f"cannot filter system calls: {os.strerror(ctypes.get_errno()) if failed < 0 else 'a thread has another filter'}")


def program(machine: str, process: int) -> Iterator[Step]:
    """The filter for a machine (platform.machine()) and the process with a number, which may send signals to itself."""
    column, architecture = _ARCHITECTURES[machine]
    yield Step(_LOAD, _ARCHITECTURE)
    yield Step(_EQUAL, architecture, 1, 0)
    yield Step(_RETURN, _KILL_PROCESS)
    yield Step(_LOAD, _NUMBER)
    if column == 0:
        yield from (Step(_AT_LEAST, _X32, 0, 1), _refuse(errno.ENOSYS))
    for first, last in _ranges(_numbers(column)):
        yield from (Step(_AT_LEAST, first, 0, 2), Step(_ABOVE, last, 1, 0), Step(_RETURN, _ALLOW))
    yield from _call(_OPEN[column], _among(1, _OPENS, mask=_ACCESS))
    yield from _call(_OPENAT[column], _among(2, _OPENS, mask=_ACCESS))
    yield from _call(_IOCTL[column], _among(1, _IOCTLS, errno.ENOTTY))
    yield from _call(_FCNTL[column], _flags_or_among())
    yield from _call(_PRCTL[column], _among(0, _PRCTLS))
    yield from _call(_PRLIMIT[column], _among(0, (0, process)))
    yield from _call(_KILL[column], _among(0, (process,)))
    yield from _call(_TGKILL[column], _among(0, (process,)))
    yield from _call(_CLONE[column], _threads())
    yield from (Step(_AT_LEAST, _FIRST_NEW, 0, 1), _refuse(errno.ENOSYS), _refuse(errno.EPERM))


def _numbers(column: int) -> set[int]:
    numbers = {int(words.split()[1 + column]) for words in _ALWAYS.split(",")}
    return numbers if column == 0 else numbers - {0}  # 0 is `read` on x86-64, and stands for none in the other column


def _ranges(numbers: Iterable[int]) -> Iterator[tuple[int, int]]:
    """The first and last of consecutive numbers."""
    ordered = sorted(numbers)
    first = last = ordered[0]
    for number in ordered[1:]:
        if number != last + 1:
            yield first, last
            first = number
        last = number
    yield first, last


def _call(number: int, steps: list[Step]) -> list[Step]:
    """Steps for one system call, all of whose ways end with a return."""
    return [Step(_EQUAL, number, 0, len(steps)), *steps] if number else []


def _among(argument: int, values: tuple[int, ...], refusal: int = errno.EPERM, mask: int = 0) -> list[Step]:
    """Allow a call whose argument is one of some values. The system reads the lower 32 bits of these arguments, as this does."""
    masked = [Step(_AND, mask)] if mask else []
    tests = [Step(_EQUAL, value, len(values) - k, 0) for k, value in enumerate(values)]
    return [Step(_LOAD, _ARGUMENTS + 8 * argument), *masked, *tests, _refuse(refusal), Step(_RETURN, _ALLOW)]


def _flags_or_among() -> list[Step]:
    """Allow fcntl of some kinds, and F_SETFL without O_ASYNC: a terminal would send SIGIO to its foreground processes."""
    set_flags = [Step(_LOAD, _ARGUMENTS + 16), Step(_ANY_BIT, _ASYNC, 0, 1), _refuse(errno.EPERM), Step(_RETURN, _ALLOW)]
    return [Step(_LOAD, _ARGUMENTS + 8), Step(_EQUAL, _SETFL, 0, len(set_flags)), *set_flags, *_among(1, _FCNTLS)]


def _threads() -> list[Step]:
    """Allow clone for threads of this process, without new namespaces."""
    flags = Step(_LOAD, _ARGUMENTS)
    return [flags, Step(_ANY_BIT, _CLONE_THREAD, 0, 1), Step(_ANY_BIT, _CLONE_NEW, 0, 1), _refuse(errno.EPERM), Step(_RETURN, _ALLOW)]


def _refuse(code: int) -> Step:
    return Step(_RETURN, _ERRNO | code)
