"""Notes of `check` on meshes of files: whether they are closed and wound one way, their bodies and Euler number."""

from __future__ import annotations

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import Diagnostic, Span
from ...lang.plain_values import counted
from .. import ir
from ..ir import F64, I64
from .topology import Topology, merged, moments, topology

MOST_TRIANGLES = 4_000_000  # of all meshes; larger scenes are not looked at


def notes(scene: ir.Scene) -> list[Diagnostic]:
    """A note for each mesh file of a scene, and a warning where faces are wound against each other or a mesh is inside out.

    The parts of one mesh that differ in material are looked at together.
    """
    geometries, names = scene.tables.geometries, scene.names.geometries
    files: dict[str, dict[str, list[int]]] = {}
    count = 0
    for g in np.flatnonzero(geometries.kind == ir.GeometryKind.MESH).tolist():
        span = scene.spans.get("geometries", g)
        reader = file_types.reader_of(span.file) if span is not None else None
        if span is not None and reader is not None and reader.kind == "mesh":
            one_frame = bool(reader.unit)
            files.setdefault(span.file, {}).setdefault("" if one_frame or g >= len(names) else names[g], []).append(g)
            count += int(geometries.triangle_count[g])
    if count > MOST_TRIANGLES:
        message = f"meshes of files have {count:,} triangles: closedness is checked for {MOST_TRIANGLES:,} at most"
        return [Diagnostic("note", message)]
    return [note for file, meshes in files.items() for note in _of_file(scene.tables, file, list(meshes.values()))]


def _of_file(tables: ir.Tables, file: str, rows: list[list[int]]) -> list[Diagnostic]:
    meshes = [_merged(tables, row) for row in rows]
    edges = [topology(*mesh) for mesh in meshes]
    span, total = Span(file), sum(each.triangles for each in edges)
    volumes = [float(moments(*mesh).volume) for mesh, each in zip(meshes, edges, strict=True) if each.closed]
    notes = [Diagnostic("note", f"{counted(total, 'triangle')}{_of(len(rows))}: {_words(edges)}", span)]
    against = sum(each.watertight and not each.wound for each in edges)
    inwards = sum(volume < 0.0 for volume in volumes)
    for wrong, what in ((against, "faces that are wound against their neighbours"), (inwards, "faces that all point inwards")):
        if wrong:
            which = "the mesh has" if len(rows) == 1 else f"{wrong} of {len(rows)} meshes {'has' if wrong == 1 else 'have'}"
            notes.append(Diagnostic("warning", f"{which} {what}", span, "--repair, in a scene mesh(…, repair: true), turns them round"))
    return notes


def _merged(tables: ir.Tables, rows: list[int]) -> tuple[F64, I64]:
    """Points (n, 3) and triangles (m, 3) of MESH geometries of one frame, equal points merged."""
    positions, triangles, start = [], [], 0
    for g in rows:
        points, corners = ir.mesh_arrays(tables, g)
        positions.append(points.astype(np.float64) + tables.geometries.origin[g])
        triangles.append(corners.astype(np.int64) + start)
        start += len(points)
    return merged(np.concatenate(positions), np.concatenate(triangles))


def _of(meshes: int) -> str:
    return "" if meshes == 1 else f" in {meshes} meshes"


def _words(edges: list[Topology]) -> str:
    is_open = [each for each in edges if not each.watertight]
    bodies = sum(each.bodies for each in edges)
    parts = f"{bodies:,} bod{'y' if bodies == 1 else 'ies'}, Euler number {sum(each.euler_number for each in edges)}"
    if not is_open:
        return f"closed, {parts}"
    which = "open" if len(edges) == 1 else f"{len(is_open)} open"
    return f"{which} at {counted(sum(each.open_edges for each in is_open), 'edge')}, {parts}"
