"""Arithmetic on the sources of inputs: values at once, pictures and graphs as nodes of MaterialX."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...materialx.graph import Node, Port
from .graphs import Graphs
from .network import Graph, Picture, Primvar

VARYING = Graph | Picture | Primvar


def numbers(source: Any) -> np.ndarray | None:
    """A value as numbers; None for other sources."""
    if isinstance(source, VARYING) or source is None:
        return None
    try:
        values = np.array(source, np.float64)
    except (TypeError, ValueError):
        return None
    return values if values.ndim <= 1 and np.isfinite(values).all() else None


def is_zero(source: Any) -> bool:
    values = numbers(source)
    return values is not None and not values.any()


class Arithmetic:
    """Operations on sources."""

    def __init__(self, graphs: Graphs) -> None:
        self._graphs = graphs

    def port(self, source: Any) -> Port:
        """A source as the input of a node."""
        if isinstance(source, Picture):
            node = self._graphs.node(source.shader)
            return self._levelled(Port("color3", source=node, output=source.output), source.gain, source.bias, "color3")
        if isinstance(source, Graph):
            return self._levelled(Port(source.kind, source=source.node, output=source.output), source.gain, source.bias, source.kind)
        if isinstance(source, Primvar):
            inputs = {"geomprop": Port("string", source.name), "default": Port("color3", _plain(source.fallback))}
            return Port("color3", source=Node("primvar", "ND_geompropvalue_color3", inputs))
        return Port("color3", _plain(source))

    def _levelled(self, port: Port, gain: float, bias: float, kind: str) -> Port:
        if (gain, bias) == (1.0, 0.0):
            return port
        suffix = "" if kind == "float" else "FA"
        product = Node("gain", f"ND_multiply_{kind}{suffix}", {"in1": port, "in2": Port("float", gain)})
        total = Node("bias", f"ND_add_{kind}{suffix}", {"in1": Port(kind, source=product), "in2": Port("float", bias)})
        return Port(kind, source=total)

    def apply(self, definition: str, fallback: Any, place: Any, **inputs: Any) -> Any:
        """The value of a node of the library, or a Graph."""
        node = Node(definition, definition, {name: self.port(source) for name, source in inputs.items()}, place)
        return self._graphs.source(node, "out", fallback)

    def times(self, a: Any, b: Any, place: Any) -> Any:
        """The product of two sources, of which one may be a colour."""
        first, second = numbers(a), numbers(b)
        if first is not None and second is not None:
            product = first * second
            return float(product) if product.ndim == 0 else tuple(product.tolist())
        for number, other in ((first, b), (second, a)):
            if number is not None and number.ndim == 0 and isinstance(other, Graph | Picture):
                return other.times(float(number))
            if number is not None and (number == 1.0).all() and isinstance(other, Primvar):
                return other
        of_colors = any(isinstance(each, Graph) and each.kind.startswith("color") for each in (a, b)) or _is_color(a) or _is_color(b)
        return self.apply("ND_multiply_color3" if of_colors else "ND_multiply_float", 0.0, place, in1=a, in2=b)

    def less(self, a: Any, place: Any) -> Any:
        """1 − a."""
        values = numbers(a)
        return float(1.0 - values.mean()) if values is not None else self.apply("ND_invert_float", 0.0, place, **{"in": a})

    def mix(self, low: Any, high: Any, share: Any, place: Any, color: bool = True) -> Any:
        return self.apply("ND_mix_color3" if color else "ND_mix_float", low, place, bg=low, fg=high, mix=share)


def _is_color(source: Any) -> bool:
    values = numbers(source)
    return isinstance(source, Picture) or (values is not None and values.ndim == 1)


def _plain(source: Any) -> Any:
    values = numbers(source)
    if values is None:
        return 0.0
    return float(values) if values.ndim == 0 else tuple(values.tolist())
