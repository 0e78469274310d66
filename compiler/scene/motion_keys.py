"""Motion blur: merges a scene compiled at several times into one scene with transform keys.

A key is a transform decomposed into translation, rotation and stretch (Shoemake and Duff 1992, Matrix Animation and Polar
Decomposition). Rotating objects thus keep their size between keys. Keys are evenly spaced between shutter opening and closing. Their
number doubles until the interpolated transforms match those at probe times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...lang.diagnostics import Diagnostics
from .. import ir
from ..formula.tape import load_tape

F64 = NDArray[np.float64]
MOST_STEPS = 64  # between keys: 128 half turns
PROBES = (0.3819, 0.8393)  # probe times as fractions of the shutter interval; they never coincide with keys
CLOSE = 1e-3  # largest corner error between keys, relative to the object's size
NOT_COMPARABLE = "objects appear or vanish while the shutter is open: nothing blurs", None, "keep their number, and move or hide them"
SLERP_THRESHOLD = 1.0 - 1e-9  # cosine of half the rotation between keys: slerp below, linear interpolation above


def shutters(scene: ir.Scene) -> tuple[float, float]:
    """Seconds from a scene's time to the first shutter opening and to the last shutter closing of its cameras."""
    cameras = scene.tables.cameras
    blurred = cameras.shutter > 0.0
    if not blurred.any():
        return 0.0, 0.0
    return float(cameras.opening[blurred].min()), float((cameras.opening + cameras.shutter)[blurred].max())


def add_motion(scene: ir.Scene, scene_at: Callable[[float], ir.Scene | None], diagnostics: Diagnostics) -> ir.Scene:
    """The scene with keys for all transforms that change while its shutters are open.

    `at(seconds)` compiles the scene at an offset from its time. Other changes are drawn as at the scene's time, with a warning.
    """
    start, end = shutters(scene)
    length = end - start
    if length <= 0.0:
        return scene
    moments: dict[float, ir.Scene] = {0.0: scene} if start == 0.0 else {}

    def moment(share: float) -> ir.Scene:
        if share not in moments:
            later = scene_at(start + share * length)
            moments[share] = scene if later is None else later
        return moments[share]

    for share in (0.0, *PROBES, 1.0):
        if not _comparable(scene, moment(share)):
            diagnostics.warning(*NOT_COMPARABLE)
            return scene
    _warn_of_other_changes(scene, [moment(share) for share in (0.0, *PROBES, 1.0)], diagnostics)
    placed = _MovableRows(scene)
    if not any(np.abs(placed.matrices(moment(share)) - placed.matrices(scene)).max(initial=0.0) > 0 for share in (0.0, *PROBES, 1.0)):
        return scene
    steps = 1
    while True:
        keys = [moment(k / steps) for k in range(steps + 1)]
        if not all(_comparable(scene, key) for key in keys):
            diagnostics.warning(*NOT_COMPARABLE)
            return scene
        parts = [decompose(m) for m in np.stack([placed.matrices(key) for key in keys], axis=1)]
        if steps >= MOST_STEPS or all(_keys_match(parts, placed, moment(share), share) for share in PROBES):
            break
        steps *= 2
    return placed.with_keys(parts, steps + 1)


_NOT_BLURRED = (  # table, columns without motion blur, message
    ("lights", ("color", "position", "direction", "size", "cos_cone", "angle"), "this light moves or changes"),
    ("materials", ("values",), "this material changes"),
    ("media", ("scattering", "absorption", "emission"), "this medium changes"),
    ("cameras", ("extent", "shift"), "this camera's lens changes"),
)


def _comparable(a: ir.Scene, b: ir.Scene) -> bool:
    return all(len(getattr(a.tables, t)[0]) == len(getattr(b.tables, t)[0]) for t in ("instances", "cameras"))


class _MovableRows:
    """The movable rows of a scene: its instances, then its cameras."""

    def __init__(self, scene: ir.Scene) -> None:
        self.scene = scene
        self.count = len(scene.tables.instances.transform)
        boxes = scene.tables.geometries.bounds[scene.tables.instances.geometry]
        boxes = np.where(np.isfinite(boxes), boxes, [[-1.0] * 3, [1.0] * 3])
        with_cameras = np.concatenate([boxes, np.tile([[[-1.0] * 3, [1.0] * 3]], (len(scene.tables.cameras.transform), 1, 1))])
        self.corners = np.stack([with_cameras[:, [k & 1, k >> 1 & 1, k >> 2], [0, 1, 2]] for k in range(8)], axis=1)  # (n, 8, 3)

    def matrices(self, scene: ir.Scene) -> F64:
        """Transforms (n, 3, 4) of these rows in a scene."""
        t = scene.tables
        return t.transforms.matrix[np.concatenate([t.instances.transform, t.cameras.transform])]

    def with_keys(self, parts: list[tuple[F64, F64, F64]], count: int) -> ir.Scene:
        """The scene in which each moving row has its own transform with keys."""
        t = self.scene.tables
        rows = np.concatenate([t.instances.transform, t.cameras.transform])
        moving = [k for k, keys in enumerate(parts) if any(np.ptp(part, axis=0).any() for part in keys) and _stays_regular(keys[2])]
        first = len(t.keys.move) + count * np.arange(len(moving))
        old = rows[moving]
        more = {
            "matrix": t.transforms.matrix[old], "inverse": t.transforms.inverse[old], "flips": t.transforms.flips[old],
            "first_key": first, "keys": np.full(len(moving), count),
        }  # fmt: skip
        new = rows.copy()
        new[moving] = len(t.transforms.matrix) + np.arange(len(moving))
        keys = [np.concatenate([parts[k][j] for k in moving]) if moving else np.zeros((0, *parts[0][j].shape[1:])) for j in range(3)]
        tables = t._replace(
            transforms=ir.table_of("transforms", {c: np.concatenate([getattr(t.transforms, c), more[c]]) for c in ir.Transforms._fields}),
            keys=ir.table_of("keys", dict(zip(ir.Keys._fields, keys, strict=True))),
            instances=ir.table_of("instances", {**t.instances._asdict(), "transform": new[: self.count]}),
            cameras=ir.table_of("cameras", {**t.cameras._asdict(), "transform": new[self.count :]}),
        )
        return replace(self.scene, tables=tables)


def _stays_regular(stretch: F64) -> bool:
    """Whether the stretch is regular at all keys, with determinants of the same sign: a change of sign passes through 0."""
    signs = np.sign(np.linalg.det(stretch))
    return bool((signs == signs[0]).all() and signs[0] != 0)


def decompose(matrices: F64) -> tuple[F64, F64, F64]:
    """Decomposes the transforms (k, 3, 4) of one object at k keys: matrix = [R S | move].

    Returns moves (k, 3), unit quaternions (k, 4) x y z w, each nearest to its predecessor, and stretches S (k, 3, 3).
    """
    linear = matrices[:, :, :3]
    u, _, v = np.linalg.svd(linear)
    turn = u @ v
    side = np.where(np.linalg.det(turn) < 0, -1.0, 1.0)[:, None, None]
    turn = turn * side
    stretch = np.swapaxes(turn, 1, 2) @ linear
    q = np.array([_quaternion(r) for r in turn])
    for k in range(1, len(q)):
        if q[k] @ q[k - 1] < 0:
            q[k] = -q[k]
    same = np.abs(np.diff(matrices[:, :, :3], axis=0)).max(axis=(1, 2), initial=0.0) == 0  # without rotation, keys are exactly equal
    for k in np.flatnonzero(same):
        q[k + 1], stretch[k + 1] = q[k], stretch[k]
    return matrices[:, :, 3].copy(), q, stretch


def _quaternion(r: F64) -> F64:
    """x, y, z, w of a rotation matrix, from the largest component (Shepperd 1978)."""
    trace = np.trace(r)
    four = np.array([*(2 * np.diag(r) - trace), trace])
    k = int(np.argmax(four))
    if k == 3:
        q = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + trace])
    else:
        i, j, n = k, (k + 1) % 3, (k + 2) % 3
        q = np.zeros(4)
        q[i], q[j], q[n], q[3] = 1 + r[i, i] - r[j, j] - r[n, n], r[j, i] + r[i, j], r[n, i] + r[i, n], r[n, j] - r[j, n]
    return q / np.linalg.norm(q)


def rotations(q: F64) -> F64:
    """(…, 3, 3) matrices of unit quaternions (…, 4)."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def interpolate(parts: tuple[F64, F64, F64], share: float) -> F64:
    """The interpolated transform (3, 4) at a fraction of the time between first and last key."""
    move, turn, stretch = parts
    position = share * (len(move) - 1)
    k = min(int(position), len(move) - 2)
    f = position - k
    cosine = float(np.clip(turn[k] @ turn[k + 1], -1, 1))
    if cosine < SLERP_THRESHOLD:
        angle = math.acos(cosine)
        q = (math.sin((1 - f) * angle) * turn[k] + math.sin(f * angle) * turn[k + 1]) / math.sin(angle)
    else:
        q = (1 - f) * turn[k] + f * turn[k + 1]
    linear = rotations(q / np.linalg.norm(q)) @ ((1 - f) * stretch[k] + f * stretch[k + 1])
    return np.concatenate([linear, ((1 - f) * move[k] + f * move[k + 1])[:, None]], axis=1)


def _keys_match(parts: list[tuple[F64, F64, F64]], placed: _MovableRows, scene: ir.Scene, share: float) -> bool:
    """Whether the interpolated transforms match a scene at a time between keys."""
    true = placed.matrices(scene)
    for k, wanted in enumerate(true):
        interpolated = interpolate(parts[k], share)
        off = (interpolated - wanted)[:, :3] @ placed.corners[k].T + (interpolated - wanted)[:, 3:]
        size = wanted[:, :3] @ placed.corners[k].T
        if not np.linalg.norm(off, axis=0).max() <= CLOSE * np.linalg.norm(np.ptp(size, axis=1)):
            return False
    return True


def _warn_of_other_changes(scene: ir.Scene, others: list[ir.Scene], diagnostics: Diagnostics) -> None:
    """Warns of changes other than transforms."""
    end = "while the shutter is open: it is drawn as it is at the opening"
    for table, columns, what in _NOT_BLURRED:
        for row in _changed(scene, others, table, columns):
            diagnostics.warning(f"{what} {end}", scene.spans.get(table, row))
    densities = [_densities(s) for s in (scene, *others)]
    for row, density in enumerate(densities[0]):
        if any(row < len(other) and other[row] != density for other in densities[1:]):
            diagnostics.warning(f"the density of this medium changes {end}", scene.spans.get("media", row), "move its shape instead")
    shapes = [_shapes(s) for s in (scene, *others)]
    for row in range(len(shapes[0])):
        if any(other[row] != shapes[0][row] for other in shapes[1:]):
            diagnostics.warning(f"this changes its shape {end}", scene.spans.get("instances", row), "its place, turn and scale may change")


def _changed(scene: ir.Scene, others: list[ir.Scene], table: str, columns: tuple[str, ...]) -> Iterator[int]:
    rows = getattr(scene.tables, table)
    for row in range(len(rows[0])):
        for other in others:
            those = getattr(other.tables, table)
            if len(those[0]) == len(rows[0]) and any((getattr(rows, c)[row] != getattr(those, c)[row]).any() for c in columns):
                yield row
                break


def _densities(scene: ir.Scene) -> list[tuple[bytes, ...]]:
    """A comparable description of the formula of each medium's density."""
    t, structures = scene.tables, []
    for row in t.media.density.tolist():
        tape = None if row < 0 or t.textures.tape[row] < 0 else load_tape(t, int(t.textures.tape[row]))
        structures.append(() if tape is None else (tape.structure(), tape.constants.tobytes()))
    return structures


def _shapes(scene: ir.Scene) -> list[tuple[object, ...]]:
    """A comparable description of each instance's shape."""
    g, pools = scene.tables.geometries, scene.tables.pools
    forms: dict[int, tuple[object, ...]] = {}
    formulas = hash(tuple(column.tobytes() for column in scene.tables.tapes))
    for row in np.unique(scene.tables.instances.geometry).tolist():
        corners = pools.positions[g.first_vertex[row] : g.first_vertex[row] + g.vertex_count[row]]
        forms[row] = (int(g.kind[row]), g.parameters[row].tobytes(), hash(corners.tobytes()), g.origin[row].tobytes())
        if g.kind[row] == ir.GeometryKind.FORMULA:
            forms[row] += (formulas,)
    return [forms[row] for row in scene.tables.instances.geometry.tolist()]
