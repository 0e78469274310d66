"""Which of the measured points are worth taking: the Pareto front of time and error, and its knee."""

from __future__ import annotations

import math
from collections.abc import Sequence

LEAST = 3  # points of a front that can have a knee


def front(times: Sequence[float], errors: Sequence[float]) -> tuple[int, ...]:
    """The points that no other beats: none is quicker without a larger error. Quickest first; of equals the first."""
    order = sorted(range(len(times)), key=lambda i: (times[i], errors[i], i))
    best, found = math.inf, []
    for i in order:
        if errors[i] < best:
            best = errors[i]
            found.append(i)
    return tuple(found)


def knee(front: Sequence[int], times: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> int | None:
    """The point of a front after which more time buys least: farthest below the line from its first to its last, on logarithmic axes.

    Errors below `floor`, the reference's own, count as it. Both axes are scaled to the front's extent (Satopää et al. 2011, "Finding a
    kneedle in a haystack"). None where the front has fewer than three points or no bend.
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
