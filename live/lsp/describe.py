"""What can be called, with its parameters and docs: elements, functions, parts and used files; and its Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...compiler.catalogue import CATALOGUE
from ...lang.eval import builtins
from ...lang.eval.values import Builtin
from ...lang.reference_page import comment_above, default_text, limits_text, sentence
from ...lang.schema.argument_types import TYPES, Arg, Entry
from ...lang.syntax import ast
from .document import DefinitionSite, Document
from .project import Project

CONSTANTS: Mapping[str, str] = {
    "pi": "The ratio of a circle's circumference to its diameter, 3.14159….",
    "true": "The truth value true.",
    "false": "The truth value false.",
    "time": "The time of the frame, in seconds.",
    "children": "The elements in braces after the call of a part.",
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter. `type` has the allowed range, `default` is as in the source; both are "" if there is none."""

    name: str
    type: str = ""
    default: str = ""
    doc: str = ""
    keyword: bool = False
    choices: tuple[str, ...] = ()
    kind: str = ""  # the type alone

    @property
    def text(self) -> str:
        """The parameter in a signature."""
        return self.name + (f": {self.type}" if self.type else "") + (f" = {self.default}" if self.default else "")

    @property
    def markdown(self) -> str:
        """The parameter with its type, default and doc."""
        kind = " or ".join(f'`"{choice}"`' for choice in self.choices) or self.type
        about = ", ".join(part for part in (kind, f"default `{self.default}`" if self.default else "") if part)
        return f"`{self.name}`" + (f": {about}" if about else "") + (f". {sentence(self.doc)}" if self.doc else "")


@dataclass(frozen=True, slots=True)
class Callee:
    """What a call calls. `kind` is element, function, part or file."""

    name: str
    kind: str
    doc: str
    parameters: tuple[Parameter, ...]
    example: str = ""
    variadic: bool = False

    @property
    def signature(self) -> str:
        """The name with its parameters; those by name alone stand after the others."""
        return f"{self.name}({', '.join([*(p.text for p in self.parameters), *['…'] * self.variadic])})"

    def parameter(self, name: str) -> Parameter | None:
        """The parameter of a name."""
        return next((p for p in self.parameters if p.name == name), None)


def of_entry(entry: Entry) -> Callee:
    """An element of the language."""
    args = [*(a for a in entry.args if not a.keyword), *(a for a in entry.args if a.keyword)]
    doc = sentence(entry.doc) + (" Takes its children in braces." if entry.children else "")
    return Callee(entry.name, "element", doc, tuple(_of_arg(arg) for arg in args), entry.example)


def _of_arg(arg: Arg) -> Parameter:
    default = default_text(arg).strip("`")
    return Parameter(
        arg.name, arg.type + limits_text(arg), "" if default in ("–", "required") else default, arg.doc, arg.keyword, arg.choices, arg.type
    )


def of_builtin(function: Builtin) -> Callee:
    """A function of the language."""
    names = [name if i < function.required else f"{name}?" for i, name in enumerate(function.parameters)]
    return Callee(function.name, "function", sentence(function.doc), tuple(Parameter(n) for n in names), variadic=function.variadic)


def of_definition(located: DefinitionSite, project: Project) -> Callee | None:
    """A part, or a used file; None for a definition that is not called."""
    node, document = located.definition.node, located.document
    match node:
        case ast.Let(parameters=tuple() as parameters):
            return Callee(node.name.id, "part", comment_above(node), tuple(_of_parameter(p, located) for p in parameters))
        case ast.Use():
            used = project.used(document, node)
            if used is None:
                return None
            params = [each for each in used.top.values() if isinstance(each.definition.node, ast.Param)]
            return Callee(located.definition.name, "file", "", tuple(_of_param(each) for each in params))
    return None


def _of_parameter(parameter: ast.Parameter, located: DefinitionSite) -> Parameter:
    default = source_of(parameter.default, located) if parameter.default is not None else ""
    kind = parameter.type.id if parameter.type else ""
    return Parameter(parameter.name.id, kind, default, kind=kind)


def _of_param(located: DefinitionSite) -> Parameter:
    node = located.definition.node
    assert isinstance(node, ast.Param)
    doc = node.doc.value if node.doc else ""
    kind = node.type.id if node.type else ""
    return Parameter(node.name.id, kind, source_of(node.default, located), doc, True, kind=kind)


def source_of(node: ast.Node, located: DefinitionSite) -> str:
    """The source of a node in the piece of a definition, on one line."""
    lines = located.placed.piece.text.split("\n")[node.span.line - 1 : node.span.end_line]
    lines[-1] = lines[-1][: node.span.end_column - 1]
    lines[0] = lines[0][node.span.column - 1 :]
    return " ".join(line.strip() for line in lines)


def of_name(name: str, owner: str, names: Mapping[str, DefinitionSite], project: Project) -> Callee | None:
    """What `name(…)`, or `owner.name(…)`, calls where `names` are visible."""
    if owner:
        located = member(owner, name, names, project)
    else:
        located = names.get(name) or (None if name in CATALOGUE or name in builtins.FUNCTIONS else project.prelude(name))
    if located is not None:
        return of_definition(located, project)
    if owner:
        return None
    if name in CATALOGUE and not CATALOGUE[name].planned:
        return of_entry(CATALOGUE[name])
    return of_builtin(builtins.FUNCTIONS[name]) if name in builtins.FUNCTIONS else None


def used_file(owner: str, names: Mapping[str, DefinitionSite], project: Project) -> Document | None:
    """The file that a visible name stands for."""
    located = names.get(owner)
    node = located.definition.node if located else None
    return project.used(located.document, node) if located and isinstance(node, ast.Use) else None


def member(owner: str, name: str, names: Mapping[str, DefinitionSite], project: Project) -> DefinitionSite | None:
    """The definition that `owner.name` means where `names` are visible."""
    used = used_file(owner, names, project)
    return used.top.get(name) if used else None


def of_callee(callee: Callee) -> str:
    """Markdown of an element, a function or a part: signature, doc, arguments and example."""
    required = [p.name for p in callee.parameters if not p.keyword] if callee.kind == "element" else [p.text for p in callee.parameters]
    shown = ", ".join([*required, *(["…"] if callee.variadic or callee.kind == "element" else [])])
    parts = [_code(f"{callee.name}({shown})"), callee.doc]
    if callee.kind in ("element", "file"):
        parts.append("\n".join(f"- {p.markdown}" for p in callee.parameters))
    if callee.example:
        parts.append(_code(callee.example))
    return "\n\n".join(part for part in parts if part)


def of_found(located: DefinitionSite, project: Project, value: str = "") -> str:
    """Markdown of a definition: its source, the comment above it, its value if it is plain, and its file if that is another one."""
    node = located.definition.node
    match node:
        case ast.Let(parameters=None) | ast.Param():
            source = _first_line(located)
        case ast.Let():
            callee = of_definition(located, project)
            source = f"let {callee.signature}" if callee else ""
        case ast.Parameter():
            source = source_of(node, located)
        case _:
            source = _first_line(located)
    parts = [_code(source)]
    if isinstance(node, ast.Item):
        parts.append(comment_above(node))
    if isinstance(node, ast.Param) and node.doc:
        parts.append(sentence(node.doc.value))
    if isinstance(node, ast.Use):
        used = project.used(located.document, node)
        parts.append(_head(used) if used else "")
    if isinstance(node, ast.Parameter) and node.type:
        parts.append(TYPES.get(node.type.id, ""))
    if value:
        parts.append(f"Value: `{value}`")
    return "\n\n".join(part for part in parts if part)


def _first_line(located: DefinitionSite) -> str:
    return located.placed.piece.text.split("\n")[located.definition.span.line - 1].strip()


def _head(document: Document) -> str:
    """The comment at the start of a file."""
    lines: list[str] = []
    for line in document.lines:
        if not line.startswith("//"):
            break
        lines.append(line.removeprefix("//").strip())
    return " ".join(lines)


def _code(text: str) -> str:
    return f"```scene\n{text}\n```"
