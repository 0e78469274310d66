"""4×4 transforms in float64 on column vectors, composed at compile time to keep precision."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...lang.elements import AxisAngle, Euler, Quaternion, Rotation

Matrix = np.ndarray  # (4, 4) float64; inverse() also takes the upper (3, 4)
SINGULAR = 1e-13  # a |det| below this fraction of the product of column lengths counts as singular


def identity() -> Matrix:
    return np.eye(4)


def translation(by: Sequence[float]) -> Matrix:
    """Translation by (x, y, z) metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def scaling(by: Sequence[float]) -> Matrix:
    """Scaling by three factors along the axes."""
    return np.diag([*by, 1.0])


def rotation(turn: Rotation) -> Matrix:
    """The matrix of an Euler, axis–angle or quaternion rotation. Raises ValueError for a zero axis or quaternion."""
    matrix = np.eye(4)
    if isinstance(turn, Euler):
        matrix[:3, :3] = _euler(*turn.angles)
    elif isinstance(turn, AxisAngle):
        matrix[:3, :3] = _axis_angle(np.array(turn.axis, dtype=np.float64), turn.angle)
    else:
        matrix[:3, :3] = _quaternion(turn)
    return matrix


def from_rows(rows: Sequence[Sequence[float]] | np.ndarray) -> Matrix:
    """A matrix from three or four rows of four numbers. Raises ValueError if the fourth row is not 0 0 0 1 (a projection)."""
    matrix = np.eye(4)
    values = np.array(rows, dtype=np.float64)
    if values.shape not in ((3, 4), (4, 4)):
        raise ValueError("a matrix has three or four rows of four numbers")
    if len(values) == 4 and tuple(values[3]) != (0.0, 0.0, 0.0, 1.0):
        raise ValueError("the last row of a matrix is 0, 0, 0, 1")
    matrix[:3] = values[:3]
    return matrix


def place(translate: Sequence[float] | None, rotate: Rotation | None, scale: Sequence[float] | None) -> Matrix:
    """T · R · S: scales first, then rotates, then translates."""
    matrix = np.eye(4)
    if rotate is not None:
        matrix = rotation(rotate)
    if scale is not None:
        matrix = matrix @ scaling(scale)
    if translate is not None:
        matrix[:3, 3] = translate
    return matrix


def inverse(matrix: Matrix) -> np.ndarray | None:
    """The (3, 4) inverse of an affine matrix (only its first three rows are used); None if singular or not finite.

    Cofactors over the determinant. Singularity is relative to the column lengths, so tiny and stretched matrices pass.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = matrix[:3].tolist()
    ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
    determinant = a * ei + b * fg + c * dh
    lengths = math.hypot(a, d, g) * math.hypot(b, e, h) * math.hypot(c, f, i)
    if not math.isfinite(determinant) or not abs(determinant) > SINGULAR * lengths or not math.isfinite(x + y + z):
        return None
    linear = (
        (ei / determinant, (c * h - b * i) / determinant, (b * f - c * e) / determinant),
        (fg / determinant, (a * i - c * g) / determinant, (c * d - a * f) / determinant),
        (dh / determinant, (b * g - a * h) / determinant, (a * e - b * d) / determinant),
    )
    inverses = np.array([(*row, -(row[0] * x + row[1] * y + row[2] * z)) for row in linear])
    return inverses if np.isfinite(inverses).all() else None


def inverses(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((n, 3, 4) inverses of affine (n, 3, 4) matrices, (n,) whether they exist); see `inverse`, with whose bits they agree."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = matrices.transpose(1, 2, 0)
    with np.errstate(all="ignore"):
        ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
        determinant = a * ei + b * fg + c * dh
        linear = np.array(
            [
                [ei / determinant, (c * h - b * i) / determinant, (b * f - c * e) / determinant],
                [fg / determinant, (a * i - c * g) / determinant, (c * d - a * f) / determinant],
                [dh / determinant, (b * g - a * h) / determinant, (a * e - b * d) / determinant],
            ]
        )
        lengths = np.hypot(np.hypot(a, d), g) * np.hypot(np.hypot(b, e), h) * np.hypot(np.hypot(c, f), i)
        moved = -(linear[:, 0] * x + linear[:, 1] * y + linear[:, 2] * z)
        good = np.isfinite(determinant) & (abs(determinant) > SINGULAR * lengths) & np.isfinite(x + y + z)
        inverted = np.ascontiguousarray(np.concatenate([linear, moved[:, None]], axis=1).transpose(2, 0, 1))
        return inverted, good & np.isfinite(inverted).all(axis=(1, 2))


def looking(position: Sequence[float], target: Sequence[float], up: Sequence[float]) -> Matrix | None:
    """Look-at frame of an eye at `position`: −z towards `target`, y nearest to `up`. None if both points coincide."""
    backward = unit(np.subtract(position, target, dtype=np.float64))
    if backward is None:
        return None
    return _frame(_perpendicular(backward, up), 2, backward, position)


def facing(position: Sequence[float], direction: Sequence[float], up: Sequence[float] | None = None) -> Matrix | None:
    """The frame of a flat shape at `position` with +y along `direction` and −z nearest to `up`. None if `direction` is 0.

    Without `up`, the smallest rotation from +y to `direction`, so a frame facing +y is the identity.
    """
    normal = unit(np.asarray(direction, dtype=np.float64))
    if normal is None:
        return None
    if up is None:
        matrix = np.eye(4)
        matrix[:3, :3] = _shortest_turn(normal)
        matrix[:3, 3] = position
        return matrix
    z = -_perpendicular(normal, up)
    return _frame(z, 1, normal, position)


def unit(v: np.ndarray) -> np.ndarray | None:
    """The normalized v; None for a zero vector. Scaled first, so that tiny and huge vectors keep their direction."""
    largest = float(np.max(np.abs(v)))
    if not 0.0 < largest < math.inf:
        return None
    v = v / largest
    return v / math.sqrt(float(v @ v))


def unscaled(matrix: np.ndarray) -> Matrix:
    """The unscaled frame of a camera: −z unchanged in direction, x nearest to its own, right-handed."""
    frame = np.eye(4)
    z = matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-300)
    y = matrix[:3, 1] - (matrix[:3, 1] @ z) * z
    y = y / max(float(np.linalg.norm(y)), 1e-300)
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = np.cross(y, z), y, z, matrix[:3, 3]
    return frame


def points(matrix: Matrix, positions: np.ndarray) -> np.ndarray:
    """Points (n, 3) transformed by a matrix."""
    return positions @ matrix[:3, :3].T + matrix[:3, 3]


def _frame(other: np.ndarray, axis: int, along: np.ndarray, position: Sequence[float]) -> Matrix:
    """A right-handed frame: `axis` 2: z = along, y = other; `axis` 1: y = along, z = other."""
    y, z = (other, along) if axis == 2 else (along, other)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = np.cross(y, z), y, z
    matrix[:3, 3] = position
    return matrix


def _perpendicular(axis: np.ndarray, up: Sequence[float]) -> np.ndarray:
    """The unit vector perpendicular to `axis` nearest to `up`; if `up` is parallel to it, nearest to −z, then x."""
    for candidate in (up, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)):
        wanted = unit(np.asarray(candidate, dtype=np.float64))
        if wanted is None:
            continue
        across = wanted - (wanted @ axis) * axis
        if math.sqrt(float(across @ across)) > 1e-9:
            across /= math.sqrt(float(across @ across))
            across -= (across @ axis) * axis  # once more: removes the rounding residue along the axis
            return across / math.sqrt(float(across @ across))
    raise AssertionError("−z and x cannot both lie along one axis")


def _shortest_turn(normal: np.ndarray) -> np.ndarray:
    """The smallest rotation from +y to a unit vector (about x if it is −y)."""
    x, y, z = normal.tolist()
    across = math.hypot(x, z)
    if y < 0 and across < 1e-290:
        return np.diag([1.0, -1.0, -1.0])
    k, a, b = (1.0 - y, x / across, z / across) if y < 0 else (1.0 / (1.0 + y), x, z)  # equal, each free of cancellation
    return np.array([[1 - k * a * a, x, -k * a * b], [-x, y, -z], [-k * a * b, z, 1 - k * b * b]])


def _euler(ax: float, ay: float, az: float) -> np.ndarray:
    """Rotation about the fixed x, then y, then z axis: Rz · Ry · Rx."""
    (cx, cy, cz), (sx, sy, sz) = zip(*((math.cos(t), math.sin(t)) for t in (ax, ay, az)), strict=True)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def _axis_angle(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues: R = cos θ·1 + sin θ·[u]× + (1 − cos θ)·uuᵀ."""
    u = unit(axis)
    if u is None:
        raise ValueError("an axis of rotation cannot be 0")
    x, y, z = u.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    versine = 2 * math.sin(angle / 2) ** 2  # 1 − cos θ without cancellation
    return np.eye(3) + math.sin(angle) * cross + versine * (cross @ cross)


def _quaternion(q: Quaternion) -> np.ndarray:
    n = unit(np.array([q.x, q.y, q.z, q.w], dtype=np.float64))
    if n is None:
        raise ValueError("a quaternion cannot be 0")
    x, y, z, w = n.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
