"""Leaves out what leads out of the folders that a stage may read: references, payloads, sublayers and value clips, in memory alone."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf

from .....lang.diagnostics import Diagnostics, Span
from ....io.sandbox import Files
from .spec_tree import SpecTree

_ATTEMPTS = 4  # usd-core removes a path from sublayers first, then from prims
_NUMBERS = re.compile("#+(?:\\\\.#+)?")  # of a template of value clips, in an escaped pattern
_MOST = 100_000  # files of a folder that are compared with a template


def file_of(path: str) -> str:
    """The file on disk of a layer's or asset's path: the package of what is in one, without arguments of a file format."""
    path = path.partition(":SDF_FORMAT_ARGS:")[0]
    while Ar.IsPackageRelativePath(path):
        path = str(Ar.SplitPackageRelativePathOuter(path)[0])
    return path


class Access:
    """What the layers of a stage may read, by the rule of `files`. What is left out is a diagnostic at its prim.

    It is a warning for a stage that is opened itself, and an error for one in a scene, as a missing file is.
    """

    def __init__(self, files: Files, path: Path, name: str, diagnostics: Diagnostics, place: Span | None = None) -> None:
        """`path` is the root layer's file and `name` its name in messages; `place` is that of a scene which uses the stage."""
        self._files, self._folder, self._name, self._diagnostics, self._place = files, path.parent, name, diagnostics, place
        self._main: Any = None
        self._session: Any = None
        self._reported: set[tuple[Any, ...]] = set()
        self._search = Ar.GetResolver().CreateDefaultContextForAsset(os.path.abspath(path))

    def begin(self, root: Any, session: Any) -> None:
        """Set the root layer and the session layer."""
        self._main, self._session = root, session

    @property
    def failed(self) -> bool:
        """Whether something was left out with an error."""
        return self._place is not None and bool(self._reported)

    def search_path(self) -> Any:
        """A block in which usd-core looks for files as in the open stage."""
        return Ar.ResolverContextBinder(self._search)

    def path_of(self, layer: Any, asset: str) -> str:
        """The full path of an asset of a layer, with the values of variables; as it is where it has none."""
        if Sdf.VariableExpression.IsExpression(asset):
            evaluated = Sdf.VariableExpression(asset).Evaluate(self._variables(layer))
            asset = str(evaluated.value) if isinstance(evaluated.value, str) else ""
        return layer.ComputeAbsolutePath(asset) if asset else ""

    def leave_out(self, layer: Any, tree: SpecTree) -> bool:
        """Leave out what a layer refers to outside; return whether it changed. `tree` has its specs."""
        changed = False
        for asset in layer.GetCompositionAssetDependencies():
            path = self.path_of(layer, asset)
            if path and (fault := self._fault(asset, path)):
                beside = self._folder / asset
                is_beside = not os.path.isabs(path) and beside.exists() and not self._files.outside(asset, beside)
                self._update(layer, asset, str(beside) if is_beside else "")
                changed = True
                if not is_beside:
                    self._tell(layer, _prims_of(tree, asset), fault)
        for path in tree.clips:
            changed |= self._leave_out_clips(layer, path)
        return changed

    def leave_out_used(self, stage: Any) -> str:
        """Mute layers of an open stage that lie outside. Why the stage must not be drawn; "" for a stage that may."""
        for _ in range(_ATTEMPTS):
            outside = [layer for layer in stage.GetUsedLayers(True) if layer.realPath and self._fault_of_layer(layer)]
            if not outside:
                return ""
            for layer in outside:
                self._tell(layer, [], self._fault_of_layer(layer) or ("", ""))
            stage.MuteAndUnmuteLayers([layer.identifier for layer in outside], [])
        return f"it reads `{outside[0].GetDisplayName()}`, which lies outside of the scene's folder"

    def _fault_of_layer(self, layer: Any) -> tuple[str, str] | None:
        if layer in (self._main, self._session):
            return None
        return self._files.outside(os.path.relpath(file_of(layer.identifier), self._folder), file_of(layer.realPath))

    def _fault(self, asset: str, path: str) -> tuple[str, str] | None:
        """Why a path of usd-core's must not be read, and the fix; None for one that may, or that does not exist."""
        file = file_of(path)
        if not os.path.isabs(file):  # found by the search path, which begins with the current folder
            file = file_of(str(Ar.GetResolver().Resolve(file)))
        return self._files.outside(asset.strip("`"), file) if file else None

    def _variables(self, layer: Any) -> Mapping[str, Any]:
        """The variables of expressions in a layer. Those of the root layer and of the session layer are stronger than its own."""
        variables: dict[str, Any] = {}
        for each in (layer, self._main, self._session):
            if each is not None:
                variables.update(each.expressionVariables)
        return variables

    def _update(self, layer: Any, asset: str, new: str) -> None:
        for _ in range(_ATTEMPTS):
            if asset in layer.GetCompositionAssetDependencies():
                layer.UpdateCompositionAssetDependency(asset, new)

    def _leave_out_clips(self, layer: Any, path: Any) -> bool:
        """Leave out the sets of value clips of a prim that have a file outside; return whether there are some."""
        spec = layer.GetPrimAtPath(path)
        sets = dict(spec.GetInfo("clips"))
        outside = {name: fault for name, clips in sets.items() if (fault := self._fault_of_clips(layer, clips))}
        for fault in outside.values():
            self._tell(layer, [str(path)], fault)
        if outside:
            spec.SetInfo("clips", {name: clips for name, clips in sets.items() if name not in outside})
        return bool(outside)

    def _fault_of_clips(self, layer: Any, clips: Any) -> tuple[str, str] | None:
        for asset in _assets(clips):
            path = self.path_of(layer, asset)
            for file in _files_of(path) if "#" in asset else [path]:
                if file and (fault := self._fault(asset, file)):
                    return fault
        return None

    def _tell(self, layer: Any, prims: Sequence[str], fault: tuple[str, str]) -> None:
        """Tell once of what is left out at some prims of a layer, or in its sublayers."""
        name, prim = self._name if layer == self._main else layer.GetDisplayName(), min(prims, default="")
        key = name, prim, fault
        if key in self._reported:
            return
        self._reported.add(key)
        message, hint = fault
        if self._place is not None:
            self._diagnostics.error(f"`{Path(self._name).name}` reads outside: {message}", self._place, hint)
        else:
            others = f", here and at {len(prims) - 1} other prim{'s' * (len(prims) > 2)}" if len(prims) > 1 else ""
            self._diagnostics.warning(f"{message}: it is left out{others}", Span(f"{name}<{prim}>" if prim else name), hint)


def _prims_of(tree: SpecTree, asset: str) -> list[str]:
    """The paths of the specs with an arc to an asset; none for one that is a sublayer alone."""
    return [str(path) for path, row in tree.rows.items() if any(asset == to for to, _ in tree.arcs.get(row, ()))]


def _assets(clips: Any) -> Iterator[str]:
    """The paths of a set of value clips."""
    if not isinstance(clips, Mapping):
        return
    yield from (str(asset.path) for asset in clips.get("assetPaths") or () if hasattr(asset, "path"))
    for name in ("manifestAssetPath", "templateAssetPath"):
        asset_path = clips.get(name)
        if asset_path:
            yield str(getattr(asset_path, "path", asset_path))


def _files_of(template: str) -> list[str]:
    """A template of value clips, and the files that fit it."""
    folder, name = os.path.split(template)
    pattern = re.compile(_NUMBERS.sub(r"-?\\d+(?:\\.\\d+)?", re.escape(name).replace("\\#", "#")))
    try:
        with os.scandir(folder or ".") as entries:
            return [template, *(entry.path for _, entry in zip(range(_MOST), entries, strict=False) if pattern.fullmatch(entry.name))]
    except OSError:
        return [template]
