"""Reads damaged `.usda` layers: byte order marks, stray bytes, and statements that usd-core refuses are left out with warnings."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import codecs
import re
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from .....lang.diagnostics import Diagnostics, Span
from . import crate_check, crate_values, missing_specs, mtlx_files, packages

MOST = 20  # statements of a layer that may be left out
_HEADER = "#usda 1.0"
_FARTHEST = 1000  # characters before the header
_CRATE = b"PXR-USDC"
_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_ODD = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ufffd\ufeff]+")
_METADATA = {
    "upAxis": str, "metersPerUnit": (int, float), "timeCodesPerSecond": (int, float), "framesPerSecond": (int, float),
    "startTimeCode": (int, float), "endTimeCode": (int, float), "startFrame": (int, float), "endFrame": (int, float),
}  # fmt: skip
_PLACE = re.compile(r":(\d+):\d+: ")
_PROPERTY = re.compile(r" in <[^<>]*?([^/<>.]+)\.([\w:]+)>")


def text_of(failure: Exception) -> str:
    """The text of an error of usd-core; "" where it is not UTF-8."""
    try:
        return str(failure)
    except UnicodeDecodeError:
        return ""


def clear_metadata(root: Any, diagnostics: Diagnostics) -> None:
    """Clear the stage metadata of a root layer whose values have another type, in memory, with a warning for each."""
    for name, types in _METADATA.items():
        try:
            fits = not root.pseudoRoot.HasInfo(name) or isinstance(root.pseudoRoot.GetInfo(name), types)
        except (Tf.ErrorException, TypeError, ValueError):
            fits = False
        if fits and types is not str and root.pseudoRoot.HasInfo(name):
            root.pseudoRoot.SetInfo(name, float(root.pseudoRoot.GetInfo(name)))  # usd-core refuses floats of 32 bits
        if not fits:
            root.pseudoRoot.ClearInfo(name)
            diagnostics.warning(f"the value of `{name}` has another type: its default is used", Span(root.GetDisplayName()))


def layers(root: Any, diagnostics: Diagnostics, made: list[Any]) -> list[Any]:
    """The layers that a layer refers to, and those that they refer to. They stay in memory as long as they are kept.

    Damaged ones are repaired: those in place of files are added to `made`. A reference to a .mtlx file becomes one to a layer with
    its materials, in memory alone.
    """
    found: dict[str, Any] = {}
    packages_read = {root.identifier}
    waiting = [root]
    while waiting:
        layer = waiting.pop()
        missing_specs.leave_out(layer, diagnostics)
        for asset in layer.GetCompositionAssetDependencies():
            path = layer.ComputeAbsolutePath(asset)
            package = path.partition("[")[0] if path.endswith("]") else ""
            if package and package not in packages_read:  # a layer in a package whose first layer is not referred to
                packages_read.add(package)
                found[package] = _opened(package, diagnostics, made)
            if path and path not in found:
                packages_read.add(path)
                found[path] = other = _opened(path, diagnostics, made)
                if other:
                    waiting.append(other)
            if path and found[path] and (found[path].anonymous or found[path].identifier.startswith(f"{path}[")):
                layer.UpdateCompositionAssetDependency(asset, found[path].identifier)
    return [layer for layer in found.values() if layer]


def _opened(path: str, diagnostics: Diagnostics, made: list[Any]) -> Any:
    """The layer of a file, repaired; None for one that usd-core refuses. One in place of the file is added to `made`.

    It is anonymous for a MaterialX document, and empty for a file that usd-core must not read.
    """
    file = Path(path)
    if file.suffix.lower() == ".mtlx":
        return mtlx_files.layer(file, diagnostics) if file.is_file() else None
    if file.exists() and not (file.is_file() or file.is_dir()):
        diagnostics.warning("this layer is no ordinary file: it is left out", Span(path))
        return Sdf.Layer.CreateAnonymous(".usda")
    if why := crate_check.fault(file):
        diagnostics.warning(f"this layer cannot be read: {why}", Span(file.name))
        return Sdf.Layer.CreateAnonymous(".usda")
    try:
        return opened(file, diagnostics, made)
    except Tf.ErrorException:
        return None


def opened(path: Path, diagnostics: Diagnostics, made: list[Any]) -> Any:
    """The layer of a file that `crate_check.fault` lets through, repaired; None for one that is none. Raises Tf.ErrorException.

    Layers in place of files are added to `made`.
    """
    if path.suffix.lower() == ".usdz":
        replaced = packages.replaced(path, diagnostics)
        made += replaced
        return replaced[0] if replaced else Sdf.Layer.FindOrOpen(str(path)) or package(path, diagnostics)
    try:
        found = _without_excess(path, diagnostics)
        if found is None:
            return Sdf.Layer.FindOrOpen(str(path))
    except Tf.ErrorException:
        found = repaired(path, diagnostics)
        if found is None:
            raise
    made.append(found)
    return found


def _without_excess(path: Path, diagnostics: Diagnostics) -> Any:
    """The layer of a crate file without values of too many items, which are named; None without any."""
    data = crate_values.read(path, diagnostics)
    if not data:
        return None
    with tempfile.TemporaryDirectory() as folder:
        (copy := Path(folder) / "x.usdc").write_bytes(data)
        made = _layer(path)
        made.TransferContent(Sdf.Layer.OpenAsAnonymous(str(copy)))
    return made


def repaired(path: Path, diagnostics: Diagnostics) -> Any:
    """The layer of a damaged text file, under the file's path; None for another file or one of which no prim can be read."""
    if path.suffix.lower() not in (".usda", ".usdc", ".usd") or not path.is_file():
        return None
    data = path.read_bytes()
    if data.startswith(_CRATE):
        return _crate(path, diagnostics) if path.suffix.lower() == ".usda" else None
    mark = next((mark for mark in _MARKS if data.startswith(mark)), b"")
    before, header, rest = data.removeprefix(mark).decode(_MARKS.get(mark, "utf-8"), "replace").partition(_HEADER)
    if not header or len(before) > _FARTHEST:
        return None
    said = Diagnostics()  # for a layer that can be read
    if path.suffix.lower() == ".usdc":
        _warn(path, 1, "this file is text, and its name ends as those of binary files", said)
    if mark:
        _warn(path, 1, f"a byte order mark ({_MARKS[mark].upper()}) is left out", said)
    skipped = before.count("\n")
    if odd := _ODD.search(rest):
        _warn(path, skipped + rest[: odd.start()].count("\n") + 1, "bytes that are no text are left out", said)
    lines = [""] * skipped + (header + _ODD.sub(" ", rest)).split("\n")
    found = Sdf.Layer.CreateAnonymous(".usda")
    if not _read(found, lines, skipped, path, said) or (said.items and not found.rootPrims):
        return None
    diagnostics.items += said.items
    made = _layer(path)
    made.TransferContent(found)
    return made


def _layer(path: Path) -> Any:
    """An empty layer under a file's path. It is in memory alone."""
    return Sdf.Layer.New(Sdf.FileFormat.FindByExtension(path.suffix[1:].lower()), str(path.resolve()))


def _crate(path: Path, diagnostics: Diagnostics) -> Any:
    """The layer of a binary file whose name ends as those of text; None if it is damaged."""
    with tempfile.TemporaryDirectory() as folder:
        (link := Path(folder) / "x.usdc").symlink_to(path.resolve())
        try:
            found = Sdf.Layer.OpenAsAnonymous(str(link))
        except Tf.ErrorException:
            return None
        _warn(path, 1, "this file is binary, and its name ends as those of text", diagnostics)
        made = _layer(path)
        made.TransferContent(found)
        return made


def package(path: Path, diagnostics: Diagnostics) -> Any:
    """The first layer in a .usdz whose first file is none, which usd-core refuses; None without any."""
    try:
        with zipfile.ZipFile(path) as files:
            names = packages.layer_names(files.namelist())
        found = Sdf.Layer.FindOrOpen(f"{path}[{names[0]}]") if names else None
    except (zipfile.BadZipFile, OSError, Tf.ErrorException):
        return None
    if found:
        packages.warn_of_first(path, names[0], diagnostics)
    return found


def _read(layer: Any, lines: list[str], skipped: int, path: Path, diagnostics: Diagnostics) -> bool:
    """Fill the layer from lines, after `skipped` empty ones. Lines that cannot be read are made empty."""
    closed = 0
    for _ in range(MOST):
        try:
            return bool(layer.ImportFromString("\n".join(lines[skipped:]) + "\n" + "}\n" * closed))
        except Tf.ErrorException as failure:
            text = text_of(failure)
        layer.Clear()
        found = _bad(text, lines, skipped)
        if found is None:
            return False
        first, last = found
        if first >= len(lines) or not any(line.strip() for line in lines[first:]):
            if not closed:
                _warn(path, len(lines), "the file ends early: it is read as if its prims ended there", diagnostics)
            closed += 1
            continue
        _warn(path, first + 1, f"this statement cannot be read and is left out: `{lines[first].strip()[:60]}`", diagnostics)
        lines[first : last + 1] = [""] * (last + 1 - first)
    return False


def _bad(text: str, lines: list[str], skipped: int) -> tuple[int, int] | None:
    """The first and last line of the statement that an error of the parser names; None if it names none."""
    if named := _PROPERTY.search(text):
        prim, name = named.groups()
        opening = next((k for k, line in enumerate(lines) if f'"{prim}"' in line), 0)
        statement = re.compile(rf"(?:^|[\s\]]){re.escape(name)}(?:\.\w+)?\s*=")
        first = next((k for k in range(opening, len(lines)) if statement.search(lines[k])), -1)
    elif at := _PLACE.search(text):
        first = int(at[1]) - 1 + skipped
    else:
        return None
    if first < 0:
        return None
    last, depth = first, 0
    while last < len(lines):
        depth += sum(lines[last].count(c) for c in "([{") - sum(lines[last].count(c) for c in ")]}")
        if depth <= 0:
            break
        last += 1
    return first, first if last == len(lines) else last


def _warn(path: Path, line: int, message: str, diagnostics: Diagnostics) -> None:
    diagnostics.warning(message, Span(path.name, line, 1, line, 1))
