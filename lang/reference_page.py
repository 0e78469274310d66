"""The reference page, made from the schema, the functions, the units and the library.

python -m maquette.lang.reference_page > docs/reference.md
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from . import units
from .diagnostics import Diagnostics, Span
from .eval import builtins, parameters
from .eval.values import Builtin
from .schema.argument_types import REQUIRED, TYPES, Arg, Entry
from .schema.elements import SCHEMA
from .syntax import ast
from .syntax.parser import parse

HEAD = """\
# Reference of the .scene language

Made by `python -m maquette.lang.reference_page > docs/reference.md`; edit the schema, the functions or the library instead.

A number before an argument is its place where it is given without its name; the others are given by name. A default of "–" means
that nothing is set. Bare lengths are in the unit of the file.
"""

SECTIONS = {
    "shape": "Shapes",
    "solid": "Solids",
    "block": "Blocks",
    "light": "Lights",
    "material": "Materials",
    "texture": "Textures",
    "camera": "Camera",
    "setting": "Settings",
}
UNITS_ACROSS_FILES = """\
`unit mm` sets the unit of bare lengths for one file. A bare number keeps the unit of the file that it is written in: in
`unit mm`, `part.post(at: [10, 20, 30])` places the post at 10 mm, 20 mm, 30 mm, whatever the unit of the part's file. A factor that
multiplies bare lengths of the part is declared as a number: `let post(scale: number = 1) = …`, and a list of factors as a `list`."""

_ANGLE_TYPES = ("angle",)
_LENGTH_TYPES = ("length", "point", "size2", "size3")


def reference(library: Mapping[str, str]) -> str:
    """The page as Markdown. `library` holds the text of each file of the library by its name, as in `std/room`."""
    parts = [HEAD]
    for category, title in SECTIONS.items():
        parts.append(_section(title, [e for e in SCHEMA.values() if e.category == category]))
    parts += [_functions(), _units(), _types()]
    parts += ["## Library\n"] + [_file(name, text) for name, text in library.items()]
    return "\n".join(parts)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


# --- elements -------------------------------------------------------------------------------------------------------


def _section(title: str, entries: list[Entry]) -> str:
    built = [e for e in entries if not e.planned]
    planned = [f"`{e.name}`" for e in entries if e.planned]
    parts = [f"## {title}\n"]
    shared = _shared(built)
    if shared:
        parts += [f"Each of them also takes, by name:\n\n{_arguments(shared)}"]
    parts += [_entry(e, shared) for e in built]
    if planned:
        parts.append(f"Not built yet: {', '.join(planned)}.\n")
    return "\n".join(parts)


def _shared(entries: list[Entry]) -> list[Arg]:
    """The arguments by name that all of several entries have alike."""
    if len(entries) < 2:
        return []
    return [a for a in entries[0].args if a.keyword and all(a in e.args for e in entries)]


def _entry(entry: Entry, shared: list[Arg]) -> str:
    parts = [f"### {entry.name}\n", f"{_sentence(entry.doc)}{' Takes what it applies to in braces.' if entry.children else ''}\n"]
    if entry.example:
        parts.append(f"```\n{entry.example}\n```\n")
    own = [a for a in entry.args if a not in shared]
    if own:
        parts.append(_arguments(own))
    for group in entry.exclusive:
        parts.append(f"At most one of {', '.join(f'`{name}`' for name in group)} is given.\n")
    return "\n".join(parts)


def _arguments(args: list[Arg]) -> str:
    positional = [a for a in args if not a.keyword]
    places = {a.name: str(n) for n, a in enumerate(positional, 1)}
    rows = [(places.get(a.name, ""), *_row(a)) for a in (*positional, *(a for a in args if a.keyword))]
    return _table(("", "argument", "type", "default", ""), rows)


def _row(arg: Arg) -> tuple[str, ...]:
    name = f"`{arg.name}`" + "".join(f", `{alias}`" for alias in arg.aliases)
    kind = " ".join(f'`"{c}"`' for c in arg.choices) if arg.choices else arg.type
    return name, kind + _limits(arg), _default(arg), arg.doc


def _limits(arg: Arg) -> str:
    """The allowed range, as ` ≥ 0`."""
    limits = [(" >", arg.above), (" ≥", arg.minimum), (" ≤", arg.maximum), (" <", arg.below)]
    return ",".join(f"{sign} {_number(value, arg.type)}" for sign, value in limits if value is not None)


def _default(arg: Arg) -> str:
    if arg.default is REQUIRED:
        return "required"
    return "–" if arg.default is None else f"`{_value(arg.default, arg.type)}`"


def _value(value: object, type_name: str) -> str:
    """A default as it would be written in a scene."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return _number(value, type_name)
    if isinstance(value, tuple):
        if type_name in ("color", "color_map"):
            return f"rgb({', '.join(f'{c:g}' for c in value)})"
        return "[" + ", ".join(_value(v, type_name) for v in value) + "]"
    return f'"{value}"'


def _number(value: float, type_name: str) -> str:
    if type_name in _ANGLE_TYPES and value:
        return f"{math.degrees(value):.6g}deg"
    if type_name in _LENGTH_TYPES and value:
        return f"{value * 1000:g}mm" if abs(value) < 0.1 else f"{value:g}m"
    if math.isclose(value / math.pi, round(value / math.pi)) and value:
        factor = round(value / math.pi)
        return "pi" if factor == 1 else f"{factor} * pi"
    return f"{value:g}"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


# --- functions, units, types ----------------------------------------------------------------------------------------


def _functions() -> str:
    rows = [(f"`{_signature(f)}`", f.doc) for f in builtins.FUNCTIONS.values()]
    names = ", ".join(f"`{name}`" for name in builtins.CONSTANTS)
    constants = f"Constants: {names}. `time` is the time of the frame; `children` what a part was given in braces.\n"
    return "\n".join(["## Functions\n", _table(("function", ""), rows), constants])


def _signature(function: Builtin) -> str:
    names = [name if i < function.required else f"{name}?" for i, name in enumerate(function.parameters)]
    return f"{function.name}({', '.join(names + ['…'] * function.variadic)})"


def _units() -> str:
    by_dimension: dict[str, list[str]] = {}
    for symbol, (_, dimension) in units.UNITS.items():
        if symbol and dimension != units.NONE:
            by_dimension.setdefault(units.name(dimension), []).append(f"`{symbol}`")
    rows = [(name, " ".join(dict.fromkeys(symbols))) for name, symbols in by_dimension.items()]
    return "\n".join(["## Units\n", f"`%` is 0.01; `ev` counts stops.\n\n{UNITS_ACROSS_FILES}\n", _table(("dimension", "units"), rows)])


def _types() -> str:
    rows = [(name, doc) for name, doc in TYPES.items()]
    of_params = f"A `param`, and a parameter of a `let`, can be: {', '.join(f'`{t}`' for t in parameters.TYPES)}.\n"
    return "\n".join(["## Types\n", _table(("type", "what is given"), rows), of_params])


# --- the library ----------------------------------------------------------------------------------------------------


def _file(name: str, text: str) -> str:
    file = parse(text, f"std/{name}", Diagnostics())
    parts = [f"### std/{name}\n"]
    rows: list[tuple[str, ...]] = []
    head = _paragraphs(file.items[0].before)[:1] if file.items else []
    parts += [f"{paragraph}\n" for paragraph in head]
    for item in file.items:
        heading = _heading(item)
        if heading:
            parts += _flushed(rows) + [f"**{heading}**\n"]
        if isinstance(item, ast.Let) and item.parameters is not None:
            rows.append((f"`{_call(item, text)}`", _doc(item)))
    return "\n".join(parts + _flushed(rows))


def _flushed(rows: list[tuple[str, ...]]) -> list[str]:
    """The rows so far as a table, which are then taken out of the list."""
    table = [_table(("part", ""), rows)] if rows else []
    rows.clear()
    return table


def _call(let: ast.Let, text: str) -> str:
    return f"{let.name.id}({', '.join(_source(p.span, text) for p in let.parameters or ())})"


def _source(span: Span, text: str) -> str:
    """The text of a span, in one line."""
    lines = text.split("\n")[span.line - 1 : span.end_line]
    lines[-1] = lines[-1][: span.end_column - 1]
    lines[0] = lines[0][span.column - 1 :]
    return " ".join(line.strip() for line in lines)


def _doc(item: ast.Item) -> str:
    """The comment directly above an item."""
    if not item.before or item.before[-1].span.line + 1 < item.span.line:
        return ""
    return _paragraphs(item.before)[-1]


def _heading(item: ast.Item) -> str:
    """`matt` for a comment line `// --- matt ---` above an item."""
    for comment in item.before:
        match = re.fullmatch(r"// --- (.*) ---", comment.text)
        if match:
            return match[1]
    return ""


def _paragraphs(comments: tuple[ast.Comment, ...]) -> list[str]:
    """The text of comments, those on neighbouring lines together."""

    def pieces() -> Iterator[str]:
        lines: list[str] = []
        last = 0
        for comment in comments:
            if lines and comment.span.line > last + 1:
                yield " ".join(lines)
                lines = []
            lines.append(comment.text.removeprefix("//").strip())
            last = comment.span.line
        if lines:
            yield " ".join(lines)

    return list(pieces())


def main() -> None:
    """Write the page to standard output."""
    folder = Path(__file__).parent.parent / "stdlib"
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    sys.stdout.write(reference({path.stem: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.scene"))}))


if __name__ == "__main__":
    main()
