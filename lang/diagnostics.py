"""Source spans and diagnostics (errors, warnings, notes), with their text and JSON forms."""

from __future__ import annotations

import difflib
import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

MAX_SHOWN_LINE = 160
MAX_WORD = 200  # characters of a word that is compared with known ones
MAX_NAMES = 1000  # known names that a word is compared with


@dataclass(frozen=True, slots=True, order=True)
class Span:
    """A range of source text. Lines and columns count from 1; the end is exclusive.

    `file` is the displayed name: a path, `std/room`, or a USD prim such as `robot.usda</Robot/Arm>`.
    A span of a whole file or prim has line 0.
    """

    file: str
    line: int = 0
    column: int = 0
    end_line: int = 0
    end_column: int = 0

    def to(self, other: Span) -> Span:
        """The span from the start of this one to the end of `other`."""
        return replace(self, end_line=other.end_line, end_column=other.end_column)

    @property
    def in_library(self) -> bool:
        """Whether this is a place of the library, such as `std/room`."""
        return self.file.startswith("std/") and not self.file.endswith(".scene")

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One message. `hint` is the fix, printed after the carets. `trace` is the chain of calls, innermost first."""

    severity: str
    message: str
    span: Span | None = None
    hint: str = ""
    trace: tuple[tuple[str, Span], ...] = ()

    def to_json(self) -> dict[str, object]:
        """This diagnostic as plain data (the items of `check --json`)."""
        return {
            "severity": self.severity,
            "message": self.message,
            "hint": self.hint,
            "span": _span_json(self.span),
            "trace": [{"call": name, "span": _span_json(span)} for name, span in self.trace],
        }


MAX_MESSAGES = 8  # in the text of a SceneError


class SceneWarning(UserWarning):
    """The category of a warning about a scene or a picture, for Python's `warnings`."""


class SceneError(Exception):
    """Raised for input with errors. Carries all diagnostics so far, warnings included."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        errors = [d.message for d in self.diagnostics if d.severity == "error"]
        more = [f"and {len(errors) - MAX_MESSAGES} more"] if len(errors) > MAX_MESSAGES else []
        super().__init__("; ".join(errors[:MAX_MESSAGES] + more))


@dataclass(slots=True)
class Diagnostics:
    """The diagnostics of one run. Every stage appends to it."""

    items: list[Diagnostic] = field(default_factory=list)

    def error(self, message: str, span: Span | None = None, hint: str = "", trace: Iterable[tuple[str, Span]] = ()) -> None:
        self.items.append(Diagnostic("error", message, span, hint, tuple(trace)))

    def warning(self, message: str, span: Span | None = None, hint: str = "", trace: Iterable[tuple[str, Span]] = ()) -> None:
        self.items.append(Diagnostic("warning", message, span, hint, tuple(trace)))

    def note(self, message: str, span: Span | None = None, hint: str = "", trace: Iterable[tuple[str, Span]] = ()) -> None:
        self.items.append(Diagnostic("note", message, span, hint, tuple(trace)))

    @property
    def failed(self) -> bool:
        """Whether the list has an error."""
        return any(d.severity == "error" for d in self.items)

    def raise_if_failed(self) -> None:
        """Raise SceneError with all diagnostics if one is an error."""
        if self.failed:
            raise SceneError(self.items)


_MISSPELT, _SIMILAR = 0.8, 0.6  # similarity of words as difflib measures it
_SUGGESTED = 2  # names that have the word as a part


def suggest(word: str, names: Iterable[str]) -> str:
    """`did you mean …?` for a misspelt word, or for a part of names, as of `polished_brass`; an empty string without a similar name.

    Words of more than MAX_WORD characters, and more than MAX_NAMES names, are not compared.
    """
    known = list(itertools.islice(names, MAX_NAMES + 1))
    if len(word) > MAX_WORD or len(known) > MAX_NAMES:
        return ""
    near = difflib.get_close_matches(word, known, n=1, cutoff=_SIMILAR)
    if not near or difflib.SequenceMatcher(None, near[0], word).ratio() < _MISSPELT:
        near = [name for name in known if word in name.split("_")][:_SUGGESTED] or near
    return f"did you mean {' or '.join(f'`{name}`' for name in near)}?" if near else ""


def sort_diagnostics(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Diagnostics sorted by file (in order of first mention), then by position, without duplicates."""
    unique = list(dict.fromkeys(diagnostics))
    files: dict[str, int] = {}
    for d in unique:
        files.setdefault(d.span.file if d.span else "", len(files))
    return sorted(unique, key=lambda d: (files[d.span.file], d.span.line, d.span.column) if d.span else (files[""], 0, 0))


_PICTURES = {code: 0x2400 + code for code in range(32) if code != ord("\n")} | {127: 0x2421}
_PICTURES |= dict.fromkeys((*range(0x80, 0xA0), 0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)), 0xFFFD)


def render_text(d: Diagnostic, source: Callable[[str], str | None]) -> str:
    """The text form: place, severity, message; the source line with carets and hint; the chain of calls.

    `source(file)` returns the text of a file by its displayed name, or None. Characters of names and sources that control a terminal are
    shown as their pictures, and those that change the direction of text as U+FFFD.
    """
    place = f"{d.span}: " if d.span else ""
    lines = [f"{place}{d.severity}: {d.message}"]
    quoted = _quote(d.span, source) if d.span and d.span.line else None
    if quoted:
        text, carets = quoted
        lines += [text, f"{carets} {d.hint}".rstrip()]
    elif d.hint:
        lines.append(f"  {d.hint}")
    lines += [f"  in {name}, called at {span}" for name, span in d.trace]
    return "\n".join(lines).translate(_PICTURES)


@functools.lru_cache(maxsize=8)
def _rows(text: str) -> list[str]:
    return text.split("\n")


def _quote(span: Span, source: Callable[[str], str | None]) -> tuple[str, str] | None:
    text = source(span.file)
    rows = _rows(text) if text is not None else []
    if not 0 < span.line <= len(rows):
        return None
    row = rows[span.line - 1].rstrip("\r").replace("\t", " ")
    start = span.column - 1
    width = (span.end_column - span.column) if span.end_line == span.line else len(row) - start
    cut = max(0, start - MAX_SHOWN_LINE // 2) if len(row) > MAX_SHOWN_LINE else 0
    shown = row[cut : cut + MAX_SHOWN_LINE]
    width = max(1, min(width, len(shown) - (start - cut)))
    gutter = f"{span.line:>4} | "
    return f"{gutter}{shown}", " " * (len(gutter) - 2) + "| " + " " * (start - cut) + "^" * width


def _span_json(span: Span | None) -> dict[str, object] | None:
    if span is None:
        return None
    return {
        "file": span.file,
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }
