"""Pictures that read another set of texture coordinates than their mesh's: the affine maps between two sets.

The IR has one set a mesh. Each triangle has an affine map from that set to any other. Faces with the same map are one part, whose pictures
of the other set get the map as their frame.
"""

from __future__ import annotations

import numpy as np

from ...ir import F64, I64

MOST_PARTS = 64
TOLERANCE = 1e-4  # of texture coordinates: a tenth of a texel of 1024
PLAIN = np.eye(3)


def split(uvs: F64, others: F64, counts: I64) -> list[tuple[I64, F64]] | None:
    """Groups of faces, each with the maps (k, 3, 3) from the mesh's own coordinates (c, 2) to the others (c, 2 k) at corners.

    `counts` (f,) are the corners of each face. None if more than MOST_PARTS maps are needed.
    """
    counts = np.asarray(counts, np.int64)
    firsts = np.cumsum(counts) - counts
    points = np.concatenate([uvs, np.ones((len(uvs), 1))], axis=1)
    face = np.repeat(np.arange(len(counts)), counts)
    bases, sizes = _bases(uvs, firsts, counts)
    waiting, groups = counts > 0, []
    while waiting.any():
        if len(groups) == MOST_PARTS:
            return None
        best = int(np.argmax(np.where(waiting, sizes, -1.0)))
        rows = bases[best]
        if sizes[best] > 0:
            linear = np.linalg.solve(points[rows], others[rows]).T
        else:  # the face has no area in its own set: its pictures have one colour
            linear = np.concatenate([np.zeros((others.shape[1], 2)), others[rows[:1]].T], axis=1)
        far = np.abs(points @ linear.T - others).max(axis=1) > TOLERANCE
        misfit = np.zeros(len(counts), bool)
        misfit[face[far]] = True
        fits = waiting & ~misfit
        fits[best] = True
        waiting &= ~fits
        maps = np.tile(PLAIN, (others.shape[1] // 2, 1, 1))
        maps[:, :2] = linear.reshape(-1, 2, 3)
        groups.append((np.flatnonzero(fits), maps))
    return groups


def _bases(uvs: F64, firsts: I64, counts: I64) -> tuple[I64, F64]:
    """Three corners of each face that span the most area in texture space (f, 3), of a fan, and that area (f,)."""
    bases = np.stack([firsts, np.minimum(firsts + 1, len(uvs) - 1), np.minimum(firsts + 2, len(uvs) - 1)], axis=1)
    sizes = np.full(len(firsts), -0.5)
    for k in range(1, int(counts.max(initial=0)) - 1):
        rows = np.flatnonzero(counts > k + 1)
        fan = np.stack([firsts[rows], firsts[rows] + k, firsts[rows] + k + 1], axis=1)
        (u1, v1), (u2, v2) = (uvs[fan[:, 1]] - uvs[fan[:, 0]]).T, (uvs[fan[:, 2]] - uvs[fan[:, 0]]).T
        area = np.abs(u1 * v2 - u2 * v1)
        area = np.where(area > 1e-12, area, 0.0)
        better = area > sizes[rows]
        bases[rows[better]], sizes[rows[better]] = fan[better], area[better]
    return bases, sizes
