"""Exports a scene as a file of triangles: the parts, what the format lacks, and how far its digits move a corner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...mesh import parts as printable
from ...mesh.parts import Part
from ..export import Export, ExportError
from ..export_job import ExportJob

DIGITS = 12  # of numbers in text
_MM = 1000.0


@dataclass(frozen=True, slots=True)
class Format:
    """A format of triangles.

    `encode` makes the content of the file, and may add files beside it to the export. `single`: its numbers have single precision.
    `printed`: it is in millimetres with z up, as programs for printing expect; the others are in metres, y up. `colored`: it holds a
    colour for each corner.
    """

    encode: Callable[[Sequence[Part], Export], bytes]
    single: bool = False
    printed: bool = False
    colored: bool = True


def export(job: ExportJob, form: Format) -> Export:
    """The file of a scene. Raises ExportError for a scene without a bounded surface."""
    out = Export(job.scene)
    parts, diagnostics = job.parts()
    out.diagnostics += diagnostics
    if not parts:
        raise ExportError("the scene has no bounded surface to write", out)
    _report_losses(out, parts, job.ending, form)
    if form.single:
        parts, moved = printable.center(parts)
        if moved is not None:
            offset = ", ".join(f"{x + 0.0:.9g}" for x in moved.tolist())
            out.messages.append(f"moved by [{offset}] metres: {job.ending} has too few digits for positions so far from the origin")
    parts, shared_edges = printable.separate(parts, form.single)
    placed = [part._replace(positions=part.positions[:, [0, 2, 1]] * [_MM, -_MM, _MM] + 0.0) for part in parts] if form.printed else parts
    out.data = form.encode(placed, out)
    out.triangles = sum(len(part.triangles) for part in parts)
    out.deviation = max(part.deviation for part in parts) + rounding(parts, form)
    open_edges = sum(part.open_edges for part in parts)
    crossings = f"{shared_edges} edges of more than two triangles" if shared_edges else "closed"
    out.closed = f"{open_edges} open edges" if open_edges else crossings
    return out


def rounding(parts: Sequence[Part], form: Format) -> float:
    """The largest distance, in metres, by which the digits of a format move a vertex."""
    scale = _MM if form.printed else 1.0
    written = np.concatenate([part.positions for part in parts]) * scale
    if form.single:
        error = np.abs(written.astype(np.float32).astype(np.float64) - written).max(initial=0.0)
    else:
        error = 0.5 * 10.0 ** (1 - DIGITS) * np.abs(written).max(initial=0.0)
    return 3.0**0.5 * float(error) / scale


def _report_losses(out: Export, parts: Sequence[Part], ending: str, form: Format) -> None:
    """Report each texture, and colours of vertices, that the file lacks."""
    materials = out.scene.tables.materials
    for row in sorted({row for part in parts for row in part.rows}):
        if (materials.textures[row] >= 0).any():
            out.cannot(f"a texture is not carried: a {ending} file has none", "materials", row, ".glb and .usdz hold pictures")
    tinted = [part.instance for part in parts if part.colors is not None]
    if tinted and not form.colored:
        message, hint = f"colours of vertices are not carried: a {ending} file has none", ".ply, .obj and .3mf hold colours"
        out.cannot(message, "instances", tinted[0], hint)
