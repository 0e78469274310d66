"""Lowers shapes that are swept from points: `revolve`, `extrude` and `curve`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...lang.elements import Element
from ..formula import polygon_fields
from ..formula.builder import Builder
from ..formula.solid_fields import Point
from ..mesh import polygon_mesh, profiles, splines, swept, tubes
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

MOST_TURN = math.radians(8)  # of a tube's path from one section to the next
WHOLE = 1 - 1e-12  # of a turn, from which a revolved profile closes


def revolve(lowering: Context, element: Element) -> list[Piece]:
    """A surface of revolution; nothing, after a diagnostic, if its profile is impossible."""
    args = element.args
    for number, (radius, y) in enumerate(args["profile"], 1):
        if radius < 0:
            place = f"point {number} of the profile, {profiles.show(np.array((radius, y)))}"
            return lowering.refuse(element, f"{place}, has a radius below 0", "write [radius, y]: a radius is 0 or more")
    closed = args["angle"] >= WHOLE * 2 * math.pi
    try:
        profile = _revolved_profile(args["profile"], args["kind"], args["closed"], _half(lowering))
    except profiles.ProfileError as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    angle = 2 * math.pi if closed else args["angle"]
    off = profiles.deviation(args["profile"], args["kind"], args["closed"], _half(lowering))
    off += swept.sagitta(float(profile[:, 0].max()), angle / swept.turns(profile, angle, _half(lowering)))
    return _piece(lowering, element, swept.revolve(profile, args["closed"], angle, _half(lowering)), off)


def _half(lowering: Context) -> float | None:
    """Half the tolerance asked for, for each of two deviations that add up; None: the default."""
    return None if lowering.tolerance is None else 0.5 * lowering.tolerance


def _revolved_profile(points: tuple[tuple[float, float], ...], kind: str, closed: bool, tolerance: float | None = None) -> np.ndarray:
    """The polygon or polyline of a profile, whose curve may not cross the axis. Raises ProfileError."""
    line = profiles.outline(points, kind, tolerance=tolerance) if closed else profiles.curve(points, kind, False, tolerance=tolerance)
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
    taper = args["taper"]
    if (taper[0] == 0) != (taper[1] == 0):
        axis = "x" if taper[0] == 0 else "z"
        hint = "write taper: 0 for a point, or a number above 0 for each axis"
        return lowering.refuse(element, f"`taper` is 0 along {axis} alone: the top would be an edge", hint)
    try:
        loops, sweep = _prism(args, _half(lowering))
        rings = [args["profile"], *(args["holes"] or ())]
        off = max(profiles.deviation(ring, args["kind"], True, _half(lowering)) for ring in rings) * max(1.0, *taper)
        if sweep.twist or taper[0] != taper[1]:  # by the shape of a cell's side, and by the chord of a layer
            off += 2 * profiles.fineness(np.concatenate(loops), sweep.tolerance)
        return _piece(lowering, element, swept.extrude(loops, sweep), off)
    except profiles.ProfileError as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)


def field(element: Element) -> tuple[Callable[[Builder, Point], int], np.ndarray] | None:
    """The field of a `revolve` or `extrude` and its bounds (2, 3); None of one without a field.

    Those of few straight lines have one, unless they are open, scaled unevenly, or impossible.
    """
    args = element.args
    if element.kind not in ("revolve", "extrude") or args["kind"] != "linear":
        return None
    try:
        return _revolved_field(args) if element.kind == "revolve" else _prism_field(args)
    except profiles.ProfileError:
        return None


def _revolved_field(args: Mapping[str, Any]) -> tuple[Callable[[Builder, Point], int], np.ndarray] | None:
    if not args["closed"] or len(args["profile"]) > polygon_fields.MOST_EDGES or any(radius < 0 for radius, _ in args["profile"]):
        return None
    profile = _revolved_profile(args["profile"], "linear", True)
    angle = 2 * math.pi if args["angle"] >= WHOLE * 2 * math.pi else args["angle"]
    (reach, high), low = profile.max(axis=0), profile[:, 1].min()
    bounds = np.array([[-reach, low, -reach], [reach, high, reach]])
    return lambda b, point: polygon_fields.revolved(b, profile, angle, point), bounds


def _prism_field(args: Mapping[str, Any]) -> tuple[Callable[[Builder, Point], int], np.ndarray] | None:
    taper = args["taper"]
    count = len(args["profile"]) + sum(map(len, args["holes"] or ()))
    if taper[0] != taper[1] or count > polygon_fields.MOST_EDGES:
        return None
    loops, sweep = _prism(args)
    flat = np.concatenate(loops) * (1.0, -1.0)
    corners = np.concatenate([flat, flat * taper[0]])
    if sweep.twist:
        corners = np.linalg.norm(corners, axis=1).max() * np.array([[-1, -1], [1, 1]])
    (x0, z0), (x1, z1) = corners.min(axis=0), corners.max(axis=0)
    bounds = np.array([[x0, sweep.base, z0], [x1, sweep.base + sweep.height, z1]])
    outlines = (loops[0], *(hole[::-1] for hole in loops[1:]))
    shape = polygon_fields.Prism(outlines, sweep.base, sweep.height, sweep.twist, taper[0])
    return lambda b, point: polygon_fields.prism(b, shape, point), bounds


def _prism(args: Mapping[str, Any], tolerance: float | None = None) -> tuple[list[np.ndarray], swept.Sweep]:
    """The loops of a prism in [x, -z], holes clockwise, and how they are swept. Raises ProfileError."""
    outer = profiles.outline(args["profile"], args["kind"], tolerance=tolerance)
    holes = [profiles.outline(hole, args["kind"], f"hole {n}", tolerance) for n, hole in enumerate(args["holes"] or (), 1)]
    loops = [loop[::-1] * (1.0, -1.0) for loop in profiles.with_holes(outer, holes)]
    base, half = -args["height"] / 2 if args["centered"] else 0.0, None if tolerance is None else 0.5 * tolerance
    return loops, swept.Sweep(base, args["height"], args["twist"], args["taper"], half)


def curve(lowering: Context, element: Element) -> list[Piece]:
    """A tube along a curve; nothing, after a diagnostic, if there is none."""
    args = element.args
    points, closed = np.array(args["points"]).reshape(-1, 3), args["closed"]
    fault, hint = _unfit_radii(args["radius"], len(points), closed)
    if fault:
        return lowering.refuse(element, fault, hint)
    radii = np.broadcast_to(np.array(args["radius"]), len(points))
    same = (points[1:] == points[:-1]).all(axis=1) & (radii[1:] != radii[:-1])
    if same.any():
        first = int(np.flatnonzero(same)[0]) + 1
        return lowering.refuse(element, f"points {first} and {first + 1} are the same and have two radii", "move one of them a little")
    if not len(points):
        return lowering.refuse(element, "a curve has two points or more, got 0")
    largest, control = float(radii.max()), np.column_stack([points, radii])
    tolerance, turn = (profiles.extent(points) + 2 * largest) / profiles.FINENESS, MOST_TURN
    if lowering.tolerance is not None:
        tolerance = lowering.tolerance / 4  # of the path, the bends, and both ways round a cap
        turn = min(MOST_TURN, 2 * math.acos(max(0.0, 1 - tolerance / largest)))
    try:
        line = splines.polyline(control, args["kind"], closed, tolerance, turn)
        line = _without_repetitions(line, closed)
        sides = swept.sides(largest, tolerance)
        off = _off_tube(line[:1] if args["kind"] == "linear" else line, largest, sides)
        off += splines.deviation(control, args["kind"], closed, tolerance)
        mesh = tubes.tube(line[:, :3], np.maximum(line[:, 3], 0.0), closed, args["caps"], sides)
    except (splines.SplineError, tubes.TubeError) as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    if mesh.fold is not None:
        message = f"the tube folds into itself near {profiles.show(mesh.fold)}: its bend is tighter than its radius"
        lowering.warn(element, message, "a smaller radius, or a wider bend")
    return _piece(lowering, element, mesh.mesh, off)


def _off_tube(line: np.ndarray, radius: float, sides: int) -> float:
    """The distance of a tube's triangles from the round tube along a smooth polyline (n, 4): chords around it, of caps and of bends."""
    legs = np.diff(line[:, :3], axis=0)
    legs = legs / np.maximum(np.linalg.norm(legs, axis=1, keepdims=True), 1e-300)
    bends = np.arccos(np.clip((legs[1:] * legs[:-1]).sum(axis=1), -1.0, 1.0)) if len(legs) > 1 else np.zeros(1)
    bend = swept.sagitta(radius, min(float(bends.max()), math.pi))
    return 2 * swept.sagitta(radius, 0.5 * math.pi / max(3, sides // 4)) + 2 * bend


def _unfit_radii(radii: tuple[float, ...], count: int, closed: bool) -> tuple[str, str]:
    """The message and the hint for wrong radii of a curve of `count` points; empty for right ones."""
    if len(radii) not in (1, count):
        return f"the curve has {count} points and {len(radii)} radii", "give one radius for each point, or one for all"
    if len(radii) == 1 and not radii[0]:
        return "`radius` must be more than 0, got 0", ""
    inner = radii if closed else radii[1:-1]
    if len(radii) > 1 and not all(inner):
        number = radii.index(0.0, 0 if closed else 1) + 1
        return f"radius {number} is 0", "a closed tube has no tip" if closed else "a tip is at an end: only the first and the last may be 0"
    if not any(radii):
        return "the radii of both ends are 0: the tube has no volume", "give one of them a radius"
    return "", ""


def _without_repetitions(line: np.ndarray, closed: bool) -> np.ndarray:
    """The points of a polyline without those that are too near to the one before for a direction. Raises SplineError if one is left."""
    near = np.linalg.norm(line[:, :3] - np.roll(line[:, :3], 1, axis=0), axis=1) <= 1e-9 * np.ptp(line[:, :3], axis=0).max()
    near[0] &= closed
    if np.count_nonzero(~near) < (3 if closed else 2):
        raise splines.SplineError("the points are the same: a curve has two different ones or more")
    return line[~near]


def _piece(lowering: Context, element: Element, mesh: polygon_mesh.PolyMesh, off: float) -> list[Piece]:
    """The piece of a mesh whose triangles are `off` metres from its surface, at most."""
    data, _ = polygon_mesh.assemble(mesh, element.args["crease"])
    return [Piece(lowering.builder.mesh(replace(data, deviation=off), element.place), transforms.identity())]
