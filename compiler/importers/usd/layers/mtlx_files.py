"""Reads MaterialX documents (.mtlx) as USD layers, for which usd-core has no file format.

The layer has the prims of OpenUSD's UsdMtlx plugin: /MaterialX/Materials/NAME, with shaders and node graphs below each material.
Format: MaterialX Specification 1.39.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pxr import Sdf, Tf, Usd, UsdShade

from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import read_bytes

_TYPES = {
    "float": Sdf.ValueTypeNames.Float, "integer": Sdf.ValueTypeNames.Int, "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f, "color4": Sdf.ValueTypeNames.Color4f, "vector2": Sdf.ValueTypeNames.Float2,
    "vector3": Sdf.ValueTypeNames.Float3, "vector4": Sdf.ValueTypeNames.Float4, "string": Sdf.ValueTypeNames.String,
    "filename": Sdf.ValueTypeNames.Asset,
}  # fmt: skip
_COUNTS = {"color3": 3, "color4": 4, "vector2": 2, "vector3": 3, "vector4": 4}
_BLANKS = " \t\r\n,"
_SEPARATORS = re.compile(r"[\s,]+")  # of the numbers of a value, as the library of MaterialX separates them
_ROOT = Sdf.Path("/MaterialX/Materials")


def layer(path: Path, diagnostics: Diagnostics) -> Any:
    """An anonymous layer with the materials of a document; None, with a warning, for one that is not MaterialX."""
    span = Span(path.name)

    def warn(message: str) -> None:
        diagnostics.warning(message, span)

    try:
        root = ElementTree.fromstring(_without_blanks(read_bytes(path)))
    except (ElementTree.ParseError, OSError, ValueError, LookupError) as failure:
        warn(f"the MaterialX file `{path.name}` cannot be read: {failure}")
        return None
    new_layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(new_layer)
    stage.SetDefaultPrim(stage.DefinePrim("/MaterialX"))
    materials = root.findall("surfacematerial")
    if not materials:
        warn(f"`{path.name}` has no `surfacematerial`: nothing of it is drawn")
    for unread in sorted({child.tag.rpartition("}")[2] for child in root} & {"include", "look", "material"}):
        warn(f"the elements `{unread}` of `{path.name}` are not drawn")
    for element in materials:
        prim_path = _ROOT.AppendChild(_identifier(element.get("name", "")))
        document = _Document(stage, root, path.parent, root.get("fileprefix", ""), warn)
        shader = next((port for port in element.findall("input") if port.get("type") == "surfaceshader"), None)
        material = UsdShade.Material.Define(stage, prim_path)
        if shader is not None and (source := document.source(shader, root, prim_path)) is not None:
            material.CreateSurfaceOutput("mtlx").ConnectToSource(source)
    return new_layer


def _without_blanks(data: bytes) -> bytes:
    """A document without blanks before its declaration, which XML refuses and pugixml, the parser of MaterialX, passes over."""
    mark = codecs.BOM_UTF8 if data.startswith(codecs.BOM_UTF8) else b""
    return mark + data.removeprefix(mark).lstrip()


def _identifier(name: str) -> str:
    return Tf.MakeValidIdentifier(name)


@dataclass(slots=True)
class _Document:
    """Copies the nodes that one material uses to prims."""

    stage: Any
    root: ElementTree.Element
    folder: Path
    prefix: str
    warn: Callable[[str], None]
    copied: set[Any] = field(default_factory=set)  # paths of prims

    def source(self, port: ElementTree.Element, scope: ElementTree.Element, scope_path: Any) -> Any:
        """The path of the output that feeds an input or output of `scope`, whose prim is `scope_path`; None for none."""
        output = _identifier(port.get("output") or "out")
        if name := port.get("nodegraph"):
            graph = self._named(name, self.root)
            return None if graph is None else self._graph(graph, scope_path, port.get("output"))
        node = self._named(port.get("nodename", ""), scope)
        if node is None:
            return None
        path = scope_path.AppendChild(_identifier(node.get("name", "")))
        if path not in self.copied:
            self.copied.add(path)
            self._shader(node, scope, scope_path, path)
        UsdShade.Shader(self.stage.GetPrimAtPath(path)).CreateOutput(output, Sdf.ValueTypeNames.Token)
        return path.AppendProperty(f"outputs:{output}")

    def _named(self, name: str, scope: ElementTree.Element) -> ElementTree.Element | None:
        node = next((child for child in scope if child.get("name") == name), None)
        if node is None:
            self.warn(f"there is no node `{name}`: the input that it feeds takes its default")
        return node

    def _graph(self, graph: ElementTree.Element, scope_path: Any, output: str | None) -> Any:
        """The path of an output of a node graph, which is copied below `scope_path`."""
        path = scope_path.AppendChild(_identifier(graph.get("name", "")))
        graph_prim = UsdShade.NodeGraph.Define(self.stage, path)
        outputs = [child for child in graph.findall("output") if output in (None, child.get("name"))]
        if not outputs:
            self.warn(f"the node graph `{graph.get('name')}` has no output `{output}`")
            return None
        if path not in self.copied:
            self.copied.add(path)
            for port in graph.findall("input"):
                self._input(graph_prim, port, self.root, scope_path)
        graph_output = graph_prim.CreateOutput(_identifier(outputs[0].get("name", "out")), Sdf.ValueTypeNames.Token)
        if (source := self.source(outputs[0], graph, path)) is not None:
            graph_output.ConnectToSource(source)
        return graph_output.GetAttr().GetPath()

    def _shader(self, node: ElementTree.Element, scope: ElementTree.Element, scope_path: Any, path: Any) -> None:
        shader = UsdShade.Shader.Define(self.stage, path)
        shader.CreateIdAttr(node.get("nodedef") or f"ND_{node.tag}_{node.get('type')}")
        for port in node.findall("input"):
            self._input(shader, port, scope, scope_path)

    def _input(self, owner: Any, port: ElementTree.Element, scope: ElementTree.Element, scope_path: Any) -> None:
        name, type_ = port.get("name", ""), port.get("type", "")
        if type_ not in _TYPES:
            self.warn(f"inputs of the type `{type_}` are not drawn")
            return
        shader_input = owner.CreateInput(_identifier(name), _TYPES[type_])
        if interface := port.get("interfacename"):
            shader_input.ConnectToSource(scope_path.AppendProperty(f"inputs:{_identifier(interface)}"))
        elif port.get("nodename") or port.get("nodegraph"):
            if (source := self.source(port, scope, scope_path)) is not None:
                shader_input.ConnectToSource(source)
        elif (value := self._value(port.get("value", ""), type_)) is not None:
            shader_input.Set(value)
        if space := port.get("colorspace"):
            shader_input.GetAttr().SetColorSpace(space)

    def _value(self, text: str, type_: str) -> Any:
        if type_ == "filename":
            return Sdf.AssetPath(os.fspath(self.folder / (self.prefix + text)))
        if type_ == "string":
            return text
        if type_ == "boolean":
            return text.strip().lower() == "true"
        try:
            numbers = tuple(map(float, _SEPARATORS.split(text.strip(_BLANKS))))
            if len(numbers) == _COUNTS.get(type_, 1):
                return int(numbers[0]) if type_ == "integer" else numbers[0] if type_ == "float" else numbers
        except (ValueError, OverflowError):
            pass
        self.warn(f"`{text[:40]}` is not of the type {type_}: the input takes its default")
        return None
