"""Builds a wheel with the general kernels, compiled for each instruction set.

    python tools/wheel.py [--out dist] [--build build/wheel] [--sets avx512,avx2,sse] [--scenes examples/hello.scene,…] [--no-general]

The wheel holds the folder maquette/prebuilt (render/jit/prebuilt.py). It serves every version of Python. Kernels are compiled in processes
of their own, with MAQUETTE_SIMD, in caches below build/wheel that the next wheel starts from. Beside the wheel stands its bill of
materials (tools/sbom.py).
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ROOT / "tools"
SETS = ("avx512", "avx2", "sse") if platform.machine() in ("x86_64", "AMD64") else ("sse",)
_RUNS = "from maquette.render.simd import target as t; print(t.BYTES[t.ISA] <= t.BYTES[t.highest(t.HOST)])"
LARGEST = 40_000_000  # bytes of a wheel
WORKERS = 2
_LEFT_OUT = {"build", "dist", "prebuilt", "tests", "tools", "bench", "docs", "examples"}  # beside the packages


def copy_tree(build: Path) -> Path:
    """A copy of the package as it goes into the wheel, importable as `maquette` from build / "path"."""
    tree = build / "path" / "maquette"
    shutil.rmtree(tree, ignore_errors=True)

    def left_out(folder: str, names: list[str]) -> list[str]:
        top = _LEFT_OUT if Path(folder) == ROOT else set()
        return [name for name in names if name in top or name.startswith(".") or name == "__pycache__" or name.endswith(".egg-info")]

    shutil.copytree(ROOT, tree, ignore=left_out)
    return tree


def run(build: Path, isa: str, *arguments: str, requests: str = "") -> str:
    """Run Python on the copy, with the cache of an instruction set; return its last line. Raises CalledProcessError."""
    environment = {
        **os.environ, "MAQUETTE_SIMD": isa, "MAQUETTE_CACHE": str(build / isa), "PYTHONPATH": str(build / "path"),
        "MAQUETTE_REQUESTS": requests,
    }  # fmt: skip
    done = subprocess.run([sys.executable, "-P", *arguments], env=environment, check=True, cwd=build, stdout=subprocess.PIPE, text=True)
    return (done.stdout.splitlines() or [""])[-1]


def compile_kernels(build: Path, isa: str, chosen: Sequence[Path], general: bool) -> None:
    """Fill the cache of an instruction set.

    For a set that this machine lacks, the scenes are drawn with its lanes and the machine's instructions; this lists the kernels.
    """
    runs = run(build, isa, "-c", _RUNS) == "True"
    requests = "" if runs else str(build / f"{isa}-requests")
    if requests:
        shutil.rmtree(requests, ignore_errors=True)
    if general:
        run(build, isa, "-m", "maquette.cli.build_kernels", requests=requests)
    parts = [part for k in range(WORKERS) if (part := [str(path) for path in chosen[k::WORKERS]])]
    with ThreadPoolExecutor(WORKERS) as pool:
        list(pool.map(lambda part: run(build, isa, str(TOOLS / "compile_scenes.py"), *part, requests=requests), parts))
    if requests:
        run(build, isa, str(TOOLS / "compile_requests.py"), requests)


def make_wheel(build: Path, out: Path) -> Path:
    """Build the wheel of the copy; its path."""
    other = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    system = f"manylinux_2_17_{platform.machine()}" if sys.platform == "linux" else other  # kernels use no version of the C library
    wheels = build / "made"
    shutil.rmtree(wheels, ignore_errors=True)
    command = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels)]
    option = f"--config-settings=--build-option=--plat-name={system}"
    subprocess.run([sys.executable, *command, option, str(build / "path" / "maquette")], check=True)
    (wheel,) = wheels.glob("*.whl")
    out.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copy(wheel, out / wheel.name))


def write_bill(build: Path, wheel: Path) -> None:
    """Write the software bill of materials beside the wheel, as NAME.cdx.json."""
    environment = {**os.environ, "PYTHONPATH": str(build / "path")}
    done = subprocess.run([sys.executable, "-P", str(TOOLS / "sbom.py")], env=environment, check=True, stdout=subprocess.PIPE)
    wheel.with_suffix(".cdx.json").write_bytes(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "wheel", help="folder of caches and of the copy")
    parser.add_argument("--sets", default=",".join(SETS), help="instruction sets")
    parser.add_argument("--scenes", help="scenes whose specialised kernels come along")
    parser.add_argument("--no-general", action="store_true", help="leave the general kernels out")
    options = parser.parse_args()
    build = options.build.resolve()
    chosen = [Path(name).resolve() for name in options.scenes.split(",")] if options.scenes else []
    tree = copy_tree(build)
    for isa in options.sets.split(","):
        compile_kernels(build, isa, chosen, not options.no_general)
        run(build, isa, str(TOOLS / "collect_kernels.py"), str(tree / "prebuilt"))
    wheel = make_wheel(build, options.out)
    write_bill(build, wheel)
    size = wheel.stat().st_size
    print(f"{wheel}: {size / 1e6:.1f} MB")
    return 0 if size <= LARGEST else 1


if __name__ == "__main__":
    sys.exit(main())
