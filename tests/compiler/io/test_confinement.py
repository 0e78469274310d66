"""A confined process opens the files it may and no others, makes no system calls but those it needs, and takes no more memory."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from maquette.compiler.io import landlock, seccomp, unlinked_paths

pytestmark = pytest.mark.skipif(not landlock.version() or bool(seccomp.missing()), reason="this system confines no processes")
BEGIN = """
import ctypes, fcntl, json, mmap, os, resource, signal, socket, subprocess, sys, tempfile, termios, threading
from pathlib import Path
from maquette.compiler.io import confinement
folder = Path(FOLDER)
"""
CONFINE = """
confinement.confine([folder / "read"], [folder / "write"], MEMORY)
X86 = os.uname().machine == "x86_64"
libc = ctypes.CDLL(None, use_errno=True)
def call(number, *arguments):
    if libc.syscall(ctypes.c_long(number), *(ctypes.c_long(each) for each in arguments)) < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
"""


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    for name in ("read", "write", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.txt").write_text(name, encoding="utf-8")
    return tmp_path


def process(folder: Path, program: str, **more: object) -> subprocess.CompletedProcess[str]:
    text = program.replace("FOLDER", repr(str(folder)))
    return subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60, cwd=folder, **more)  # type: ignore[call-overload]


def confined(folder: Path, program: str, memory: str = "None", before: str = "") -> str:
    """What a confined process prints; the name of the exception where one is raised."""
    body = textwrap.indent(textwrap.dedent(program), "    ")
    caught = "except BaseException as error:\n    print(type(error).__name__)\n"
    done = process(folder, f"{BEGIN}{before}{CONFINE.replace('MEMORY', memory)}\ntry:\n{body}\n{caught}")
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What each program of PROGRAMS does in one confined process: what it returns, or the name of its exception."""
    folder = tmp_path_factory.mktemp("confined")
    for name in ("read", "write", "other"):
        (folder / name).mkdir()
        (folder / name / "a.txt").write_text(name, encoding="utf-8")
    (folder / "read" / "link").symlink_to(folder / "other" / "a.txt")
    (folder / "write" / "folder").mkdir()
    secret, shared = folder / "other" / "a.txt", "/dev/shm"
    (folder / "cache" / "live").mkdir(parents=True)
    (folder / "cache" / "live" / "a.json").write_text("{}", encoding="utf-8")
    before = "os.environ['MAQUETTE_CACHE'] = str(folder / 'cache')\n"
    before += "inherited = 100  # a number that no later file gets\nos.dup2(os.open(folder / 'other' / 'a.txt', os.O_RDWR), inherited)\n"
    run = """
results = {}
for each in json.loads(PROGRAMS):
    try:
        results[each] = str(eval(each))
    except BaseException as error:
        results[each] = type(error).__name__
print(json.dumps(results))
"""
    done = process(folder, f"{BEGIN}{before}{CONFINE.replace('MEMORY', 'None')}{run.replace('PROGRAMS', repr(json.dumps([*PROGRAMS])))}")
    assert done.returncode == 0, done.stderr
    assert secret.read_text(encoding="utf-8") == "other"
    assert secret.stat().st_mode & 0o777 == (folder / "read" / "a.txt").stat().st_mode & 0o777
    assert not any(name.startswith("maquette-test") for name in os.listdir(shared))
    return json.loads(done.stdout)


PROGRAMS = {
    # what a renderer does
    "(folder / 'read' / 'a.txt').read_text()": "read",
    "os.listdir(folder / 'read')": None,
    "(folder / 'write' / 'b.txt').write_text('new')": "3",
    "os.replace(folder / 'write' / 'b.txt', folder / 'write' / 'c.txt')": "None",
    "os.mkdir(folder / 'write' / 'made')": "None",
    "Path(tempfile.gettempdir()).name": "write",
    "tempfile.TemporaryFile().write(b'12')": "2",
    "open('/dev/null', 'w').write('12')": "2",
    "len(os.urandom(4))": "4",
    "os.write(os.memfd_create('picture'), b'12')": "2",
    "__import__('numpy').ones(3).sum()": "3.0",
    "threading.Thread(target=print, args=('',), kwargs={'end': ''}).start()": "None",
    "os.kill(os.getpid(), 0)": "None",
    "signal.pthread_kill(threading.get_ident(), 0)": "None",
    "len(Path('/proc/self/statm').read_text().split())": "7",
    "sys.stdin.read()": "",
    # files outside
    "(folder / 'other' / 'a.txt').read_text()": "PermissionError",
    "os.listdir(folder / 'other')": "PermissionError",
    "os.listdir(folder)": "PermissionError",
    "(folder / 'other' / 'b.txt').write_text('new')": "PermissionError",
    "(folder / 'read' / 'a.txt').write_text('new')": "PermissionError",
    "os.open(folder / 'read' / 'a.txt', os.O_RDONLY | os.O_TRUNC)": "PermissionError",
    "os.open(folder / 'read' / 'a.txt', 3)": "PermissionError",
    "os.truncate(folder / 'read' / 'a.txt', 0)": "PermissionError",
    "(folder / 'read' / 'link').read_text()": "PermissionError",
    "Path('/proc/self/root', *(folder / 'other' / 'a.txt').parts[1:]).read_text()": "PermissionError",
    "os.listdir('/proc/self/cwd/other')": "PermissionError",
    "os.replace(folder / 'write' / 'a.txt', folder / 'other' / 'b.txt')": "PermissionError",
    "os.replace(folder / 'other' / 'a.txt', folder / 'write' / 'd.txt')": "PermissionError",
    "os.unlink(folder / 'other' / 'a.txt')": "PermissionError",
    "os.read(inherited, 5)": "OSError",
    **{f"open({name!r}, 'rb').read(1)": "PermissionError" for name in ("/etc/passwd", "/etc/hostname", "/proc/1/environ", "/proc/1/maps")},
    "os.listdir('/proc')": "PermissionError",
    "os.listdir('/dev/shm')": "PermissionError",
    "os.listdir(os.environ['MAQUETTE_CACHE'])": "PermissionError",  # also the secrets of live windows
    "Path(os.environ['MAQUETTE_CACHE'], 'live', 'a.json').read_text()": "PermissionError",
    "open('/dev/shm/maquette-test', 'w')": "PermissionError",
    "__import__('_posixshmem').shm_open('/maquette-test', os.O_CREAT | os.O_RDWR, mode=0o600)": "PermissionError",
    # links, special files, permissions, times, attributes
    "os.symlink(folder / 'other' / 'a.txt', folder / 'write' / 'link')": "PermissionError",
    "os.link(folder / 'read' / 'a.txt', folder / 'write' / 'hard')": "PermissionError",
    "os.mkfifo(folder / 'write' / 'pipe')": "PermissionError",
    "os.chmod(folder / 'other' / 'a.txt', 0o777)": "PermissionError",
    "os.chmod(folder / 'write' / 'a.txt', 0o777)": "PermissionError",
    "os.fchmod(os.open(folder / 'write' / 'a.txt', os.O_RDONLY), 0o777)": "PermissionError",
    "os.chown(folder / 'write' / 'a.txt', 0, 0)": "PermissionError",
    "os.utime(folder / 'other' / 'a.txt')": "PermissionError",
    "os.setxattr(folder / 'write' / 'a.txt', 'user.a', b'1')": "PermissionError",
    "os.chroot(folder)": "PermissionError",
    # programs, processes, signals
    "os.execv('/bin/true', ['true'])": "PermissionError",
    "os.execve(os.open('/usr/lib/os-release', os.O_RDONLY), ['true'], {})": "PermissionError",
    "subprocess.run(['true'])": "PermissionError",
    "os.posix_spawn('/bin/true', ['true'], {})": "PermissionError",
    "os.fork()": "PermissionError",
    "os.system('true')": None,
    "call(56 if X86 else 220, signal.SIGCHLD, 0, 0, 0, 0)": "PermissionError",  # clone
    "call(56 if X86 else 220, 0x10000000 | 0x10000, 0, 0, 0, 0)": "PermissionError",  # clone: CLONE_NEWUSER | CLONE_THREAD
    "call(435, 0, 0)": "OSError",  # clone3
    "call(0x40000000 + 39)": "OSError" if os.uname().machine == "x86_64" else None,  # getpid of x32
    "call(437, 0, 0, 0, 0)": "OSError",  # openat2
    "call(425, 1, 0)": "OSError",  # io_uring_setup
    "call(101 if X86 else 117, 0, 0, 0, 0)": "PermissionError",  # ptrace
    "call(310 if X86 else 270, os.getppid(), 0, 0, 0, 0, 0)": "PermissionError",  # process_vm_readv
    "call(272 if X86 else 97, 0x10000000)": "PermissionError",  # unshare
    "call(29 if X86 else 194, 0, 4096, 0o1600)": "PermissionError",  # shmget
    "os.kill(os.getppid(), 0)": "PermissionError",
    "os.kill(0, 0)": "PermissionError",
    "os.kill(-1, 0)": "PermissionError",
    "os.setpgid(0, 0)": "PermissionError",
    "os.sched_setaffinity(os.getppid(), {0})": "PermissionError",
    "os.setpriority(os.PRIO_PROCESS, os.getppid(), 19)": "PermissionError",
    "resource.prlimit(os.getppid(), resource.RLIMIT_NOFILE)": "PermissionError",
    "resource.setrlimit(resource.RLIMIT_CORE, (1, 1))": "ValueError",
    # sockets and the terminal
    **{f"socket.socket(socket.{name})": "PermissionError" for name in ("AF_INET", "AF_INET6", "AF_UNIX", "AF_NETLINK")},
    "socket.socket(socket.AF_INET, socket.SOCK_DGRAM)": "PermissionError",
    "socket.socketpair()": "PermissionError",
    "fcntl.ioctl(1, termios.TIOCSTI, b'x')": "OSError",
    "fcntl.fcntl(1, fcntl.F_SETOWN, os.getppid())": "PermissionError",
    "fcntl.fcntl(1, fcntl.F_SETFL, os.O_ASYNC)": "PermissionError",
}  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_a_confined_process_may(outcomes: dict[str, str], program: str) -> None:
    assert program in outcomes
    assert PROGRAMS[program] is None or outcomes[program] == PROGRAMS[program]


def test_a_shell_does_not_run(outcomes: dict[str, str]) -> None:
    assert outcomes["os.system('true')"] != "0"


@pytest.mark.long
def test_memory_is_limited(folders: Path) -> None:
    assert confined(folders, "bytes(2 << 30)", memory="100_000_000") == "MemoryError"


@pytest.mark.long
def test_a_process_with_threads_is_not_confined(folders: Path) -> None:
    """Landlock holds for the thread that asks for it, and for those that it starts."""
    before = "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
    done = process(folders, f"{BEGIN}{before}{CONFINE.replace('MEMORY', 'None')}")
    assert done.stderr.strip().endswith("OSError: a process is confined before it starts threads")


@pytest.mark.long
def test_a_terminal_is_for_writing_alone(folders: Path) -> None:
    outer, inner = os.openpty()
    program = f"""{BEGIN}{CONFINE.replace('MEMORY', 'None')}
results = [os.isatty(1), os.isatty(2), os.get_terminal_size(1).columns >= 0, os.write(1, b"12")]
for number in (0, 1, 2):
    try:
        results.append(os.read(number, 1))
    except OSError as error:
        results.append(error.errno)
(folder / "write" / "results").write_text(repr(results))
"""
    text = program.replace("FOLDER", repr(str(folders)))
    with subprocess.Popen([sys.executable, "-c", text], stdin=inner, stdout=inner, stderr=inner) as process:
        assert process.wait(30) == 0
    os.close(outer)
    os.close(inner)
    assert (folders / "write" / "results").read_text(encoding="utf-8") == "[True, True, True, 2, b'', 9, 9]"


@pytest.mark.long
def test_a_folder_that_becomes_a_link_leads_nowhere(folders: Path) -> None:
    """Rights are those of the folder that was opened, and not of its name."""
    (folders / "late").mkdir()
    program = """
        os.listdir(folder / "write")
        print(sys.stdout.flush() or (folder / "write" / "a.txt").read_text())
        (folder / "write" / "b.txt").write_text("new")
    """
    swap = "confine = confinement.landlock.restrict\ndef swapped(*a):\n confine(*a)\nconfinement.landlock.restrict = swapped\n"
    moved = "os.rename(folder / 'write', folder / 'kept'); os.symlink(folder / 'other', folder / 'write')"
    before = swap.replace(" confine(*a)\n", f" {moved}; confine(*a)\n")
    assert confined(folders, program, before=before) == "PermissionError"
    assert sorted(os.listdir(folders / "other")) == ["a.txt"]


@pytest.mark.long
@pytest.mark.skipif(os.uname().machine != "x86_64", reason="for the interface of 32 bits")
def test_calls_of_32_bits_end_the_process(folders: Path) -> None:
    """They have other numbers."""
    program = """
memory = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
memory.write(bytes.fromhex("b814000000cd80c3"))  # mov eax, 20; int 0x80; ret
ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))()
print("alive")
"""
    done = process(folders, f"{BEGIN}{CONFINE.replace('MEMORY', 'None')}{program}")
    assert (done.stdout, done.returncode in (-signal.SIGSYS, -signal.SIGSEGV)) == ("", True)


@pytest.mark.parametrize("name", ["link", "folder/link", "link/a.txt", "link/../other/a.txt", "folder/loop"])
def test_paths_over_links_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").touch()
    for link in ("link", "folder/link"):
        (tmp_path / link).symlink_to(tmp_path / "other")
    (tmp_path / "folder" / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)
    for path in (name, str(tmp_path / name)):
        with pytest.raises(unlinked_paths.LinkError):
            unlinked_paths.open_path(path)
    for path in ("/proc/self/cwd/other", "/proc/self/root"):
        with pytest.raises(unlinked_paths.LinkError):
            unlinked_paths.open_path(path)
    for path in ("other/a.txt", ".", "/", "folder/../other"):
        os.close(unlinked_paths.open_path(path))
    with pytest.raises(NotADirectoryError):
        unlinked_paths.open_path("other/a.txt/b")
    with pytest.raises(FileNotFoundError):
        unlinked_paths.open_path("other/b.txt")
