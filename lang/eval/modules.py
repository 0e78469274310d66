"""Module loader: reads, parses and caches the files named by `use`."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Protocol

from .. import file_types, foreign_formats, units
from ..diagnostics import Diagnostics, Span
from ..input_error import InputError
from ..limits import MAX_FILES
from ..syntax import ast
from ..syntax.incremental import IncrementalParser
from ..syntax.lexer import KEYWORDS
from ..syntax.parser import parse


class ReadError(InputError):
    """A file that cannot be used."""


@dataclass(frozen=True, slots=True)
class Source:
    """The text of a file. `name` is its name in messages; `path` identifies it."""

    name: str
    text: str
    path: str


class Reader(Protocol):
    """Provider of file texts, implemented by the compiler."""

    def scene(self, path: str, importer: str, span: Span) -> Source:
        """The file of `use "path"` in the file with path `importer`; "std/…" is a library file. Raises ReadError."""
        ...


@dataclass(eq=False, slots=True)
class Parsed:
    """A tree, and the blocks.FileCode that the evaluator has compiled it to. Both are kept across evaluations."""

    file: ast.File
    code: Any = None


@dataclass(eq=False)
class Module:
    """A parsed file. `unit` and `scale` are the unit of its bare lengths and its metres.

    `broken` are names with reported errors: of items with syntax errors, and of files that cannot be used.
    """

    source: Source
    parsed: Parsed
    unit: str
    scale: float
    of_library: bool
    broken: set[str] = field(default_factory=set)
    uses: dict[int, Module] = field(default_factory=dict)  # by the id of the `use` item
    units_named: set[str] = field(default_factory=set)  # of numbers, "" for bare ones, and of `unit`; the linter finds them

    @property
    def file(self) -> ast.File:
        return self.parsed.file

    @cached_property
    def members(self) -> frozenset[str]:
        """The names of its `let`s and `param`s, broken ones included."""
        return frozenset({i.name.id for i in self.file.items if isinstance(i, ast.Let | ast.Param)} | self.broken)


@dataclass
class Loader:
    """Reads each file once and detects cycles."""

    reader: Reader
    diagnostics: Diagnostics
    check: Callable[[Module], None]  # static checks of a module, called after its uses are loaded
    modules: dict[str, Module] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)
    chain: list[tuple[Source, Span | None]] = field(default_factory=list)
    prelude: Module | None = None
    parsing: float = 0.0  # seconds spent in the parser

    def load(self, source: Source, library: bool, span: Span | None = None, prelude: bool = False) -> Module:
        """The module of a source with all modules that it uses. The source must not be in the current chain."""
        if source.path in self.modules:
            return self.modules[source.path]
        self.sources[source.name] = source.text
        if not library:
            self.files.append(source.path)
        self.chain.append((source, span))
        before = len(self.diagnostics.items)
        started = clock.perf_counter()
        parsed = _parse(source.text, source.name, self.diagnostics)
        file = parsed.file
        self.parsing += clock.perf_counter() - started
        unit = self._unit(file)
        module = Module(source, parsed, unit, units.UNITS[unit][0], library, set(file.broken))
        self.modules[source.path] = module
        if prelude:
            self.prelude = module
        for use in file.items:
            if isinstance(use, ast.Use):
                self._use(use, module)
        self.check(module)
        self._add_chain(before)
        self.chain.pop()
        return module

    def _add_chain(self, before: int) -> None:
        """Add the chain of uses to the diagnostics of the current file."""
        trace = tuple((source.name, span) for source, span in reversed(self.chain) if span is not None)
        if trace:
            file_name = self.chain[-1][0].name
            items = self.diagnostics.items
            for i in range(before, len(items)):
                d = items[i]
                if not d.trace and d.span and d.span.file == file_name:
                    items[i] = type(d)(d.severity, d.message, d.span, d.hint, trace)

    def _unit(self, file: ast.File) -> str:
        unit_items = [item for item in file.items if isinstance(item, ast.Unit)]
        for item in unit_items[1:]:
            self.diagnostics.error("`unit` occurs twice in this file", item.span, f"the first is in line {unit_items[0].span.line}")
        if not unit_items:
            return "m"
        name = unit_items[0].name
        if units.UNITS.get(name.id, (0, units.NONE))[1] == units.LENGTH:
            return name.id
        lengths = ", ".join(sorted({u for u, (_, d) in units.UNITS.items() if d == units.LENGTH and u.isascii() and u not in KEYWORDS}))
        self.diagnostics.error(f"expected unit of length, got `{name.id}`", name.span, f"one of {lengths}")
        return "m"

    def _use(self, use: ast.Use, module: Module) -> None:
        path = use.path.value
        if is_asset(path):
            return
        try:
            used = self._read(use, path, module)
        except ReadError as e:
            self.diagnostics.error(e.message, use.path.span, e.hint)
            module.broken.add(use_name(use))
        else:
            module.uses[id(use)] = used

    def _read(self, use: ast.Use, path: str, module: Module) -> Module:
        library = path.startswith("std/")
        if not library and not path.endswith(".scene"):
            endings = "a file ends with one of " + " ".join((*file_types.SCENE, *file_types.USD, *file_types.MESH))
            hint = foreign_formats.advice(path) or endings
            raise ReadError(f'cannot use "{path}"', hint if "." in path.rsplit("/", 1)[-1] else f'write "{path}.scene"')
        source = self.reader.scene(path, module.source.path, use.path.span)
        if any(s.path == source.path for s, _ in self.chain):
            start = next(i for i, (s, _) in enumerate(self.chain) if s.path == source.path)
            cycle = " → ".join([s.name for s, _ in self.chain[start:]] + [source.name])
            raise ReadError(f"{source.name} uses itself: {cycle}")
        if len(self.modules) >= MAX_FILES:
            raise ReadError(f"the scene uses more than {MAX_FILES} files")
        return self.load(source, library, use.span)


PRELUDE = "std/prelude"


MAX_CACHED_TEXT = 100_000  # characters; a tree takes about 100 times the memory of its text


@lru_cache(maxsize=32)
def _parser(name: str) -> IncrementalParser:
    return IncrementalParser(name)


@lru_cache(maxsize=32)
def _parse_cached(text: str, name: str) -> Parsed | None:
    diagnostics = Diagnostics()
    file = _parser(name).parse(text, diagnostics)
    return None if diagnostics.items else Parsed(file)


def parsed() -> int:
    """How many texts this process has parsed so far, without those that were taken from the cache."""
    return _parse_cached.cache_info().misses


def _parse(text: str, name: str, diagnostics: Diagnostics) -> Parsed:
    """The tree of a file, cached across evaluations. After an edit only the items that it changes are parsed.

    A file with errors is parsed again to report them.
    """
    if len(text) > MAX_CACHED_TEXT:
        return Parsed(parse(text, name, diagnostics))
    return _parse_cached(text, name) or Parsed(_parser(name).parse(text, diagnostics))


def is_asset(path: str) -> bool:
    """Whether this path is a mesh or USD file, not a scene."""
    return path.lower().endswith(file_types.USD + file_types.MESH)


def asset_kind(path: str) -> str:
    """The element for a mesh or USD file."""
    return "usd" if path.lower().endswith(file_types.USD) else "mesh"


def use_name(use: ast.Use) -> str:
    """The name that `use` binds: the alias, or the file name without its extension."""
    return use.alias.id if use.alias else use.path.value.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0]
