"""Volume, area, center and inertia of the bounded instances of a scene, each with its error.

They are integrals over closed triangle meshes at two tolerances, the second a quarter of the first. Where errors fall in proportion to the
tolerance, a third of the difference is the error of the finer one (Richardson's extrapolation), which is taken off. They do not fall so for
few chords, thin shapes and contours. So an error is at least that which the deviation of the finer one allows: a layer of this thickness on
its round faces changes the volume, and the area by the thickness times the turns of its edges (Steiner's formula). A mesh that does not
bound one volume has none: no number is given for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.mesh.parts import Part
from ...compiler.mesh.topology import Topology, counted_twice, crossings, moments, topology, turns
from ...lang.diagnostics import Diagnostic
from . import printable_mesh

FINER = 4.0
SIDE_SHARE = 1 / 500  # of an instance's longest side: its tolerance at most, in scenes of up to FEW instances
FEW = 1000
F64 = NDArray[np.float64]


class Measured(NamedTuple):
    """A value and its error, of equal shapes."""

    value: F64
    error: F64


class Properties(NamedTuple):
    """Of one instance, in metres; of density 1."""

    name: str
    low: F64  # (3,) corner of the bounding box
    high: F64  # (3,)
    deviation: float  # of the bounding box
    area: Measured | None  # None where thin parts are missing, as of all below
    volume: Measured | None  # None of a mesh that bounds none, as of all below
    center: Measured | None  # (3,)
    inertia: Measured | None  # (3, 3) about the center
    topology: Topology
    unbounded: str  # why it has no volume
    searched: bool = True  # for places where it crosses itself


def measure(scene: ir.Scene, tolerance: float | None = None) -> tuple[list[Properties], list[Diagnostic]]:
    """The properties of all bounded instances, and the diagnostics of their meshes. `tolerance`: see printable_mesh."""
    share = SIDE_SHARE * max(len(scene.tables.instances.geometry) / FEW, 1.0)
    coarse, diagnostics = printable_mesh.printable_parts(scene, tolerance, share)
    finest = tolerance or printable_mesh.default_tolerance(scene)
    fine, _ = printable_mesh.printable_parts(scene, finest / FINER if finest else None, share / FINER)
    same = {part.instance: part for part in coarse}
    return [_properties(same.get(part.instance, part), part) for part in fine], diagnostics


def _properties(coarse: Part, fine: Part) -> Properties:
    if fine.missing > 0.0:
        why = f"parts thinner than {fine.missing * 1000:.3g} mm are missing in its triangles"
        low, high = fine.positions.min(axis=0), fine.positions.max(axis=0)
        edges = topology(fine.positions, fine.triangles)
        return Properties(fine.name, low, high, fine.deviation, None, None, None, None, edges, why)
    bends = turns(fine.positions, fine.triangles)
    area = _extrapolate(_area(coarse), _area(fine), bends.total * fine.deviation)
    low, high = fine.positions.min(axis=0), fine.positions.max(axis=0)
    edges = topology(fine.positions, fine.triangles)
    first, second = moments(coarse.positions, coarse.triangles), moments(fine.positions, fine.triangles)
    why, searched = _unbounded(coarse, fine, edges, float(second.volume))
    if why:
        return Properties(fine.name, low, high, fine.deviation, area, None, None, None, edges, why)
    symmetric = not (fine.is_mesh or fine.is_contour)  # the triangles of an analytic shape are as symmetric as the shape
    round_area = bends.round_area if symmetric else float(area.value)
    layer = (round_area + bends.total * fine.deviation) * fine.deviation  # between the mesh and the surface
    reach = 0.0 if symmetric else 0.5 * float(np.linalg.norm(high - low))
    volume = _extrapolate(first.volume, second.volume, layer)
    center = _extrapolate(first.center, second.center, layer * reach / max(abs(float(volume.value)), 1e-300))
    inertia = _extrapolate(first.inertia, second.inertia, layer * reach**2)
    return Properties(fine.name, low, high, fine.deviation, area, volume, center, inertia, edges, "", searched)


def _unbounded(coarse: Part, fine: Part, edges: Topology, volume: float) -> tuple[str, bool]:
    """(why a mesh bounds no volume, empty if it bounds one; whether it was searched for crossings)"""
    if edges.watertight and not edges.wound:
        return "neighbouring faces are wound against each other", True
    if coarse.open_edges or fine.open_edges:
        return "the surface is open", True
    if not fine.is_mesh:
        return "", True
    crossing_count = crossings(fine.positions, fine.triangles)
    if crossing_count:
        return f"the surface crosses itself in {crossing_count} of its triangles", True
    if twice := counted_twice(fine.positions, fine.triangles):
        return f"{twice} of its bodies {'lies' if twice == 1 else 'lie'} inside others that face the same way", True
    if not volume > 0.0:
        return "its faces point inwards" if volume < 0.0 else "the surface encloses nothing", True
    return "", crossing_count is not None


def _extrapolate(coarse: F64, fine: F64, least: float) -> Measured:
    step = (fine - coarse) / (FINER - 1.0)
    value = np.asarray(fine + step)
    return Measured(value, np.maximum(np.abs(step), least) + 1e-12 * np.abs(value))


def _area(part: Part) -> F64:
    a, b, c = (part.positions[part.triangles[:, k]] for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def total(parts: Sequence[Properties]) -> Measured | None:
    """The sum of the volumes; None if one is unknown. What parts share counts for each of them."""
    volumes = [part.volume for part in parts if part.volume is not None]
    if len(volumes) < len(parts):
        return None
    return Measured(np.asarray(sum(v.value for v in volumes)), np.asarray(sum(v.error for v in volumes)))
