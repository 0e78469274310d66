"""Records in compiled functions: each NamedTuple gets all of its fields, also those with a default.

A field that is left out is None there. A scene that has the feature then mixes None with a lane, and its kernels do not compile. Only
pictures that use two features at once show this.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import maquette
import pytest

ROOT = Path(maquette.__file__).parent
COMPILED = {"helper", "noinline_helper", "allocating_helper", "kernel", "overload"}
Fields = dict[str, list[str]]  # of a module's records, by name


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def last_name(node: ast.expr) -> str:
    return ast.unparse(node.func if isinstance(node, ast.Call) else node).split(".")[-1]


def records(tree: ast.Module) -> Fields:
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and "NamedTuple" in map(last_name, node.bases)]
    return {c.name: [s.target.id for s in c.body if isinstance(s, ast.AnnAssign) and isinstance(s.target, ast.Name)] for c in classes}


def known_records(path: Path, tree: ast.Module, modules: dict[Path, Fields]) -> Fields:
    """The records that a module can name: its own, those that it imports, and those of modules that it imports, as `module.Name`."""
    names = dict(modules.get(path, {}))
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        folder = path.parents[node.level - 1].joinpath(*(node.module or "").split(".")) if node.module else path.parents[node.level - 1]
        for alias in node.names:
            bound = alias.asname or alias.name
            for file in (folder.with_suffix(".py"), folder / "__init__.py"):
                if alias.name in modules.get(file, {}):
                    names[bound] = modules[file][alias.name]
            names |= {f"{bound}.{record}": fields for record, fields in modules.get(folder / f"{alias.name}.py", {}).items()}
    return names


def incomplete(tree: ast.Module, names: Fields) -> Iterator[str]:
    """The constructions in compiled functions that leave out fields."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    for function in functions:
        if not COMPILED & {last_name(decorator) for decorator in function.decorator_list}:
            continue
        for call in ast.walk(function):
            if not isinstance(call, ast.Call) or any(isinstance(argument, ast.Starred) for argument in call.args):
                continue
            fields = names.get(ast.unparse(call.func))
            if fields is not None and len(call.args) + len(call.keywords) < len(fields):
                present = {*fields[: len(call.args)], *(keyword.arg for keyword in call.keywords)}
                yield f"line {call.lineno}: {ast.unparse(call.func)} without {', '.join(f for f in fields if f not in present)}"


def test_records_in_compiled_functions_have_all_fields() -> None:
    trees = {path: parse(path) for path in sorted((ROOT / "render").rglob("*.py"))}
    modules = {path: records(tree) for path, tree in trees.items()}
    assert sum(map(len, modules.values())) > 100
    wrong = [f"{path.relative_to(ROOT)}, {text}" for path, tree in trees.items()
             for text in incomplete(tree, known_records(path, tree, modules))]  # fmt: skip
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("call", ["Pair(1)", "Pair(first=1)", "state.Pair(1)", "Other(Pair(1).first, 2)"])
def test_a_field_that_is_left_out_is_named(tmp_path: Path, call: str) -> None:
    (tmp_path / "state.py").write_text("class Pair(NamedTuple):\n    first: int\n    second: int = 0\n", encoding="utf-8")
    user = tmp_path / "user.py"
    user.write_text(f"from . import state\nfrom .state import Pair\n\n@helper\ndef f():\n    return {call}\n", encoding="utf-8")
    modules = {tmp_path / "state.py": records(parse(tmp_path / "state.py"))}
    named = list(incomplete(parse(user), known_records(user, parse(user), modules)))
    assert named == [f"line 6: {'state.' if 'state' in call else ''}Pair without second"]
    plain = "from .state import Pair\n\ndef f():\n    return Pair(1)\n"
    assert not list(incomplete(ast.parse(plain), {"Pair": ["first", "second"]}))
