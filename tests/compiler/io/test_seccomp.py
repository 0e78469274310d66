"""The filter of system calls, as the system runs it, for machines that this one need not be."""

from __future__ import annotations

import errno
import re
from pathlib import Path

import pytest
from maquette.compiler.io import seccomp

OWN = 1234  # the process
AUDIT = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
ALLOWED, REFUSED, NEW, KILLED = 0x7FFF0000, 0x50000 | errno.EPERM, 0x50000 | errno.ENOSYS, 0x80000000
NO_TERMINAL = 0x50000 | errno.ENOTTY
THREAD = 0x3D0F00  # the flags that the C library starts threads with


def verdict(machine: str, number: int, *arguments: int, audit: int | None = None) -> int:
    """What the filter returns (linux/filter.h, linux/seccomp.h)."""
    words = {0: number & 0xFFFFFFFF, 4: AUDIT[machine] if audit is None else audit}
    words |= {16 + 8 * k: value & 0xFFFFFFFF for k, value in enumerate(arguments)}
    steps, at, value = list(seccomp.program(machine, OWN)), 0, 0
    assert len(steps) < 4096
    while True:
        step = steps[at]
        at += 1
        if step.code == 0x06:
            return step.value
        if step.code == 0x20:
            value = words.get(step.value, 0)
        elif step.code == 0x54:
            value &= step.value
        else:
            test = {0x15: value == step.value, 0x25: value > step.value, 0x35: value >= step.value, 0x45: bool(value & step.value)}
            at += step.yes if test[step.code] else step.no


@pytest.mark.parametrize(
    ("x86", "aarch64", "arguments", "expected"),
    [
        (0, 63, (), ALLOWED),  # read
        (231, 94, (), ALLOWED),  # exit_group
        (202, 98, (), ALLOWED),  # futex
        (56, 220, (THREAD,), ALLOWED),  # clone
        (56, 220, (17,), REFUSED),
        (56, 220, (THREAD | 0x10000000,), REFUSED),
        (435, 435, (), NEW),  # clone3
        (59, 221, (), REFUSED),  # execve
        (322, 281, (), REFUSED),  # execveat
        (41, 198, (), REFUSED),  # socket
        (206, 0, (), REFUSED),  # io_setup
        (425, 425, (), NEW),  # io_uring_setup
        (62, 129, (OWN,), ALLOWED),  # kill
        (62, 129, (OWN + (1 << 32),), ALLOWED),  # the system reads 32 bits
        (62, 129, (-1,), REFUSED),
        (62, 129, (0,), REFUSED),
        (234, 131, (OWN, 7), ALLOWED),  # tgkill
        (234, 131, (OWN + 1, 7), REFUSED),
        (257, 56, (0, 0, 0o100 | 0o1000 | 2), ALLOWED),  # openat: O_CREAT, O_TRUNC, O_RDWR
        (257, 56, (0, 0, 0o1000), REFUSED),
        (257, 56, (0, 0, 3), REFUSED),
        (16, 29, (0, 0x5401), ALLOWED),  # ioctl: TCGETS
        (16, 29, (0, 0x5412), NO_TERMINAL),  # TIOCSTI
        (16, 29, (0, 0x5412 + (1 << 32)), NO_TERMINAL),
        (72, 25, (0, 4, 0o4000), ALLOWED),  # fcntl: F_SETFL, O_NONBLOCK
        (72, 25, (0, 4, 0o20000), REFUSED),
        (72, 25, (0, 8, OWN + 1), REFUSED),
        (302, 261, (0,), ALLOWED),  # prlimit64
        (302, 261, (1,), REFUSED),
        (90, 52, (), REFUSED),  # chmod; fchmod
        (999, 999, (), NEW),
    ],
)
def test_calls(x86: int, aarch64: int, arguments: tuple[int, ...], expected: int) -> None:
    assert verdict("x86_64", x86, *arguments) == expected
    assert verdict("aarch64", aarch64, *arguments) == expected


def test_other_interfaces_of_the_processor() -> None:
    """Those of 32 bits and of x32 have other numbers."""
    assert verdict("x86_64", 20, audit=0x40000003) == KILLED
    assert verdict("x86_64", 0x40000000 + 39) == NEW
    assert verdict("aarch64", 20, audit=0x40000028) == KILLED


@pytest.mark.long
@pytest.mark.skipif(not Path("/usr/include/asm-generic/unistd.h").is_file(), reason="this system has no headers of Linux")
def test_no_call_of_another_name_is_allowed() -> None:
    """By the kernel's header for aarch64."""
    text = Path("/usr/include/asm-generic/unistd.h").read_text(encoding="utf-8")
    names = {int(number): name for name, number in re.findall(r"#define __NR(?:3264)?_(\w+) (\d+)\b", text)}
    allowed = {names.get(number, "") for number in range(600) if verdict("aarch64", number) == ALLOWED}
    parts = "exec sock ptrace mount chmod chown xattr utime symlink mknod shm msg sem keyctl bpf module kexec setns unshare uring process_"
    assert {name for name in allowed if any(part in name for part in parts.split())} - {"msync"} == set()
    assert not allowed & {"linkat", "truncate", "chroot", "setuid", "connect", "bind", "reboot", "personality", "pidfd_open"}
    assert {"read", "write", "mmap", "futex", "exit_group", "clock_gettime", "unlinkat", "renameat2"} <= allowed
