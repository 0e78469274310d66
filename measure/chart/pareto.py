"""The Pareto front of time and error, and its knee."""

from __future__ import annotations

import math
from collections.abc import Sequence

LEAST = 3  # points of a front with a knee


def front(times: Sequence[float], errors: Sequence[float]) -> tuple[int, ...]:
    """Indices of the Pareto-optimal points, fastest first; of equal points the first."""
    order = sorted(range(len(times)), key=lambda i: (times[i], errors[i], i))
    best, rows = math.inf, []
    for i in order:
        if errors[i] < best:
            best = errors[i]
            rows.append(i)
    return tuple(rows)


def knee(front: Sequence[int], times: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> int | None:
    """The knee of a front: the point farthest below the line from its first to its last point, on logarithmic axes.

    Errors below `floor`, the uncertainty of the reference, count as `floor`. Both axes are scaled to the front's extent (Satopää et al.
    2011, "Finding a kneedle in a haystack"). None for fewer than three points or a front without a bend.
    """
    usable = [i for i in front if times[i] > 0 and max(errors[i], floor) > 0]
    if len(usable) < LEAST:
        return None
    x = [math.log(times[i]) for i in usable]
    y = [math.log(max(errors[i], floor)) for i in usable]
    wide, high = x[-1] - x[0], y[0] - y[-1]
    if wide <= 0.0 or high <= 0.0:
        return None
    below = [1.0 - (a - x[0]) / wide - (b - y[-1]) / high for a, b in zip(x, y, strict=True)]
    deepest = max(range(len(below)), key=below.__getitem__)
    return usable[deepest] if below[deepest] > 1e-9 else None
