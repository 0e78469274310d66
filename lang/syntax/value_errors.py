"""Messages for syntax errors inside expressions: numbers, operators, arguments, lists, choices."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

from ..units import UNITS
from .error_site import VALUES, Answer, ErrorSite, ends_value, is_end, quote, starts_value
from .grammar import Token
from .lexer import CLOSERS, COMPARISONS, KEYWORDS, OPENERS, OPERATORS

_PAIRS = {
    "**": "write `^`",
    "||": "write `or`",
    "=>": "write `>=`; a function is written |x| x + 1",
    "->": "a function is written |x| x + 1",
    "=<": "write `<=`",
    "===": "write `==`",
    "!==": "write `!=`",
    "...": "write `..` for a range",
    "++": "names are bound once, with `let`",
    "+=": "names are bound once, with `let`",
    "-=": "names are bound once, with `let`",
    "*=": "names are bound once, with `let`",
    "/=": "names are bound once, with `let`",
    ":=": "write `=` after let and param, `:` in arguments",
}


def equals(site: ErrorSite) -> Answer | None:
    """`=` in place of `:`, `==` or `let`."""
    token, before = site.token, site.near(-1)
    if token != "=":
        return None
    inside = site.inside()
    if before in ("=", ":"):
        return None
    if inside == "call" and before.type == "NAME":
        return "arguments are written with `:`, not `=`", f"write {_with_colons(site)}", token
    if inside == "" and site.at == site.first + 1 and before.type == "NAME":
        if _is_bound(site, before):
            return f"`{before}` is bound once, with `let`, and keeps its value", f"write let {before}2 = … for another value", site.start
        return "a name is bound with `let`", f"write let {before} = …", site.start
    if inside == "" and site.near(-2) == ".":
        return "an element is not changed after it is made", f"write {before} as an argument, as in sphere(1, {before}: …)", token
    if inside == "" and site.start.type == "NAME":
        return "only `let` and `param` bind with `=`", "write let name(…) = …", token
    return "`=` binds a name; values are compared with `==`", "write `==`", token


def _is_bound(site: ErrorSite, name: str) -> bool:
    """Whether a name that is assigned to is bound in the file, or is in its own new value."""
    for i in range(site.at + 1, len(site.stream)):
        if site.stream[i].type in ("_NL", "$END"):
            break
        if site.stream[i] == name and site.stream[i].type == "NAME":
            return True
    is_bound = name in bound_names(site.stream)
    if not is_bound:
        site.unbound.add(str(name))
    return is_bound


def bound_names(stream: Sequence[Token]) -> set[str]:
    """The names after `let` and `param`."""
    return {str(following) for token, following in itertools.pairwise(stream) if token in ("let", "param")}


def _with_colons(site: ErrorSite) -> str:
    """The arguments of a call from this `=` on that have one, each with a `:`."""
    names, depth = [], 0
    for i in range(site.at, len(site.stream)):
        token = site.stream[i]
        depth += (token in OPENERS) - (token in CLOSERS)
        if depth < 0 or token.type == "_NL":
            break
        if depth == 0 and token == "=" and site.stream[i - 1].type == "NAME":
            names.append(f"{site.stream[i - 1]}: …")
    return ", ".join(names)


def colon(site: ErrorSite) -> Answer | None:
    """`:` in place of `=`, or after an expression."""
    token, before = site.token, site.near(-1)
    if site.inside() == "parameters" and before == ":" and token.type in VALUES:
        name = site.near(-2)
        return "a default is written with `=`, not `:`", f"write {name} = {token}", before
    if token != ":":
        return None
    if site.inside() == "" and site.at == site.first + 1 and before.type == "NAME":
        return "a name is bound with `let` and `=`", f"write let {before} = …; arguments are inside ( )", token
    if site.inside() in ("call", "list") and before.type != "NAME":
        return "only a name can precede `:`", "write name: value", token
    return "`:` follows the name of an argument or precedes a type", "", token


def space_before_unit(site: ErrorSite) -> Answer | None:
    """A space between a number and its unit."""
    number, unit = site.near(-1), site.token
    if number.type == "NUMBER" and number[-1].isdigit() and unit in UNITS and not starts_value(site.near(1)):
        return "a unit directly follows its number", f"write {number}{unit}", unit
    return None


def decimal_point(site: ErrorSite) -> Answer | None:
    """A decimal point without a digit on both sides."""
    token, before, following = site.token, site.near(-1), site.near(1)
    if before == "." and before.type == "DOT" and site.near(-2).type == "NUMBER":
        number = site.near(-2)
        return "a digit is missing after the point", f"write {number}.0 or {number}", before
    if token == "." and following.type == "NUMBER":
        return "a number begins with a digit", f"write 0.{following}", token
    return None


def number_suffix(site: ErrorSite) -> Answer | None:
    """A number directly followed by a number or a name that is not a unit."""
    number, token = site.near(-1), site.token
    if number.type != "NUMBER" or token.start_pos != number.end_pos or token.type not in ("NUMBER", "NAME"):
        return None
    joined, end = str(number), number.end_pos
    for each in site.stream[site.at :]:
        if each.start_pos != end:
            break
        joined, end = joined + each, each.end_pos
    if color := re.match(r"0x([0-9a-fA-F]{6})(?![0-9a-zA-Z])", joined):
        return f"`0x{color[1]}` is not a number", f"write #{color[1]} for a colour", number
    if number[-1] == "x" and token.type == "NUMBER":
        return f"`{number}{token}` is not a number", f"write [{number[:-1]}, {token}] for a size; a colour is #rrggbb", number
    return f"`{number}{token}` is not a number", "a number is digits and a unit: 1000mm", number


def _arrow(site: ErrorSite, position: int) -> bool:
    """Whether an arrow follows the bracket that opens at `position`, as after the parameters of a function in other languages."""
    following = itertools.dropwhile(lambda token: token != ")", site.stream[position:])
    return tuple(itertools.islice(following, 1, 3)) in (("=", ">"), ("-", ">"))


def list_in_parentheses(site: ErrorSite) -> Answer | None:
    """A `,` inside parentheses or outside all brackets."""
    before, following = site.near(-1), site.near(1)
    if site.token == "," and site.inside() == "group":
        i = site.opener()
        assert i is not None
        if _arrow(site, i):
            return "a function's parameters are between bars", "write |x, y, z| …, without an arrow", site.stream[i]
        return "a list is written in square brackets", "write [x, y, z]", site.stream[i]
    if site.token == "," and site.inside() == "":
        if site.near(-1) in (")", "}") and site.near(1).type == "NAME" and site.start not in KEYWORDS:
            return "`;` or the end of the line separates items, not `,`", "write ; here, or a new line", site.token
        near = before.type == following.type == "NUMBER" and before.end_pos == (following.start_pos or 0) - 1
        if near and (before == "0" or len(following) != 3):  # not a thousand
            return "a fraction is written with a point", f"write {before}.{following}; a list is [{before}, {following}]", before
        if is_end(following) or following.line != site.token.line:
            return "a `,` is only allowed inside ( ) and [ ]", "delete it", site.token
        return "a `,` is only allowed inside ( ) and [ ]", "write 1.5 for a fraction, [1, 5] for a list", site.token
    return None


def foreign_operator(site: ErrorSite) -> Answer | None:
    """An operator of another language that consists of two tokens."""
    for first, second in ((site.near(-1), site.token), (site.token, site.near(1))):
        pair = f"{first}{second}"
        if pair in _PAIRS and first.end_pos == second.start_pos:
            before = site.near(-1) if first is site.token else site.near(-2)
            hint = _PAIRS[pair]
            if pair == ":=" and before is site.start and before.type == "NAME":
                hint = f"write let {before} = …"
            elif pair == "=>" and before == ")":
                hint = _PAIRS["->"]
            return f"the language has no `{pair}`", hint, first
    return None


def chained_comparison(site: ErrorSite) -> Answer | None:
    """A second comparison or `..` in an expression."""
    token = site.token
    if token == "..":
        return "a range has two ends", "write a..b", token
    if token in COMPARISONS and ends_value(site.near(-1)):
        return "comparisons can't be chained", "write a < b and b < c", token
    return None


def incomplete_choice(site: ErrorSite) -> Answer | None:
    """`if` without `then` or `else`."""
    depth = 0
    for i in range(site.at - 1, site.first - 1, -1):
        token = site.stream[i]
        depth += (token in CLOSERS) - (token in OPENERS)
        if depth < 0:
            return None
        if depth == 0 and token == "then" and "ELSE" in site.expected:
            last = site.token if not is_end(site.token) else token
            return "this `if` has no `else`", "write if … then … else …", last
        if depth == 0 and token == "if" and "THEN" in site.expected:
            return "`then` is missing", "write if … then … else …", site.token if not is_end(site.token) else token
    return None


def missing_value(site: ErrorSite) -> Answer | None:
    """A missing operand, argument or list item."""
    token, before = site.token, site.near(-1)
    expects_value = "NUMBER" in site.expected
    if not expects_value:
        return None
    if before == "," and token == ",":
        return "a value is missing between the commas", "", token
    if (before in OPERATORS or before in ("=", ":", "in", "then", "else", "if", "|")) and (is_end(token) or token == ","):
        return f"a value is missing after `{before}`", "", before
    if before in ("(", "[") and (is_end(token) or token == ","):
        return f"a value is missing after `{before}`", "", before
    if token in OPERATORS or token in (",", "="):
        magnitude = before == "|" and site.near(-3) == "|" and site.near(-4) == "|"
        hint = f"an absolute value is written abs({site.near(-2)})" if magnitude else "write `!=`" if (before, token) == ("<", ">") else ""
        return f"a value is missing before `{token}`", hint, token
    if token == "{":
        return "a value can't begin with `{`", "a list is written [a, b], a part group() { … }", token
    return None


def two_values(site: ErrorSite) -> Answer | None:
    """Two values without an operator or a separator."""
    token, before = site.token, site.near(-1)
    if not ends_value(before) or not (starts_value(token) or token in ("if", "|", "not")):
        return None
    if token == "if":
        return "a choice begins with its `if`", "write if condition then a else b", token
    inside = site.inside()
    if token == "|" and before in ("x", "y", "z"):
        return "the `|` before a formula's parameters is missing", "write |x, y, z| …", token
    if before in ("x", "y", "z") and "VBAR" in site.expected and "COMMA" in site.expected:
        return "the `|` after a formula's parameters is missing", "write |x, y, z| …", token
    if before == "lambda":
        return "a function is written |x| x + 1", "write |x, y, z| … in place of lambda x, y, z: …", before
    if token.type == "STRING" and before in ("f", "r", "b") and before.end_pos == token.start_pos:
        return f"a string has no `{before}` before it", 'write "n = " + string(3) for a number in it', before
    if inside == "call" and before.type == "NAME" and site.near(-2) in ("(", ","):
        return f"`:` is missing after `{before}`", f"write {before}: {token}" if token.type in VALUES else "", token
    if "VBAR" in site.expected and "COMMA" in site.expected:
        return f"a `,` or the closing `|` is missing before {quote(token)}", "a function is written |x, y| x + y", token
    if inside in ("call", "list", "parameters"):
        return f"a `,` is missing before {quote(token)}", "", token
    if inside in ("condition", "group", "loop", "index"):
        return f"an operator is missing before {quote(token)}", "", token
    if site.start.type == "NAME" and site.at == site.first + 1:
        written = f"{before}({token}: …)" if site.near(1) == ":" else f"{before}({token})"
        return "arguments are written in parentheses", f"write {written}" if token.type in VALUES else "", token
    return f"an operator or the end of the line is missing before {quote(token)}", "write each item on a line of its own", token
