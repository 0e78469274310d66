"""Imports a mesh file by its extension into the builder: one geometry for each material."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...lang import file_types, foreign_formats
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..io import stage_cache
from ..io.regular_files import read_bytes
from ..io.sandbox import FileError, Files
from ..mesh import polygon_mesh
from ..scene.builder import NONE, SceneBuilder
from ..scene.row_records import WHITE, Input, MaterialData, as_color
from . import gltf, mtl, obj, off, ply, stl
from .assemblies import threemf
from .assemblies.assembly import Assembly, AssemblyError, BaseMaterial
from .common import file_names, point_lists, vertex_colors
from .mesh_parts import Frame, Part, add, tell_frame
from .stage_options import MeshOptions

T = TypeVar("T")


def read(
    source: Path | bytes, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span | None = None, files: Files | None = None,
    as_scene: bool = False, time: float | None = None, options: MeshOptions | None = None,
) -> list[Part]:  # fmt: skip
    """The parts of a mesh file; none after an error. `name` is shown in messages; its extension selects the format.

    `span` is the place of the import. `files` decides which libraries and images may be read (default: those below the file's folder).
    With `as_scene`, the file is the scene, so its lights and cameras are imported. `time` in seconds is for animations of glTF files.
    `options` are its unit and the axis that points up, which precede what the file says, and its animation; what is assumed of files
    that say nothing is a note. Without options, such files are in metres with y up.
    """
    format_ = Path(name).suffix.lower()
    whole = Span(name)
    if format_ not in file_types.MESH:
        hint = foreign_formats.placed_by(name) or f"known are {', '.join(file_types.MESH)}, and USD"
        diagnostics.error(f"`{name}` is no mesh file that is known", span or whole, hint)
        return []
    folder = source.parent if isinstance(source, Path) else None
    if files is None:
        files = Files(folder or Path.cwd())
    try:
        data = read_bytes(source) if isinstance(source, Path) else source
    except OSError as failure:
        diagnostics.error(f"cannot read `{name}`: {failure.strerror}", span or whole)
        return []
    if not data.strip():
        diagnostics.error(f"`{name}` is empty", span or whole)
        return []
    try:
        if format_ in file_types.GLTF:
            if options is not None and (options.unit or options.up):
                diagnostics.error("a glTF file is in metres with y up", span or whole, "leave out unit and up; scale or rotate it")
                return []
            moment = time, None if options is None else options.animation
            return gltf.read(data, name, folder, files, builder, diagnostics, as_scene, moment)
        if format_ == ".3mf":
            return _assembly(threemf.read, data, name, options, builder, diagnostics)
        parts = _parts(data, name, folder, Frame.of(format_, options), builder, files, diagnostics)
        tell_frame(parts, format_, options, builder, diagnostics, whole)
        return parts
    except (ply.PlyError, stl.StlError, gltf.GltfError, off.OffError, AssemblyError, point_lists.PointListError) as failure:
        diagnostics.error(str(failure), whole)
    except MemoryError:
        diagnostics.error(f"`{name}` does not fit into memory", whole)
    return []


def _parts(
    data: bytes, name: str, folder: Path | None, frame: Frame, builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> list[Part]:  # fmt: skip
    """The parts of a file that is no scene."""
    format_, span = Path(name).suffix.lower(), Span(name)
    if format_ == ".obj":
        return _obj(data, name, folder, frame, builder, files, diagnostics)
    if format_ == ".ply":
        return _ply(data, name, folder, frame, builder, files, diagnostics)
    read_ = {".stl": stl.read, ".off": off.read, ".xyz": point_lists.read}[format_]
    mesh = _cached(data, diagnostics, lambda found: read_(data, found, span), name)
    part = add(mesh, None, Path(name).stem, builder, diagnostics, span, frame)
    return [] if part is None else [part]


def _assembly(
    read_: Callable[[bytes, Callable[[str], None]], Assembly], data: bytes, name: str, options: MeshOptions | None, builder: SceneBuilder,
    diagnostics: Diagnostics,
) -> list[Part]:  # fmt: skip
    """The parts of a file of meshes with places and materials: each mesh is one geometry for each of its materials."""
    span, messages = Span(name), set[str]()

    def warn(message: str) -> None:
        if message not in messages:
            messages.add(message)
            diagnostics.warning(message, span)

    assembly = read_(data, warn)
    settings = options or MeshOptions()
    frame = Frame(assembly.unit if settings.unit is None else file_types.UNITS[settings.unit], settings.up or assembly.up)
    materials = [_base_row(material, builder, span) for material in assembly.materials]
    pieces: list[list[tuple[int, int | None, str]]] = []
    for each in assembly.meshes:
        title, rows = each.name or Path(name).stem, []
        for k, mesh in polygon_mesh.split(each.mesh, each.material):
            part = add(mesh, None if k < 0 else materials[k], title, builder, diagnostics, span, frame)
            label = assembly.materials[k].name if k >= 0 else ""
            rows += [] if part is None else [(part.geometry, part.material, label)]
        pieces.append(rows)
    return [
        Part(geometry, material, place.name or Path(name).stem, frame.placed(place.matrix)[:3], label)
        for place in assembly.places
        for geometry, material, label in pieces[place.mesh]
    ]


def _base_row(material: BaseMaterial, builder: SceneBuilder, span: Span) -> int:
    """The row of a matt material of a colour."""
    color = as_color(vertex_colors.linear(np.array(material.color)))
    inputs = {ir.Slot.DIFFUSE: Input(color), ir.Slot.AMBIENT: Input(color)}
    if material.opacity < 1.0:
        inputs[ir.Slot.OPACITY] = Input.number(material.opacity)
    return builder.material(MaterialData(inputs=inputs, name=material.name), span)


def _cached(data: bytes, diagnostics: Diagnostics, read: Callable[[Diagnostics], T], name: str) -> T:
    """read(diagnostics), or its result of the last compilation."""
    return stage_cache.cached_read("meshes read", (data, name), diagnostics, read)


def _ply(
    data: bytes, name: str, folder: Path | None, frame: Frame, builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> list[Part]:  # fmt: skip
    span = Span(name)
    mesh = _cached(data, diagnostics, lambda found: ply.read(data, found, span), name)
    pictures = ply.texture_files(data)
    material = None
    if len(pictures) > 1:
        diagnostics.warning(f"only the first of {len(pictures)} pictures is drawn: `{pictures[0]}`", span)
    if pictures and mesh.uvs is None:
        diagnostics.warning(f"the picture `{pictures[0]}` is not drawn: the PLY file has no texture coordinates", span)
    elif pictures:
        row = mtl.picture_row(mtl.MapReference(pictures[0], span), folder, True, NONE, builder, files, diagnostics)
        inputs = {ir.Slot.DIFFUSE: Input(WHITE, row), ir.Slot.AMBIENT: Input(WHITE, row)}
        material = builder.material(MaterialData(inputs=inputs, name=Path(pictures[0]).stem), span) if row >= 0 else None
    part = add(mesh, material, Path(name).stem, builder, diagnostics, span, frame)
    return [] if part is None else [replace(part, material_name="" if material is None else Path(pictures[0]).stem)]


def _obj(
    data: bytes, name: str, folder: Path | None, frame: Frame, builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> list[Part]:  # fmt: skip
    found = _cached(data, diagnostics, lambda said: obj.read(data, name, said), name)
    if found is None or diagnostics.failed:
        return []
    library = _libraries(found, folder, files, diagnostics)
    stem = Path(name).stem
    parts = []
    for k, mesh in polygon_mesh.split(found.mesh, found.material):
        asked = found.materials[k]
        row = _material(asked, found, library, builder, files, diagnostics)
        part = add(mesh, row, asked or stem, builder, diagnostics, Span(name), frame)
        parts += [] if part is None else [replace(part, material_name=asked)]
    return parts


def _material(
    asked: str, found: obj.ObjMesh, library: dict[str, mtl.MtlMaterial], builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> int | None:
    if asked in library:
        return mtl.row(library[asked], builder, files, diagnostics)
    if asked and library:
        diagnostics.warning(f"no material library has `{asked}`: its faces have no material", found.uses[asked])
    return None


def _libraries(found: obj.ObjMesh, folder: Path | None, files: Files, diagnostics: Diagnostics) -> dict[str, mtl.MtlMaterial]:
    """Materials of an OBJ file's libraries by name; the first library with a name wins. A missing library is a warning."""
    materials: dict[str, mtl.MtlMaterial] = {}
    for text, span in found.libraries:
        if folder is None:
            diagnostics.warning(f"the material library `{text}` is not read: its mesh has no folder", span)
            continue
        for path in _library_paths(text, folder, files, diagnostics, span):
            read = mtl.parse(read_bytes(path), _shown(path, files), path.parent, diagnostics)
            materials = read | materials
    return materials


def _library_paths(text: str, folder: Path, files: Files, diagnostics: Diagnostics, span: Span) -> list[Path]:
    """Files of one `mtllib` line: the whole text as one name with blanks, else each word. A missing file is a warning."""
    words = [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|(\S+)', text)]
    found: list[Path] = []

    def missing(name: str) -> FileError | None:
        try:
            found.append(file_names.find(name, folder, files, "material library"))
        except FileError as failure:
            return failure
        return None

    whole = missing(text.strip('"'))
    failures = [] if whole is None else [whole] if len(words) < 2 else [missing(word) for word in words]
    for failure in failures:
        if failure is not None:
            diagnostics.warning(f"{failure.message}: its materials are not read", span, failure.hint)
    return found


def _shown(path: Path, files: Files) -> str:
    """A file's name for messages: relative to the scene's folder if below it."""
    return str(path.relative_to(files.root)) if path.is_relative_to(files.root) else str(path)
