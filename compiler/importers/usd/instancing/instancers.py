"""Reads the instances of point instancers: prototype, id and transform of each, as UsdGeomPointInstancer defines them."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from ....ir import F64, I64
from ..materials import DISPLAY_COLOR, Materials
from ..stage import flattened, linear, moves, numbers


@dataclass(frozen=True, slots=True, eq=False)
class Instances:
    """Visible instances of a point instancer."""

    ids: I64  # (n,) their rows in the instancer's arrays
    prototypes: I64  # (n,) rows of its prototypes
    positions: F64  # (n, 3)
    linear: F64 | None  # (n, 3, 3) rotation and scale; None for none

    def places(self, chosen: I64) -> F64:
        """Transforms (m, 4, 4) of the chosen ones, without their prototypes' own."""
        matrices = np.zeros((len(chosen), 4, 4))
        matrices[:, :3, :3] = np.eye(3) if self.linear is None else self.linear[chosen]
        matrices[:, :3, 3], matrices[:, 3, 3] = self.positions[chosen], 1.0
        return matrices


def read(instancer: Any, time: Any, prototypes: int, tell: Callable[[str], None]) -> Instances:
    """The instances of an instancer with a number of prototypes; those that cannot be placed are left out with a warning."""
    prim = instancer.GetPrim()
    of = numbers(instancer.GetProtoIndicesAttr(), time, np.int64)
    positions = numbers(instancer.GetPositionsAttr(), time, np.float64, 3)
    if len(positions) != len(of):
        tell(f"the instancer has {len(of)} instances and {len(positions)} positions: the rest is left out")
    count = min(len(of), len(positions))
    ids = np.arange(count)
    mask = np.array(instancer.ComputeMaskAtTime(time), dtype=bool)
    if len(mask) == len(of):
        ids = np.flatnonzero(mask[:count])
    absent = (of[ids] < 0) | (of[ids] >= prototypes)
    if absent.any():
        lost = np.count_nonzero(absent)
        tell(
            f"{lost} instances have none of the {prototypes} prototypes of this instancer: they are left out"
            if prototypes
            else f"this instancer has no prototypes: its {lost} instances are left out"
        )
        ids = ids[~absent]
    if moves(prim, time):
        kind = type(instancer)
        matrices = np.array(instancer.ComputeInstanceTransformsAtTime(time, time, kind.ExcludeProtoXform, kind.IgnoreMask), np.float64)
        if len(matrices) == len(of):
            return Instances(ids, of[ids], matrices[ids, 3, :3], matrices[ids, :3, :3].transpose(0, 2, 1))
    turned = _fitting(prim, ("orientationsf", "orientations"), time, 4, len(of), tell)
    scaled = _fitting(prim, ("scales",), time, 3, len(of), tell)
    linear = None
    if turned is not None or scaled is not None:
        linear = np.broadcast_to(np.eye(3), (len(ids), 3, 3)) if turned is None else _rotations(turned[ids])
        linear = linear if scaled is None else linear * scaled[ids][:, None, :]
    return Instances(ids, of[ids], positions[ids], linear)


def colors(prim: Any, time: Any, materials: Materials) -> list[int]:
    """Materials of the instances of a point instancer with a displayColor for each; empty otherwise."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(DISPLAY_COLOR)
    if not primvar or not primvar.HasValue() or str(primvar.GetInterpolation()) == "constant":
        return []
    flat = flattened(primvar, time)
    instance_colors = linear(primvar.GetAttr(), np.array(() if flat is None else flat, dtype=np.float64).reshape(-1, 3))
    if len(instance_colors) != len(numbers(UsdGeom.PointInstancer(prim).GetProtoIndicesAttr(), time, np.int64)):
        materials.tell("the displayColor of this instancer does not fit its instances: it is left out", prim)
        return []
    what, rows = "a displayColor of this instancer", {}
    for color in np.unique(instance_colors, axis=0):
        r, g, b = map(float, color)
        rows[color.tobytes()] = materials.plain(materials.without_negatives((r, g, b), prim, what), 1.0, DISPLAY_COLOR)
    return [rows[color.tobytes()] for color in instance_colors]


def _fitting(prim: Any, names: tuple[str, ...], time: Any, width: int, count: int, tell: Callable[[str], None]) -> F64 | None:
    """The first of some attributes that has values, (count, width); None without one, or with a warning if it does not fit."""
    for name in names:
        values = numbers(prim.GetAttribute(name), time, np.float64, width)
        if len(values) == count:
            return values
        if len(values):
            tell(f"the {name} of this instancer have {len(values)} values for {count} instances: they are left out")
            return None
    return None


def _rotations(turns: F64) -> F64:
    """Matrices (n, 3, 3) of quaternions (x, y, z, w), as they are: usd-core does not normalize them either."""
    x, y, z, w = turns.T
    matrices = np.empty((len(turns), 3, 3))
    matrices[:, 0] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    return matrices
