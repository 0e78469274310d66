"""Cache keys of kernels: digests of the syntax trees of the modules a kernel is compiled from.

A kernel is compiled from its own module, from the modules that one imports, and from the modules that overload functions of these.
Docstrings, comments and layout leave the key unchanged. Syntax trees are read once: their digests are kept beside the kernels, each
with the size and time of its file.
"""

from __future__ import annotations

import ast
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ...compiler.io import cache_dirs
from ...compiler.io.replace_file import replace_file

ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("compiler", "lang", "render")
_ALWAYS = ("render.simd", "render.jit")  # packages that define types and operators of every kernel
_FORMAT = 1  # of the file of digests
SHIPPED = ROOT / "prebuilt" / "sources.json"
"""Digests that come with the package, so that a first picture parses no sources."""


class Source(NamedTuple):
    """A module: the digest of its syntax tree, the modules it imports, and those whose functions it overloads."""

    digest: str
    imports: tuple[str, ...]
    overloads: tuple[str, ...]


@cache
def key(module: str) -> str:
    """Digest of all modules that code of `module` ("render.film.film", or with the package's name in front) is compiled from."""
    known, extra = _sources(), _overloads()
    own = module.partition(".")[2] if module.partition(".")[0] not in _PACKAGES else module
    todo, found = [own, *(name for name in known if name.startswith(_ALWAYS))], dict[str, None]()
    while todo:
        name = todo.pop()
        if name in known and name not in found:
            found[name] = None
            todo += (*known[name].imports, *extra.get(name, ()))
    if own not in found:  # a kernel outside of the package, such as in a test
        return version()
    return _digest({name: known[name] for name in sorted(found)})


def is_ours(module: str) -> bool:
    """Return whether a dotted module, with the package's name in front or without, belongs to the package."""
    return module in _sources() or module.partition(".")[2] in _sources()


@cache
def version() -> str:
    """Digest of all modules that take part in rendering."""
    return _digest(_sources())


def _digest(sources: dict[str, Source]) -> str:
    text = "\n".join(f"{name} {source.digest}" for name, source in sorted(sources.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _overloads() -> dict[str, list[str]]:
    """For each module, the modules that overload its functions."""
    found: dict[str, list[str]] = {}
    for name, source in _sources().items():
        for target in source.overloads:
            found.setdefault(target, []).append(name)
    return found


@cache
def _sources() -> dict[str, Source]:
    """Every module of the package by its dotted name."""
    file = cache_dirs.cache_root() / "sources.json"
    before, shipped = _read(file), _read(SHIPPED)
    after: dict[str, list[Any]] = {}
    for package in _PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            relative = path.relative_to(ROOT)
            parts = relative.parent.parts if path.name == "__init__.py" else (*relative.parent.parts, path.stem)
            stat = path.stat()
            stamp = f"{path} {stat.st_mtime_ns} {stat.st_size}"
            name, known = ".".join(parts), before.get(".".join(parts))
            after[name] = known if known is not None and known[0] == stamp else [stamp, *_row(path, parts, shipped.get(name))]
    if after != before:
        _write(file, after)
    return {name: Source(row[1], tuple(row[2]), tuple(row[3])) for name, row in after.items()}


def _row(path: Path, parts: tuple[str, ...], shipped: list[Any] | None) -> tuple[str, list[str], list[str]]:
    """Digest, imported modules and overloaded modules of one file: as they came with the package, if the file did too."""
    if shipped is not None and content_digest(path) == shipped[0]:
        return shipped[1], shipped[2], shipped[3]
    return _parse(path, parts)


def content_digest(path: Path) -> str:
    """Digest of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def ship() -> str:
    """The content of SHIPPED: the digests of all modules by the digests of their files, which are the same for every version of Python."""
    rows = {name: [content_digest(_path(name)), *source] for name, source in _sources().items()}
    return json.dumps({"form": _FORMAT, "modules": rows})


def _path(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _read(file: Path) -> dict[str, list[Any]]:
    """The digests kept on disk; none where the file is missing, damaged or of another form."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        rows = found["modules"] if found["form"] == _FORMAT else {}
        good = all(len(row) == 4 and all(isinstance(each, str) for each in (*row[:2], *row[2], *row[3])) for row in rows.values())
        return rows if good else {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _write(file: Path, rows: dict[str, list[Any]]) -> None:
    """Replace the file as a whole; without a writable folder the next process parses again."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, json.dumps({"form": _FORMAT, "modules": rows}).encode())
    except OSError:
        return


def _parse(path: Path, parts: tuple[str, ...]) -> tuple[str, list[str], list[str]]:
    """Digest, imported modules and overloaded modules of one file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    package = list(parts if path.name == "__init__.py" else parts[:-1])
    where: dict[str, str] = {}  # local name → module it comes from, or is
    imports: dict[str, None] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1] + (node.module.split(".") if node.module else [])
            for alias in node.names:
                inner = ".".join([*base, alias.name])
                target = inner if _is_module(inner) else ".".join(base)
                where[alias.asname or alias.name] = target
                imports[target] = None
    overloads: dict[str, None] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id.startswith("overload") and node.args:
            target = node.args[0]
            name = target.value if isinstance(target, ast.Attribute) else target
            if isinstance(name, ast.Name) and name.id in where:
                overloads[where[name.id]] = None
    _drop_docstrings(tree)
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16], list(imports), list(overloads)


@cache
def _is_module(dotted: str) -> bool:
    path = ROOT.joinpath(*dotted.split("."))
    return path.with_suffix(".py").is_file() or path.is_dir()


def _drop_docstrings(tree: ast.AST) -> None:
    """Remove expression statements that are constants: docstrings of modules, classes, functions and constants."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            kept = [each for each in body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))]
            node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]
