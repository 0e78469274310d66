"""Checks of the installation: versions, instruction set, caches, prebuilt kernels, missing packages."""

from __future__ import annotations

import os
import platform
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from ..lang import distribution

ROOT = Path(__file__).resolve().parent.parent


class Finding(NamedTuple):
    """One line. An `error` prevents rendering; rendering works without what is `missing`."""

    name: str
    state: str  # "ok", "missing" or "error"
    text: str
    data: dict[str, Any]


def findings() -> list[Finding]:
    """All findings, in order."""
    return [finding for check in CHECKS for finding in _safely(check)]


def _safely(check: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """The findings of a check; a check that fails is an error."""
    try:
        yield from check()
    except Exception as fault:
        yield Finding(check.__name__.strip("_").replace("_", " "), "error", f"{type(fault).__name__}: {fault}", {})


def _versions() -> Iterator[Finding]:
    yield Finding("maquette", "ok", f"{distribution.VERSION}, in {ROOT}", {"version": distribution.VERSION, "folder": str(ROOT)})
    python = platform.python_version()
    yield Finding("Python", "ok", f"{python}, {sys.executable}", {"version": python, "executable": sys.executable})


def _packages() -> Iterator[Finding]:
    """One line for the packages that rendering needs, and one for each that is missing or too old."""
    versions = {}
    for name, least in required_packages().items():
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            yield Finding(name, "error", f"not installed: pip install '{name}>={least}'", {"version": None, "least": least})
            continue
        if _numbers(versions[name]) < _numbers(least):
            text = f"{versions[name]} is too old: pip install '{name}>={least}'"
            yield Finding(name, "error", text, {"version": versions[name], "least": least})
    yield Finding("packages", "ok", ", ".join(f"{name} {version}" for name, version in versions.items()), {"versions": versions})


def required_packages() -> dict[str, str]:
    """The packages that this one depends on, with their least versions: from its metadata, or from pyproject.toml in a checkout.

    Those of some platforms alone are left out.
    """
    project = ROOT / "pyproject.toml"
    if project.exists():
        texts = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["dependencies"]
    else:
        texts = [text for text in metadata.requires(distribution.NAME) or () if "extra ==" not in text]
    texts = [text for text in texts if ";" not in text]
    parts = (re.fullmatch(r"([\w.-]+)\s*>=\s*([\w.]+).*", text) for text in texts)
    return {match[1]: match[2] for match in parts if match}


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def _instruction_set() -> Iterator[Finding]:
    from ..render.simd import target

    target.check_host()
    best = target.highest(target.HOST)
    data = {"isa": target.ISA, "cpu": target.LEVEL.cpu, "highest": best, "processors": target.cores()}
    yield Finding("instruction set", "ok", f"{target.ISA} ({target.LEVEL.cpu}), {target.cores()} processors; the machine has {best}", data)


def _kernel_cache() -> Iterator[Finding]:
    from ..render.jit import cache_folder, kernel_cache

    folder, limit = kernel_cache.CACHE, cache_folder.largest_size()
    kernels, size = _files(folder)[0], _files(folder.parent)[1]
    writable = folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
    usable = writable and cache_folder.is_trusted(folder)
    text = f"{folder}: {kernels} files; {_megabytes(size)} of {_megabytes(limit)} (MAQUETTE_CACHE_SIZE) for all targets"
    data = {"folder": str(folder), "files": kernels, "bytes": size, "limit": limit, "writable": writable, "used": usable}
    if not usable:
        why = "open to other users" if writable else "not writable"
        text += f"; {why}, so that each run compiles what is not prebuilt: MAQUETTE_CACHE names another folder"
    yield Finding("kernel cache", "ok" if usable else "missing", text, data)


def _prebuilt_kernels() -> Iterator[Finding]:
    from ..render.jit import prebuilt
    from ..render.simd import target

    folder = prebuilt.folder()
    number, size = _files(folder) if folder is not None else (0, 0)
    data = {"folder": None if folder is None else str(folder), "files": number, "bytes": size}
    if folder is not None:
        yield Finding("prebuilt kernels", "ok", f"{folder}: {number} files, {_megabytes(size)}", data)
    elif not prebuilt.ROOT.is_dir():
        text = "none, as this is not a wheel made by `make wheel`: kernels are compiled when they are first needed"
        yield Finding("prebuilt kernels", "missing", text, data)
    else:
        targets = ", ".join(sorted(path.name for path in prebuilt.ROOT.iterdir() if path.is_dir()))
        wanted = f"{target.ISA}-{target.LEVEL.cpu}" + (" with MAQUETTE_CHECKED" if target.CHECKED else "")
        yield Finding("prebuilt kernels", "missing", f"none for {wanted}: this package has {targets}", data)


def _files(folder: Path) -> tuple[int, int]:
    """(number, bytes) of the files in a folder and its folders."""
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    return len(sizes), sum(sizes)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB"


def _extras() -> Iterator[Finding]:
    from ..measure.peers import registry

    try:
        version = metadata.version("pyoidn")
        yield Finding("denoiser", "ok", f"pyoidn {version}, for noise that the default number of samples leaves", {"version": version})
    except metadata.PackageNotFoundError:
        yield Finding("denoiser", "missing", f"noise is left in pictures: {distribution.install_command('denoise')}", {"version": None})
    try:
        version = metadata.version("DracoPy")
        yield Finding("draco", "ok", f"DracoPy {version}, for compressed glTF meshes", {"version": version})
    except metadata.PackageNotFoundError:
        text = f"for compressed glTF meshes: {distribution.install_command('draco')}"
        yield Finding("draco", "missing", text, {"version": None})
    try:
        version = metadata.version("opengl_basisu")
        yield Finding("basisu", "ok", f"opengl_basisu {version}, for pictures in KTX 2", {"version": version})
    except metadata.PackageNotFoundError:
        yield Finding("basisu", "missing", f"for pictures in KTX 2: {distribution.install_command('basisu')}", {"version": None})
    try:
        version = metadata.version("distributed")
        yield Finding("cluster", "ok", f"Dask {version}, for render --cluster", {"version": version})
    except metadata.PackageNotFoundError:
        yield Finding("cluster", "missing", f"for render --cluster: {distribution.install_command('cluster')}", {"version": None})
    for peer in registry.every():
        missing = peer.missing
        text = f"for chart --peers {peer.name}: {missing}" if missing else f"{peer.version}, for chart --peers {peer.name}"
        yield Finding(peer.name, "missing" if missing else "ok", text, {"version": None if missing else peer.version})


CHECKS = (_versions, _packages, _instruction_set, _kernel_cache, _prebuilt_kernels, _extras)
