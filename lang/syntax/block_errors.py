"""Messages for errors of block expressions: their items, their value, their place among operators."""

from __future__ import annotations

from collections.abc import Sequence

from ..diagnostics import Span
from . import ast
from .error_site import Answer, ErrorSite, ends_value
from .lexer import CLOSERS, KEYWORDS, OPENERS, OPERATORS

NO_LET = "this block has no `let`"
LIST_OR_PART = "a list is written [a, b], a part group() { … }"
_TOP_LEVEL = {"param": "write let name = …", "use": "write it at the top of the file", "unit": "write it at the top of the file"}


class WrongBlock(Exception):
    """A block expression without a `let`, or whose value is not its last item."""

    def __init__(self, message: str, hint: str, span: Span) -> None:
        super().__init__(message)
        self.message, self.hint, self.span = message, hint, span


def check_items(items: Sequence[ast.Item], block: Span) -> None:
    """Raise WrongBlock unless the items are one or more `let`s and a result in the last place."""
    opening = Span(block.file, block.line, block.column, block.line, block.column + 1)
    if not items:
        raise WrongBlock("an empty block has no value", "write { let a = 1; 2 * a }; an empty list is []", opening)
    results = [item for item in items if isinstance(item, ast.Result)]
    if len(results) == len(items):
        raise WrongBlock(NO_LET, f"delete the braces; {LIST_OR_PART}" if len(items) == 1 else LIST_OR_PART, opening)
    if not results:
        closing = Span(block.file, block.end_line, block.end_column - 1, block.end_line, block.end_column)
        raise WrongBlock("this block has no value", "write the value after the last `let`", closing)
    if results[0] is not items[-1]:
        raise WrongBlock("only the last item of this block can be a value", "write let name = … to keep it", results[0].span)
    before, result = items[-2].span, results[0]
    if _begins_with_sign(result.expression) and before.end_line < result.span.line:
        sign = Span(block.file, result.span.line, result.span.column, result.span.line, result.span.column + 1)
        raise WrongBlock("a line can't begin with `-`", "end the line above with the `-`, or write the value in parentheses", sign)


def _begins_with_sign(node: ast.Node) -> bool:
    while isinstance(node, ast.Binary):
        node = node.left
    return isinstance(node, ast.Unary) and node.op == "-"


def chooses_with_braces(site: ErrorSite) -> bool:
    """Whether this token is the `{` of `if (…) {` in the place of a value."""
    if site.token != "{" or site.near(-1) != ")":
        return False
    depth = 0
    for i in range(site.at - 1, site.first, -1):
        depth += (site.stream[i] in CLOSERS) - (site.stream[i] in OPENERS)
        if depth == 0:
            return site.stream[i - 1] == "if"
    return False


def choice(site: ErrorSite) -> Answer | None:
    """`if (…) { … } else { … }` in the place of a value."""
    if chooses_with_braces(site):
        return "`if (…) { … }` is a statement; a value is chosen with `then`", "write if … then … else …", site.token
    return None


def _begins_value(site: ErrorSite) -> bool:
    """Whether the item of `site` is a value in the first place of a block expression."""
    if site.first < 2 or site.stream[site.first - 1] != "{" or site.start in KEYWORDS or site.inside():
        return False
    before = site.stream[site.first - 2]
    return not ends_value(before) and before != "else"


def step(site: ErrorSite) -> Answer | None:
    """An item that places elements or belongs at the top level of a file; a list or a record in braces."""
    token = site.token
    if token in (",", ":") and _begins_value(site):
        return NO_LET, LIST_OR_PART, site.stream[site.first - 1]
    if site.at != site.first or "LET" not in site.expected or "FOR" in site.expected:
        return None
    if token == "for":
        return "a block that is a value has no `for`", "write [f(k) for k in 0..5]; `fold` and `scan` accumulate", token
    if token in _TOP_LEVEL:
        return f"`{token}` belongs at the top level of a file, not in a block", _TOP_LEVEL[token], token
    return None


def operand(site: ErrorSite) -> Answer | None:
    """A block expression as an operand, without parentheses."""
    token = site.token
    if token == "{" and "NUMBER" in site.expected and "let" in (site.near(1), site.near(2)):
        return "a block among operators is written in parentheses", "write ({ let … })", token
    if site.near(-1) == "}" and (token in OPERATORS or token in (".", "(", "[", "{")):
        return f"a block before `{token}` is written in parentheses", "write ({ let … })", token
    return None
