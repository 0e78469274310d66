"""Places the labels of a chart: near their anchors, clear of other labels, points and lines. Greedy, in pixels.

Imhof (1975, "Positioning names on maps"): a few candidate places around an anchor, in order of preference; the one with the least overlap
is used. Christensen, Marks and Shieber (1995): at our densities greedy placement is within a few labels of the optimum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

# Directions around an anchor in order of preference: right above, right, left above, right below, left, above, below, left below.
DIRECTIONS = ((1, 1), (1, 0), (-1, 1), (1, -1), (-1, 0), (0, 1), (0, -1), (-1, -1))
DISTANCES = (1.0, 1.8, 3.0, 4.5, 6.5, 9.0)  # times the gap
ON_LABEL, ON_POINT, ON_LINE = 30.0, 12.0, 3.0  # cost of a covered area or length, relative to the label's own
OUTSIDE = 1e6


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle: x0 < x1, y0 < y1."""

    x0: float
    y0: float
    x1: float
    y1: float

    def overlap_area(self, other: Box) -> float:
        """The area of the intersection with `other`."""
        wide = min(self.x1, other.x1) - max(self.x0, other.x0)
        high = min(self.y1, other.y1) - max(self.y0, other.y0)
        return max(wide, 0.0) * max(high, 0.0)

    def expand(self, by: float) -> Box:
        """The rectangle, larger by `by` on every side."""
        return Box(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def contains(self, other: Box) -> bool:
        """Whether `other` lies inside."""
        return self.x0 <= other.x0 and self.y0 <= other.y0 and other.x1 <= self.x1 and other.y1 <= self.y1

    def clipped_length(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """The length of the segment from a to b inside (Liang and Barsky 1984)."""
        first, last = 0.0, 1.0
        dx, dy = b[0] - a[0], b[1] - a[1]
        for delta, margin in ((-dx, a[0] - self.x0), (dx, self.x1 - a[0]), (-dy, a[1] - self.y0), (dy, self.y1 - a[1])):
            if delta == 0:
                if margin < 0:
                    return 0.0
            elif delta < 0:
                first = max(first, margin / delta)
            else:
                last = min(last, margin / delta)
        return max(last - first, 0.0) * math.hypot(dx, dy)


@dataclass(slots=True)
class LabelLayout:
    """Occupied parts of the drawing area `inside`: points, lines and placed labels."""

    inside: Box
    points: list[Box] = field(default_factory=list)
    lines: list[tuple[tuple[float, float], tuple[float, float]]] = field(default_factory=list)
    labels: list[Box] = field(default_factory=list)

    def cost(self, box: Box) -> float:
        """The cost of a label at `box`: 0 without overlap."""
        if not self.inside.contains(box):
            return OUTSIDE
        area, width = (box.x1 - box.x0) * (box.y1 - box.y0), box.x1 - box.x0
        labels = sum(box.expand(2).overlap_area(other) for other in self.labels) / area
        points = sum(box.overlap_area(other) for other in self.points) / area
        lines = sum(box.clipped_length(a, b) for a, b in self.lines) / width
        return ON_LABEL * labels + ON_POINT * points + ON_LINE * lines

    def place(
        self, size: tuple[float, float], anchors: Sequence[tuple[float, float]], gap: float, most: float = math.inf, reach: float = math.inf
    ) -> tuple[Box, tuple[float, float]] | None:
        """Place a label of `size` near one of `anchors`, in order of preference. Returns its box and anchor.

        `reach` limits the distance to the anchor. None if every place costs more than `most`.
        """
        best: tuple[float, Box, tuple[float, float]] | None = None
        for rank, anchor in enumerate(anchors):
            for preference, box in _candidates(anchor, size, gap, reach):
                cost = self.cost(box) + preference + 0.08 * rank
                if best is None or cost < best[0]:
                    best = (cost, box, anchor)
        if best is None or best[0] > most:
            return None
        self.labels.append(best[1])
        return best[1], best[2]


def _candidates(anchor: tuple[float, float], size: tuple[float, float], gap: float, reach: float) -> Iterator[tuple[float, Box]]:
    """Candidate boxes around an anchor, with small costs of distance and direction."""
    (x, y), (wide, high) = anchor, size
    for far, times in enumerate(DISTANCES):
        distance = gap * times
        if distance > reach:
            return
        for order, (sx, sy) in enumerate(DIRECTIONS):
            along = distance if 0 in (sx, sy) else distance * math.sqrt(0.5)
            x0 = x + sx * along - (wide if sx < 0 else wide / 2 if sx == 0 else 0.0)
            y0 = y + sy * along - (high if sy < 0 else high / 2 if sy == 0 else 0.0)
            yield 0.25 * far + 0.02 * order, Box(x0, y0, x0 + wide, y0 + high)
