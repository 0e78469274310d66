"""Trivia: attaches comments and blank lines to the items of the syntax tree."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from . import ast

Place = tuple[int, int]  # line, column


def _place(comment: ast.Comment) -> Place:
    return comment.span.line, comment.span.column


class Comments:
    """The comments of a file that are not attached yet, in source order."""

    def __init__(self, comments: Sequence[ast.Comment] = ()) -> None:
        self._rest = sorted(comments, key=_place)

    def attach(self, items: Sequence[ast.Item], start: Place, end: Place) -> tuple[tuple[ast.Item, ...], tuple[ast.Comment, ...]]:
        """The items of a block with their comments, and the comments after the last item.

        A comment above an item or inside its expression becomes `before`; one after it on its last line becomes `after`.
        The comments of blocks inside the items are attached already.
        """
        comments = deque(self._take(start, end))
        done: list[ast.Item] = []
        line = start[0]  # the last line with an item
        for item, following in zip(items, [*items[1:], None], strict=False):
            item_end = (item.span.end_line, item.span.end_column)
            before: list[ast.Comment] = []
            while comments and _place(comments[0]) < item_end:
                before.append(comments.popleft())
            next_start = (following.span.line, following.span.column) if following else end
            on_last_line = bool(comments) and comments[0].span.line == item_end[0] and _place(comments[0]) < next_start
            after = comments.popleft() if on_last_line else None
            first = min([item.span.line, *(c.span.line for c in before)])
            done.append(replace(item, before=tuple(before), after=after, blank_before=0 < line < first - 1))
            line = item_end[0]
        return tuple(done), tuple(comments)

    def _take(self, start: Place, end: Place) -> list[ast.Comment]:
        i, j = (bisect_left(self._rest, p, key=_place) for p in (start, end))
        comments = self._rest[i:j]
        del self._rest[i:j]
        return comments
