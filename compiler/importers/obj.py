"""Reads OBJ files: polygons, material groups, smoothing groups, vertex colours.

Format: Wavefront's Object Files, version 3.0 (Appendix B1 of the Advanced Visualizer manual), as written by today's programs.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..io.regular_files import read_bytes
from ..io.sandbox import FileError, Files
from ..mesh import polygon_mesh
from ..mesh.polygon_mesh import PolyMesh
from ..scene.builder import SceneBuilder
from ..scene.row_records import MeshAttribute
from . import mesh_tables, mtl, obj_lexer
from .common import file_names, point_clouds, vertex_colors
from .common.mesh_parts import MeshFile, Part, add

_LINES = ("l", "curv", "curv2", "surf")  # what may use the vertices of a file without faces


@dataclass(slots=True)
class ObjMesh:
    """Content of an OBJ file. `materials[k]` is the name for faces with material[f] = k, "" for none."""

    mesh: PolyMesh
    material: np.ndarray  # (f,) rows of materials
    materials: list[str]
    libraries: list[tuple[str, Span]]
    uses: dict[str, Span]  # first use of each material


@dataclass(slots=True)
class _Problems:
    """Reports each kind of problem once, at its first line, with the number of further occurrences."""

    file: str
    diagnostics: Diagnostics
    places: dict[tuple[str, str], list[tuple[int, str]]] = field(default_factory=dict)

    def add(self, severity: str, kind: str, line: int, message: str) -> None:
        self.places.setdefault((severity, kind), []).append((line, message))

    def report(self) -> None:
        for (severity, _), places in sorted(self.places.items(), key=lambda item: item[1][0][0]):
            line, message = places[0]
            more = len({line for line, _ in places}) - 1
            also = f"; so {'is' if more == 1 else 'are'} {more} more line{'s' if more > 1 else ''}" if more else ""
            (self.diagnostics.error if severity == "error" else self.diagnostics.warning)(message + also, Span(self.file, line, 1, line, 1))


def read(data: bytes, file: str, diagnostics: Diagnostics) -> ObjMesh | None:
    """The mesh of an OBJ file, or None and an error. `file` is the name for messages."""
    lines = obj_lexer.split(data)
    problems = _Problems(file, diagnostics)
    groups = _read(lines, file, problems)
    problems.report()
    return groups


def _read(lines: obj_lexer.Lines, file: str, problems: _Problems) -> ObjMesh | None:
    def malformed(line: int, message: str) -> None:
        problems.add("warning", "malformed", line, f"malformed line: {message}")

    if not np.isin(lines.keys, (0, 3)).any():
        problems.diagnostics.error("this is not an OBJ file: it has neither vertices nor faces", Span(file))
        return None
    def warn(message: str) -> None:
        problems.diagnostics.warning(message, Span(file))

    lines = obj_lexer.with_plain_numbers(lines, lambda line, message: problems.add("warning", "commas", line, message))
    points, tints = _vertices(*obj_lexer.numbers(lines, 0, 3, malformed), warn)
    uv_values = _columns(*obj_lexer.numbers(lines, 1, 1, malformed), width=2)
    normal_values = _columns(*obj_lexer.numbers(lines, 2, 3, malformed), width=3)
    faces = obj_lexer.faces(lines, malformed)
    is_cloud = not len(faces.rows) and not any(keyword in _LINES for _, keyword, _ in obj_lexer.others(lines))
    state = _State.read(lines, file, problems, is_cloud)
    if is_cloud and (cloud := point_clouds.mesh(points, tints, problems.diagnostics, Span(file))) is not None:
        return ObjMesh(cloud, np.full(len(cloud.counts), len(state.names) - 1), state.names, state.libraries, state.uses)
    corners, counts, valid = _resolved(lines, faces, (points, uv_values, normal_values), problems)
    if not len(counts):
        problems.diagnostics.error("the OBJ file has no faces that can be drawn", Span(file), "a face is a line like `f 1 2 3`")
        return None
    rows = faces.rows[valid]
    mesh = PolyMesh(
        points, counts, corners[:, 0],
        _by_corner(normal_values, corners[:, 2], missing=0.0), _by_corner(uv_values, corners[:, 1], missing=0.0),
        None if tints is None else MeshAttribute(tints), state.values_at(state.smoothing, rows) if state.smoothing else None,
    )  # fmt: skip
    materials = state.values_at(state.material, rows) if state.material else np.zeros(len(rows), dtype=np.int64)
    return ObjMesh(mesh, materials, state.names, state.libraries, state.uses)


@dataclass(slots=True)
class _State:
    """State-setting lines between faces; each list holds (row of Lines, value from there on)."""

    names: list[str] = field(default_factory=lambda: [""])
    material: list[tuple[int, int]] = field(default_factory=list)
    smoothing: list[tuple[int, int]] = field(default_factory=list)
    libraries: list[tuple[str, Span]] = field(default_factory=list)
    uses: dict[str, Span] = field(default_factory=dict)

    @staticmethod
    def values_at(events: list[tuple[int, int]], rows: np.ndarray) -> np.ndarray:
        """The value in effect at each of `rows`; 0 before the first."""
        where = np.array([row for row, _ in events])
        values = np.array([0] + [value for _, value in events], dtype=np.int64)
        return values[np.searchsorted(where, rows)]

    @classmethod
    def read(cls, lines: obj_lexer.Lines, file: str, problems: _Problems, is_cloud: bool) -> _State:
        state = cls()
        numbered = {"": 0}
        for row, keyword, rest in obj_lexer.others(lines):
            line = int(lines.numbers[row])
            rest = obj_lexer.without_comment(rest)
            if keyword == "usemtl":
                if rest not in numbered:
                    numbered[rest] = len(state.names)
                    state.names.append(rest)
                    state.uses[rest] = Span(file, line, 1, line, len("usemtl ") + len(rest) + 1)
                state.material.append((row, numbered[rest]))
            elif keyword == "mtllib":
                state.libraries.append((rest, Span(file, line, 1, line, len("mtllib ") + len(rest) + 1)))
            elif keyword == "s":
                state.smoothing.append((row, int(rest) if rest.isdecimal() and len(rest) < 10 else 0))
            elif keyword == "p" and is_cloud:
                pass  # all vertices are drawn
            elif mesh_tables.OBJ.find(keyword) is None:
                problems.add("warning", "keyword", line, f"OBJ has no keyword `{keyword[:40]}`: the line is left out")
            elif message := mesh_tables.OBJ.report(f"`{keyword}`", keyword):
                problems.add("warning", keyword, line, message)
        return state


def _vertices(values: np.ndarray, counts: np.ndarray, warn: Callable[[str], None]) -> tuple[np.ndarray, np.ndarray | None]:
    """Points (n, 3), and linear colours (n, 3) from `v x y z r g b` lines (sRGB, as vertex painting programs write)."""
    points = _columns(values, counts, 3)
    tinted = (counts == 6) | (counts == 7)
    if not tinted.any():
        return points, None
    firsts = np.cumsum(counts) - counts
    tints = np.ones((len(counts), 3))
    tints[tinted] = vertex_colors.from_numbers(values[firsts[tinted][:, None] + np.arange(3, 6)], warn)
    return points, tints


def _columns(values: np.ndarray, counts: np.ndarray, width: int) -> np.ndarray:
    """(n, width) first numbers of each line, padded with 0."""
    if len(counts) and (counts == counts[0]).all():
        table = values.reshape(-1, counts[0])[:, :width]
        return np.pad(table, ((0, 0), (0, width - table.shape[1])))
    firsts = np.cumsum(counts) - counts
    table = np.zeros((len(counts), width))
    for k in range(width):
        present = counts > k
        table[present, k] = values[firsts[present] + k]
    return table


def _resolved(
    lines: obj_lexer.Lines, faces: obj_lexer.Faces, values: tuple[np.ndarray, ...], problems: _Problems
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Resolves indices: corners as rows from 0 (−1: absent), corner counts, mask of valid faces.

    A face with a missing or non-finite vertex is dropped. A missing or non-finite texture coordinate or normal counts as absent.
    Negative indices count back from the elements read so far.
    """
    face_of = np.repeat(np.arange(len(faces.rows)), faces.counts)
    corners = np.full_like(faces.corners, -1)
    bad_face = np.zeros(len(faces.rows), dtype=bool)
    for k, (key, what) in enumerate(((0, "vertex"), (1, "texture coordinate"), (2, "normal"))):
        written = faces.corners[:, k]
        defined = np.cumsum(lines.keys == key)[faces.rows][face_of]
        rows = np.where(written > 0, written - 1, defined + written)
        bad = (written != obj_lexer.NONE) & ((rows < 0) | (rows >= len(values[k]))) & (written != obj_lexer.BAD)
        if k == 0:
            bad |= written == obj_lexer.NONE
        rows[(written == obj_lexer.NONE) | bad | (written == obj_lexer.BAD)] = -1
        corners[:, k] = rows
        for row in np.flatnonzero(bad):
            line = int(lines.numbers[faces.rows[face_of[row]]])
            effect = "the face is left out" if k == 0 else "the face is drawn without"
            problems.add("warning", what, line, f"there is no {what} {written[row]} (the file has {len(values[k])}): {effect}")
        if k == 0:
            bad_face[face_of[(rows < 0)]] = True
    finite = np.asarray(np.isfinite(values[0]).all(axis=1))
    for row in np.flatnonzero((corners[:, 0] >= 0) & ~finite[corners[:, 0]]) if not finite.all() else ():
        bad_face[face_of[row]] = True
        if ("warning", "malformed") in problems.places:
            continue  # already reported
        line = int(lines.numbers[faces.rows[face_of[row]]])
        problems.add("warning", "finite", line, f"vertex {corners[row, 0] + 1} of this face is not finite: the face is left out")
    for row in np.flatnonzero(faces.counts < 3):
        line = int(lines.numbers[faces.rows[row]])
        problems.add("warning", "short", line, f"a face needs 3 corners or more, this one has {faces.counts[row]}: it is left out")
    valid = ~bad_face & (faces.counts >= 3)
    return corners[valid[face_of]], faces.counts[valid], np.flatnonzero(valid)


def _by_corner(values: np.ndarray, rows: np.ndarray, missing: float) -> MeshAttribute | None:
    """Values at corners, `missing` where a corner has none. None if no corner has a value."""
    if not len(values) or not (rows >= 0).any():
        return None
    taken = values[rows]
    taken[rows < 0] = missing
    return MeshAttribute(np.clip(np.nan_to_num(taken), -1e30, 1e30).astype(np.float32), ir.Interpolation.CORNER)


def parts(file: MeshFile) -> list[Part]:
    """The parts of the file, one for each material of its libraries."""
    builder, diagnostics, frame = file.builder, file.diagnostics, file.frame
    groups = file.cached(lambda messages: read(file.data, file.name, messages))
    if groups is None or diagnostics.failed:
        return []
    library = _libraries(groups, file.folder, file.files, diagnostics)
    parts = []
    repaired, source = file.repaired(groups.mesh)
    for k, mesh in polygon_mesh.split(repaired, groups.material if source is None else groups.material[source]):
        material_name = groups.materials[k]
        row = _material(material_name, groups, library, builder, file.files, diagnostics)
        part = add(mesh, row, material_name or file.stem, builder, diagnostics, file.span, frame)
        parts += [] if part is None else [replace(part, material_name=material_name)]
    return parts


def _material(
    name: str, groups: ObjMesh, library: dict[str, mtl.MtlMaterial], builder: SceneBuilder, files: Files, diagnostics: Diagnostics
) -> int | None:
    if name in library:
        return mtl.row(library[name], builder, files, diagnostics)
    if name and library:
        diagnostics.warning(f"no material library has `{name}`: its faces have no material", groups.uses[name])
    return None


def _libraries(groups: ObjMesh, folder: Path | None, files: Files, diagnostics: Diagnostics) -> dict[str, mtl.MtlMaterial]:
    """Materials of an OBJ file's libraries by name; the first library with a name wins. A missing library is a warning."""
    materials: dict[str, mtl.MtlMaterial] = {}
    for text, span in groups.libraries:
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
    paths: list[Path] = []

    def missing(name: str) -> FileError | None:
        try:
            paths.append(file_names.find(name, folder, files, "material library"))
        except FileError as failure:
            return failure
        return None

    absent = missing(text.strip('"'))
    failures = [] if absent is None else [absent] if len(words) < 2 else [missing(word) for word in words]
    for failure in failures:
        if failure is not None:
            diagnostics.warning(f"{failure.message}: its materials are not read", span, failure.hint)
    return paths


def _shown(path: Path, files: Files) -> str:
    """A file's name for messages: relative to the scene's folder if below it."""
    return str(path.relative_to(files.root)) if path.is_relative_to(files.root) else str(path)
