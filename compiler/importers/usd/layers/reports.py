"""usd-core's messages as diagnostics: warnings while it reads a stage, and the reason of a failure."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pxr import UsdUtils

from .....lang import file_types, foreign_formats
from .....lang.diagnostics import Diagnostics, Span
from . import text_layers

MAX_WARNINGS = 20


class Reports:
    """Captures usd-core's messages, which it would print, and emits them as warnings."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._delegate = UsdUtils.CoalescingDiagnosticDelegate()

    def tell(self, diagnostics: Diagnostics, span: Span) -> None:
        said = dict.fromkeys(_plain(_commentary(d), self._path) for d in self._delegate.TakeUncoalescedDiagnostics())
        for count, message in enumerate(said):
            if count == MAX_WARNINGS:
                diagnostics.warning(f"usd-core has {len(said) - count} more warnings", span)
                break
            diagnostics.warning(message, span, _without_format(message))


def _commentary(diagnostic: Any) -> str:
    try:
        return diagnostic.commentary
    except UnicodeDecodeError:
        return "usd-core has a message that is not UTF-8"


def reason(failure: Exception, path: Path) -> str:
    """The first of usd-core's messages. Its lines are `Error in 'function' at line n in file f : 'message'`."""
    lines = text_layers.text_of(failure).strip().splitlines() or ["no reason given"]
    first = next((line for line in lines if "Error in" in line), lines[-1])
    return _plain(first.partition(" : '")[2].rstrip("'") or first, path)


def left_out(failure: Exception, path: Path) -> str:
    """The message for a prim whose values usd-core cannot read."""
    return f"this prim and its descendants are left out: {reason(failure, path)}"


def _plain(message: str, path: Path) -> str:
    """A message on one line, with paths relative to the stage's folder and without usd-core's object names."""
    line = " ".join(message.split())
    line = re.sub(r" \(instantiating stage on stage .*?>\)", "", line)
    line = re.sub(r" matching \S*pxrInternal\S*", "", line)
    line = re.sub(r",?@anon:0x[0-9a-f]+[^@]*@", "", line)  # the session layer
    for folder in (path.parent, path.resolve().parent):
        line = line.replace(f"{folder}/", "")
    return line if len(line) <= 300 else line[:299] + "…"


def _without_format(message: str) -> str:
    """What to do with a layer of a format that usd-core does not read; empty for other messages."""
    match = re.search(r"Cannot determine file format for @(.+?)(?::SDF_FORMAT_ARGS\b.*)?@", message)
    if not match:
        return ""
    name = re.split(r"[/\\]", match[1])[-1]
    if name.lower().endswith(file_types.MESH):
        return f"write {name} as .usdc by `maquette convert`, and refer to that"
    return foreign_formats.advice(name)
