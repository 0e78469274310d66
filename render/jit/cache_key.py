"""Cache keys of kernels: digests of the definitions that a kernel is compiled from.

A kernel is compiled from its own definition and, step by step, from the definitions that one refers to: in its module, and by relative
imports in others. Overloads stand in the module of their function.
"""

from __future__ import annotations

import ast
import functools
import sys
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from ...compiler.io import cache_dirs
from .definitions import OTHER
from .package_sources import Sources, digest, read_rows, write_rows

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "prebuilt" / "sources.json"
"""Definitions that come with the package, so that a first picture parses no sources."""
_ALWAYS = ("render.simd.", "render.jit.compiler")  # define the types and operators of every kernel, and compile it
_RUNTIME = (
    "compiler.io.", "render.jit.cache", "render.jit.compile_lock", "render.jit.compile_process",
    "render.jit.kernel_cache", "render.jit.prebuilt",
)  # fmt: skip
"""Modules that find, keep and load kernels: the decorators of kernels refer to them, but no kernel is compiled from them."""
_PACKAGE = __name__.partition(".")[0]
_FAMILIES = {
    ("shapes", "SHAPES"): ("FLAT", "hit", "normal", "uv"),
    ("lights", "LIGHTS"): ("FORM", "HAS_ANGLE", "HAS_IMAGE", "profile"),
    ("materials", "MATERIALS"): ("facets", "LOBES", "HALF_VECTOR"),
    ("materials", "ADDED"): ("LOBE",),
}
"""Tables of modules, and the definitions of each module that kernels over all of them are made from."""
_FORMAT = 2  # of the file of keys
_CHECKOUTS = 8  # whose keys are kept

Place = tuple[str, str]
"""A module and the name of a definition in it."""


class Keys:
    """Keys of the kernels in a package's modules, kept on disk while no file of the package changes."""

    def __init__(self, sources: Sources) -> None:
        self.sources = sources
        self._resolved: dict[Place, tuple[Place, ...]] = {}
        self._digests: dict[Place, str] = {}

    def key(self, module: str, name: str = "") -> str:
        """Digest of all that a definition of a module is compiled from, or the whole module.

        `module` is dotted ("render.film.film"), or has the package's name in front. `name` may have dotted names inside of the definition.
        Raises KeyError for a module of others.
        """
        dotted, outer = self.own(module), name.partition(".")[0]
        if dotted is None:
            raise KeyError(f"{module} is not a module of the package")
        place = f"{dotted}~{outer}"
        if place not in self._kept:
            self._kept[place] = self._digest_of(dotted, outer)
            self.sources.keep()
            self._keep()
        return self._kept[place]

    def digest_of(self, module: str, name: str = "") -> str:
        """`key`, for the many helpers of a kernel: it is computed in each process, and not kept on disk."""
        dotted, outer = self.own(module), name.partition(".")[0]
        if dotted is None:
            raise KeyError(f"{module} is not a module of the package")
        place = dotted, outer
        if place not in self._digests:
            self._digests[place] = self._kept.get(f"{dotted}~{outer}") or self._digest_of(dotted, outer)
        return self._digests[place]

    def _digest_of(self, module: str, name: str) -> str:
        is_definition = name in self.sources.module(module).definitions  # else it is made by code of the module
        return self._digest(self.reach(module, name if is_definition else ""))

    def key_of_file(self, path: Path) -> str:
        """Digest of a file outside of the package, of the files that it imports by relative paths, and of its imports from the package."""
        contents, places, todo = dict[Path, str](), set[Place](), [path]
        while todo:
            file = todo.pop()
            if file not in contents and file.is_file():
                text = file.read_bytes()
                contents[file] = digest(text)
                for node in (each for each in ast.walk(ast.parse(text)) if isinstance(each, ast.ImportFrom)):
                    base, names = (node.module or "").split("."), [alias.name for alias in node.names]
                    if node.level:
                        folder = file.parents[node.level - 1].joinpath(*base)
                        todo += (folder.with_suffix(".py"), *(folder / f"{name}.py" for name in names))
                    elif base[0] == _PACKAGE:
                        places |= self._follow([place for name in names for place in self._imported(".".join(base[1:]), name, "")])
        self.sources.keep()
        return digest(f"{sorted(contents.values())} {self._digest(places | self._always)}")

    def _digest(self, places: set[Place]) -> str:
        module = self.sources.module
        return digest("\n".join(sorted(f"{base}.{name} {module(base).definitions[name].digest}" for base, name in places)))

    def reach(self, module: str, name: str = "") -> set[Place]:
        """All definitions that one of them, or a whole module, is compiled from."""
        return self._follow([(module, name)] if name else list(self._all(module))) | self._always

    @cached_property
    def _always(self) -> set[Place]:
        """The definitions of every kernel."""
        return self._follow([place for name in self.sources.files if name.startswith(_ALWAYS) for place in self._all(name)])

    def _all(self, module: str) -> Iterator[Place]:
        return ((module, name) for name in self.sources.module(module).definitions)

    def _follow(self, todo: list[Place]) -> set[Place]:
        """These definitions and those they refer to, step by step."""
        reached = set[Place]()
        while todo:
            place = todo.pop()
            module, name = place
            if place in reached or module.startswith(_RUNTIME):
                continue
            reached.add(place)
            todo.append((module, OTHER))
            for used in self.sources.module(module).definitions[name].names:
                todo += self._resolve(module, used)
        return reached

    def _resolve(self, module: str, dotted: str) -> tuple[Place, ...]:
        """The definitions that a dotted name of a module refers to. A module that is read as a value is all of its definitions."""
        place = module, dotted
        if place not in self._resolved:
            self._resolved[place] = ()  # for packages whose parts import each other
            first, _, attributes = dotted.partition(".")
            source = self.sources.module(module)
            local = [(module, first)] if first in source.definitions else []
            if (module, first) in _FAMILIES:
                members = (name for name in self.sources.files if name.startswith(f"{module}."))
                local += [each for member in members for name in _FAMILIES[module, first] for each in self._resolve(member, name)]
            imported = [each for base, name in source.imports.get(first, ()) for each in self._imported(base, name, attributes)]
            self._resolved[place] = (*local, *imported)
        return self._resolved[place]

    def _imported(self, base: str, name: str, attributes: str) -> Iterator[Place]:
        """The definitions that name.rest refers to after `from base import name`."""
        inner, files = f"{base}.{name}", self.sources.files
        if inner in files:
            following, _, beyond = attributes.partition(".")
            if not attributes:
                yield from self._all(inner)
            elif f"{inner}.{following}" in files:
                yield from self._imported(inner, following, beyond)
            else:
                yield from self._resolve(inner, attributes)
        elif base in files:
            yield from self._resolve(base, f"{name}.{attributes}" if attributes else name)

    def own(self, module: str) -> str | None:
        """The dotted name of a module in the package; None for a module of others."""
        inner = module.partition(".")[2]
        return module if module in self.sources.files else inner if inner in self.sources.files else None

    # --- keys on disk ----------------------------------------------------------------------------------------------------

    @cached_property
    def _kept(self) -> dict[str, str]:
        return read_rows(_file(), _FORMAT).get(self.sources.stamp, {}) if self.sources.stamp else {}

    def _keep(self) -> None:
        if self.sources.stamp:
            rows = read_rows(_file(), _FORMAT)
            ours = {**rows.pop(self.sources.stamp, {}), **self._kept}
            write_rows(_file(), _FORMAT, {**dict(list(rows.items())[1 - _CHECKOUTS :]), self.sources.stamp: ours})


def _file() -> Path:
    """The file of keys in the cache directory."""
    return cache_dirs.cache_root() / "keys.json"


_package = Keys(Sources(ROOT, SHIPPED))
key, key_of_file, reach, digest_of = _package.key, _package.key_of_file, _package.reach, _package.digest_of


def is_ours(module: str) -> bool:
    """Return whether a dotted module, with the package's name in front or without, belongs to the package."""
    return _package.own(module) is not None


def ship() -> str:
    """The content of SHIPPED."""
    return _package.sources.ship()


def version() -> str:
    """Digest of all modules that take part in rendering, by the bytes of their files."""
    sources = _package.sources
    return digest("\n".join(f"{name} {sources.content(name)}" for name in sources.files))


# --- function objects -----------------------------------------------------------------------------------------------------


class NoDigest(Exception):
    """A value that is different in each process."""


@functools.cache
def digest_of_function(function: Any) -> str:
    """Digest of a function object: of its code, of all that it refers to, of the values that it closes over, and of its defaults.

    Raises NoDigest for a value that has none.
    """
    code, module = function.__code__, function.__module__
    defaults = *(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()
    parts = [_code_text(code), *map(_value, (*(cell.cell_contents for cell in function.__closure__ or ()), *defaults))]
    if module is not None and is_ours(module):
        parts.append(digest_of(module, function.__qualname__))
    elif module is not None and getattr(sys.modules.get(module), "__file__", None):
        parts.append(_file_key(Path(str(sys.modules[module].__file__))))
    else:  # made by exec
        parts += [f"{name} {_value(function.__globals__[name])}" for name in _names(code) if name in function.__globals__]
    return digest("\n".join(parts))


_file_key = functools.cache(key_of_file)


def _names(code: CodeType) -> list[str]:
    """The global names of a function's code, and of the functions inside of it."""
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return sorted({*code.co_names, *(name for each in inner for name in _names(each))})


def _code_text(code: CodeType) -> str:
    """Code without its place in a file."""
    consts = [_code_text(each) if isinstance(each, CodeType) else repr(each) for each in code.co_consts]
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    return repr((code.co_code, consts, names, code.co_argcount, code.co_flags))


def _value(value: Any) -> str:
    """A value that code refers to, as text that tells it from others."""
    for name in ("definition", "_defn", "py_func"):  # of intrinsics, of Numba's intrinsics, of kernels
        value = getattr(value, name, value)
    if isinstance(value, FunctionType):
        return digest_of_function(value)
    if value is None or isinstance(value, int | float | str | np.generic):
        return repr(value)
    if isinstance(value, tuple):
        return f"({','.join(map(_value, value))})"
    if isinstance(value, type | ModuleType):
        module, name = (value.__module__, value.__qualname__) if isinstance(value, type) else (value.__name__, "")
        return f"{module}.{name} {digest_of(module, name) if is_ours(module) else ''}"
    kind = getattr(value, "name", None)  # of a Numba type
    if not isinstance(kind, str) or " at 0x" in kind:
        raise NoDigest(value)
    return f"{type(value).__name__} {kind}"
