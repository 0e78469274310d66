"""Affine transforms of points, vectors and normals: rows of (n, 3, 4) matrices, or their twelve numbers row by row."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..types import Lane, Vec


@helper
def load12(matrix: Any, i: Lane) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]:
    """Load row i of (n, 3, 4) matrices as twelve numbers, row by row."""
    return (
        matrix[i, 0, 0], matrix[i, 0, 1], matrix[i, 0, 2], matrix[i, 0, 3], matrix[i, 1, 0], matrix[i, 1, 1], matrix[i, 1, 2],
        matrix[i, 1, 3], matrix[i, 2, 0], matrix[i, 2, 1], matrix[i, 2, 2], matrix[i, 2, 3],
    )  # fmt: skip


@helper
def transform_point12(m: Any, p: Vec) -> Vec:
    """Transform a point by a transform's twelve numbers."""
    return (
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3], m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
        m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
    )  # fmt: skip


@helper
def transform_vector12(m: Any, v: Vec) -> Vec:
    """Transform a direction by a transform's twelve numbers."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[4] * v[0] + m[5] * v[1] + m[6] * v[2], m[8] * v[0] + m[9] * v[1] + m[10] * v[2],
    )  # fmt: skip


@helper
def transform_normal12(inverse: Any, n: Vec) -> Vec:
    """Transform a normal by the transpose of the inverse's twelve numbers; the result is not normalized."""
    m = inverse
    return (
        m[0] * n[0] + m[4] * n[1] + m[8] * n[2], m[1] * n[0] + m[5] * n[1] + m[9] * n[2], m[2] * n[0] + m[6] * n[1] + m[10] * n[2],
    )  # fmt: skip


@helper
def transform_point(matrix: Any, i: Lane, p: Vec) -> Vec:
    """Transform a point by row i of (n, 3, 4) matrices."""
    return (
        matrix[i, 0, 0] * p[0] + matrix[i, 0, 1] * p[1] + matrix[i, 0, 2] * p[2] + matrix[i, 0, 3],
        matrix[i, 1, 0] * p[0] + matrix[i, 1, 1] * p[1] + matrix[i, 1, 2] * p[2] + matrix[i, 1, 3],
        matrix[i, 2, 0] * p[0] + matrix[i, 2, 1] * p[1] + matrix[i, 2, 2] * p[2] + matrix[i, 2, 3],
    )


@helper
def transform_vector(matrix: Any, i: Lane, v: Vec) -> Vec:
    """Transform a direction by row i of (n, 3, 4) matrices."""
    return (
        matrix[i, 0, 0] * v[0] + matrix[i, 0, 1] * v[1] + matrix[i, 0, 2] * v[2],
        matrix[i, 1, 0] * v[0] + matrix[i, 1, 1] * v[1] + matrix[i, 1, 2] * v[2],
        matrix[i, 2, 0] * v[0] + matrix[i, 2, 1] * v[1] + matrix[i, 2, 2] * v[2],
    )


@helper
def transform_normal(inverse: Any, i: Lane, n: Vec) -> Vec:
    """Transform a normal by the transpose of row i of the inverse matrices; the result is not normalized."""
    return (
        inverse[i, 0, 0] * n[0] + inverse[i, 1, 0] * n[1] + inverse[i, 2, 0] * n[2],
        inverse[i, 0, 1] * n[0] + inverse[i, 1, 1] * n[1] + inverse[i, 2, 1] * n[2],
        inverse[i, 0, 2] * n[0] + inverse[i, 1, 2] * n[1] + inverse[i, 2, 2] * n[2],
    )
