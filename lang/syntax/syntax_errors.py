"""Messages and fixes for syntax errors: the ordered list of rules."""

from __future__ import annotations

from collections.abc import Callable

from . import block_errors, item_errors, value_errors
from .error_site import Answer, ErrorSite, is_end, quote
from .lexer import CLOSERS


def explain(site: ErrorSite) -> Answer:
    """The message, the fix and the token that the message points at, by the first rule that applies."""
    for rule in _RULES:
        answer = rule(site)
        if answer:
            return answer
    return _fallback(site)


_RULES: tuple[Callable[[ErrorSite], Answer | None], ...] = (
    block_errors.choice,
    block_errors.step,
    item_errors.use,
    item_errors.unit,
    item_errors.foreign_word,
    item_errors.wrapper_without_braces,
    item_errors.vector_in_angles,
    item_errors.keyword_as_name,
    value_errors.foreign_operator,
    value_errors.decimal_point,
    value_errors.number_suffix,
    value_errors.space_before_unit,
    item_errors.binding,
    item_errors.block_words,
    item_errors.line_start,
    value_errors.equals,
    value_errors.colon,
    value_errors.incomplete_choice,
    value_errors.list_in_parentheses,
    item_errors.separator,
    block_errors.operand,
    value_errors.missing_value,
    value_errors.two_values,
    value_errors.chained_comparison,
)
_WANTED = {
    "EQUAL": "`=`", "COLON": "`:`", "COMMA": "`,`", "RPAR": "`)`", "RSQB": "`]`", "LPAR": "`(`", "LBRACE": "`{`",
    "IN": "`in`", "THEN": "`then`", "ELSE": "`else`", "VBAR": "`|`", "NAME": "a name", "STRING": "a string",
}  # fmt: skip


def _fallback(site: ErrorSite) -> Answer:
    wanted = [text for kind, text in _WANTED.items() if kind in site.expected]
    hint = f"expected {' or '.join(wanted)}" if 0 < len(wanted) <= 3 else ""
    token = site.token
    if is_end(token) and token not in CLOSERS:
        before = site.near(-1)
        return f"something is missing after {quote(before)}", hint, before
    return f"{quote(token)} can't be here", hint, token
