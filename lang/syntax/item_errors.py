"""Messages for syntax errors of items: `use`, `unit`, `let`, `param`, blocks, lines."""

from __future__ import annotations

from .error_site import VALUES, Answer, ErrorSite, is_end, starts_value
from .lexer import CLOSERS, KEYWORDS, OPENERS, OPERATORS

_FOREIGN = {  # keywords of other languages at the beginning of a line
    **dict.fromkeys(("import", "include", "from"), 'write use "parts.scene" for a file of scenes'),
    "def": "write let name(…) = …",
    "function": "write let name(…) = …",
    "fn": "write let name(…) = …",
    "var": "write let name = …",
    "const": "write let name = …",
    "return": "the value of a `let` follows its `=`; that of a block is its last line",
    "while": "write for (k in 0..5) { … }; `fold` and `scan` accumulate",
    "elif": "write else if (…) { … }",
    "elseif": "write else if (…) { … }",
    "module": "write let name(…) = group { … }",
    "class": "write let name(…) = group { … }",
    "new": "write the element alone, as in box(1)",
    "declare": "write let name = …",
    "#declare": "write let name = …",
    "local": "write let name = …",
}
_WRAPPERS = frozenset("translate rotate scale transform group union difference intersection shell offset".split())

_OPENSCAD = {  # what stands before a shape there
    "mirror": "write mirrored(…) {{ {}(…) }}",
    "resize": "write scale([2, 1, 1]) {{ {}(…) }}",
    "multmatrix": "write transform(…) {{ {}(…) }}",
    "linear_extrude": "write extrude(profile, height)",
    "rotate_extrude": "write revolve([[radius, y], …])",
    "hull": "a hull of two balls is capsule(…) or curve([a, b], radius)",
    "minkowski": "write offset(radius) {{ … }} to round outwards",
}
_SOLIDS = {"+": "union", "-": "difference", "*": "intersection", "/": "difference"}  # by operator between two solids


def use(site: ErrorSite) -> Answer | None:
    """`use` with an unquoted path or an incomplete `as`."""
    if site.start != "use":
        return None
    if site.at == site.first + 1:
        if site.token.type == "NAME":
            path = site.word()
            fix = f'write use "{path}"' if "/" in path or "." in path else f'write use "std/{path}" or use "{path}.scene"'
            return "the file after `use` is written in quotes", fix, site.token
        return "`use` needs a file", 'write use "std/room" or use "gear.scene"', site.start
    if site.near(-1) == "as":
        return "`as` needs a name", 'write use "robot.usdz" as robot', site.near(-1)
    if site.at == site.first + 2 and site.token.type == "NAME":
        return f"`as` is missing before `{site.token}`", f"write as {site.token}", site.token
    return None


def unit(site: ErrorSite) -> Answer | None:
    """`unit` without a unit."""
    if site.start == "unit" and site.at == site.first + 1:
        fix = "write unit inch" if site.token == "in" else "write unit mm"
        return "`unit` needs a unit of length", fix, site.start if is_end(site.token) else site.token
    return None


def foreign_word(site: ErrorSite) -> Answer | None:
    """A keyword of another language."""
    start = site.start
    if start not in _FOREIGN or start.type != "NAME" or site.at == site.first:
        return None
    if site.at == site.first + 1 or (site.inside() == "" and site.stream[site.first + 1] not in ("(", ".", "=")):
        return f"the language has no `{start}`", _FOREIGN[start], start
    return None


def wrapper_without_braces(site: ErrorSite) -> Answer | None:
    """`translate(…) sphere(1)`, as in OpenSCAD: the children of a block stand in braces."""
    start, token = site.start, site.token
    if token.type != "NAME" or site.near(-1) != ")" or site.near(1) != "(" or site.inside() != "":
        return None
    if start in ("color", "colour"):
        return "a colour belongs to a material", f"write {token}(…, material: lambert(#c83232))", start
    if start in _OPENSCAD:
        return f"`{start}` of OpenSCAD is written otherwise", _OPENSCAD[start].format(token), start
    if start in _WRAPPERS:
        return f"what `{start}` holds is written in braces", f"write {_nested([start, *_chain(site)])}", token
    return None


def _chain(site: ErrorSite) -> list[str]:
    """The names of calls that follow each other from this token on."""
    names, depth = [], 0
    for i in range(site.at, len(site.stream) - 1):
        token = site.stream[i]
        if depth == 0 and not (token.type == "NAME" and site.stream[i + 1] == "(") and token not in ("(", ")"):
            break
        if depth == 0 and token.type == "NAME":
            names.append(str(token))
        depth += (token in OPENERS) - (token in CLOSERS)
    return names


def _nested(names: list[str]) -> str:
    """Calls of these names, each in the braces of the one before."""
    return f"{names[0]}(…) {{ {_nested(names[1:])} }}" if len(names) > 1 else f"{names[0]}(…)"


def vector_in_angles(site: ErrorSite) -> Answer | None:
    """`<0, 1, 0>`, as in POV-Ray."""
    if site.token == "<" and (site.near(1).type == "NUMBER" or (site.near(1) == "-" and site.near(2).type == "NUMBER")):
        return "a vector is written in brackets", "write [x, y, z] in place of <x, y, z>", site.token
    if site.near(-1) == ">":  # `rgb <1, 0, 0>` was read as a comparison
        opening = next((k for k in range(site.at - 1, site.first, -1) if site.stream[k] == "<"), 0)
        inside = {token.type for token in site.stream[opening + 1 : site.at - 1]}
        if opening and site.stream[opening - 1].type == "NAME" and inside <= {"NUMBER", "COMMA", "MINUS"}:
            return "arguments are written in parentheses", f"write {site.stream[opening - 1]}(…, …, …)", site.stream[opening]
    return None


def keyword_as_name(site: ErrorSite) -> Answer | None:
    """A keyword in place of a name or a value."""
    token = site.token
    binding = site.near(-1) in ("let", "param", "unit", "as", ".")
    naming = site.near(1) in (":", "=") and "NAME" in site.expected
    if token in KEYWORDS and (binding or naming):
        return f"`{token}` is a keyword and can't be a name", "choose another name", token
    if token in ("for", "in", "use", "unit", "as", "param") and "NUMBER" in site.expected and site.at > site.first:
        fix = "write [f(k) for k in 0..5]" if token == "for" and site.near(-1) == "[" else ""
        return f"`{token}` is a keyword, not a value", fix, token
    return None


def binding(site: ErrorSite) -> Answer | None:
    """An incomplete or misspelt `let` or `param`."""
    start, token = site.start, site.token
    if start not in ("let", "param"):
        return None
    name = site.stream[site.first + 1]
    if site.at == site.first + 1:
        if token.type == "NUMBER":
            return f"a name begins with a letter, unlike `{token}`", "", token
        return f"`{start}` needs a name", f"write {start} size = 3", start if is_end(token) else token
    if site.at == site.first + 2:
        if token == ",":
            return f"`{start}` binds one name", f"write a line for each: {start} {name} = …", token
        if token == ":" or token == "==":
            return f"`{start}` takes `=`, not `{token}`", f"write {start} {name} = …", token
        if token == "-" and token.start_pos == name.end_pos and site.near(1).type == "NAME":
            return "a name has no `-`", f"write {name}_{site.near(1)}", token
        if start == "param" and token == "(":
            return "a `param` takes no parameters", f"write let {name}(…) = …", token
        if token.type in VALUES or token in ("-", "[", "|", "not"):
            return f"`=` is missing after `{start} {name}`", f"write {start} {name} = …", token
        if is_end(token):
            return f"`{start} {name}` has no value", f"write {start} {name} = …", name
        if token == "{":
            return f"`=` is missing after `let {name}`", f"write let {name} = group() {{ … }}", token
    if start == "param" and site.near(-1) == ":" and token.type != "NAME" and site.at == site.first + 3:
        return "a type is missing after the `:`", f"write param {name} = … or param {name}: int = …", token
    if start == "param" and token == ":" and site.opener() is None:
        return "a `param` takes its value with `=`", f"write param {name} = …", token
    if "EQUAL" in site.expected and site.inside() == "":
        written = f"let {name}(…)" if start == "let" else f"param {name}: {site.near(-1)}"
        value = "group { … }" if token == "{" else "…"
        return f"`=` is missing before the value of `{name}`", f"write {written} = {value}", token if not is_end(token) else name
    if start == "let" and token == "in" and site.inside() == "":
        return "only a `param` has a range", f"write param {name} = …", token
    if start == "param" and "STRING" in site.expected and starts_value(token):
        return "the description of a `param` is quoted", f'write param {name} = … "description"', token
    return None


def block_words(site: ErrorSite) -> Answer | None:
    """`if`, `else` or `for` without condition, name or block."""
    start, token = site.start, site.token
    if start == "else" and site.at == site.first:
        return "this `else` has no `if`", "write if (…) { … } else { … }", token
    if "NUMBER" in site.expected:  # an `if` that is a value
        return None
    if site.near(-1) == "if" and site.near(-2) == "else" and site.inside() == "" and site.token != "(":
        return "`if` needs its condition in parentheses", "write else if (…) { … }", token if not is_end(token) else site.near(-1)
    if start not in ("if", "for"):
        return None
    named = next((str(token) for token in site.stream[site.first : site.at + 1] if token.type == "NAME" and token != "int"), "k")
    form = "if (…) { … }" if start == "if" else f"for ({named} in 0..5) {{ … }}"
    if site.at == site.first + 1:
        what = "its condition" if start == "if" else "its name and list"
        return f"`{start}` needs {what} in parentheses", f"write {form}", token if not is_end(token) else start
    if site.inside() == "loop" and site.near(-1).type == "NAME" and "IN" in site.expected:
        return "`for` needs `in` after its name", f"write {form}", token
    if site.inside() == "loop" and site.near(-1) == "(":
        return "`for` needs a name", f"write {form}", token
    if site.near(-1) == ")" and "LBRACE" in site.expected and len(site.expected) == 1:
        if token == "then":
            return "`if … then … else …` is a value; this `if` is a statement", f"write {form}", token
        return f"`{start}` needs a block", f"write {form}", token if not is_end(token) else start
    if site.near(-1) == "else":
        return "`else` needs a block or another `if`", "write else { … }", site.near(-1)
    return None


def line_start(site: ErrorSite) -> Answer | None:
    """A token that cannot begin a line, or a line that is only a value."""
    token = site.token
    if site.at != site.first:
        is_element = "AND" not in site.expected  # not the value of a block
        if token in OPERATORS and is_element and site.inside() == "" and site.start not in KEYWORDS:
            both = site.near(-1) == ")" and site.near(1).type == "NAME" and site.near(2) == "("
            hint = f"solids are combined as {_SOLIDS[token]} {{ …; … }}" if both and token in _SOLIDS else "write let name = … to keep it"
            return "this line is a value, and only elements can be placed", hint, token
        return None
    if token in OPERATORS or token in (",", "=", ":", ".", "|"):
        if token == "-" and site.near(1) == "-":
            return "`--` begins no comment", "write `//`", token
        if token == "<" and site.near(1).type == "NAME":
            return "the language has no tags", "an element is written sphere(1)", token
        return f"a line can't begin with `{token}`", f"end the line above with the `{token}`" if token not in ("|", "not") else "", token
    if token in KEYWORDS:
        return f"a line can't begin with `{token}`", "", token
    if token == "{":
        return "this `{` follows no element", "write group() { … }", token
    return None


def separator(site: ErrorSite) -> Answer | None:
    """`;` or an item inside brackets, `,` inside an index, `for` inside a call."""
    token = site.token
    if token.type == "_NL" and ";" in token and site.inside():
        return "`;` ends an item, but a bracket is still open", "write `,`", token
    if token in ("let", "param", "use", "unit"):
        if site.inside():
            return f"`{token}` can't be inside brackets", "write it on a line of its own", token
        return f"`{token}` begins an item", "write it on a line of its own", token
    if token == "," and site.inside() == "index":
        opening = site.opener() or 0
        before = site.stream[opening - 1]
        if before.type == "NAME" and (opening - 1 == site.first or before.end_pos != site.stream[opening].start_pos):
            return "arguments are written in parentheses", f"write {before}([…, …])", site.stream[opening]
        return "an index is one number", "write list[i][j]", token
    if token == "for" and site.inside() == "call":
        return "a `for` inside a value is part of a list", "write [f(k) for k in 0..5]", token
    return None
