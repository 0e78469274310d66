"""Helpers of the evaluator's tests: evaluate a text with files in memory, and read messages as a user sees them."""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.diagnostics import Diagnostics, Span, render_text, sort_diagnostics
from maquette.lang.elements import Document, Element
from maquette.lang.eval import evaluator
from maquette.lang.schema.argument_types import Catalogue

unhurried = settings(deadline=None)  # for properties: the first example builds the parser, and the machine may be busy


class Files:
    """A Reader of files in memory: `use "gear.scene"` finds the text under that key, whoever asks."""

    def __init__(self, files: dict[str, str]) -> None:
        self.files = files
        self.reads: list[str] = []

    def scene(self, path: str, importer: str, span: Span) -> evaluator.Source:
        self.reads.append(path)
        if path not in self.files:
            raise evaluator.ReadError(f"there is no {path}", "is it spelt so?")
        return evaluator.Source(path, self.files[path], path)


def run(
    text: str, files: dict[str, str] | None = None, catalogue: Catalogue = CATALOGUE, **options: Any
) -> tuple[Document, list[str]]:
    """The document, and every message as it is printed."""
    diagnostics = Diagnostics()
    source = evaluator.Source("a.scene", text, "a.scene")
    document = evaluator.evaluate(source, catalogue, Files(files or {}), diagnostics, **options)
    return document, [render_text(d, document.sources.get) for d in sort_diagnostics(diagnostics.items)]


def good(text: str, files: dict[str, str] | None = None, **options: Any) -> Document:
    """The document of a text that has no error and no warning."""
    document, messages = run(text, files, **options)
    assert not messages, "\n".join(messages)
    return document


def elements(text: str, files: dict[str, str] | None = None, **options: Any) -> tuple[Element, ...]:
    return good(text, files, **options).elements


def value(expression: str, before: str = "") -> Any:
    """The value of an expression in the language: `before` are items above it."""
    diagnostics = Diagnostics()
    machine = evaluator.Evaluator(CATALOGUE, Files({}), diagnostics, 0.0)
    text = f"{before}\nlet wanted = {expression}\n"
    module = machine.loader.load(evaluator.Source("a.scene", text, "a.scene"), library=False)
    scope = machine.instance(module, {}, "", None, machine.root)
    thunk = scope.names["wanted"]
    assert not diagnostics.items, diagnostics.items
    result = machine.force(thunk, Span("a.scene"), scope)
    assert not diagnostics.items, diagnostics.items
    return result


def mistake(expression: str, before: str = "") -> str:
    """The message of an expression's only error, without its place, followed by the hint."""
    diagnostics = Diagnostics()
    text = f"{before}\nlet wanted = {expression}\n"
    evaluator.evaluate(evaluator.Source("a.scene", text, "a.scene"), CATALOGUE, Files({}), diagnostics)
    errors = [d for d in diagnostics.items if d.severity == "error"]
    assert len(errors) == 1, errors
    return errors[0].message + (f" | {errors[0].hint}" if errors[0].hint else "")
