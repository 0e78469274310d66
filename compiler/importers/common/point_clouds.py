"""Points without faces, as scanners write them: spheres, as those of a Points prim of USD."""

from __future__ import annotations

import numpy as np

from ....lang.diagnostics import Diagnostics, Span
from ...ir import F64, I64
from ...mesh import strands
from ...mesh.polygon_mesh import PolyMesh

THIN = 150  # the extent of points or lines without a width, over the width that they get
MOST = 500_000  # points that are drawn: 10 million triangles


def radius(points: F64) -> float:
    """Half the width of points (n, 3) without one: 1/150 of their extent, and less for more than 150² points.

    About n points on a surface of that extent then cover it. Points at one place have the width 1, as those of USD.
    """
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return extent / max(THIN, float(np.sqrt(len(points)))) / 2 if extent > 0 else 0.5


def thinned(rows: I64, diagnostics: Diagnostics, span: Span) -> I64:
    """At most MOST of the rows of points: every second, third and so on, with a warning."""
    step = -(-len(rows) // MOST)
    if step > 1:
        message = f"of {len(rows):,} points, every {step}{'nd' if step == 2 else 'rd' if step == 3 else 'th'} is drawn, and wider"
        diagnostics.warning(message, span, f"at most {MOST:,} points are drawn")
    return rows[::step] if step > 1 else rows


def mesh(points: F64, colors: np.ndarray | None, diagnostics: Diagnostics, span: Span) -> PolyMesh | None:
    """Spheres at the points (n, 3), with linear colours (n, 3); None if no point is finite. Tells their width, and what is left out."""
    sound = np.asarray(np.isfinite(points).all(axis=1))
    if lost := int(np.count_nonzero(~sound)):
        diagnostics.warning(f"{lost:,} of {len(points):,} points are not finite: they are left out", span)
    rows = np.flatnonzero(sound)
    if not len(rows):
        return None
    rows = thinned(rows, diagnostics, span)
    half = radius(points[rows])
    shown = f"{len(rows):,} points are drawn as spheres" if len(rows) > 1 else "1 point is drawn as a sphere"
    diagnostics.note(f"{shown} with a width of {2 * half:.3g}: the file has no faces", span)
    return strands.balls(points[rows], np.full(len(rows), half), None if colors is None else colors[rows])
