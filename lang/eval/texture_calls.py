"""Calls of textures inside formulas: `picture(u, v)` looks up an image, `marble(x, y, z)` is the value of another pattern there."""

from __future__ import annotations

from ..elements import Element
from ..formula_graph import PATTERN_INPUTS, Formula, Graph, Term
from . import operators
from .context import ArgumentValue, Scope
from .values import POISON, Color, Mistake, Poisoned, Value, describe


def call(texture: Element, givens: list[ArgumentValue], scope: Scope, label: str) -> Value:
    """The colour, or the number, of a texture at coordinates of a formula. `label` is the callee as written. Raises Mistake."""
    if texture.kind not in ("image", "pattern"):
        raise Mistake(f"a formula has no values of {describe(texture)}", "image(…)(u, v) and pattern(…)(x, y, z) have values there")
    fix = f"write {label if label.isidentifier() else f'{texture.kind}(…)'}({_coordinates(texture)})"
    for given in givens:
        if given.value is POISON:
            raise Poisoned
        if given.name is not None:
            raise Mistake("coordinates of a texture have no names", fix, span=given.name_span)
        if not operators.is_scalar(given.value):
            raise Mistake(f"expected number, got {describe(given.value)}", span=given.span)
    count = len(_coordinates(texture).split())
    if len(givens) != count:
        raise Mistake(f"this {texture.kind} takes {count} coordinates, got {len(givens)}", fix)
    graph = operators.graph_of(scope, *[given.value for given in givens])
    if graph is None:
        raise Mistake(f"{describe(texture)} has values inside of a pattern alone", "write pattern(|x, y, z, u, v| …) around it")
    terms = [operators.lift(graph, given.value) for given in givens]
    return _pattern(graph, texture.args["formula"], terms) if texture.kind == "pattern" else _picture(graph, texture, terms)


def _coordinates(texture: Element) -> str:
    return "u, v" if texture.kind == "image" else ", ".join(texture.args["formula"].parameters)


def _picture(graph: Graph, texture: Element, terms: list[Term]) -> Value:
    if texture.args["mapping"] != "uv":
        raise Mistake("a picture in a formula is placed by its coordinates", "leave out `mapping`")
    texel = dict(zip("rgba", graph.look_up(texture, *terms), strict=True))
    channel = texture.args["channel"]
    return Color(texel["r"], texel["g"], texel["b"]) if channel is None else texel[channel]


def _pattern(graph: Graph, formula: Formula, terms: list[Term]) -> Value:
    """A pattern's value. The point is in units of its own file."""
    if formula.unit != graph.unit:
        inputs = next((names for names in PATTERN_INPUTS if len(names) == len(terms)), ())
        factor = graph.constant(graph.unit / formula.unit)
        terms = [
            graph.apply("multiply", term, factor) if name in ("x", "y", "z") else term for name, term in zip(inputs, terms, strict=True)
        ]
    results = graph.inline(formula, terms)
    if formula.kind == "truth":
        return graph.apply("select", results[0], graph.constant(1.0), graph.constant(0.0))
    return Color(*results) if formula.kind == "color" else results[0]
