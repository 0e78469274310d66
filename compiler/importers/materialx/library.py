"""Definitions of MaterialX' library: inputs with types and defaults, and graphs that implement nodes by others.

Source: the documents stdlib, pbrlib and bxdf of the package MaterialX.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from functools import cache
from typing import Any

from .graph import Node, Port

_NAMES = {"UsdUVTexture": "ND_UsdUVTexture_23", "ND_UsdUVTexture": "ND_UsdUVTexture_23", "UsdTransform2d": "ND_UsdTransform2d"}
_READERS = {"float": "float", "float2": "vector2", "float3": "vector3", "float4": "vector4", "int": "integer", "string": "string",
            "normal": "vector3", "point": "vector3", "vector": "vector3"}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Definition:
    """A node definition. `graph` is an element of the package, or None for a node that graphs do not implement."""

    name: str
    category: str
    inputs: dict[str, Port]
    outputs: dict[str, str]  # types
    graph: Any


@cache
def package() -> Any:
    """The package MaterialX, or None where it is not installed."""
    try:
        return importlib.import_module("MaterialX")
    except ImportError:
        return None


@cache
def document() -> Any:
    """The library as a document; None without the package."""
    mx = package()
    if mx is None:
        return None
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    return library


@cache
def _graphs() -> dict[str, Any]:
    """Graphs that implement definitions, by name of these."""
    library = document()
    graphs = {graph.getNodeDefString(): graph for graph in library.getNodeGraphs() if graph.getNodeDefString()}
    for element in library.getImplementations():
        if name := element.getAttribute("nodegraph"):
            graphs[element.getNodeDefString()] = library.getNodeGraph(name)
    return graphs


@cache
def definition(name: str) -> Definition | None:
    """The definition of a name, as ND_add_float or UsdUVTexture; None for others, or without the package."""
    name = _NAMES.get(name, name)
    if name.startswith("UsdPrimvarReader_"):
        name = f"ND_UsdPrimvarReader_{_READERS.get(name.rpartition('_')[2], 'float')}"
    library = document()
    element = library.getNodeDef(name) if library is not None else None
    if element is None:
        return None
    inputs = {port.getName(): port_of(port) for port in element.getActiveInputs()}
    outputs = {port.getName(): port.getType() for port in element.getActiveOutputs()}
    return Definition(name, element.getNodeString(), inputs, outputs, _graphs().get(name))


def category(node: Node) -> str:
    """The category of a node, as add."""
    defined = definition(node.definition)
    return defined.category if defined else node.definition.removeprefix("ND_").partition("_")[0]


def port_of(element: Any) -> Port:
    """The input of an element of the package: its value, or the property of the geometry that is its default."""
    kind = element.getType()
    value = element.getValue()
    return Port(kind, plain(value, kind), geometry=element.getDefaultGeomPropString() if value is None else "",
                space=element.getActiveColorSpace() if kind in ("filename", "color3", "color4") else "")  # fmt: skip


def plain(value: Any, kind: str) -> Any:
    """A value of the package as numbers, a truth value or a text."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if kind.startswith("matrix"):
        side = 3 if kind == "matrix33" else 4
        return tuple(float(value[i, j]) for i in range(side) for j in range(side))
    return tuple(float(value[k]) for k in range(len(value)))


def instance(node: Node, defined: Definition) -> dict[str, Port]:
    """The outputs of the graph that implements a node, as ports that read nodes with this node's inputs."""
    graph, nodes = defined.graph, {}
    for child in graph.getNodes():
        definition_name = child.getNodeDef().getName() if child.getNodeDef() is not None else ""
        nodes[child.getName()] = Node(f"{node.name}/{child.getName()}", definition_name, {}, node.place)

    def port(element: Any) -> Port:
        if interface := element.getAttribute("interfacename"):
            return node.inputs.get(interface) or defined.inputs.get(interface) or Port(element.getType())
        if (source := element.getAttribute("nodename")) in nodes:
            return Port(element.getType(), source=nodes[source], output=element.getAttribute("output") or "out")
        return port_of(element)

    for child in graph.getNodes():
        nodes[child.getName()].inputs = {element.getName(): port(element) for element in child.getInputs()}
    return {element.getName(): port(element) for element in graph.getOutputs()}
