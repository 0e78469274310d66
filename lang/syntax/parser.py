"""Parser entry point: text to syntax tree, with recovery after errors."""

from __future__ import annotations

import threading
from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from .. import text_encoding
from ..diagnostics import Diagnostic, Diagnostics, Span, sort_diagnostics
from ..file_types import is_binary
from . import ast, block_errors, lexer, line_joining, syntax_errors
from .ast_builder import BROKEN, MAX_DEPTH, TooDeep, TreeBuilder
from .block_errors import WrongBlock
from .error_site import ErrorSite
from .grammar import ParserState, Token, UnexpectedToken, grammar
from .trivia import Comments
from .value_errors import bound_names

BINDS = frozenset(("let", "param", "function", "module", "def", "const", "var"))  # words of other languages as well
MAX_BYTES = 4_000_000
MAX_ERRORS = 100  # syntax errors shown for a file
MAX_TRIES = 2  # recoveries up to the same token


def decode(data: bytes, name: str, diagnostics: Diagnostics) -> str | None:
    """The text of a .scene file from its bytes: UTF-8, UTF-16 or UTF-32; lines end with `\\n`.

    None, with a diagnostic, for data that is too large or not text.
    """
    if len(data) > MAX_BYTES:
        _too_large(len(data), name, diagnostics)
        return None
    if is_binary(data):
        diagnostics.error("this is a binary file, no scene", Span(name))
        return None
    try:
        text = text_encoding.decode(data)
    except UnicodeDecodeError as e:
        if text_encoding.is_wide(data):
            diagnostics.error("this is damaged text of UTF-16 or UTF-32", Span(name), "save the file as UTF-8")
            return None
        line = data.count(b"\n", 0, e.start) + 1
        diagnostics.error(f"line {line} is not UTF-8 text (byte 0x{data[e.start]:02x})", Span(name), "save the file as UTF-8")
        return None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse(text: str, name: str, diagnostics: Diagnostics) -> ast.File:
    """The syntax tree of `text`, named `name` in spans. Never raises on input.

    Adds syntax errors to `diagnostics`, in order. The tree lacks the items with errors.
    """
    if is_too_large(text, name, diagnostics):
        return ast.File(Span(name), name, text, ())
    return file_of(text, name, [parse_segment(text.removeprefix("\ufeff"), name, is_whole=True)], diagnostics)


def is_too_large(text: str, name: str, diagnostics: Diagnostics) -> bool:
    """Whether a text is larger than a scene may be, which is then reported."""
    if len(text) > MAX_BYTES:
        _too_large(len(text), name, diagnostics)
    return len(text) > MAX_BYTES


def file_of(text: str, name: str, segments: Sequence[Segment], diagnostics: Diagnostics) -> ast.File:
    """The file that consists of `segments`, whose items have their comments. Adds their messages to `diagnostics`."""
    shown = sort_diagnostics(d for segment in segments for d in segment.messages)
    diagnostics.items.extend(shown[:MAX_ERRORS])
    if len(shown) > MAX_ERRORS:
        diagnostics.error(f"more than {MAX_ERRORS} syntax errors; the rest is not shown", Span(name))
    items = tuple(item for segment in segments for item in segment.items)
    broken = frozenset().union(*(segment.broken for segment in segments))
    calls = [call for segment in segments for call in segment.calls]
    used = frozenset().union(*(segment.names for segment in segments)) if calls else ()
    called = tuple(call for call in calls if call.id not in used)
    return ast.File(Span(name), name, text, items, segments[-1].dangling, broken, called)


class Segment(NamedTuple):
    """The parse of some lines of a file, or of all.

    A closed one does not depend on the lines behind it, if these begin with an item outside all brackets.
    """

    text: str
    line: int  # of its start
    items: tuple[ast.Item, ...]
    dangling: tuple[ast.Comment, ...]  # after its last item
    messages: tuple[Diagnostic, ...]
    broken: frozenset[str]  # names that items with errors bind
    calls: tuple[ast.Name, ...]  # functions called in items with errors
    names: frozenset[str]  # used otherwise than in calls
    bound: frozenset[str]  # after `let` and `param`
    unbound: frozenset[str]  # names whose messages depend on whether other segments bind them
    scan: lexer.Scan  # without its tokens
    is_complete: bool  # the grammar allows its end
    is_closed: bool


def parse_segment(text: str, name: str, line: int = 1, is_whole: bool = False) -> Segment:
    """The parse of `text`, which begins in `line` of file `name`. A whole file's has no `bound`, and `names` beside `calls` alone."""
    messages = Diagnostics()
    scan = lexer.scan(text, name, messages, line)
    stream = line_joining.join_lines(scan, name, messages)
    parsing = _Parsing(stream, scan, name, messages)
    items, dangling = parsing.run()
    is_closed = parsing.ends_between_items and scan.ends_line and not scan.open_at_end
    names, calls = parsing.names() if parsing.dropped or not is_whole else (frozenset(), ())
    bound = frozenset() if is_whole else frozenset(bound_names(stream))
    scan.tokens, scan.comments = [], []
    return Segment(
        text, line, items, dangling, tuple(messages.items), frozenset(parsing.broken), calls, names,
        bound, frozenset(parsing.unbound), scan, parsing.is_complete, is_closed,
    )  # fmt: skip


def _too_large(size: int, name: str, diagnostics: Diagnostics) -> None:
    hint = "put large meshes and tables into files of their own"
    diagnostics.error(f"the file has {size / 1e6:.1f} MB; a scene has {MAX_BYTES / 1e6:.0f} MB at most", Span(name), hint)


class _Automaton(threading.local):
    """The tree builder of a thread, as actions of the grammar: making these takes as long as parsing some lines."""

    builder: TreeBuilder | None = None

    def start(self, file: str, comments: list[ast.Comment]) -> ParserState[int]:
        """Lark's parser before the first token of `file`."""
        if self.builder is None:
            self.builder = TreeBuilder()
            self.actions, self.no_text = grammar().actions(self.builder), grammar().tokens("")
        self.builder.begin(file, Comments(comments))
        return ParserState(self.actions, self.no_text)


_automaton = _Automaton()


@dataclass(slots=True)
class _Level:
    """A list of items during the parse: the file, or a block."""

    depth: int  # brackets open around it
    height: int  # of the parser's value stack at the start of the current item
    first: int  # first token of the current item
    broken: bool = False  # the current item has a reported error
    opener: Token | None = None  # the `{` of a block expression; None for other lists of items
    loses_items: bool = False  # an item of it was dropped


@dataclass
class _Parsing:
    """One parse with error recovery: drops an item with an error and resumes at the next one."""

    stream: list[Token]
    scan: lexer.Scan
    file: str
    diagnostics: Diagnostics
    broken: set[str] = field(default_factory=set)  # names that items with errors bind
    dropped: list[tuple[int, int]] = field(default_factory=list)  # tokens of items with errors
    resumed: int = -1  # token up to which the last recovery went
    tries: int = 0  # recoveries up to it before
    unbound: set[str] = field(default_factory=set)  # names that messages asked for, and that `stream` does not bind
    is_complete: bool = False  # the grammar allows the end of the text
    ends_between_items: bool = False  # no item is open there

    def run(self) -> tuple[tuple[ast.Item, ...], tuple[ast.Comment, ...]]:
        """The items of the file, and the comments after the last one."""
        self.state = _automaton.start(self.file, self.scan.comments)
        self.levels = [_Level(0, 0, 0)]
        self.depths = _depths(self.stream)
        self.wrong = sorted(self.scan.wrong)
        i = 0
        result: Any = ((), ())
        while i < len(self.stream):
            token = self.stream[i]
            if self._drops_item(i):
                i = self._resume(self._recover(i))
                continue
            if self._chooses_with_braces(i):
                self._report(i, {"THEN"})
                i = self._resume(self._recover(i, blocks=False))
                continue
            try:
                result = self.state.feed_token(token, token.type == "$END")
            except UnexpectedToken as e:
                self._report(i, e.expected)
                is_value = token == "{" and "NUMBER" in e.expected
                is_vector = token == "<" and "NUMBER" in e.expected  # of POV-Ray, whose blocks hold arguments
                in_value = self.levels[-1].opener is not None
                i = self._resume(self._recover(i, blocks=not (is_value or in_value), lines=not is_vector or len(self.levels) == 1))
            except TooDeep:
                self._report_depth(i)
                i = self._resume(self._recover(i))
            except WrongBlock as e:
                if not self._is_known(i):
                    self.diagnostics.error(e.message, e.span, e.hint)
                i = self._resume(self._recover(i))
            else:
                self._follow(i)
                i += 1
        return result or ((), ())

    def _resume(self, i: int) -> int:
        """The token to go on from after a recovery up to token `i`: behind it if the parser refuses it, as brackets do not match."""
        self.tries = self.tries + 1 if i == self.resumed else 0
        self.resumed = i
        return i + (self.tries > MAX_TRIES)

    def _drops_item(self, i: int) -> bool:
        """Whether token `i` ends an item with a repaired error, which is dropped too."""
        level, token = self.levels[-1], self.stream[i]
        ends = token.type in ("_NL", "$END") or (token.type == "RBRACE" and self.depths[i] < level.depth)
        if not ends or not self.wrong or i == level.first:
            return False
        first, last = self._wrong_between(level.first, i)
        del self.wrong[first:last]
        drops = first < last and not level.broken
        if drops:
            self.dropped.append((level.first, i))
        return drops

    def _wrong_between(self, first: int, last: int) -> tuple[int, int]:
        """The range of `wrong` inside the tokens `first` to `last`."""
        a, b = self.stream[first], self.stream[last]
        start, end = (a.line or 1, a.column or 1), (b.end_line or 1, b.end_column or 1)
        return bisect_left(self.wrong, start), bisect_left(self.wrong, end)

    def _follow(self, i: int) -> None:
        """Update the stack of blocks and items after token `i`."""
        level, token = self.levels[-1], self.stream[i]
        if token.type == "LBRACE":
            opener = token if self._accepts("VBAR") else None
            self.levels.append(_Level(self.depths[i] + 1, len(self.state.value_stack), i + 1, opener=opener))
        elif token.type == "RBRACE":
            closed = self.levels.pop()
            if closed.opener is not None and closed.loses_items:  # the item around it is dropped too
                insort(self.wrong, (closed.opener.line or 1, closed.opener.column or 1))
        elif token.type == "_NL":
            level.height, level.first, level.broken = len(self.state.value_stack), i + 1, False
        elif token.type == "$END":
            self.is_complete = True
            self.ends_between_items = len(self.levels) == 1 and level.first == i and not level.broken

    def _accepts(self, kind: str) -> bool:
        """Whether the parser's state has an action for a kind of token."""
        return kind in self.state.parse_conf.parse_table.states[self.state.position]

    def _chooses_with_braces(self, i: int) -> bool:
        """Whether token `i` is the `{` of `if (…) {` in the place of a value."""
        if self.stream[i] != "{" or self.stream[i - 1] != ")" or not self._accepts("THEN"):
            return False
        return block_errors.chooses_with_braces(ErrorSite(self.stream, i, self.levels[-1].first, set(), self.unbound))

    def _recover(self, i: int, blocks: bool = True, lines: bool = True) -> int:
        """Drop the current item and skip the rest of it, up to a block of its own whose items are still parsed.

        Without `lines`, skip all items of the block that the current item is in.
        """
        level, start = self.levels[-1], self.levels[-1].first
        level.broken = level.loses_items = True
        self._remember_names(level)
        del self.state.value_stack[level.height :], self.state.state_stack[level.height + 1 :]
        while i < len(self.stream):
            token, depth = self.stream[i], self.depths[i]
            if token.type == "$END" or (token == "}" and depth < level.depth):
                break
            if lines and depth == level.depth and token.type == "_NL":
                self.dropped.append((start, i))
                level.first, level.broken = i + 1, False
                return i + 1
            if lines and blocks and depth == level.depth and token == "{":
                self._feed_broken_head(i, level.first)
                break
            i += 1
        self.dropped.append((start, i))
        return i

    def _feed_broken_head(self, i: int, first: int) -> None:
        """Feed the head of a broken item whose block opens at token `i`: an element, or a `let` before a block expression."""
        token, before = self.stream[i], self.stream[i - 1]
        is_value = before in ("=", "|", "then") or (before == "else" and self.stream[first] != "if")
        head = (("LET", "let"), ("NAME", BROKEN), ("EQUAL", "=")) if is_value else (("NAME", BROKEN),)
        for kind, text in head:
            self.state.feed_token(Token(kind, text, token.start_pos, token.line, token.column, token.line, token.column))

    def names(self) -> tuple[frozenset[str], tuple[ast.Name, ...]]:
        """The names that are used otherwise than as functions, and the functions called in items with errors."""
        calls = [k + 1 < len(self.stream) and self._calls(k) for k in range(len(self.stream))]
        names = frozenset(str(token) for token, call in zip(self.stream, calls, strict=True) if token.type == "NAME" and not call)
        callees = [self.stream[k] for first, last in self.dropped for k in range(first, last) if calls[k]]
        return names, tuple(ast.Name(lexer.span_of(token, self.file), str(token)) for token in callees)

    def _calls(self, k: int) -> bool:
        """Whether token `k` is the name of a function that is called."""
        before = self.stream[k - 1] if k else ""
        return self.stream[k].type == "NAME" and self.stream[k + 1] == "(" and before != "." and before not in BINDS

    def _remember_names(self, level: _Level) -> None:
        item = self.stream[level.first : level.first + 4]
        if len(item) < 2:
            return
        if item[0].type == "NAME" and (item[1] == "=" or (len(item) > 2 and item[1] == ":" and item[2] == "=")):
            self.broken.add(str(item[0]))
        elif item[0] in BINDS and item[1].type == "NAME":
            self.broken.add(str(item[1]))
        elif item[0] == "use":
            named = item[3] if len(item) > 3 and item[2] == "as" else item[1]
            self.broken.add(str(named).strip('"').rsplit("/", 1)[-1].rsplit(".", 1)[0])

    def _report(self, i: int, expected: set[str]) -> None:
        if not self._is_known(i):
            site = ErrorSite(self.stream, i, self.levels[-1].first, expected, self.unbound)
            message, hint, token = syntax_errors.explain(site)
            self.diagnostics.error(message, lexer.span_of(token, self.file), hint)

    def _report_depth(self, i: int) -> None:
        if not self._is_known(i):
            span = lexer.span_of(self.stream[self.levels[-1].first], self.file)
            message = f"operators, calls and blocks more than {MAX_DEPTH} deep"
            self.diagnostics.error(message, span, "give parts of it a name with `let`; add up long lists with `fold`")

    def _is_known(self, i: int) -> bool:
        """Whether an error of the current item has been reported."""
        level = self.levels[-1]
        first, last = self._wrong_between(level.first, i)
        return level.broken or first < last


def _depths(stream: list[Token]) -> list[int]:
    """For each token the number of open brackets around it, not counting the token's own bracket."""
    depths, depth = [], 0
    for text in map(str, stream):
        depth -= text in lexer.CLOSERS
        depths.append(depth)
        depth += text in lexer.OPENERS
    return depths
