"""Incremental parser: parses the texts of a file edit after edit. Items that an edit leaves alone keep their trees.

A text is cut at lines that begin with an item. A closed segment is parsed without the others. Where a segment depends on others, as one
with an open `{` at the end of the file does, the whole text is parsed.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..diagnostics import Diagnostics, Span
from . import ast
from .lexer import CLOSERS, MAX_MISTAKES, MAX_NESTING, OPENERS
from .line_joining import MAX_BRACKET_ERRORS
from .parser import Segment, file_of, is_too_large, parse, parse_segment
from .relocation import moved

# The lines at which a text is cut. No item begins with the excluded words: a line that does may continue the line above.
_STARTS = re.compile(r"^(?!(?:else|then|and|or|in|as)\b)(?=[A-Za-z_])", re.MULTILINE)
_CLOSES_PARENTHESES = re.compile(r"(?:let|param|use|unit)\b")  # and brackets that are open at the end of the line above
_MAX_TRIES = 5  # extents of a segment; then it goes to the end of the text


class IncrementalParser:
    """The parser of a file `name`. It keeps the segments of the last text."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._table = _SegmentTable()
        self._attachments: dict[int, _Attachment] = {}

    def parse(self, text: str, diagnostics: Diagnostics) -> ast.File:
        """As `parser.parse`, with an equal tree and equal messages. Items that are unchanged since the last text are the same objects."""
        if is_too_large(text, self.name, diagnostics):
            return ast.File(Span(self.name), self.name, text, ())
        cut = _Cut(text.removeprefix("\ufeff"), self.name, self._table)
        if not cut.covers_text or not _are_independent(cut.segments):
            return parse(text, self.name, diagnostics)
        attachments = _attached(cut.segments, self._attachments)
        self._table, self._attachments = cut.table, {id(each.segment): each for each in attachments}
        return file_of(text, self.name, [each.attached for each in attachments], diagnostics)


class _SegmentTable:
    """Segments by their first part, up to the second line at which a text is cut, and by the line of their start."""

    def __init__(self) -> None:
        self._segments: dict[str, dict[int, Segment]] = {}

    def add(self, part: str, segment: Segment) -> None:
        self._segments.setdefault(part, {})[segment.line] = segment

    def starting(self, part: str, line: int) -> Iterator[Segment]:
        """The segment that begins with `part` in `line`, and one in another line."""
        if lines := self._segments.get(part):
            if line in lines:
                yield lines[line]
            yield next(iter(lines.values()))


class _Cut:
    """A text as segments, those of `before` where they fit. They cover it unless one would depend on those before it."""

    def __init__(self, text: str, name: str, before: _SegmentTable) -> None:
        self.text, self.name = text, name
        self.starts = [0, *(match.start() for match in _STARTS.finditer(text) if match.start()), len(text)]
        self.last = len(self.starts) - 1
        self.segments: list[Segment] = []
        self.table = _SegmentTable()
        k, line = 0, 1
        while k < self.last:
            part = self._part(k, k + 1)
            segment, end = self._reused(k, line, before.starting(part, line)) or self._parsed(k, line)
            if segment is None:
                break
            self.table.add(part, segment)
            self.segments.append(segment)
            k, line = end, line + segment.text.count("\n")
        self.covers_text = k == self.last

    def _part(self, first: int, last: int) -> str:
        return self.text[self.starts[first] : self.starts[last]]

    def _reused(self, k: int, line: int, candidates: Iterator[Segment]) -> tuple[Segment, int] | None:
        """A segment of `candidates` that fits at start `k`, and the start behind it."""
        for segment in candidates:
            end = self.starts[k] + len(segment.text)
            following = bisect_left(self.starts, end, k)
            is_cut_there = following <= self.last and self.starts[following] == end
            can_end_there = segment.is_closed or (following == self.last and _can_end_file(segment))
            if is_cut_there and can_end_there and self.text.startswith(segment.text, self.starts[k]):
                return moved(segment, line) or parse_segment(segment.text, self.name, line), following
        return None

    def _parsed(self, k: int, line: int) -> tuple[Segment | None, int]:
        """The first closed segment from start `k` on, or the rest of the text; None if that depends on the segments before."""
        end = k + 1
        for tries in range(1, _MAX_TRIES + 2):
            segment = parse_segment(self._part(k, end), self.name, line)
            if segment.is_closed or (end == self.last and (k == 0 or _can_end_file(segment))):
                return segment, end
            if end == self.last:
                break
            end = self._next_end(k, end, segment.scan.open_at_end) if tries < _MAX_TRIES else self.last
            if end == self.last and k and "{" in segment.scan.open_at_end and _depth(self._part(k, end)) > 0:
                break  # the rest would not be closed either
        return None, k

    def _next_end(self, k: int, end: int, opened: str) -> int:
        """A later end for a segment that is not closed. `opened` are the brackets that are open at `end`."""
        if not opened:
            return min(self.last, 2 * end - k)
        depth = _depth(self._part(k, end))
        for following in range(end, self.last):
            part = self._part(following, following + 1)
            depth += _depth(part)
            if depth <= 0 or ("{" not in opened and _CLOSES_PARENTHESES.match(part)):
                return following + 1
        return self.last


def _depth(text: str) -> int:
    """About how many brackets are open at the end of a text: those of strings and comments count."""
    return sum(map(text.count, OPENERS)) - sum(map(text.count, CLOSERS))


def _can_end_file(segment: Segment) -> bool:
    """Whether a segment that is not closed depends only on the end of the file. The repair of an open `{` reads the whole file."""
    return segment.is_complete and "{" not in segment.scan.open_at_end


def _are_independent(segments: Sequence[Segment]) -> bool:
    """Whether no limit and no name of one segment changes the messages of another."""
    scans = [segment.scan for segment in segments]
    unbound = frozenset().union(*(segment.unbound for segment in segments))
    return (
        sum(scan.mistakes for scan in scans) < MAX_MISTAKES
        and sum(scan.bracket_errors for scan in scans) < MAX_BRACKET_ERRORS
        and sum(scan.depth for scan in scans) + max((scan.deepest for scan in scans), default=0) <= MAX_NESTING
        and not any(unbound & segment.bound for segment in segments if unbound)
    )


class _Attachment(NamedTuple):
    """A segment without and with the comments and the blank line above its first item."""

    segment: Segment
    comments: tuple[ast.Comment, ...]
    blank_before: bool
    attached: Segment


def _attached(segments: Sequence[Segment], before: dict[int, _Attachment]) -> list[_Attachment]:
    """The segments with the comments and blank lines between them at their first items. `before` has those of the last text, by `id`."""
    attachments: list[_Attachment] = []
    comments: tuple[ast.Comment, ...] = ()
    line = 0  # the last line with an item
    for segment in segments:
        above, blank_before = (), False
        if segment.items:
            above, comments = comments, segment.dangling
            first = segment.items[0]
            top = min([first.span.line, *(comment.span.line for comment in (*above, *first.before))])
            blank_before, line = 0 < line < top - 1, segment.items[-1].span.end_line
        else:
            comments += segment.dangling
        attachment = before.get(id(segment))
        if attachment is None or attachment[1:3] != (above, blank_before):
            attached = segment
            if above or blank_before:
                head = replace(first, before=(*above, *first.before), blank_before=blank_before)
                attached = segment._replace(items=(head, *segment.items[1:]))
            attachment = _Attachment(segment, above, blank_before, attached)
        attachments.append(attachment)
    last = attachments[-1]
    attachments[-1] = last._replace(attached=last.attached._replace(dangling=comments))
    return attachments
