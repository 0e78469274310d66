"""Opens the layers of a stage, and repairs damaged ones in memory, with warnings."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import read_bytes
from . import crate_check, crate_values, missing_specs, mtlx_files, packages, spec_tree, text_layers
from .access import Access
from .spec_tree import SpecTree

_POSITIVE = ("metersPerUnit", "timeCodesPerSecond", "framesPerSecond")
_NUMBERS = (*_POSITIVE, "startTimeCode", "endTimeCode", "startFrame", "endFrame")
_UP = ("Y", "Z")


def clear_metadata(root: Any, diagnostics: Diagnostics) -> None:
    """Clear the stage metadata of a root layer whose values have no meaning, in memory, with a warning for each."""
    top = root.pseudoRoot
    for name in ("upAxis", *_NUMBERS):
        try:
            fault = _metadata_fault(name, top.GetInfo(name)) if top.HasInfo(name) else ""
        except (Tf.ErrorException, TypeError, ValueError):
            fault = "has another type"
        if fault:
            top.ClearInfo(name)
            diagnostics.warning(f"the value of `{name}` {fault}: its default is used", Span(root.GetDisplayName()))
        elif name in _NUMBERS and top.HasInfo(name):
            top.SetInfo(name, float(top.GetInfo(name)))  # usd-core refuses floats of 32 bits


def _metadata_fault(name: str, value: object) -> str:
    """What is wrong with the value of a stage's metadata; "" for a sound one."""
    if name == "upAxis" and isinstance(value, str):
        return "" if value in _UP else f"is `{value}`, neither Y nor Z"
    if name == "upAxis" or not isinstance(value, int | float):
        return "has another type"
    if not math.isfinite(value):
        return "is not finite"
    return f"is {value:g}, not above 0" if name in _POSITIVE and value <= 0 else ""


def layers(
    root: Any, session: Any, diagnostics: Diagnostics, stand_ins: list[Any], access: Access
) -> tuple[list[Any], dict[str, SpecTree]]:  # fmt: skip
    """The layers that a root layer and its session layer refer to, and those that they refer to, and the specs of all by identifier.

    The layers stay in memory as long as they are kept. They refer to nothing that `access` forbids.

    Damaged ones are repaired: those in place of files are added to `stand_ins`. A reference to a .mtlx file becomes one to a layer with
    its materials, in memory alone.
    """
    loaded: dict[str, Any] = {}
    trees: dict[str, SpecTree] = {}
    packages_read = {root.identifier}
    waiting = [root, session]
    while waiting:
        layer = waiting.pop()
        tree = trees[layer.identifier] = spec_tree.read(layer)
        missing_specs.leave_out(layer, tree.missing, diagnostics)  # first: usd-core's search for arcs ends the process at one
        if access.leave_out(layer, tree):
            stand_ins.append(layer)
            trees[layer.identifier] = spec_tree.read(layer)
        for asset in layer.GetCompositionAssetDependencies():
            path = access.path_of(layer, asset)
            package = path.partition("[")[0] if path.endswith("]") else ""
            if package and package not in packages_read:  # a layer in a package whose first layer is not referred to
                packages_read.add(package)
                loaded[package] = _opened(package, diagnostics, stand_ins)
            if path and path not in loaded:
                packages_read.add(path)
                loaded[path] = other = _opened(path, diagnostics, stand_ins)
                if other:
                    waiting.append(other)
            if path and loaded[path] and (loaded[path].anonymous or loaded[path].identifier.startswith(f"{path}[")):
                layer.UpdateCompositionAssetDependency(asset, loaded[path].identifier)
                trees[layer.identifier] = spec_tree.read(layer)
    return [layer for layer in loaded.values() if layer], trees


def _opened(path: str, diagnostics: Diagnostics, stand_ins: list[Any]) -> Any:
    """The layer of a file, repaired; None for one that usd-core refuses. One in place of the file is added to `stand_ins`.

    It is anonymous for a MaterialX document, and empty for a file that usd-core must not read.
    """
    file = Path(path)
    if file.suffix.lower() == ".mtlx":
        return mtlx_files.layer(file, diagnostics) if file.is_file() else None
    if file.exists() and not (file.is_file() or file.is_dir()):
        diagnostics.warning("this layer is not an ordinary file: it is left out", Span(path))
        return Sdf.Layer.CreateAnonymous(".usda")
    if why := crate_check.fault(file):
        diagnostics.warning(f"this layer cannot be read: {why}", Span(file.name))
        return Sdf.Layer.CreateAnonymous(".usda")
    try:
        return opened(file, diagnostics, stand_ins)
    except Tf.ErrorException:
        return None


def opened(path: Path, diagnostics: Diagnostics, stand_ins: list[Any]) -> Any:
    """The layer of a file that `crate_check.fault` lets through, repaired; None for one that is none. Raises Tf.ErrorException.

    Layers in place of files are added to `stand_ins`.
    """
    if path.suffix.lower() == ".usdz":
        replaced = packages.replaced(path, diagnostics)
        stand_ins += replaced
        return replaced[0] if replaced else Sdf.Layer.FindOrOpen(str(path)) or package(path, diagnostics)
    try:
        layer = _without_excess(path, diagnostics)
        if layer is None and text_layers.nests_too_deep(path):
            layer = repaired(path, diagnostics)
        if layer is None:
            return Sdf.Layer.FindOrOpen(str(path))
    except Tf.ErrorException:
        layer = repaired(path, diagnostics)
        if layer is None:
            raise
    stand_ins.append(layer)
    return layer


def _without_excess(path: Path, diagnostics: Diagnostics) -> Any:
    """The layer of a crate file without values of too many items, which are named; None without any."""
    data = crate_values.read(path, diagnostics)
    if not data:
        return None
    with tempfile.TemporaryDirectory() as folder:
        (copy := Path(folder) / "x.usdc").write_bytes(data)
        layer = _layer(path)
        layer.TransferContent(Sdf.Layer.OpenAsAnonymous(str(copy)))
    return layer


def repaired(path: Path, diagnostics: Diagnostics) -> Any:
    """The layer of a damaged text file, under the file's path; None for another file or one of which no prim can be read."""
    if path.suffix.lower() not in (".usda", ".usdc", ".usd") or not path.is_file():
        return None
    data = read_bytes(path)
    if data.startswith(crate_check.IDENTIFIER):
        return _crate(path, data, diagnostics) if path.suffix.lower() == ".usda" else None
    content = text_layers.repaired(data, path.name, diagnostics)
    if content is None:
        return None
    layer = _layer(path)
    layer.TransferContent(content)
    return layer


def _layer(path: Path) -> Any:
    """An empty layer under a file's path. It is in memory alone."""
    return Sdf.Layer.New(Sdf.FileFormat.FindByExtension(path.suffix[1:].lower()), str(path.resolve()))


def _crate(path: Path, data: bytes, diagnostics: Diagnostics) -> Any:
    """The layer of a binary file whose name ends as those of text; None if it is damaged."""
    with tempfile.TemporaryDirectory() as folder:
        (copy := Path(folder) / "x.usdc").write_bytes(data)
        try:
            binary = Sdf.Layer.OpenAsAnonymous(str(copy))
        except Tf.ErrorException:
            return None
        text_layers.warn(path.name, 1, "this file is binary, and its name ends as those of text", diagnostics)
        text_layer = _layer(path)
        text_layer.TransferContent(binary)
        return text_layer


def package(path: Path, diagnostics: Diagnostics) -> Any:
    """The first layer in a .usdz whose first file is none, which usd-core refuses; None without any."""
    try:
        with zipfile.ZipFile(path) as files:
            names = packages.layer_names(files.namelist())
        layer = Sdf.Layer.FindOrOpen(f"{path}[{names[0]}]") if names else None
    except (zipfile.BadZipFile, OSError, Tf.ErrorException):
        return None
    if layer:
        packages.warn_of_first(path, names[0], diagnostics)
    return layer
