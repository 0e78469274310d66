"""Reads mesh files of every known format into the builder: one geometry for each material."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import Diagnostics, Span
from ..io.sandbox import FileError, Files
from ..mesh import polygon_mesh
from ..scene.builder import SceneBuilder
from . import glb, mtl, obj, off, ply, stl
from .mesh_parts import Part, add


def read(
    source: Path | bytes, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span | None = None, files: Files | None = None
) -> list[Part]:
    """The parts of a mesh file, none after an error. `name` is shown in messages, and its ending says the format.

    `span` is where the file is asked for. `files` says which libraries and pictures may be read; left out, those in the file's
    own folder and below.
    """
    format_ = Path(name).suffix.lower()
    whole = Span(name)
    if format_ not in file_types.MESH:
        diagnostics.error(f"`{name}` is no mesh file that is known", span or whole, f"known are {', '.join(file_types.MESH)}, and USD")
        return []
    folder = source.parent if isinstance(source, Path) else None
    if files is None:
        files = Files(folder or Path.cwd())
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
    except OSError as failure:
        diagnostics.error(f"cannot read `{name}`: {failure.strerror}", span or whole)
        return []
    if not data.strip():
        diagnostics.error(f"`{name}` is empty", span or whole)
        return []
    try:
        if format_ == ".obj":
            return _obj(data, name, folder, builder, files, diagnostics)
        if format_ == ".ply":
            mesh = ply.read(data, diagnostics, whole)
            return _parts(mesh, Path(name).stem, builder, diagnostics, whole)
        if format_ == ".stl":
            return _parts(stl.read(data), Path(name).stem, builder, diagnostics, whole)
        if format_ == ".off":
            return _parts(off.read(data), Path(name).stem, builder, diagnostics, whole)
        return glb.read(data, name, builder, diagnostics)
    except (ply.PlyError, stl.StlError, glb.GlbError, off.OffError) as failure:
        diagnostics.error(str(failure), whole)
    except MemoryError:
        diagnostics.error(f"`{name}` does not fit into memory", whole)
    return []


def _parts(mesh: polygon_mesh.PolyMesh, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span) -> list[Part]:
    part = add(mesh, None, name, builder, diagnostics, span)
    return [] if part is None else [part]


def _obj(data: bytes, name: str, folder: Path | None, builder: SceneBuilder, files: Files, diagnostics: Diagnostics) -> list[Part]:
    found = obj.read(data, name, diagnostics)
    if found is None or diagnostics.failed:
        return []
    library = _libraries(found, folder, files, diagnostics)
    stem = Path(name).stem
    parts = []
    for k in np.unique(found.material):
        asked = found.materials[k]
        row = _material(asked, found, library, builder, files, diagnostics)
        faces = np.flatnonzero(found.material == k)
        mesh = found.mesh if len(faces) == len(found.material) else polygon_mesh.subset(found.mesh, faces)
        part = add(mesh, row, asked or stem, builder, diagnostics, Span(name))
        parts += [] if part is None else [part]
    return parts


def _material(
    asked: str, found: obj.ObjMesh, library: dict[str, mtl.MtlMaterial], builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> int | None:
    if asked in library:
        return mtl.row(library[asked], builder, files, diagnostics)
    if asked and library:
        diagnostics.warning(f"no material library has `{asked}`: it is drawn grey", found.uses[asked])
    return None


def _libraries(found: obj.ObjMesh, folder: Path | None, files: Files, diagnostics: Diagnostics) -> dict[str, mtl.MtlMaterial]:
    """All materials of an OBJ file's libraries by name; the first library that has a name gives it. A missing one is a warning."""
    materials: dict[str, mtl.MtlMaterial] = {}
    for text, span in found.libraries:
        if folder is None:
            diagnostics.warning(f"the material library `{text}` is not read: its mesh has no folder", span)
            continue
        try:
            paths = _library_paths(text, folder, files)
        except FileError as failure:
            diagnostics.warning(f"{failure.message}: things are drawn grey", span, failure.hint)
            continue
        for path in paths:
            read = mtl.parse(path.read_bytes(), _shown(path, files), path.parent, diagnostics)
            materials = read | materials
    return materials


def _library_paths(text: str, folder: Path, files: Files) -> list[Path]:
    """The files of one `mtllib` line: its whole text as one name with blanks, else each word of it."""
    try:
        return [mtl.find(text, folder, files, "material library")]
    except FileError:
        words = text.split()
        if len(words) < 2:
            raise
        return [mtl.find(word, folder, files, "material library") for word in words]


def _shown(path: Path, files: Files) -> str:
    """A file's name for messages: from the scene's folder on where it lies below it."""
    return str(path.relative_to(files.root)) if path.is_relative_to(files.root) else str(path)
