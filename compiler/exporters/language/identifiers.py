"""Names of lets and of files: identifiers that nothing else has."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from ....lang.eval.builtins import CONSTANTS, FUNCTIONS
from ....lang.formula_graph import PATTERN_INPUTS
from ....lang.syntax.lexer import KEYWORDS
from ...catalogue import CATALOGUE

LONGEST = 60  # characters of a name
_RESERVED = frozenset((*KEYWORDS, *CATALOGUE, *FUNCTIONS, *CONSTANTS, "time", "children", "at", "frame", *PATTERN_INPUTS[-1]))
_DEVICES = frozenset(("con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(10))))  # of Windows


class Identifiers:
    """Names of lets, each given once."""

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self._used = {*_RESERVED, *reserved}

    def new(self, source: str, fallback: str) -> str:
        """An identifier like `source`, or like `fallback` where nothing of it is one."""
        return _unused(_identifier(source, fallback), self._used)


class FileNames:
    """Names of files in one folder, in letters of ASCII, different on systems that do not tell capitals."""

    def __init__(self) -> None:
        self._used = set(_DEVICES)

    def new(self, source: str, fallback: str, ending: str) -> str:
        """A name with an ending."""
        plain = unicodedata.normalize("NFKD", source).encode("ascii", "ignore").decode()
        return _unused(_identifier(plain, fallback).lower(), self._used) + ending


def _identifier(source: str, fallback: str) -> str:
    last = re.split(r"[/\\]", source.rstrip("/\\"))[-1] if source else ""
    plain = re.sub(r"\W+", "_", unicodedata.normalize("NFKC", last)).strip("_")[:LONGEST]
    if not plain:
        return fallback
    return plain if re.match(r"[^\W\d]", plain) else f"{fallback}_{plain}"


def _unused(name: str, used: set[str]) -> str:
    """The name, with a number where it is used; it is used then."""
    number, candidate = 1, name
    while candidate in used:
        number += 1
        candidate = f"{name}_{number}"
    used.add(candidate)
    return candidate
