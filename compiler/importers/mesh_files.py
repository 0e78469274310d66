"""Imports a mesh file into the builder, by the reader of its ending: one geometry for each material."""

from __future__ import annotations

import importlib
from pathlib import Path

from ...lang import file_types, foreign_formats
from ...lang.diagnostics import Diagnostics, Span
from ..io.regular_files import read_bytes
from ..io.sandbox import Files
from ..scene.builder import SceneBuilder
from .common.mesh_options import MeshOptions
from .common.mesh_parts import MeshFile, MeshFileError, Part, tell_frame


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
    file_span, reader = Span(name), file_types.reader_of(name)
    if reader is None or not reader.module:
        hint = foreign_formats.placed_by(name) or f"known are {', '.join(file_types.MESH)}, and USD"
        diagnostics.error(f"`{name}` is not a mesh file of a known format", span or file_span, hint)
        return []
    folder = source.parent if isinstance(source, Path) else None
    try:
        data = read_bytes(source) if isinstance(source, Path) else source
    except OSError as failure:
        diagnostics.error(f"cannot read `{name}`: {failure.strerror}", span or file_span)
        return []
    if not data.strip():
        diagnostics.error(f"`{name}` is empty", span or file_span)
        return []
    allowed = Files(folder or Path.cwd()) if files is None else files
    file = MeshFile(data, name, folder, reader, builder, allowed, diagnostics, span or file_span, as_scene, time, options)
    try:
        parts: list[Part] = importlib.import_module(f".{reader.module}", __package__).parts(file)
        tell_frame(parts, Path(name).suffix.lower(), options, builder, diagnostics, file_span)
        return parts
    except MeshFileError as failure:
        diagnostics.error(str(failure), file_span)
    except MemoryError:
        diagnostics.error(f"`{name}` does not fit into memory", file_span)
    return []
