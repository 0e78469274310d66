"""Reads MaterialX documents (.mtlx) as USD layers, for which usd-core has no file format.

The layer has the prims of OpenUSD's UsdMtlx plugin: /MaterialX/Materials/NAME, with shaders and node graphs below each material. The
package MaterialX upgrades documents of older versions to 1.39 and finds the definitions of nodes.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core and MaterialX create their modules' names at run time)

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pxr import Gf, Sdf, Tf, Usd, UsdShade

from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import read_bytes
from ...materialx import library

_TYPES = {
    "float": Sdf.ValueTypeNames.Float, "integer": Sdf.ValueTypeNames.Int, "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f, "color4": Sdf.ValueTypeNames.Color4f, "vector2": Sdf.ValueTypeNames.Float2,
    "vector3": Sdf.ValueTypeNames.Float3, "vector4": Sdf.ValueTypeNames.Float4, "string": Sdf.ValueTypeNames.String,
    "filename": Sdf.ValueTypeNames.Asset, "matrix33": Sdf.ValueTypeNames.Matrix3d, "matrix44": Sdf.ValueTypeNames.Matrix4d,
}  # fmt: skip
_CLOSURES = ("BSDF", "EDF", "VDF", "surfaceshader", "displacementshader", "volumeshader", "material")
_ROOT = Sdf.Path("/MaterialX/Materials")
MOST_INCLUDES = 64
MOST_DEPTH = 120  # nodes and node graphs one behind the other
_PREFIX = re.compile(rb"</?([A-Za-z_][\w.-]*):[A-Za-z_]")
_NUMBERS = ("float", "integer", "boolean", "color3", "color4", "vector2", "vector3", "vector4")


def layer(path: Path, diagnostics: Diagnostics) -> Any:
    """An anonymous layer with the materials of a document; None, with a warning, for one that is not MaterialX."""
    span = Span(path.name)

    def warn(message: str, hint: str = "") -> None:
        diagnostics.warning(message, span, hint)

    mx = library.package()
    if mx is None:
        warn(f"the MaterialX file `{path.name}` is not read: the package MaterialX is not installed", "pip install MaterialX")
        return None
    try:
        document = _document(path, warn)
        definitions = {element.getName() for element in document.getNodeDefs()}
        outputs = _outputs(document)
        in_graphs = [node for graph in _graphs(document) for node in graph.getNodes() if node.getType() == "material"]
        document.setDataLibrary(library.document())
    except (ElementTree.ParseError, OSError, ValueError, LookupError, RuntimeError) as failure:
        warn(f"the MaterialX file `{path.name}` cannot be read: {failure}")
        return None
    new_layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(new_layer)
    stage.SetDefaultPrim(stage.DefinePrim("/MaterialX"))
    materials = [*document.getMaterialNodes(), *in_graphs] or [node for node in document.getNodes() if node.getType() == "surfaceshader"]
    if not materials and not outputs:
        warn(f"`{path.name}` has no `surfacematerial`: nothing of it is drawn")
    looks = [look for look in document.getLooks() if look.getMaterialAssigns()]
    if looks:
        warn(f"the looks of `{path.name}` are not drawn: a stage binds materials to its prims")
    for node in materials:
        prim_path = _ROOT.AppendChild(Tf.MakeValidIdentifier(node.getNamePath().replace("/", "_")))
        reader = _Document(stage, document, path.parent, definitions, warn)
        material = UsdShade.Material.Define(stage, prim_path)
        for type_, output in (("surfaceshader", "surface"), ("displacementshader", "displacement"), ("volumeshader", "volume")):
            port, scope = next((port for port in node.getInputs() if port.getType() == type_), None), node.getParent()
            while port is not None and port.getInterfaceName():  # of a material in a node graph
                port, scope = scope.getInput(port.getInterfaceName()), scope.getParent()
            source = None if port is None else reader.source(port, scope, prim_path)
            if node.getType() == type_:
                source = reader.output(node, "out", document, prim_path)
            if source is not None:
                material.CreateOutput(f"mtlx:{output}", Sdf.ValueTypeNames.Token).ConnectToSource(source)
    for output in [] if materials else outputs:
        prim_path = _ROOT.AppendChild(Tf.MakeValidIdentifier(output.getNamePath().replace("/", "_")))
        _Document(stage, document, path.parent, definitions, warn).material_of_output(output, prim_path)
    return new_layer


def _graphs(document: Any) -> list[Any]:
    """Node graphs that define no node."""
    return [graph for graph in document.getNodeGraphs() if not graph.getNodeDefString()]


def _outputs(document: Any) -> list[Any]:
    """What MaterialX's viewer shows of a document without materials: outputs of the document and of graphs that define no node."""
    outputs = [output for owner in (document, *_graphs(document)) for output in owner.getOutputs()]
    return [output for output in outputs if output.getType() in ("surfaceshader", *_NUMBERS)]


def _document(path: Path, warn: Callable[[str], None]) -> Any:
    """A document of the package with what it includes. Each one is of its own version, and its elements have the colour space, the prefix
    of files and the namespace of its root. Raises ElementTree.ParseError, OSError, ValueError, LookupError, RuntimeError.
    """
    parsed = _parsed(path, warn)
    documents = [_of_package(parsed[0].root)]
    for each in parsed[1:]:
        try:
            documents.append(_of_package(each.root))
        except (ValueError, LookupError, RuntimeError) as failure:
            warn(f"the document `{each.name}` cannot be read: {failure}")
            documents.append(library.package().createDocument())
    for index in reversed(range(1, len(documents))):
        documents[parsed[index].parent].importLibrary(documents[index])
    return documents[0]


def _of_package(root: ElementTree.Element) -> Any:
    mx = library.package()
    document, options = mx.createDocument(), mx.XmlReadOptions()
    options.readXIncludeFunction = None
    mx.readFromXmlString(document, ElementTree.tostring(root, encoding="unicode"), mx.FileSearchPath(), options)
    return document


@dataclass(frozen=True, slots=True)
class _Parsed:
    """The elements of a document. `parent` is the index of the document that includes it."""

    root: ElementTree.Element
    folder: Path
    name: str = ""
    parent: int = 0


def _parsed(path: Path, warn: Callable[[str], None]) -> list[_Parsed]:
    """A document and the documents that it includes, in or below its folder."""
    result = [_Parsed(_elements(read_bytes(path)), path.parent)]
    folder, read = path.parent.resolve(), {path.resolve()}
    for index, document in enumerate(result):  # grows
        for child in [each for each in document.root if each.tag.rpartition("}")[2] == "include"]:
            document.root.remove(child)
            file = (document.folder / child.get("href", "")).resolve()
            if file in read:
                continue
            if not file.is_relative_to(folder) or len(read) > MOST_INCLUDES:
                warn(f"the document `{child.get('href')}` lies outside of the folder of `{path.name}`: it is left out")
                continue
            try:
                included = _elements(read_bytes(file))
            except (ElementTree.ParseError, OSError, ValueError, LookupError) as failure:
                warn(f"the document `{child.get('href')}` cannot be read: {failure}")
                continue
            read.add(file)
            result.append(_Parsed(included, file.parent, child.get("href", ""), index))
    for document in result:
        for element in document.root.iter("node"):  # the long form of 1.39
            element.tag = element.get("nodetype") or "node"
    return result


def _elements(data: bytes) -> ElementTree.Element:
    """The root of a document. Prefixes of nodes are names of MaterialX, which documents need not declare as those of XML."""
    text = _without_blanks(data)
    prefixes = {prefix.decode() for prefix in _PREFIX.findall(text)} - {"xi", "xml"}
    declared = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in sorted(prefixes) if f"xmlns:{prefix}=".encode() not in text)
    root = ElementTree.fromstring(re.sub(rb"<materialx\b", b"<materialx" + declared.encode(), text, count=1))
    for element in root.iter():
        space, _, name = element.tag.removeprefix("{").rpartition("}")
        if space in prefixes:
            element.tag = f"{space}:{name}"
    return root


def _without_blanks(data: bytes) -> bytes:
    """A document without blanks before its declaration, which XML refuses and pugixml, the parser of MaterialX, passes over."""
    mark = codecs.BOM_UTF8 if data.startswith(codecs.BOM_UTF8) else b""
    return mark + data.removeprefix(mark).lstrip()


@dataclass(slots=True)
class _Document:
    """Copies the nodes that one material uses to prims."""

    stage: Any
    document: Any
    folder: Path
    definitions: set[str]  # names of those of the document itself
    warn: Callable[[str], None]
    copied: set[Any] = field(default_factory=set)  # paths of prims
    depth: int = 0

    def source(self, port: Any, scope: Any, scope_path: Any) -> Any:
        """The path of the output that feeds an input or output of `scope`, whose prim is `scope_path`; None for none."""
        output = port.getAttribute("output") or "out"
        if self.depth >= MOST_DEPTH:
            self.warn(f"more than {MOST_DEPTH} nodes feed each other, or a node feeds itself: the input takes its default")
            return None
        self.depth += 1
        try:
            return self._source(port, output, scope, scope_path)
        finally:
            self.depth -= 1

    def _source(self, port: Any, output: str, scope: Any, scope_path: Any) -> Any:
        if name := port.getAttribute("nodegraph"):
            graph = scope.getChild(name) or self.document.getNodeGraph(name)
            if graph is None:
                self.warn(f"there is no node graph `{name}`: the input that it feeds takes its default")
                return None
            return self._graph(graph, scope_path, port.getAttribute("output"), [], self.document)
        name = port.getAttribute("nodename")
        if not name:
            written = self.document.getOutput(output) if port.getAttribute("output") else None
            return None if written is None else self.source(written, self.document, scope_path)
        node = scope.getChild(name)
        if node is None:
            self.warn(f"there is no node `{name}`: the input that it feeds takes its default")
            return None
        types = node.getType(), port.getType()
        if types[0] != types[1] and "multioutput" not in types and not all(each in _NUMBERS for each in types):
            self.warn(f"the node `{name}` gives a {types[0]}, where a {types[1]} is wanted: the input takes its default")
            return None
        return self.output(node, output, scope, scope_path)

    def output(self, node: Any, output: str, scope: Any, scope_path: Any) -> Any:
        """The path of an output of a node, which is copied to a shader, or to a node graph where the document defines it by one."""
        path = scope_path.AppendChild(Tf.MakeValidIdentifier(node.getName()))
        definition: Any = node.getNodeDef()
        name = definition.getName() if definition is not None else ""
        graph = next((g for g in self.document.getNodeGraphs() if g.getNodeDefString() == name), None) if name in self.definitions else None
        if definition is not None and graph is not None:
            inputs = {port.getName(): port for port in definition.getActiveInputs()} | {port.getName(): port for port in node.getInputs()}
            return self._graph(graph, scope_path, output, list(inputs.values()), scope, path)
        name = Tf.MakeValidIdentifier(output)
        if path not in self.copied:
            self.copied.add(path)
            shader = UsdShade.Shader.Define(self.stage, path)
            shader.CreateIdAttr(definition.getName() if definition is not None else f"ND_{node.getCategory()}_{node.getType()}")
            written = definition if definition is not None else library.document().getNodeDef(str(shader.GetIdAttr().Get()))
            for port in node.getInputs():
                defined = written.getActiveInput(port.getName()) if written is not None else None
                types = port.getType(), port.getType() if defined is None else defined.getType()
                if types == ("string", "integer") and (number := _enumerated(defined, port.getValueString())) is not None:
                    shader.CreateInput(Tf.MakeValidIdentifier(port.getName()), Sdf.ValueTypeNames.Int).Set(number)
                elif types[0] != types[1]:
                    place = f"the input `{port.getName()}` of `{node.getName()}`"
                    self.warn(f"{place} has the type {types[0]}, not {types[1]}: it takes its default")
                else:
                    self._input(shader, port, scope, scope_path)
            if node.getCategory() == "UsdUVTexture":
                self._wraps(shader)
        UsdShade.Shader(self.stage.GetPrimAtPath(path)).CreateOutput(name, Sdf.ValueTypeNames.Token)
        return path.AppendProperty(f"outputs:{name}")

    def _wraps(self, shader: Any) -> None:
        """Writes MaterialX's wrap mode of UsdUVTexture, which is another one in USD."""
        defined = library.definition("UsdUVTexture")
        for name in ("wrapS", "wrapT"):
            if defined is not None and name in defined.inputs and not shader.GetInput(name):
                shader.CreateInput(name, Sdf.ValueTypeNames.String).Set(str(defined.inputs[name].value))

    def material_of_output(self, output: Any, prim_path: Any) -> None:
        """A material of a surface shader, or one that emits the values of an output."""
        owner = output.getParent()
        in_graph = owner.isA(library.package().NodeGraph)
        source = self._graph(owner, prim_path, output.getName(), [], owner) if in_graph else self.source(output, owner, prim_path)
        if source is None:
            return
        if (kind := output.getType()) != "surfaceshader":
            shader = UsdShade.Shader.Define(self.stage, prim_path.AppendChild("shown"))
            shader.CreateIdAttr(f"ND_convert_{kind}_surfaceshader")
            shader.CreateInput("in", _TYPES[kind]).ConnectToSource(source)
            source = shader.CreateOutput("out", Sdf.ValueTypeNames.Token).GetAttr().GetPath()
        UsdShade.Material.Define(self.stage, prim_path).CreateOutput("mtlx:surface", Sdf.ValueTypeNames.Token).ConnectToSource(source)

    def _graph(self, graph: Any, scope_path: Any, output: str, inputs: list[Any], scope: Any, path: Any = None) -> Any:
        """The path of an output of a node graph, which is copied below `scope_path`, or to `path` with the inputs of a node."""
        path = path or scope_path.AppendChild(Tf.MakeValidIdentifier(graph.getName()))
        graph_prim = UsdShade.NodeGraph.Define(self.stage, path)
        outputs = list(graph.getOutputs())
        chosen = next((each for each in outputs if each.getName() == output), outputs[0] if outputs and output in ("", "out") else None)
        if chosen is None:
            self.warn(f"the node graph `{graph.getName()}` has no output `{output}`")
            return None
        if path not in self.copied:
            self.copied.add(path)
            for port in inputs or graph.getInputs():
                self._input(graph_prim, port, scope, scope_path)
        graph_output = graph_prim.CreateOutput(Tf.MakeValidIdentifier(chosen.getName()), Sdf.ValueTypeNames.Token)
        if not graph_output.HasConnectedSource() and (source := self.source(chosen, graph, path)) is not None:
            graph_output.ConnectToSource(source)
        return graph_output.GetAttr().GetPath()

    def _input(self, owner: Any, port: Any, scope: Any, scope_path: Any) -> None:
        type_ = port.getType()
        if type_ not in _TYPES and type_ not in _CLOSURES:
            self.warn(f"inputs of the type `{type_}` are not drawn")
            return
        shader_input = owner.CreateInput(Tf.MakeValidIdentifier(port.getName()), _TYPES.get(type_, Sdf.ValueTypeNames.Token))
        if interface := port.getAttribute("interfacename"):
            shader_input.ConnectToSource(scope_path.AppendProperty(f"inputs:{Tf.MakeValidIdentifier(interface)}"))
        elif port.getAttribute("nodename") or port.getAttribute("nodegraph") or port.getAttribute("output"):
            if (source := self.source(port, scope, scope_path)) is not None:
                shader_input.ConnectToSource(source)
        elif (value := self._value(port, type_)) is not None:
            shader_input.Set(value)
        space = port.getActiveColorSpace() if type_ in ("color3", "color4", "filename") else ""
        if space or type_ == "filename":  # a picture without a colour space is read as it is: MaterialX converts none
            shader_input.GetAttr().SetColorSpace(space or "raw")

    def _value(self, port: Any, type_: str) -> Any:
        text = port.getValueString()
        if type_ == "filename":
            written = (port.getActiveFilePrefix() + text).replace("\\", "/") if text else ""
            return Sdf.AssetPath(os.fspath(self.folder / written)) if written else None
        if type_ in _CLOSURES or not text:
            return None
        value = library.plain(port.getValue(), type_)
        if value is None:
            self.warn(f"`{text[:40]}` is not of the type {type_}: the input takes its default")
        elif type_.startswith("matrix"):
            return Gf.Matrix3d(*value) if type_ == "matrix33" else Gf.Matrix4d(*value)
        elif (factor := self._units(port)) != 1.0 and isinstance(value, float | tuple):
            return value * factor if isinstance(value, float) else tuple(each * factor for each in value)
        return value

    def _units(self, port: Any) -> float:
        """The factor that makes a value metres or degrees, by its `unit` and `unittype`; 1 without both."""
        unit, kind = port.getUnit(), port.getUnitType()
        if not unit or not kind:
            return 1.0
        scales = {each.getName(): each.getAttribute("scale") for each in self.document.getUnitDefs()
                  if each.getUnitType() == kind for each in each.getUnits()}  # fmt: skip
        if unit not in scales:
            self.warn(f"the unit `{unit}` of `{port.getNamePath()}` is not known: the value is drawn as it is")
        return float(scales.get(unit, 1.0))


def _enumerated(defined: Any, text: str) -> int | None:
    """The number of an integer input that has a name for it, as `presence` of opacityMode."""
    names, values = (defined.getAttribute(name).split(",") for name in ("enum", "enumvalues"))
    named = dict(zip((name.strip() for name in names), values, strict=False))
    return int(named[text]) if named.get(text, "").strip().lstrip("-").isdigit() else None
