"""Damages files at random and gives them to the parser, the evaluator and the readers.

    python tests/fuzz/fuzzing.py --seconds 60 [--seed 1] [--only glb,usdc] [--found FOLDER]

A process for each kind reads the inputs, with a limit of memory. Anything but a scene or a diagnostic is a finding: another
exception, the end of the process, more than 5 seconds, or growth over 1 GB. Findings are written to FOLDER; a mended one goes to `corpus`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import maquette
import numpy as np
from maquette.compiler.importers import images
from maquette.compiler.scene import serialize, validate
from maquette.lang.diagnostics import Diagnostics, SceneError
from maquette.lang.syntax import parser
from maquette.render.film import checkpoint
from maquette.tests.fuzz import crates

ROOT = Path(maquette.__file__).parent
CORPUS = Path(__file__).parent / "corpus"
HANG = 5.0  # seconds of processor time for one input
GROWTH = 1 << 30  # bytes beyond those of the process before
MESHES = ("obj", "ply", "stl", "off", "glb", "gltf")
PICTURES = ("png", "jpg", "exr", "tiff", "hdr")
STAGES = ("usda", "usdc")
KINDS = ("parser", "evaluator", *MESHES, *STAGES, "crate", *PICTURES, "npz", "checkpoint")  # crate: inside of .usdc's compressed sections
_WORDS = (*b"0 -1 1e308 nan inf 4294967295 () [ { \" #".split(), b"\n", b"\xff\xff\xff\xff", b"\x00\x00\x00\x80")


# --- inputs ----------------------------------------------------------------------------------------------------------------


def seeds(kind: str, folder: Path) -> list[bytes]:
    """Whole files of a kind, and those of `corpus`."""
    kept = [path.read_bytes() for path in sorted(CORPUS.glob(f"*.{kind}"))]
    if kind in ("parser", "evaluator"):
        texts = [path.read_bytes() for path in sorted((ROOT / "examples").glob("*.scene"))]
        parts = {part for text in texts for part in text.split(b"\n\n") if len(part) < 300}  # short ones: more executions a second
        return [*sorted(parts), *(text for text in texts if len(text) < 1500 and kind == "evaluator"), *kept]
    if kind in (*STAGES, "crate"):
        return [*_stages(folder / f"seed.{suffix(kind)}"), *kept]
    return [_written(kind, folder), *kept]


def suffix(kind: str) -> str:
    """The end of the names of files of a kind."""
    return "usdc" if kind == "crate" else kind


def _stages(path: Path) -> list[bytes]:
    sdf: Any = importlib.import_module("pxr.Sdf")
    made = []
    for source in (ROOT / "examples" / "pavilion.usda", Path(__file__).parent / "stage.usda"):
        sdf.Layer.OpenAsAnonymous(str(source)).Export(str(path))
        made.append(path.read_bytes())
    return made


def _written(kind: str, folder: Path) -> bytes:
    path = folder / f"seed.{kind}"
    if kind in ("obj", "ply", "stl", "off", "glb"):
        import trimesh

        trimesh.creation.box().export(path)
    elif kind == "gltf":
        data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"
        accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
        primitive = {"attributes": {"POSITION": 0}, "material": 0}
        made = {
            "asset": {"version": "2.0"}, "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{data}"}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [accessor], "meshes": [{"primitives": [primitive]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.5}}], "nodes": [{"mesh": 0, "translation": [0, 1, 0]}],
            "scenes": [{"nodes": [0]}], "scene": 0,
        }  # fmt: skip
        path.write_text(json.dumps(made), encoding="utf-8")
    elif kind in PICTURES:
        import OpenImageIO as oiio

        pixels = oiio.ImageBuf(oiio.ImageSpec(9, 7, 3, oiio.FLOAT if kind in ("exr", "hdr") else oiio.UINT8))
        oiio.ImageBufAlgo.checker(pixels, 2, 2, 1, (0.1, 0.2, 0.3), (0.9, 0.5, 0.4))
        pixels.write(str(path))
    elif kind == "npz":
        serialize.save(maquette.load(ROOT / "examples" / "hello.scene"), path)
    else:
        with open(path, "wb") as file:
            checkpoint.save(file, "key", checkpoint.State({"a": np.arange(12.0).reshape(3, 4)}, {"n": 3}))
    return path.read_bytes()


def damaged(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """A file with one to eight random changes: bits, bytes, words, parts that are doubled, moved, left out or of another file."""
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        at, length = rng.randrange(len(made) + 1), rng.choice((1, 2, 4, 16, 64))
        change = rng.randrange(8)
        if change == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif change == 1:
            made[at : at + length] = rng.randbytes(length)
        elif change == 2:
            del made[at : at + length]
        elif change == 3:
            made[at:at] = made[at : at + length] * rng.choice((1, 2, 50))
        elif change == 4:
            made[at : at + rng.choice((0, 1, 4))] = rng.choice(_WORDS)
        elif change == 5:
            start = rng.randrange(len(made) + 1)
            made[at : at + length] = made[start : start + length]
        elif change == 6:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            made[at : at + length] = other[start : start + length]
        elif rng.random() < 0.2:
            del made[at:]
    return bytes(made)


# --- what reads them ---------------------------------------------------------------------------------------------------------


def reader(kind: str, folder: Path) -> Callable[[bytes], object]:
    """A function that reads an input. It may raise SceneError and ImageError."""
    path = folder / f"input.{suffix(kind)}"

    def load(data: bytes) -> object:
        path.write_bytes(data)
        return maquette.load(path)

    def parse(data: bytes) -> object:
        found = Diagnostics()
        text = parser.decode(data, "a.scene", found)
        return None if text is None else parser.parse(text, "a.scene", found)

    def evaluate(data: bytes) -> object:
        return maquette.load_text(data.decode("utf-8", "replace"))

    def load_ir(data: bytes) -> object:
        path.write_bytes(data)
        return validate.validate(serialize.load(path))

    def resume(data: bytes) -> object:
        path.write_bytes(data)
        return checkpoint.load(path, "key")

    own = {"parser": parse, "evaluator": evaluate, "npz": load_ir, "checkpoint": resume}
    if kind in PICTURES:
        return lambda data: images.read(data, f"input.{kind}")
    return own.get(kind, load)


class Hang(BaseException):
    """An input took longer than HANG."""


def execute(read: Callable[[bytes], object], data: bytes) -> str:
    """Read one input; the finding, or nothing."""

    def stop(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, HANG)
    try:
        read(data)
    except (SceneError, images.ImageError):
        return ""
    except Hang:
        return f"more than {HANG:g} s"
    except Exception:
        return traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return ""


def inputs(kind: str, folder: Path, seed: int) -> Iterator[bytes]:
    """Kept and damaged files without end, the same for the same seed."""
    whole = seeds(kind, folder)
    yield from whole
    rng = random.Random(f"{kind} {seed}")
    while True:
        yield crates.damaged(rng.choice(whole), rng) if kind == "crate" else damaged(rng.choice(whole), whole, rng)


def work(kind: str, seconds: float, count: int, seed: int, folder: Path) -> None:
    """Read inputs of a kind for some seconds, or so many; print the number and the finding as JSON. `last` has the last input."""
    os.chdir(folder)
    read = reader(kind, folder)
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + GROWTH + (512 << 20), resource.RLIM_INFINITY))  # libraries are loaded later
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    done, end, finding = 0, time.monotonic() + seconds, ""
    last = os.open(folder / "last", os.O_WRONLY | os.O_CREAT)
    for data in inputs(kind, folder, seed):
        if done >= count or time.monotonic() > end or finding:
            break
        os.pwrite(last, _LAST.pack(done, len(data)) + data, 0)
        finding = execute(read, data)
        done += 1
    print(json.dumps([done, finding]))


_LAST = struct.Struct("<QQ")  # inputs before, and the bytes of this one
_MEMORY = "/dev/shm"  # a file system in memory: most inputs are files


def fuzz(kind: str, seconds: float, count: int, seed: int) -> tuple[int, str, bytes]:
    """Read inputs in another process; (how many, the finding or nothing, the last input)."""
    with tempfile.TemporaryDirectory(dir=_MEMORY if os.access(_MEMORY, os.W_OK) else None) as made:
        folder = Path(made)
        command = [sys.executable, str(Path(__file__).resolve()), "--work", kind, str(seconds), str(count), str(seed), made]
        done = subprocess.run(command, capture_output=True, text=True)
        kept = (folder / "last").read_bytes() if (folder / "last").exists() else b""
        kept = kept.ljust(_LAST.size, b"\0")  # nothing is written before the first input
        number, length = _LAST.unpack_from(kept)
        last = kept[_LAST.size : _LAST.size + length]
        if done.returncode:
            return number, f"the process ended with {done.returncode}: {done.stderr[-500:]}", last
        number, finding = json.loads(done.stdout.splitlines()[-1])
        return number, finding, last


def campaign(kinds: list[str], seconds: float, seed: int, found: Path) -> int:
    """Fuzz each kind for its share of the time; print the numbers, write findings, and return how many there were."""
    total = findings = 0
    for kind in kinds:
        end, number, k, told = time.monotonic() + seconds / len(kinds), 0, seed, set[str]()
        while (left := end - time.monotonic()) > 1.0:
            done, finding, last = fuzz(kind, left, 1 << 62, k)
            number, k = number + done, k + 1_000_003
            line = finding.strip().splitlines()[-1] if finding else ""
            if finding and line not in told:
                told.add(line)
                found.mkdir(parents=True, exist_ok=True)
                (found / f"{k}.{kind}").write_bytes(last)
                (found / f"{k}.{kind}.txt").write_text(finding, encoding="utf-8")
                print(f"{kind}: {line}", flush=True)
        print(f"{kind}: {number} executions, {len(told)} findings", flush=True)
        total, findings = total + number, findings + len(told)
    print(f"{total} executions, {findings} findings")
    return findings


def main() -> int:
    words: Any = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--seconds", type=float, default=60.0)
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--only", default=",".join(KINDS))
    words.add_argument("--found", type=Path, default=Path("build/findings"))
    words.add_argument("--work", nargs=5, help=argparse.SUPPRESS)
    asked = words.parse_args()
    if asked.work:
        kind, seconds, count, seed, folder = asked.work
        work(kind, float(seconds), int(count), int(seed), Path(folder))
        return 0
    return 1 if campaign(asked.only.split(","), asked.seconds, asked.seed, asked.found) else 0


if __name__ == "__main__":
    sys.exit(main())
