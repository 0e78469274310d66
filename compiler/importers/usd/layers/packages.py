"""Replaces layers in `.usdz` packages that usd-core must not read: in memory, so that the rest of a package is drawn."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import ANY_SIZE, open_regular
from . import crate_check, crate_values, text_layers

CUT_OFF = "it is cut off: the list of files at the end of the zip archive is missing"
_LAYERS = (".usd", ".usda", ".usdc")


def replaced(path: Path, diagnostics: Diagnostics) -> list[Any]:
    """The layers of a package whose replacements are in memory, the package's own first; none for a sound package.

    Damaged crate files are empty, damaged text is repaired, and layers with values of too many items lack these, with a warning for
    each. The identifiers are those of the package. usd-core finds them there as long as they are kept, and reads the other layers
    from the package.
    """
    try:
        replacements = dict(_replacements(path, diagnostics))
        if not replacements:
            return []
        with zipfile.ZipFile(path) as files:
            names = files.namelist()
            first = layer_names(names)[0]
            replacements.setdefault(first, files.read(first))
        if first != names[0]:
            warn_of_first(path, first, diagnostics)
        return _opened(os.path.abspath(path), first, replacements)
    except (OSError, ValueError, IndexError, NotImplementedError, RuntimeError, zipfile.BadZipFile, Tf.ErrorException):
        return []  # usd-core reports it


def fault_of(path: Path) -> str:
    """Why a file is not a package that can be read; "" for others, and for those of which usd-core gives the reason."""
    try:
        with open_regular(path, ANY_SIZE) as file:
            begin = file.read(4)
        if not begin:
            return "it is empty"
        if path.suffix.lower() != ".usdz":
            return ""
        if not zipfile.is_zipfile(path):
            return CUT_OFF if begin == b"PK\3\4" else "it is not a zip archive"
        with zipfile.ZipFile(path) as files:
            return "" if layer_names(files.namelist()) else "it holds no layer: no .usda, .usdc or .usd file"
    except OSError as failure:
        return failure.strerror or str(failure)
    except (ValueError, NotImplementedError, zipfile.BadZipFile) as failure:
        return str(failure)


def layer_names(names: list[str]) -> list[str]:
    """The files of a package that are layers."""
    return [name for name in names if name.lower().endswith(_LAYERS)]


def warn_of_first(path: Path, first: str, diagnostics: Diagnostics) -> None:
    """The warning about a package whose first file is not a layer."""
    diagnostics.warning(f"the first file of the package is not a layer: `{first}` is drawn", Span(path.name))


def _replacements(path: Path, diagnostics: Diagnostics) -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of the layers that replace others. A first one that is a crate file is sound, see `crate_check.fault`."""
    for name, data in crate_check.layers_of(path):
        place = f"{path.name}[{name}]"
        if data and not data.startswith(crate_check.IDENTIFIER):
            layer = None if text_layers.is_sound(data) else text_layers.repaired(data, place, diagnostics)
            if layer:
                yield name, layer.ExportToString().encode()
        elif why := crate_check.fault_of(data):
            diagnostics.warning(f"this layer cannot be read: {why}", Span(place))
            yield name, _empty()
        elif excess := crate_values.excessive(data):
            crate_values.warn(place, data, excess, diagnostics)
            yield name, crate_values.without(data, excess)


def _opened(package: str, first: str, replacements: dict[str, bytes]) -> list[Any]:
    """The layer of a package and those in `replacements`. Each is read from a copy and then has its identifier in the package."""
    open_layers = [Sdf.Layer.Find(package), *(Sdf.Layer.Find(f"{package}[{name}]") for name in replacements)]
    if all(open_layers):  # of a stage that is still open
        return open_layers
    with tempfile.TemporaryDirectory() as folder:
        copy = os.path.join(folder, os.path.basename(package))
        with zipfile.ZipFile(copy, "w", zipfile.ZIP_STORED) as files:
            for name in sorted(replacements, key=lambda name: name != first):
                files.writestr(name, replacements[name])
        layers = []
        for inner in ("", *(f"[{name}]" for name in replacements)):
            layer = Sdf.Layer.Find(package + inner)
            if layer is None:
                layer = Sdf.Layer.FindOrOpen(copy + inner)
                layer.identifier = package + inner
            layers.append(layer)
    return layers


def _empty() -> bytes:
    """The bytes of a crate file without prims."""
    with tempfile.TemporaryDirectory() as folder:
        Sdf.Layer.CreateAnonymous(".usdc").Export(f"{folder}/x.usdc")
        return Path(folder, "x.usdc").read_bytes()
