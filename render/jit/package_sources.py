"""The modules of the package: their files, and their definitions, which are parsed once for each content of a file.

Definitions are kept in one file of the cache directory, by the digest of a module's bytes: several checkouts share it. Those of an
installed package come with it.
"""

from __future__ import annotations

import hashlib
import json
import time
from functools import cached_property
from pathlib import Path
from typing import Any

from ...compiler.io import cache_dirs
from ...compiler.io.replace_file import replace_file
from . import definitions
from .definitions import Definition, Module

PACKAGES = ("compiler", "lang", "lights", "materials", "render", "shapes")
_FORMAT = 2  # of the file of definitions
_CONTENTS = 4  # of one module whose definitions are kept
_SETTLED = 2_000_000_000  # nanoseconds after which a change of a file changes its times


class Sources:
    """The modules in the folder `root`. `shipped` is the file of definitions that comes with the package."""

    def __init__(self, root: Path, shipped: Path) -> None:
        self.root = root
        self._shipped_file = shipped
        self._contents: dict[str, str] = {}
        self._modules: dict[str, Module] = {}
        self._parsed: dict[str, Any] = {}  # rows that are not on disk yet

    @cached_property
    def files(self) -> dict[str, Path]:
        """The file of every module by its dotted name."""
        modules = {}
        for package in PACKAGES:
            for path in sorted((self.root / package).rglob("*.py")):
                parts = path.relative_to(self.root).with_suffix("").parts
                modules[".".join(parts[:-1] if path.name == "__init__.py" else parts)] = path
        return modules

    @cached_property
    def stamp(self) -> str:
        """Digest of the names, sizes and times of all files; "" while one is so new that an edit could leave its times as they are."""
        newest, rows = 0, []
        for name, path in self.files.items():
            status = path.stat()
            newest = max(newest, status.st_mtime_ns, status.st_ctime_ns)
            rows.append(f"{name} {status.st_ino} {status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}")
        return digest("\n".join([str(self.root), *rows])) if newest < time.time_ns() - _SETTLED else ""

    def content(self, name: str) -> str:
        """Digest of the bytes of a module's file."""
        if name not in self._contents:
            self._contents[name] = digest(self.files[name].read_bytes())
        return self._contents[name]

    def module(self, name: str) -> Module:
        """The definitions of a module: as kept, as they came with the package, or parsed."""
        module = self._modules.get(name)
        if module is None:
            module = self._modules[name] = self._read(name)
        return module

    def _read(self, name: str) -> Module:
        row = f"{name} {self.content(name)}"
        for rows in (self._kept, self._shipped):
            if row in rows:
                return _from_plain(rows[row])
        path, parts = self.files[name], tuple(name.split("."))
        module = definitions.read_module(path.read_text(encoding="utf-8"), parts if path.name == "__init__.py" else parts[:-1])
        self._parsed[row] = _to_plain(module)
        return module

    @cached_property
    def _kept(self) -> dict[str, Any]:
        return read_rows(kept_file(), _FORMAT)

    @cached_property
    def _shipped(self) -> dict[str, Any]:
        return read_rows(self._shipped_file, _FORMAT)

    def keep(self) -> None:
        """Write the definitions that were parsed since the last call. Without a writable folder the next process parses again."""
        if self._parsed:
            rows = {**read_rows(kept_file(), _FORMAT), **self._parsed}
            self._parsed = {}
            contents: dict[str, list[str]] = {}
            for row in rows:
                contents.setdefault(row.partition(" ")[0], []).append(row)
            write_rows(kept_file(), _FORMAT, {row: rows[row] for each in contents.values() for row in each[-_CONTENTS:]})

    def ship(self) -> str:
        """The content of the file of definitions for an installed package: of all modules, the same for every version of Python."""
        return packed_rows(_FORMAT, {f"{name} {self.content(name)}": _to_plain(self.module(name)) for name in self.files})


def kept_file() -> Path:
    """The file of definitions in the cache directory."""
    return cache_dirs.cache_root() / "definitions.json"


def digest(data: str | bytes) -> str:
    """Digest of a text or of bytes: 16 hexadecimal digits."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()[:16]


# --- files of rows -------------------------------------------------------------------------------------------------------


def packed_rows(form: int, rows: dict[str, Any]) -> str:
    """The text of a file of rows: the digest of the rest, then JSON."""
    text = json.dumps({"form": form, "rows": rows})
    return f"{digest(text)}\n{text}\n"


def read_rows(file: Path, form: int) -> dict[str, Any]:
    """The rows of a file; none where it is missing, damaged or of another form."""
    try:
        expected, _, text = file.read_text(encoding="utf-8").partition("\n")
        content = json.loads(text) if digest(text.removesuffix("\n")) == expected else {}
        return content["rows"] if content.get("form") == form else {}
    except (OSError, ValueError):
        return {}


def write_rows(file: Path, form: int, rows: dict[str, Any]) -> None:
    """Replace a file of rows as a whole. Without a writable folder nothing is kept."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, packed_rows(form, rows).encode())
    except OSError:
        return


def _to_plain(module: Module) -> list[Any]:
    return [{name: list(each) for name, each in module.definitions.items()}, module.imports]


def _from_plain(record: list[Any]) -> Module:
    defined = {name: Definition(each[0], tuple(each[1])) for name, each in record[0].items()}
    return Module(defined, {name: tuple((base, inner) for base, inner in origins) for name, origins in record[1].items()})
