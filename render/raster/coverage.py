"""Three ways to tell which samples a polygon covers, on 24.8 fixed-point numbers, all exact and all the same samples.

Vertices and samples are int64 multiples of 1/256 pixel, y down. Coordinates stay below 2²⁸ (2²⁰ pixels, see raster_setup's
guard band), so products of two differences stay below 2⁶⁰. The rule for samples on an outline, shared by all three: an edge
owns its samples if the inside is to its right (left edge) or, when level, below it (top edge). Every sample of a
polygon's inner edges then belongs to exactly one of its triangles, and neighbours neither overlap nor leave gaps.

edges      one half-plane test an edge (Pineda, A Parallel Algorithm for Polygon Rasterization, 1988). It is the course's
           a x - y + b > 0 with the slope multiplied out: nothing is divided, so upright edges are like any others.
areas      signed areas of the triangles from the sample to two corners each: inside when all have one sign. The course's
           equality S1 + S2 + S3 = S is the same thing without the signs, and fails in floating point.
scanline   crossings of a level line with all edges, sorted; inside after an odd number. Edges are half open in y, so that
           a corner is crossed once and a level edge never. It takes any polygon: concave, with holes.
"""

from __future__ import annotations

from ..jit.kernel import helper

ONE = 256  # fixed-point units a pixel
HALF = 128
EDGES, AREAS, SCANLINE = 0, 1, 2
NAMES = {"edges": EDGES, "areas": AREAS, "scanline": SCANLINE}


@helper
def doubled_area(ax: int, ay: int, bx: int, by: int, cx: int, cy: int) -> int:
    """Twice the signed area of a triangle; positive when a, b, c go clockwise on the screen (y down)."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@helper
def owns(dx: int, dy: int) -> bool:
    """Whether an edge in direction (dx, dy) of a polygon going clockwise on the screen owns the samples on it: top or left."""
    return dy < 0 or (dy == 0 and dx > 0)


@helper
def inside_edges(ax: int, ay: int, bx: int, by: int, cx: int, cy: int, px: int, py: int) -> bool:
    """Whether the sample (px, py) is covered, by the half-planes of the three edges. The triangle goes clockwise on the screen."""
    ab = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    bc = (cx - bx) * (py - by) - (cy - by) * (px - bx)
    ca = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
    if ab < 0 or bc < 0 or ca < 0:
        return False
    on_ab = ab > 0 or owns(bx - ax, by - ay)
    on_bc = bc > 0 or owns(cx - bx, cy - by)
    return on_ab and on_bc and (ca > 0 or owns(ax - cx, ay - cy))


@helper
def inside_areas(ax: int, ay: int, bx: int, by: int, cx: int, cy: int, px: int, py: int) -> bool:
    """Whether the sample is covered, by the signs of the three areas it makes with the corners. Clockwise, as above."""
    a = doubled_area(px, py, bx, by, cx, cy)
    b = doubled_area(ax, ay, px, py, cx, cy)
    c = doubled_area(ax, ay, bx, by, px, py)
    if min(a, min(b, c)) < 0:
        return False
    return (a > 0 or owns(cx - bx, cy - by)) and (b > 0 or owns(ax - cx, ay - cy)) and (c > 0 or owns(bx - ax, by - ay))


@helper
def crossings(loop_x, loop_y, first: int, count: int, y: int, out, found: int) -> int:
    """Add the x of each crossing of the level line y with a closed loop to the sorted list out[:found]; returns the new length.

    An x is rounded up to the next fixed-point unit, exactly: a sample px is right of or on the crossing iff px >= that number.
    """
    for start in range(first, first + count):
        end = start + 1 if start + 1 < first + count else first
        y0, y1 = loop_y[start], loop_y[end]
        if (y0 <= y) == (y1 <= y):  # half open: the upper end belongs to an edge, the lower does not
            continue
        x0, x1 = loop_x[start], loop_x[end]
        x = x0 - ((y - y0) * (x0 - x1)) // (y1 - y0)  # -(-a // b) is a / b rounded up
        place = found
        while place > 0 and out[place - 1] > x:  # insertion: lists are short and nearly sorted from line to line
            out[place] = out[place - 1]
            place -= 1
        out[place] = x
        found += 1
    return found


@helper
def inside_crossings(sorted_x, found: int, px: int) -> bool:
    """Whether a sample is inside by the even-odd rule: an odd number of crossings at or left of it."""
    passed = 0
    while passed < found and sorted_x[passed] <= px:
        passed += 1
    return passed % 2 == 1
