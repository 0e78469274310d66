"""`maquette render --cluster`: pictures and frames, faults of workers, and messages."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.lang.distribution import VERSION
from maquette.render.cluster import dask_cluster, dispatcher
from maquette.render.image import image_reader

from ...cluster_processes import Processes, until
from ...files import standing_by

SCENE = """animate(duration: 1s, fps: 8)
sphere(0.5, center: [0, 0.5 + 0.25 * time / 1s, 0], material: lambert(#d0402a))
plane(material: lambert(#e8e8e8))
point([2, 4, 3], intensity: 20)
camera(position: [0, 1.2, 4], look_at: [0, 0.4, 0], fov: 35deg)
render(size: [64, 48], samples: 8)
"""


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small scene as a.scene in the current folder."""
    standing_by(tmp_path, monkeypatch, SCENE)


@pytest.fixture(scope="module")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    made = Processes(tmp_path_factory.mktemp("dask"))
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def address(processes: Processes) -> str:
    """The address of a scheduler with two workers."""
    processes.start(2 - len(processes.workers))
    processes.wait(2)
    return processes.address


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


def same(a: Path | str, b: Path | str) -> None:
    one, other = (image_reader.read(Path(path)).channels["rgba"] for path in (a, b))
    np.testing.assert_array_equal(one, other)


@pytest.mark.long
def test_a_picture_and_frames_equal_those_of_one_process(address: str) -> None:
    assert run("render", "a.scene", "-o", "here.exr")[0] == 0
    code, out, err = run("render", "a.scene", "-o", "there.exr", "--cluster", address)
    assert (code, err) == (0, "")
    assert out.startswith("there.exr: 64x48, ray, 8 samples a pixel, √relMSE ")
    same("here.exr", "there.exr")
    assert run("render", "a.scene", "-o", "here.##.exr", "--frames", "all")[0] == 0
    code, out, err = run("render", "a.scene", "-o", "there.##.exr", "--frames", "all", "--cluster", address, "--stats", "s.json")
    assert (code, err) == (0, "")
    assert [line.partition(":")[0] for line in out.splitlines()] == [f"there.0{k}.exr" for k in range(8)]
    for k in range(8):
        same(f"here.0{k}.exr", f"there.0{k}.exr")


@pytest.mark.long
def test_a_sheet_equals_that_of_one_process(address: str) -> None:
    Path("b.scene").write_text(f"param size = 0.5 in 0..1\n{SCENE.replace('sphere(0.5', 'sphere(size')}", encoding="utf-8")
    assert run("sweep", "b.scene", "--set", "size=0.2..0.6/3", "-o", "here.png")[0] == 0
    code, out, err = run("sweep", "b.scene", "--set", "size=0.2..0.6/3", "-o", "there.png", "--cluster", address)
    assert (code, out, err) == (0, "there.png: 3 pictures\n", "")
    same("here.png", "there.png")
    code, _, err = run("sweep", "b.scene", "--set", "size=0.2..0.6/3", "--cluster", address, "--threads", 2)
    assert (code, err.splitlines()[-1].split(":")[1]) == (2, " --cluster and --threads exclude each other")


@pytest.mark.long
def test_frames_that_are_there_are_kept(address: str) -> None:
    assert run("render", "a.scene", "-o", "f.##.exr", "--frames", "0..3", "--cluster", address)[0] == 0
    before = {path.name: path.stat().st_mtime_ns for path in Path().glob("f.*.exr")}
    code, out, err = run("render", "a.scene", "-o", "f.##.exr", "--frames", "0..8", "--resume", "--cluster", address)
    assert (code, err) == (0, "4 frames are there already\n")
    assert [line.partition(":")[0] for line in out.splitlines()] == [f"f.0{k}.exr" for k in range(4, 9)]
    assert {name: Path(name).stat().st_mtime_ns for name in before} == before


@pytest.mark.long
def test_a_worker_that_is_killed_loses_no_frame(processes: Processes, address: str) -> None:
    """It is killed when the first frame is there."""
    options = ("--frames", "0..6", "--samples", 100, "--size", "160x120")

    def kill() -> None:
        until(Path("there.00.exr").exists, "frame")
        processes.send(next(iter(processes.workers)), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    code, _, err = run("render", "a.scene", "-o", "there.##.exr", *options, "--cluster", address)
    killer.join()
    assert (code, err) == (0, "")
    assert len(processes.workers) == 1
    assert run("render", "a.scene", "-o", "here.##.exr", *options)[0] == 0
    for k in range(7):
        same(f"here.0{k}.exr", f"there.0{k}.exr")


@pytest.mark.long
def test_the_old_picture_stays_if_no_worker_is_left(processes: Processes, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("render", "a.scene", "-o", "a.png")[0] == 0
    before = Path("a.png").read_bytes()
    for name in list(processes.workers):
        processes.send(name, signal.SIGKILL)
    monkeypatch.setattr(dispatcher, "PATIENCE", 3.0)
    code, out, err = run("render", "a.scene", "-o", "a.png", "--cluster", address)
    assert (code, out) == (1, "")
    assert err == f"error: {address} has no workers: start some with `dask worker {address}`\n"
    assert Path("a.png").read_bytes() == before
    assert sorted(path.name for path in Path().iterdir()) == ["a.png", "a.scene"]


@pytest.mark.long
def test_another_version_is_told_and_the_render_goes_on(processes: Processes, address: str) -> None:
    (name,) = processes.start(1, "from maquette.lang import distribution; distribution.VERSION = '0.0.1'")
    processes.wait(3)
    try:
        code, _, err = run("render", "a.scene", "-o", "a.exr", "--cluster", address)
        assert code == 0
        assert err.startswith("warning: worker tcp://127.0.0.1:")
        assert err.endswith(f" has maquette 0.0.1, and this client {VERSION}: it draws nothing\n  install the same version on all\n")
    finally:
        processes.send(name, signal.SIGKILL)


@pytest.mark.long
def test_a_worker_that_answers_something_else_is_told(processes: Processes, address: str) -> None:
    code = "import importlib; importlib.import_module('maquette.render.cluster.worker').serve = lambda message: b'rubbish'"
    (name,) = processes.start(1, code)
    processes.wait(3)
    try:
        code, _, err = run("render", "a.scene", "-o", "a.exr", "--cluster", address)
        assert code == 0
        assert err.startswith("warning: worker tcp://127.0.0.1:")
        why = "JSONDecodeError: Expecting value: line 1 column 1 (char 0)"
        assert err.endswith(f" cannot draw ({why}): it draws nothing\n  install maquette {VERSION} with the extra `cluster` there\n")
    finally:
        processes.send(name, signal.SIGKILL)


@pytest.mark.long
def test_a_scheduler_that_is_killed_ends_the_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its workers are not blamed."""
    monkeypatch.setattr(dispatcher, "PATIENCE", 3.0)
    (tmp_path / "cluster").mkdir()
    own = Processes(tmp_path / "cluster")
    try:
        asked = tmp_path / "asked"
        serve = f"lambda message: (pathlib.Path({str(asked)!r}).touch(), time.sleep(60))"
        own.start(1, f"import importlib, pathlib, time; importlib.import_module('maquette.render.cluster.worker').serve = {serve}")
        own.wait(1)

        def kill() -> None:
            until(asked.exists, "message")
            own.scheduler.kill()

        killer = threading.Thread(target=kill)
        killer.start()
        code, _, err = run("render", "a.scene", "-o", "a.exr", "--cluster", own.address)
        killer.join()
        assert (code, err) == (1, f"error: the scheduler {own.address} does not answer any more\n")
    finally:
        own.close()


MESSAGES = {
    "nobody there": ("tcp://127.0.0.1:9", 1, "error: no scheduler answers at tcp://127.0.0.1:9: "),
    "no address": ("nonsense://x", 1, "error: no scheduler answers at nonsense://x: "),
    "no number": ("local:x", 1, "error: --cluster local:x: write local or local:N with the number of workers, such as local:4\n"),
    "no workers": ("local:0", 1, "error: --cluster local:0: write local or local:N with the number of workers, such as local:4\n"),
}


@pytest.mark.long
@pytest.mark.parametrize("case", MESSAGES)
def test_a_cluster_that_is_not_there(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_cluster, "CONNECT", 1.0)
    address, expected, message = MESSAGES[case]
    code, out, err = run("render", "a.scene", "-o", "a.png", "--cluster", address)
    assert (code, out) == (expected, "")
    assert err.startswith(message)
    assert err.count("\n") == 1


@pytest.mark.long
@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" + b"x" * 1000, None])
def test_another_server_is_no_scheduler(answer: bytes | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says nothing, something else, or closes the connection."""
    monkeypatch.setattr(dask_cluster, "CONNECT", 1.0)
    taken = []

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                taken.append(server.accept()[0])
                if answer is None:
                    taken[-1].close()
                else:
                    taken[-1].sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        began = time.monotonic()
        code, out, err = run("render", "a.scene", "-o", "a.png", "--cluster", address)
        server.shutdown(socket.SHUT_RDWR)
        thread.join(5)
    assert (code, out) == (1, "")
    if answer is None:
        assert err.startswith(f"error: no scheduler answers at {address}: ")
        assert err.count("\n") == 1
    else:
        assert err == f"error: no scheduler answers at {address}: something else listens there, or it is stopped\n"
    assert time.monotonic() - began < 10


def test_tls_without_certificates() -> None:
    link = "https://distributed.dask.org/en/stable/tls.html"
    message = f"error: no scheduler answers at tls://127.0.0.1:9: Dask's configuration has no certificates: see {link}\n"
    assert run("render", "a.scene", "-o", "a.png", "--cluster", "tls://127.0.0.1:9") == (1, "", message)


def test_without_dask_the_message_has_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run("render", "a.scene", "--cluster", "local") == (1, "", "error: --cluster needs Dask: pip install maquette-render[cluster]\n")


@pytest.mark.parametrize(("option", "why"), [("--sandbox", "a confined process opens no"), ("--threads 2", "give each worker its")])
def test_options_that_exclude_a_cluster(option: str, why: str) -> None:
    code, _, err = run("render", "a.scene", "--cluster", "local", *option.split())
    assert code == 2
    assert why in err


def processes_of(group: int) -> list[str]:
    """The command lines of the processes of a session."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            ended = (folder / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
            if folder.name.isdecimal() and os.getsid(int(folder.name)) == group and not ended:
                found.append((folder / "cmdline").read_text())
        except OSError:
            continue
    return found


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_local_cluster_ends_with_its_command(number: int) -> None:
    """Ctrl-C, which a terminal sends to the workers too, leaves a partial picture; nothing leaves processes."""
    command = [sys.executable, "-m", "maquette", "render", "a.scene", "-o", "a.exr", "--error", "0.01%", "--checkpoint", "1s"]
    pipe = subprocess.PIPE
    child = subprocess.Popen([*command, "--cluster", "local:2"], start_new_session=True, stdout=pipe, stderr=pipe, text=True)
    try:
        until(Path("a.exr.checkpoint").exists, "checkpoint")
        if number == signal.SIGINT:
            os.killpg(child.pid, number)
            _, err = child.communicate(timeout=60)
            assert child.returncode == 130
            assert err == "interrupted: the partial picture is in a.partial.exr; --resume goes on from a.exr.checkpoint\n"
        else:
            child.kill()
            child.wait()
        until(lambda: not processes_of(child.pid), "end of all processes")
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
