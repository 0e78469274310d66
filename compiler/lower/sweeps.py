"""Lowers shapes that are swept from points: `revolve` and `extrude`."""

from __future__ import annotations

import math

import numpy as np

from ...lang.elements import Element
from ..mesh import polygon_mesh, profiles, swept
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

WHOLE = 1 - 1e-12  # of a turn, from which a revolved profile closes


def revolve(lowering: Context, element: Element) -> list[Piece]:
    """A surface of revolution; nothing, after a diagnostic, if its profile is impossible."""
    args = element.args
    for number, (radius, y) in enumerate(args["profile"], 1):
        if radius < 0:
            place = f"point {number} of the profile, {profiles.show(np.array((radius, y)))}"
            return lowering.refuse(element, f"{place}, has a radius below 0", "write [radius, y]: a radius is 0 or more")
    whole = args["angle"] >= WHOLE * 2 * math.pi
    try:
        profile = _revolved_profile(args["profile"], args["kind"], args["closed"])
    except profiles.ProfileError as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    return _piece(lowering, element, swept.revolve(profile, args["closed"], 2 * math.pi if whole else args["angle"]))


def _revolved_profile(points: tuple[tuple[float, float], ...], kind: str, closed: bool) -> np.ndarray:
    """The polygon or polyline of a profile, whose curve may not cross the axis. Raises ProfileError."""
    line = profiles.outline(points, kind) if closed else profiles.curve(points, kind, False)
    slack = 1e-9 * profiles.extent(line)
    least = int(np.argmin(line[:, 0]))
    if line[least, 0] < -slack:
        place = profiles.show(line[least])
        raise profiles.ProfileError(f"the curve of the profile crosses the axis near {place}", "move its points away from the axis")
    line[:, 0] = np.where(line[:, 0] <= slack, 0.0, line[:, 0])
    if not line[:, 0].any():
        raise profiles.ProfileError("the profile lies on the axis: it has no radius", "write [radius, y]")
    return line


def extrude(lowering: Context, element: Element) -> list[Piece]:
    """A prism; nothing, after a diagnostic, if its profile is impossible."""
    args = element.args
    taper, height = args["taper"], args["height"]
    if (taper[0] == 0) != (taper[1] == 0):
        axis = "x" if taper[0] == 0 else "z"
        hint = "write taper: 0 for a point, or a number above 0 for each axis"
        return lowering.refuse(element, f"`taper` is 0 along {axis} alone: the top would be an edge", hint)
    try:
        outer = profiles.outline(args["profile"], args["kind"])
        holes = [profiles.outline(hole, args["kind"], f"hole {n}") for n, hole in enumerate(args["holes"] or (), 1)]
        loops = [loop[::-1] * (1.0, -1.0) for loop in profiles.with_holes(outer, holes)]
        sweep = swept.Sweep(-height / 2 if args["centered"] else 0.0, height, args["twist"], taper)
        return _piece(lowering, element, swept.extrude(loops, sweep))
    except profiles.ProfileError as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)


def _piece(lowering: Context, element: Element, mesh: polygon_mesh.PolyMesh) -> list[Piece]:
    data, _ = polygon_mesh.assemble(mesh, element.args["crease"])
    return [Piece(lowering.builder.mesh(data, element.span), transforms.identity())]
