"""Says in plain words what is wrong where the grammar does not go on, and how to write it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

from lark import Token

from ..units import UNITS
from .lexer import CLOSERS, COMPARISONS, KEYWORDS, OPENERS, OPERATORS

_VALUE = frozenset(("NUMBER", "STRING", "COLOR", "NAME"))

_FOREIGN = {  # words of other languages that people begin a line with
    "import": 'write use "gear.scene"',
    "include": 'write use "gear.scene"',
    "def": "write let name(…) = …",
    "function": "write let name(…) = …",
    "fn": "write let name(…) = …",
    "var": "write let name = …",
    "const": "write let name = …",
    "return": "what stands behind the `=` of a `let` is its value",
    "while": "write for (k in 0..5) { … }; `fold` and `scan` accumulate",
    "elif": "write else if (…) { … }",
    "elseif": "write else if (…) { … }",
}

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

_SOLIDS = {"+": "union", "-": "difference", "*": "intersection", "/": "difference"}  # what signs between solids are meant for

Answer = tuple[str, str, Token]  # message, hint, where


@dataclass(frozen=True, slots=True)
class Place:
    """Token `at` of a stream, where the item that begins at `first` cannot go on; `expected` are lark's terminals that could."""

    stream: list[Token]
    at: int
    first: int
    expected: set[str]

    @property
    def token(self) -> Token:
        return self.stream[self.at]

    @property
    def start(self) -> Token:
        return self.stream[self.first]

    def near(self, offset: int) -> Token:
        """A token before or behind; an empty one outside of the item's reach."""
        i = self.at + offset
        return self.stream[i] if self.first <= i < len(self.stream) else Token("", "")

    def word(self) -> str:
        """The token with all that follows it without a space."""
        end = self.at + 1
        while self.stream[end].start_pos == self.stream[end - 1].end_pos and self.stream[end].type not in ("_NL", "$END"):
            end += 1
        return "".join(self.stream[self.at : end])

    def opener(self) -> int | None:
        """Index of the innermost bracket of the item that is open here."""
        depth = 0
        for i in range(self.at - 1, self.first - 1, -1):
            token = self.stream[i]
            if token in CLOSERS:
                depth += 1
            elif token in OPENERS:
                if depth == 0:
                    return i
                depth -= 1
        return None

    def inside(self) -> str:
        """What is open here: `call`, `parameters`, `condition`, `loop`, `group`, `list`, `index`, or nothing."""
        i = self.opener()
        if i is None:
            return ""
        before = self.stream[i - 1] if i > self.first else Token("", "")
        if self.stream[i] == "[":
            return "index" if _ends_value(before) else "list"
        if before in ("if", "for"):
            return "condition" if before == "if" else "loop"
        if i == self.first + 2 and self.start == "let":
            return "parameters"
        return "call" if _ends_value(before) else "group"


def explain(place: Place) -> Answer:
    """The message, the fix and the token it points at."""
    for rule in _RULES:
        answer = rule(place)
        if answer:
            return answer
    return _fallback(place)


def _ends_value(token: Token) -> bool:
    return (token.type in _VALUE) or token in (")", "]", "}")


def _starts_value(token: Token) -> bool:
    return token.type in _VALUE or token in ("(", "[")


def _shown(token: Token) -> str:
    if token.type == "$END":
        return "the end of the file"
    if token.type == "_NL":
        return "`;`" if ";" in token else "the end of the line"
    text = str(token)
    return f"`{text}`" if len(text) <= 40 else f"`{text[:37]}…`"


def _is_end(token: Token) -> bool:
    return token.type in ("$END", "_NL") or token in (")", "]", "}")


# --- items ----------------------------------------------------------------------------------------------------------


def _use(place: Place) -> Answer | None:
    if place.start != "use":
        return None
    if place.at == place.first + 1:
        if place.token.type == "NAME":
            path = place.word()
            fix = f'write use "{path}"' if "/" in path or "." in path else f'write use "std/{path}" or use "{path}.scene"'
            return "the file after `use` is written in quotes", fix, place.token
        return "`use` wants a file", 'write use "std/room" or use "gear.scene"', place.start
    if place.near(-1) == "as":
        return "`as` wants a name", 'write use "robot.usdz" as robot', place.near(-1)
    if place.at == place.first + 2 and place.token.type == "NAME":
        return f"`as` is missing before `{place.token}`", f"write as {place.token}", place.token
    return None


def _unit(place: Place) -> Answer | None:
    if place.start == "unit" and place.at == place.first + 1:
        return "`unit` wants a unit of length", "write unit mm", place.start if _is_end(place.token) else place.token
    return None


def _foreign_word(place: Place) -> Answer | None:
    start = place.start
    if start in _FOREIGN and place.at == place.first + 1 and start.type == "NAME":
        return f"the language has no `{start}`", _FOREIGN[start], start
    return None


def _keyword_as_name(place: Place) -> Answer | None:
    token = place.token
    binding = place.near(-1) in ("let", "param", "unit", "as", ".")
    naming = place.near(1) in (":", "=") and "NAME" in place.expected
    if token in KEYWORDS and (binding or naming):
        return f"`{token}` is a word of the language and can't be a name", "choose another name", token
    if token in ("for", "in", "use", "unit", "as", "param") and "NUMBER" in place.expected and place.at > place.first:
        return f"`{token}` is a word of the language, no value", "", token
    return None


def _binding(place: Place) -> Answer | None:
    start, token = place.start, place.token
    if start not in ("let", "param"):
        return None
    name = place.stream[place.first + 1]
    if place.at == place.first + 1:
        if token.type == "NUMBER":
            return f"a name begins with a letter, not as `{token}`", "", token
        return f"`{start}` wants a name", f"write {start} size = 3", start if _is_end(token) else token
    if place.at == place.first + 2:
        if token == ",":
            return f"`{start}` binds one name", f"write a line for each: {start} {name} = …", token
        if token == ":" or token == "==":
            return f"`{start}` takes `=`, not `{token}`", f"write {start} {name} = …", token
        if token == "-" and token.start_pos == name.end_pos and place.near(1).type == "NAME":
            return "a name has no `-`", f"write {name}_{place.near(1)}", token
        if start == "param" and token == "(":
            return "a `param` takes no parameters", f"write let {name}(…) = …", token
        if token.type in _VALUE or token in ("-", "[", "|", "not"):
            return f"`=` is missing after `{start} {name}`", f"write {start} {name} = …", token
        if _is_end(token):
            return f"`{start} {name}` has no value", f"write {start} {name} = …", name
        if token == "{":
            return f"`=` is missing after `let {name}`", f"write let {name} = group() {{ … }}", token
    if start == "param" and place.near(-1) == ":" and token.type != "NAME" and place.at == place.first + 3:
        return "a type is wanted behind the `:`", f"write param {name} = … or param {name}: int = …", token
    if start == "param" and token == ":" and place.opener() is None:
        return "a `param` takes its value with `=`", f"write param {name} = …", token
    if "EQUAL" in place.expected and place.inside() == "":
        written = f"let {name}(…)" if start == "let" else f"param {name}: {place.near(-1)}"
        return f"`=` is missing before the value of `{name}`", f"write {written} = …", token if not _is_end(token) else name
    if start == "let" and token == "in" and place.inside() == "":
        return "only a `param` has a range", f"write param {name} = …", token
    if start == "param" and "STRING" in place.expected and _starts_value(token):
        return "what a `param` is for stands in quotes", f'write param {name} = … "what it is for"', token
    return None


def _block_words(place: Place) -> Answer | None:
    start, token = place.start, place.token
    if start == "else" and place.at == place.first:
        return "this `else` has no `if`", "write if (…) { … } else { … }", token
    if place.near(-1) == "if" and place.near(-2) == "else" and place.inside() == "" and place.token != "(":
        return "`if` wants its condition in parentheses", "write else if (…) { … }", token if not _is_end(token) else place.near(-1)
    if start not in ("if", "for"):
        return None
    form = "if (…) { … }" if start == "if" else "for (k in 0..5) { … }"
    if place.at == place.first + 1:
        what = "its condition" if start == "if" else "its name and list"
        return f"`{start}` wants {what} in parentheses", f"write {form}", token if not _is_end(token) else start
    if place.inside() == "loop" and place.near(-1).type == "NAME" and "IN" in place.expected:
        return "`for` wants `in` after its name", f"write {form}", token
    if place.inside() == "loop" and place.near(-1) == "(":
        return "`for` wants a name", f"write {form}", token
    if place.near(-1) == ")" and "LBRACE" in place.expected and len(place.expected) == 1:
        if token == "then":
            return "`if … then … else …` is a value, this `if` stands by itself", f"write {form}", token
        return f"`{start}` wants a block", f"write {form}", token if not _is_end(token) else start
    if place.near(-1) == "else":
        return "`else` wants a block or another `if`", "write else { … }", place.near(-1)
    return None


def _line_start(place: Place) -> Answer | None:
    token = place.token
    if place.at != place.first:
        if token in OPERATORS and place.inside() == "" and place.start not in KEYWORDS:
            both = place.near(-1) == ")" and place.near(1).type == "NAME" and place.near(2) == "("
            hint = f"solids are combined as {_SOLIDS[token]} {{ …; … }}" if both and token in _SOLIDS else "write let name = … to keep it"
            return "this line is a value, and only elements can be placed", hint, token
        return None
    if token in OPERATORS or token in (",", "=", ":", ".", "|"):
        return f"a line can't begin with `{token}`", f"end the line above with the `{token}`" if token not in ("|", "not") else "", token
    if token in KEYWORDS:
        return f"a line can't begin with `{token}`", "", token
    if token == "{":
        return "this `{` has nothing to belong to", "write group() { … }", token
    return None


# --- inside expressions ---------------------------------------------------------------------------------------------


def _equals(place: Place) -> Answer | None:
    token, before = place.token, place.near(-1)
    if token != "=":
        return None
    inside = place.inside()
    if before in ("=", ":"):
        return None
    if inside == "call" and before.type == "NAME":
        return "arguments are written with `:`, not `=`", f"write {before}: …", token
    if inside == "" and place.at == place.first + 1 and before.type == "NAME":
        return "a name is bound with `let`", f"write let {before} = …", place.start
    if inside == "" and place.start.type == "NAME":
        return "only `let` and `param` bind with `=`", "write let name(…) = …", token
    return "`=` binds a name; values are compared with `==`", "write `==`", token


def _colon(place: Place) -> Answer | None:
    token, before = place.token, place.near(-1)
    if place.inside() == "parameters" and before == ":" and token.type in _VALUE:
        name = place.near(-2)
        return "a default is written with `=`, not `:`", f"write {name} = {token}", before
    if token != ":":
        return None
    if place.inside() == "" and place.at == place.first + 1 and before.type == "NAME":
        return "a name is bound with `let` and `=`", f"write let {before} = …; arguments stand inside ( )", token
    if place.inside() in ("call", "list") and before.type != "NAME":
        return "only a name stands before `:`", "write name: value", token
    return "`:` stands only behind the name of an argument or before a type", "", token


def _space_before_unit(place: Place) -> Answer | None:
    number, unit = place.near(-1), place.token
    if number.type == "NUMBER" and number[-1].isdigit() and unit in UNITS and not _starts_value(place.near(1)):
        return "a unit stands right behind its number", f"write {number}{unit}", unit
    return None


def _number_dots(place: Place) -> Answer | None:
    token, before, behind = place.token, place.near(-1), place.near(1)
    if before == "." and before.type == "DOT" and place.near(-2).type == "NUMBER":
        number = place.near(-2)
        return "a digit is missing after the point", f"write {number}.0 or {number}", before
    if token == "." and behind.type == "NUMBER":
        return "a number begins with a digit", f"write 0.{behind}", token
    return None


def _number_goes_on(place: Place) -> Answer | None:
    number, token = place.near(-1), place.token
    if number.type != "NUMBER" or token.start_pos != number.end_pos or token.type not in ("NUMBER", "NAME"):
        return None
    if number[-1] == "x" and token.type == "NUMBER":
        return f"`{number}{token}` is no number", f"write [{number[:-1]}, {token}] for a size; a colour is #rrggbb", number
    return f"`{number}{token}` is no number", "a number is digits with a unit behind them: 1000mm", number


def _arrow(place: Place, at: int) -> bool:
    """Whether the bracket that opens at `at` closes before an arrow, as that of another language's parameters."""
    behind = itertools.dropwhile(lambda token: token != ")", place.stream[at:])
    return tuple(itertools.islice(behind, 1, 3)) in (("=", ">"), ("-", ">"))


def _list_in_parentheses(place: Place) -> Answer | None:
    before, behind = place.near(-1), place.near(1)
    if place.token == "," and place.inside() == "group":
        i = place.opener()
        assert i is not None
        if _arrow(place, i):
            return "a function's parameters stand between bars", "write |x, y, z| …, without an arrow", place.stream[i]
        return "a list is written in square brackets", "write [x, y, z]", place.stream[i]
    if place.token == "," and place.inside() == "":
        if place.near(-1) in (")", "}") and place.near(1).type == "NAME" and place.start not in KEYWORDS:
            return "things are not parted by `,` but by `;` or the end of the line", "write ; here, or a new line", place.token
        near = before.type == behind.type == "NUMBER" and before.end_pos == (behind.start_pos or 0) - 1
        if near and (before == "0" or len(behind) != 3):  # not a thousand
            return "a fraction is written with a point", f"write {before}.{behind}; a list is [{before}, {behind}]", before
        return "a `,` stands only inside ( ) and [ ]", "write 1.5 for a fraction, [1, 5] for a list", place.token
    return None


def _doubled(place: Place) -> Answer | None:
    for first, second in ((place.near(-1), place.token), (place.token, place.near(1))):
        pair = f"{first}{second}"
        if pair in _PAIRS and first.end_pos == second.start_pos:
            return f"the language has no `{pair}`", _PAIRS[pair], first
    return None


def _chain(place: Place) -> Answer | None:
    token = place.token
    if token == "..":
        return "a range has two ends", "write a..b", token
    if token in COMPARISONS and _ends_value(place.near(-1)):
        return "comparisons can't be chained", "write a < b and b < c", token
    return None


def _choice(place: Place) -> Answer | None:
    depth = 0
    for i in range(place.at - 1, place.first - 1, -1):
        token = place.stream[i]
        depth += (token in CLOSERS) - (token in OPENERS)
        if depth < 0:
            return None
        if depth == 0 and token == "then" and "ELSE" in place.expected:
            at = place.token if not _is_end(place.token) else token
            return "this `if` has no `else`", "write if … then … else …", at
        if depth == 0 and token == "if" and i > place.first and "THEN" in place.expected:
            return "`then` is missing", "write if … then … else …", place.token if not _is_end(place.token) else token
    return None


def _missing_value(place: Place) -> Answer | None:
    token, before = place.token, place.near(-1)
    expects_value = "NUMBER" in place.expected
    if not expects_value:
        return None
    if before == "," and token == ",":
        return "a value is missing between the commas", "", token
    if (before in OPERATORS or before in ("=", ":", "in", "then", "else", "if", "|")) and (_is_end(token) or token == ","):
        return f"a value is missing after `{before}`", "", before
    if before in ("(", "[") and (_is_end(token) or token == ","):
        return f"a value is missing after `{before}`", "", before
    if token in OPERATORS or token in (",", "="):
        magnitude = before == "|" and place.near(-3) == "|" and place.near(-4) == "|"
        hint = f"a magnitude is written abs({place.near(-2)})" if magnitude else "write `!=`" if (before, token) == ("<", ">") else ""
        return f"a value is missing before `{token}`", hint, token
    if token == "{":
        return "a value can't begin with `{`", "a list is written [a, b], a part group() { … }", token
    return None


def _two_values(place: Place) -> Answer | None:
    token, before = place.token, place.near(-1)
    if not _ends_value(before) or not (_starts_value(token) or token in ("if", "|", "not")):
        return None
    if token == "if":
        return "a choice begins with its `if`", "write if condition then a else b", token
    inside = place.inside()
    if token == "|" and before in ("x", "y", "z"):
        return "the `|` before a formula's parameters is missing", "write |x, y, z| …", token
    if before in ("x", "y", "z") and "VBAR" in place.expected and "COMMA" in place.expected:
        return "the `|` behind a formula's parameters is missing", "write |x, y, z| …", token
    if before == "lambda":
        return "a function is written |x| x + 1", "write |x, y, z| … in place of lambda x, y, z: …", before
    if inside == "call" and before.type == "NAME" and place.near(-2) in ("(", ","):
        return f"`:` is missing after `{before}`", f"write {before}: {token}" if token.type in _VALUE else "", token
    if "VBAR" in place.expected and "COMMA" in place.expected:
        return f"a `,` or the closing `|` is missing before {_shown(token)}", "a function is written |x, y| x + y", token
    if inside in ("call", "list", "parameters"):
        return f"a `,` is missing before {_shown(token)}", "", token
    if inside in ("condition", "group", "loop", "index"):
        return f"an operator is missing before {_shown(token)}", "", token
    if place.start.type == "NAME" and place.at == place.first + 1:
        written = f"{before}({token}: …)" if place.near(1) == ":" else f"{before}({token})"
        return "arguments are written in parentheses", f"write {written}" if token.type in _VALUE else "", token
    return f"an operator or the end of the line is missing before {_shown(token)}", "write each item on a line of its own", token


def _separator(place: Place) -> Answer | None:
    token = place.token
    if token.type == "_NL" and ";" in token and place.inside():
        return "`;` ends an item, but a bracket is still open", "write `,`", token
    if token in ("let", "param", "use", "unit"):
        if place.inside():
            return f"`{token}` can't stand inside brackets", "write it on a line of its own", token
        return f"`{token}` begins an item", "write it on a line of its own", token
    if token == "," and place.inside() == "index":
        at = place.opener() or 0
        before = place.stream[at - 1]
        if before.type == "NAME" and (at - 1 == place.first or before.end_pos != place.stream[at].start_pos):
            return "arguments are written in parentheses", f"write {before}([…, …])", place.stream[at]
        return "an index is one number", "write list[i][j]", token
    if token == "for" and place.inside() == "call":
        return "a `for` inside a value stands in a list", "write [f(k) for k in 0..5]", token
    return None


_RULES: tuple[Callable[[Place], Answer | None], ...] = (
    _use,
    _unit,
    _foreign_word,
    _keyword_as_name,
    _doubled,
    _number_dots,
    _number_goes_on,
    _space_before_unit,
    _binding,
    _block_words,
    _line_start,
    _equals,
    _colon,
    _choice,
    _list_in_parentheses,
    _separator,
    _missing_value,
    _two_values,
    _chain,
)
_WANTED = {
    "EQUAL": "`=`", "COLON": "`:`", "COMMA": "`,`", "RPAR": "`)`", "RSQB": "`]`", "LPAR": "`(`", "LBRACE": "`{`",
    "IN": "`in`", "THEN": "`then`", "ELSE": "`else`", "VBAR": "`|`", "NAME": "a name", "STRING": "a string",
}  # fmt: skip


def _fallback(place: Place) -> Answer:
    wanted = [text for kind, text in _WANTED.items() if kind in place.expected]
    hint = f"here belongs {' or '.join(wanted)}" if 0 < len(wanted) <= 3 else ""
    at = place.token
    if _is_end(at) and at not in CLOSERS:
        before = place.near(-1)
        return f"something is missing after {_shown(before)}", hint, before
    return f"{_shown(at)} can't stand here", hint, at
