"""Gives each comment and blank line to the item it belongs to."""

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
    """The comments of a file that no item has taken yet, in the order written."""

    def __init__(self, comments: Sequence[ast.Comment] = ()) -> None:
        self._left = sorted(comments, key=_place)

    def attach(self, items: Sequence[ast.Item], start: Place, end: Place) -> tuple[tuple[ast.Item, ...], tuple[ast.Comment, ...]]:
        """The items of a block with their comments, and the comments after the last item.

        A comment above an item or inside its expression goes before it; one behind it on its last line goes after it.
        Blocks inside the items have taken theirs already.
        """
        comments = deque(self._take(start, end))
        done: list[ast.Item] = []
        line = start[0]  # the last line something was written on
        for item, following in zip(items, [*items[1:], None], strict=False):
            item_end = (item.span.end_line, item.span.end_column)
            before: list[ast.Comment] = []
            while comments and _place(comments[0]) < item_end:
                before.append(comments.popleft())
            next_start = (following.span.line, following.span.column) if following else end
            behind = bool(comments) and comments[0].span.line == item_end[0] and _place(comments[0]) < next_start
            after = comments.popleft() if behind else None
            first = min([item.span.line, *(c.span.line for c in before)])
            done.append(replace(item, before=tuple(before), after=after, blank_before=0 < line < first - 1))
            line = item_end[0]
        return tuple(done), tuple(comments)

    def _take(self, start: Place, end: Place) -> list[ast.Comment]:
        i, j = (bisect_left(self._left, p, key=_place) for p in (start, end))
        taken = self._left[i:j]
        del self._left[i:j]
        return taken
